//! The order of a file's rows in time. Times fall where a counter wraps, where a block begins, or where rows are
//! swapped.

use super::uneven::mean_of_most;

/// Times in the order in which samples were taken.
pub(super) struct Order {
    pub times: Vec<f64>,
    /// The rows in that order, if it is not that of the file.
    pub rows: Option<Vec<usize>>,
    /// What was changed, in words.
    pub remark: Option<String>,
}

/// Least size of a fall of times, in steps, at which they start again, and largest ratio of the step across a wrap to
/// the usual one, so that a few samples may be missing there.
const START: (f64, f64) = (2.0, 8.0);

/// Least number of steps in a counter's span.
const LEAST_SPAN: f64 = 64.0;

/// Seconds after which times of day start again.
const DAY_S: f64 = 86_400.0;

impl Order {
    /// Finds the order of `times`. Where they fall, either they start again, as counters and blocks do, or rows are not
    /// in the order of their times. What leaves the more even steps counts.
    pub fn of(mut times: Vec<f64>) -> Self {
        let as_they_are = |times| Self {
            times,
            rows: None,
            remark: None,
        };
        if times.is_sorted() {
            return as_they_are(times);
        }
        let rises = times
            .windows(2)
            .map(|pair| pair[1] - pair[0])
            .filter(|step| *step >= 0.0);
        let usual = mean_of_most(rises.collect());
        // A single time that is out of place between two others tells nothing.
        let mut wrong = 0;
        for row in 1..times.len() - 1 {
            let (before, after) = (times[row - 1], times[row + 1]);
            let is_room = (1.5..3.0).contains(&((after - before) / usual));
            if is_room && !(before..=after).contains(&times[row]) {
                times[row] = f64::midpoint(before, after);
                wrong += 1;
            }
        }
        let uneven = |times: &[f64]| -> f64 {
            times
                .windows(2)
                .map(|pair| (pair[1] - pair[0]) / usual - 1.0)
                .map(|off| off.abs().min(LEAST_SPAN))
                .sum()
        };
        let (gone_on, starts, span) = gone_on(&times, usual);
        let sorted = |times: &[f64]| {
            let mut rows: Vec<usize> = (0..times.len()).collect();
            rows.sort_by(|one, other| times[*one].total_cmp(&times[*other]));
            (rows.iter().map(|&row| times[row]).collect::<Vec<f64>>(), rows)
        };
        let (by_time, on) = (sorted(&times), sorted(&gone_on));
        let is_restart = starts > 0 && uneven(&on.0) < uneven(&by_time.0);
        let (times, rows) = if is_restart { on } else { by_time };
        let moved = rows.iter().enumerate().filter(|(place, row)| place != *row).count();
        let told: Vec<String> = [
            is_restart.then(|| {
                let span = (1e9 * span).round() / 1e9;
                format!("its times start again after {span}, and are taken to go on")
            }),
            (moved > 0).then(|| format!("{moved} of its rows are put in the order of their times")),
            (wrong > 0).then(|| format!("{wrong} of its times, out of place between their neighbours, are not used")),
        ]
        .into_iter()
        .flatten()
        .collect();
        Self {
            times,
            rows: (moved > 0).then_some(rows),
            remark: (!told.is_empty()).then(|| told.join("; ")),
        }
    }
}

/// Returns `times` that go on where they start again, how often they do, and after what. The span of a counter is a
/// power of two, in its unit or a thousandth, millionth or billionth of it; that of the time of day is a day. Times
/// that start again after anything else go on with the `usual` step.
fn gone_on(times: &[f64], usual: f64) -> (Vec<f64>, usize, f64) {
    let (least, most) = START;
    let fall = |row: usize| times[row - 1] - times[row];
    let starts: Vec<usize> = (1..times.len()).filter(|&row| fall(row) > least * usual).collect();
    let counters = [1.0, 1e3, 1e6, 1e9]
        .into_iter()
        .flat_map(|unit| (8..=64).map(move |bits| 2f64.powi(bits) / unit));
    let goes_on = |span: &f64| {
        let steps = starts.iter().map(|&row| (span - fall(row)) / usual);
        *span > LEAST_SPAN * usual && steps.clone().all(|step| (0.0..=most).contains(&step))
            // Where it starts again, a counter does not wait each time.
            && steps.fold(f64::INFINITY, f64::min) < if starts.len() > 1 { least } else { most }
    };
    // Times that always start from the same one are those of blocks.
    let are_blocks = starts.len() > 1
        && starts
            .iter()
            .all(|&row| times[row].total_cmp(&times[starts[0]]).is_eq());
    let span = counters.chain([DAY_S]).find(|span| !are_blocks && goes_on(span));
    let (mut offset, mut after) = (0.0, 0.0);
    let gone_on = (0..times.len()).map(|row| {
        if row > 0 && fall(row) > least * usual {
            after = span.unwrap_or(fall(row) + usual);
            offset += after;
        }
        times[row] + offset
    });
    (gone_on.collect(), starts.len(), after)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]

        /// A counter of any width, signed or not, whose unit may have been divided; blocks whose times begin at 0.
        #[test]
        fn times_that_start_again_go_on(
            bits in 16i32..=48, unit in prop::sample::select(vec![1.0, 1e6]), is_signed: bool, blocks: bool,
            begin in 0.0..1.0f64, step in 1u64..400, lost in 0usize..3000,
        ) {
            let span = 2f64.powi(bits);
            let place = |row: usize| (row + if row > lost && !blocks { 2 } else { 0 }) as f64;
            let counted: Vec<f64> = (0..3000).map(|row| (begin * span).floor() + step as f64 * place(row)).collect();
            let written: Vec<f64> = counted.iter().enumerate().map(|(row, count)| match (blocks, is_signed) {
                (true, _) => (row % 250) as f64 * step as f64 / 1e6,
                (_, true) => ((count + span / 2.0) % span - span / 2.0) / unit,
                (_, false) => count % span / unit,
            }).collect();
            let has_wrapped = !written.is_sorted();
            let Order { times, rows, remark } = Order::of(written);
            prop_assert_eq!((rows, remark.is_some()), (None, has_wrapped));
            let unit = if blocks { 1e6 } else { unit };
            for row in 1..3000 {
                let expected = step as f64 * (place(row) - place(row - 1)) / unit;
                prop_assert!((times[row] - times[row - 1] - expected).abs() < 1e-3 * step as f64 / unit, "{}", row);
            }
        }
    }
}
