//! Times that start again at 0: those of a counter, as in microcontrollers, and times of day at midnight.

use super::uneven::Steps;

/// Numbers of bits of counters: Arduino's `micros()`, which wraps after 71.6 minutes, or a timer's register.
const COUNTER_BITS: [i32; 2] = [16, 32];

/// Seconds after which times of day start again.
const DAY_S: f64 = 86_400.0;

/// Largest ratio of the step across a wrap to the usual step, so that a few samples may be missing there.
const LARGEST_STEP: f64 = 8.0;

/// Makes `times` continue where they start again, and returns a remark about it. Other times stay the same.
pub(super) fn unwrap(times: &mut [f64]) -> Option<String> {
    if times.len() < 3 || times.windows(2).all(|pair| pair[1] >= pair[0]) {
        return None;
    }
    let usual = Steps::of(times).usual_s;
    let find = |span: &f64| {
        // A counter's times are whole numbers.
        let is_in_span = |time: &f64| (0.0..*span).contains(time) && (*span == DAY_S || time.fract() == 0.0);
        let goes_on = |pair: &[f64]| {
            let step = pair[1] - pair[0];
            step >= 0.0 || (0.0..=LARGEST_STEP * usual).contains(&(step + span))
        };
        times.iter().all(is_in_span) && times.windows(2).all(goes_on)
    };
    let spans = COUNTER_BITS.map(|bits| 2f64.powi(bits));
    let span = spans.into_iter().chain([DAY_S]).find(find)?;
    let (mut before, mut starts) = (times[0], 0);
    for time in times {
        starts += u32::from(*time < before);
        before = *time;
        *time += f64::from(starts) * span;
    }
    Some(format!("its times start again after {span}, and are taken to go on"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn times_that_start_again_go_on(
            begin in 0u64..1 << 32, step in 1u64..20_000, rows in 3usize..4000, lost in 0usize..4000,
            span in prop::sample::select(vec![1 << 16, 1 << 32, 86_400]),
        ) {
            let place = |row: usize| row as u64 + if row > lost { 2 } else { 0 };
            // A counter that wraps within a few steps does not distinguish them.
            let step = step.min(span / 16);
            let expected: Vec<f64> = (0..rows).map(|row| (begin % span + place(row) * step) as f64).collect();
            let mut times: Vec<f64> = expected.iter().map(|time| time % span as f64).collect();
            let has_wrapped = times != expected;
            prop_assert_eq!(unwrap(&mut times).is_some(), has_wrapped);
            prop_assert_eq!(times, expected);
        }
    }

    #[test]
    fn times_that_fall_otherwise_stay() {
        for times in [
            &[0.0, 200.0, 400.0, 0.0, 200.0][..],
            &[65_000.0, 65_200.0, 65_400.0, 30_000.0, 30_200.0],
            &[65_000.5, 65_200.5, 65_400.5, 64.5, 264.5],
            &[65_000.0, 65_200.0, 65_800.0, 264.0, 464.0],
            &[3.0, 2.0],
            &[],
        ] {
            let mut after = times.to_vec();
            assert_eq!(unwrap(&mut after), None);
            assert_eq!(after, times);
        }
    }
}
