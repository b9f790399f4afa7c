//! A column of times: its unit, determined from its name, an option, or the rates that a recording can have; and times
//! that are written as text: times of day, with or without dates (ISO 8601), and MATLAB's durations.

use serde::{Deserialize, Serialize};

use super::rate::RATES_HZ;

/// A unit of times.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum TimeUnit {
    /// Seconds.
    S,
    /// Milliseconds.
    Ms,
    /// Microseconds.
    Us,
    /// Nanoseconds.
    Ns,
}

/// Words for a time in a column's name.
const TIMES: [&str; 9] = [
    "time",
    "times",
    "t",
    "ts",
    "timestamp",
    "timestamps",
    "stamp",
    "elapsed",
    "zeit",
];

/// Largest relative deviation of a given rate from that of the times at which it still determines their unit.
const NEAR_RATE: f64 = 0.2;

impl TimeUnit {
    const ALL: [Self; 4] = [Self::S, Self::Ms, Self::Us, Self::Ns];

    /// Name of the unit, as users give it on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Self::S => "s",
            Self::Ms => "ms",
            Self::Us => "us",
            Self::Ns => "ns",
        }
    }

    /// Number of these units per second.
    pub fn per_second(self) -> f64 {
        match self {
            Self::S => 1.0,
            Self::Ms => 1e3,
            Self::Us => 1e6,
            Self::Ns => 1e9,
        }
    }

    /// Returns the unit for which a word stands.
    fn of_word(word: &str) -> Option<Self> {
        match word {
            "s" | "sec" | "secs" | "second" | "seconds" => Some(Self::S),
            "ms" | "msec" | "millis" | "millisecond" | "milliseconds" => Some(Self::Ms),
            "us" | "µs" | "μs" | "usec" | "micros" | "microsecond" | "microseconds" => Some(Self::Us),
            "ns" | "nsec" | "nanos" | "nanosecond" | "nanoseconds" => Some(Self::Ns),
            _ => None,
        }
    }

    /// Returns the unit of times whose steps are `mean` and `usual` in this unit. It is the unit in which one of the
    /// steps gives `rate_hz`. If no rate is given, it is the largest unit in which both steps, or else one, give a rate
    /// that a recording can have.
    pub(super) fn of_steps(mean: f64, usual: f64, rate_hz: Option<f64>) -> Option<Self> {
        let is_right = |rate: f64| match rate_hz {
            Some(asked) => (rate / asked - 1.0).abs() < NEAR_RATE,
            None => RATES_HZ.contains(&rate),
        };
        let makes = |step: f64, unit: Self| is_right(unit.per_second() / step);
        let find = |of: &dyn Fn(Self) -> bool| Self::ALL.into_iter().find(|unit| of(*unit));
        find(&|unit| makes(mean, unit) && makes(usual, unit))
            .or_else(|| find(&|unit| makes(mean, unit)))
            .or_else(|| find(&|unit| makes(usual, unit)))
    }
}

/// A column of times.
pub(crate) struct TimeColumn {
    /// Index of the column in the table.
    pub index: usize,
    /// Name of the column.
    pub name: String,
    /// Unit of the times, if the column's name states it.
    pub unit: Option<TimeUnit>,
}

impl TimeColumn {
    /// Returns the column with this `index` and `name`, if it is a column of times.
    ///
    /// Every word of such a name stands for a time or its unit, as in `Time [ms]`, `timestamp_us` or `timeMs`.
    pub fn named(index: usize, name: &str) -> Option<Self> {
        let lower = name.to_lowercase();
        let words: Vec<&str> = lower
            .split(|c: char| !c.is_alphanumeric())
            .filter(|word| !word.is_empty())
            .collect();
        let (mut unit, mut is_time) = (None, false);
        for word in words {
            let joined = || {
                let mut rests = TIMES.iter().filter_map(|time| word.strip_prefix(time));
                rests.find_map(TimeUnit::of_word)
            };
            if TIMES.contains(&word) {
                is_time = true;
            } else if let Some(own) = TimeUnit::of_word(word) {
                // A single letter may mean anything.
                is_time |= own != TimeUnit::S || word.len() > 1;
                unit = Some(own);
            } else {
                unit = Some(joined()?);
                is_time = true;
            }
        }
        let name = name.to_owned();
        is_time.then_some(Self { index, name, unit })
    }

    /// Returns the one of `columns`, which ascend, that has this index.
    pub fn of(columns: &[Self], index: usize) -> Option<&Self> {
        let place = columns.binary_search_by_key(&index, |column| column.index);
        columns.get(place.ok()?)
    }

    /// Returns the column that determines the rate: the first with a unit, or otherwise the first.
    pub fn best(columns: &[Self]) -> Option<&Self> {
        columns.iter().find(|column| column.unit.is_some()).or(columns.first())
    }
}

/// Seconds per day.
const DAY_S: f64 = 86_400.0;

/// Returns the seconds of a time such as `12:34:56.789`, `2026-01-31T12:34:56.789Z` or `0.25 sec`. They are counted
/// since midnight or since 1970, or are those of the duration. Returns `None` for any other text.
///
/// An offset from UTC is ignored, because all times of a file have the same offset.
pub(super) fn seconds(field: &str) -> Option<f64> {
    if let Some(duration) = field.strip_suffix("sec") {
        return number(duration.trim_end());
    }
    let (date, time) = field.split_once(['T', ' ']).unwrap_or(("", field));
    let (hours, rest) = time.split_once(':')?;
    let (minutes, rest) = rest.split_once(':')?;
    // After the seconds there may be Z, or an offset with its sign.
    let end = rest.find(['Z', '+', '-']).unwrap_or(rest.len());
    let days = if date.is_empty() { 0.0 } else { days(date)? };
    let [hours, minutes] = [whole(hours, 24)?, whole(minutes, 60)?];
    // A minute with a leap second has 61 seconds.
    let seconds = number(&rest[..end]).filter(|seconds| (0.0..61.0).contains(seconds))?;
    Some(days * DAY_S + f64::from(60 * (60 * hours + minutes)) + seconds)
}

/// Parses a whole number below `end` that consists only of digits.
fn whole(text: &str, end: u32) -> Option<u32> {
    let is_digits = text.bytes().all(|byte| byte.is_ascii_digit());
    text.parse().ok().filter(|value| is_digits && *value < end)
}

/// Parses a number with a decimal point or a decimal comma.
fn number(text: &str) -> Option<f64> {
    let is_plain = text.starts_with(|first: char| first.is_ascii_digit());
    text.replacen(',', ".", 1).parse().ok().filter(|_| is_plain)
}

/// Returns the days from 1970-01-01 to a date whose year comes first, in the Gregorian calendar.
///
/// Years begin in March here, so that a leap day is the last day of its year.
fn days(date: &str) -> Option<f64> {
    let mut parts = date.split(['-', '/']);
    let year = parts.next().filter(|year| year.len() == 4)?;
    let (year, month, day) = (
        whole(year, 10_000)?,
        whole(parts.next()?, 13)?,
        whole(parts.next()?, 32)?,
    );
    if parts.next().is_some() || month == 0 || day == 0 {
        return None;
    }
    let from_march = (month + 9) % 12;
    let year = i64::from(year) - i64::from(month < 3);
    let leaps = year / 4 - year / 100 + year / 400;
    // From March on, months have 31, 30, 31, 30, 31 days, and then the same again.
    let before_month = i64::from((153 * from_march + 2) / 5);
    let since_march_of_0 = 365 * year + leaps + before_month + i64::from(day) - 1;
    // 1970-01-01 is day 719 468.
    Some((since_march_of_0 - 719_468) as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_columns_name_tells_that_it_is_a_time_and_its_unit() {
        let (s, ms, us, ns) = (TimeUnit::S, TimeUnit::Ms, TimeUnit::Us, TimeUnit::Ns);
        for (name, expected) in [
            ("time_s", Some(Some(s))),
            ("Time (s)", Some(Some(s))),
            ("seconds_elapsed", Some(Some(s))),
            ("t_ms", Some(Some(ms))),
            ("Time [ms]", Some(Some(ms))),
            ("timeMs", Some(Some(ms))),
            ("millis", Some(Some(ms))),
            ("timestamp_us", Some(Some(us))),
            ("Time(µs)", Some(Some(us))),
            ("timestamp (ns)", Some(Some(ns))),
            ("t", Some(None)),
            ("%time", Some(None)),
            ("Zeit", Some(None)),
            ("time_stamp", Some(None)),
            ("x", None),
            ("s", None),
            ("speed", None),
            ("x_ms2", None),
            ("time since start", None),
            ("tilt", None),
            ("", None),
        ] {
            let found = TimeColumn::named(0, name);
            assert_eq!(found.map(|column| column.unit), expected, "{name}");
        }
    }

    #[test]
    fn steps_tell_the_unit_by_the_rate_that_they_make() {
        for (step, rate_hz, expected) in [
            (2e-4, None, Some(TimeUnit::S)),
            (0.2, None, Some(TimeUnit::Ms)),
            (1.0, None, Some(TimeUnit::Ms)),
            (200.0, None, Some(TimeUnit::Us)),
            (2e5, None, Some(TimeUnit::Ns)),
            (2.0, Some(480_000.0), Some(TimeUnit::Us)),
            (2.0, Some(500.0), Some(TimeUnit::Ms)),
            (2.0, Some(5000.0), None),
            (1e9, None, None),
            (0.0, None, None),
            (f64::NAN, None, None),
        ] {
            assert_eq!(TimeUnit::of_steps(step, step, rate_hz), expected, "{step} {rate_hz:?}");
        }
        // A queue that is read at once has a short usual step, or a step of zero.
        assert_eq!(TimeUnit::of_steps(0.5, 0.005, None), Some(TimeUnit::Ms));
        assert_eq!(TimeUnit::of_steps(0.2, 0.0, None), Some(TimeUnit::Ms));
    }

    /// Reference: `date -u -d … +%s` of GNU coreutils.
    #[test]
    fn times_are_those_of_the_systems_calendar() {
        for (text, expected) in [
            ("1970-01-01T00:00:00Z", 0.0),
            ("2000-02-29 23:59:59.5", 951_868_799.5),
            ("2026/11/28T02:30:00.25+01:00", 1_795_833_000.25),
            ("2100-03-01 00:00:00", 4_107_542_400.0),
            ("00:00:01,5", 1.5),
            ("9:05:07", 32_707.0),
            ("0.0002 sec", 2e-4),
        ] {
            assert_eq!(seconds(text), Some(expected), "{text}");
        }
    }

    #[test]
    fn other_texts_are_no_times() {
        for text in [
            "",
            ":",
            "::",
            "sec",
            " sec",
            "-1 sec",
            "12:00",
            "25:00:00",
            "12:60:00",
            "12:00:61",
            "12:00:-1",
            "1/2/2026 12:00:00",
            "2026-13-01T00:00:00",
            "2026-00-01T00:00:00",
            "2026-01-01",
            "12:00:00 PM",
            "12:00:00 AM",
            "é:00:00",
            "NaN sec",
        ] {
            assert_eq!(seconds(text), None, "{text}");
        }
    }
}
