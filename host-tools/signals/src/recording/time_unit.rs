//! Units of a column of times, determined from its name, an option, or the rates that a recording can have.

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
}
