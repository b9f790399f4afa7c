//! Columns of times: evenly spaced, or told where they are not.

use crate::support::csv_table::CsvTable;
use crate::support::error::{Error, Result};

/// Largest deviation of a step from the usual step, as a share of it.
const UNEVENNESS: f64 = 0.5;

/// Most steps of which the usual one is the median: as many tell it, and no more memory is taken.
const MOST_STEPS: usize = 4096;

/// Returns the sample rate of the times in `column` of `table`, one per row below its header, in Hz.
///
/// # Errors
/// Fewer than two times; a time that does not rise, or a gap, with its line.
pub(super) fn rate_of(table: &CsvTable, column: &str, times: &[f64]) -> Result<f64> {
    let path = table.path();
    let (Some(first), Some(last)) = (times.first(), times.last()) else {
        return Err(Error::file(path, "holds no samples"));
    };
    if times.len() == 1 {
        let problem = "holds one sample, whose time tells no sample rate: record for longer";
        return Err(Error::file(path, problem));
    }
    let usual = usual_step(times);
    let uneven = |pair: &[f64]| {
        let step = pair[1] - pair[0];
        // Not a number is no step.
        !(step > 0.0 && (step / usual - 1.0).abs() <= UNEVENNESS)
    };
    if let Some(index) = times.windows(2).position(uneven) {
        let problem = step_fault(column, times[index], times[index + 1], usual);
        return Err(Error::line(path, table.line_of_row(index + 2), problem));
    }
    let step = (last - first) / (times.len() - 1) as f64;
    if !step.is_finite() {
        let problem = format!("its column '{column}' does not hold seconds");
        return Err(Error::file(path, problem));
    }
    Ok(1.0 / step)
}

/// The problem of a step from `before` to `time`, s, where steps are `usual`, in words.
fn step_fault(column: &str, before: f64, time: f64, usual: f64) -> String {
    let step = time - before;
    if step > 0.0 && step.is_finite() && usual > 0.0 {
        let (kind, remedy) = if step > usual {
            (
                "a gap",
                "times must rise in even steps; cut the file there, or record it again",
            )
        } else {
            ("a short step", "resample it to even steps first")
        };
        format!(
            "{column} is {time} after {before}: {kind} of {step:.6} s where lines are {usual:.6} s apart; {remedy}"
        )
    } else if step == 0.0 {
        format!(
            "{column} is {time} as in the line before: write times with more digits, or remove the line"
        )
    } else {
        format!(
            "{column} is {time} after {before}: times must rise in even steps; cut the file there"
        )
    }
}

/// Median of the steps, or of as many as tell it, s.
fn usual_step(times: &[f64]) -> f64 {
    let stride = times.len().div_ceil(MOST_STEPS);
    let mut steps: Vec<f64> = times
        .windows(2)
        .step_by(stride)
        .map(|pair| pair[1] - pair[0])
        .collect();
    let middle = steps.len() / 2;
    *steps.select_nth_unstable_by(middle, f64::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::path::Path;

    fn rate(times: &[f64]) -> Result<f64> {
        let mut text = String::from("# x\ntime_s,x\n");
        for time in times {
            text += &format!("{time},1\n");
        }
        let table = CsvTable::of(Path::new("a.csv"), text);
        rate_of(&table, "time_s", times)
    }

    proptest! {
        #[test]
        fn a_gap_and_a_step_back_are_named_with_their_line(
            at in 1usize..999, step_s in 1e-5..0.1f64, share in prop::sample::select(vec![-40.0, -1.0, 0.6, 30.0, 0.0]),
        ) {
            let mut times: Vec<f64> = (0..1000).map(|n| step_s * f64::from(n)).collect();
            prop_assert!((rate(&times).unwrap() * step_s - 1.0).abs() < 1e-6);
            // A step of zero is a line that repeats its time.
            let off = if share == 0.0 { -step_s } else { share * step_s };
            times[at..].iter_mut().for_each(|time| *time += off);
            if share == 0.0 {
                times[at] = times[at - 1];
            }
            let message = rate(&times).unwrap_err().to_string();
            let words = [(-40.0, "must rise"), (-1.0, ""), (0.6, "a gap"), (30.0, "a gap"), (0.0, "")];
            let word = words.iter().find(|(of, _)| *of == share).map_or("", |(_, word)| word);
            prop_assert!(message.contains(&format!("line {}:", at + 3)), "{}", message);
            prop_assert!(message.contains(word), "{}", message);
        }
    }

    #[test]
    fn times_that_tell_no_rate_are_refused() {
        for times in [
            &[][..],
            &[1.0],
            &[0.0, 0.0, 0.0],
            &[0.0, f64::NAN],
            &[0.0, f64::INFINITY],
        ] {
            assert!(rate(times).is_err(), "{times:?}");
        }
        let message = rate(&[0.0, 0.001, 0.001, 0.002]).unwrap_err().to_string();
        assert!(
            message.contains("line 5") && message.contains("more digits"),
            "{message}"
        );
    }
}
