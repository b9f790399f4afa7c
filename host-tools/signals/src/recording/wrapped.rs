//! Times from a counter that wraps to 0, as in microcontrollers.

use super::uneven::Steps;

/// Numbers of bits of counters: Arduino's `micros()`, which wraps after 71.6 minutes, or a timer's register.
const COUNTER_BITS: [i32; 2] = [16, 32];

/// Largest ratio of the step across a wrap to the usual step, so that a few samples may be missing there.
const LARGEST_STEP: f64 = 8.0;

/// Makes `times` continue where their counter wraps, and returns a remark about it. Other times stay the same.
pub(super) fn unwrap(times: &mut [f64]) -> Option<String> {
    if times.len() < 3 || times.windows(2).all(|pair| pair[1] >= pair[0]) {
        return None;
    }
    let usual = Steps::of(times).usual_s;
    let find = |span: &f64| {
        // A counter's times are whole numbers below its range.
        let are_counts = times
            .iter()
            .all(|time| time.fract() == 0.0 && (0.0..*span).contains(time));
        let goes_on = |pair: &[f64]| {
            let step = pair[1] - pair[0];
            step >= 0.0 || (0.0..=LARGEST_STEP * usual).contains(&(step + span))
        };
        are_counts && times.windows(2).all(goes_on)
    };
    let spans = COUNTER_BITS.map(|bits| 2f64.powi(bits));
    let span = spans.into_iter().find(find)?;
    let (mut before, mut starts) = (times[0], 0);
    for time in times {
        starts += u32::from(*time < before);
        before = *time;
        *time += f64::from(starts) * span;
    }
    Some(format!(
        "its times start again after {span}, and are taken to go on"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_counter_that_starts_again_goes_on(
            begin in 0u64..1 << 32, step in 1u64..20_000, rows in 3usize..4000, lost in 0usize..4000,
            bits in prop::sample::select(vec![16, 32]),
        ) {
            let place = |row: usize| row as u64 + if row > lost { 2 } else { 0 };
            // A counter that wraps within a few steps does not distinguish them.
            let step = step.min((1 << bits) / 16);
            let expected: Vec<f64> = (0..rows).map(|row| (begin % (1 << bits) + place(row) * step) as f64).collect();
            let mut times: Vec<f64> = expected.iter().map(|time| time % f64::from(bits).exp2()).collect();
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
