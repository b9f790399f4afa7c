//! Times that are written as text: times of day, with or without dates (ISO 8601), and MATLAB's durations.

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
