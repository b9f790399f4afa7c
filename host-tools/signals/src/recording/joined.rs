//! Rows that repeat the last sample of a sensor, because they were written for a sample of another sensor.

use std::ops::Range;

use super::uneven::Steps;

/// Deviation of a step from the usual step, as a fraction of it, beyond which a sample is out of time.
const OFF: f64 = 0.2;

/// Returns the rows of `part` without the rows that were added when several sensors were joined; `None` if there are no
/// such rows. Rows count as added if they repeat all of `channels`, lie between the steps of the remaining rows, and
/// leave fewer than half as many uneven steps when they are removed.
///
/// A sample that equals the previous one and comes at its expected time is kept.
pub(super) fn own_rows(times: &[f64], channels: &[Vec<f64>], part: Range<usize>) -> Option<Vec<usize>> {
    let is_repeated = |row: &usize| *row > part.start && channels.iter().all(|axis| axis[*row] == axis[*row - 1]);
    let changed: Vec<usize> = part.clone().filter(|row| !is_repeated(row)).collect();
    if changed.len() == part.len() || changed.len() < 2 {
        return None;
    }
    let gathered = |rows: &[usize]| rows.iter().map(|&row| times[row]).collect::<Vec<f64>>();
    let step = Steps::of(&gathered(&changed), 1).usual_s;
    let mut rows: Vec<usize> = Vec::with_capacity(changed.len());
    let mut next = 0;
    for row in part.clone() {
        if changed.get(next) == Some(&row) {
            next += 1;
            rows.push(row);
            continue;
        }
        // A repetition is a sample if it is due, and if the next sample does not follow too soon.
        let since = rows.last().map_or(0.0, |&last| times[row] - times[last]);
        let until = changed.get(next).map_or(f64::INFINITY, |&at| times[at] - times[row]);
        if (since / step - 1.0).abs() <= OFF && until >= (1.0 - OFF) * step {
            rows.push(row);
        }
    }
    let is_joined = rows.len() < part.len() && 2 * off(&gathered(&rows)) < off(&times[part]);
    is_joined.then_some(rows)
}

/// Returns the number of steps that deviate from the usual step.
fn off(times: &[f64]) -> usize {
    let usual_s = Steps::of(times, 1).usual_s;
    let is_off = |pair: &&[f64]| ((pair[1] - pair[0]) / usual_s - 1.0).abs() > OFF;
    times.windows(2).filter(is_off).count()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use test_helpers::noise;

    proptest! {
        /// A sensor at 1 kHz, whose samples may equal the previous one, joined with other sensors at their own times.
        #[test]
        fn rows_of_other_sensors_are_taken_out_and_equal_samples_stay(
            period_ms in 2.0..40.0f64, offset_ms in 0.05..0.95f64, coarse: bool, jitter in 0.0..0.05f64,
        ) {
            let own: Vec<f64> = noise(1, 3000).iter().map(|x| if coarse { (8.0 * x).round() } else { *x }).collect();
            let shifts = noise(2, 3000);
            let mut rows: Vec<(f64, usize, bool)> = (0..3000)
                .map(|n| (n as f64 + jitter * shifts[n].clamp(-1.0, 1.0), n, true))
                .collect();
            let others = (1..).map(|k| f64::from(k) * period_ms + offset_ms).take_while(|t| *t < 2999.0);
            let last = rows.clone();
            rows.extend(others.map(|time| (time, last.partition_point(|row| row.0 <= time) - 1, false)));
            rows.sort_by(|a, b| a.0.total_cmp(&b.0));
            let times: Vec<f64> = rows.iter().map(|row| row.0 * 1e-3).collect();
            let values: Vec<f64> = rows.iter().map(|row| own[row.1]).collect();
            let found = own_rows(&times, &[values], 0..rows.len()).expect("joined");
            let expected: Vec<usize> = (0..rows.len()).filter(|&row| rows[row].2).collect();
            let wrong = found.len().abs_diff(expected.len());
            prop_assert!(wrong <= 3000 / 50, "{} {} of {}", wrong, found.len(), expected.len());
            if !coarse {
                prop_assert_eq!(found, expected);
            }
        }
    }

    #[test]
    fn equal_neighbours_in_even_steps_are_samples() {
        let times: Vec<f64> = (0..2000).map(|n| f64::from(n) * 1e-3).collect();
        let coarse: Vec<f64> = noise(3, 2000).iter().map(|x| x.round()).collect();
        assert_eq!(own_rows(&times, &[coarse], 0..2000), None);
        assert_eq!(own_rows(&times, &[vec![0.0; 2000]], 0..2000), None);
        assert_eq!(own_rows(&[], &[vec![]], 0..0), None);
    }
}
