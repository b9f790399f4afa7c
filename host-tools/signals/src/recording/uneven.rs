//! Converts samples at uneven times to even times.

/// Number of samples around a time from which its value is interpolated: a polynomial of the fifth degree passes
/// through them. For a tone at an eighth of the sample rate, the error is 0.1 %.
const POINTS: usize = 6;

/// Largest number of steps from which the usual step and the unevenness are determined. More would only take more
/// memory.
const MOST_STEPS: usize = 4096;

/// Largest unevenness of steps that are meant to be even, as a fraction of the usual step; and largest deviation from
/// even times, as a fraction of a step, at which samples are not moved.
pub(super) const EVEN: f64 = 0.05;

/// Largest deviation of a single step from the usual step, as a fraction of it, for steps that are meant to be even.
const LARGEST_DEVIATION: f64 = 0.5;

/// Largest deviation of an uneven step, relative to the usual unevenness, and largest ratio of any step to the usual
/// step.
const LARGEST_STEP: (f64, f64) = (4.0, 8.0);

/// The steps of a file's times.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Steps {
    /// Median of the steps, in the unit of the times.
    pub usual_s: f64,
    /// Relative deviation from the median that nine of ten steps do not exceed.
    pub unevenness: f64,
}

impl Steps {
    /// Computes the steps of more than `width` times, in any unit, each over `width` samples.
    pub fn of(times: &[f64], width: usize) -> Self {
        let stride = times.len().div_ceil(MOST_STEPS);
        let mut steps: Vec<f64> = times
            .windows(width + 1)
            .step_by(stride)
            .map(|pair| pair[width] - pair[0])
            .collect();
        let quantile = |share: f64, steps: &mut [f64]| {
            let index = ((steps.len() as f64 * share) as usize).min(steps.len() - 1);
            *steps.select_nth_unstable_by(index, f64::total_cmp).1
        };
        let usual_s = quantile(0.5, &mut steps);
        for step in &mut steps {
            *step = (*step / usual_s - 1.0).abs();
        }
        let unevenness = quantile(0.9, &mut steps);
        Self { usual_s, unevenness }
    }

    /// Returns whether `step_s`, in the unit of the times, is possible for even steps.
    fn hold_even(&self, step_s: f64) -> bool {
        // The comparison is false for a NaN.
        step_s > 0.0 && (step_s / self.usual_s - 1.0).abs() <= LARGEST_DEVIATION
    }

    /// Returns whether `step_s` can be an ordinary step of these times. It is then neither a gap nor a step back, nor,
    /// if the times are even, much shorter than the usual step.
    pub fn hold(&self, step_s: f64) -> bool {
        if self.unevenness < EVEN {
            return self.hold_even(step_s);
        }
        let ratio = step_s / self.usual_s;
        let (times, most) = LARGEST_STEP;
        let largest = 1.0 + (times * self.unevenness).max(LARGEST_DEVIATION);
        step_s > 0.0 && ratio <= largest.min(most)
    }
}

/// Number of the longest steps that are left out of a mean, because they may be pauses.
const PAUSES: usize = 8;

/// Returns the mean of the steps between `times`, without the few longest.
pub(super) fn mean_step(times: &[f64]) -> f64 {
    mean_of_most(times.windows(2).map(|pair| pair[1] - pair[0]).collect())
}

/// Returns the mean of `steps`, of which there is at least one, without the few longest.
pub(super) fn mean_of_most(mut steps: Vec<f64>) -> f64 {
    let kept = steps.len() - PAUSES.min(steps.len() / 16);
    steps.select_nth_unstable_by(kept - 1, f64::total_cmp);
    steps[..kept].iter().sum::<f64>() / kept as f64
}

/// Interpolates samples of `channels`, taken at ascending `times`, at every 1/`rate_hz` from the first time on. It is
/// exact for polynomials of the fifth degree (Lagrange's interpolation through the six nearest samples).
pub(super) fn evened(channels: &[Vec<f64>], times: &[f64], rate_hz: f64) -> Vec<Vec<f64>> {
    let (Some(first), Some(last)) = (times.first(), times.last()) else {
        return channels.to_vec();
    };
    // The small term prevents round-off of the product from losing the sample at the last time.
    let count = ((last - first) * rate_hz + 1e-6) as usize + 1;
    let points = POINTS.min(times.len());
    let mut evened = vec![Vec::with_capacity(count); channels.len()];
    let mut next = 0;
    for n in 0..count {
        let time = first + n as f64 / rate_hz;
        while next < times.len() && times[next] <= time {
            next += 1;
        }
        // Near an end, most points lie on one side of the time.
        let from = next.saturating_sub(points / 2).min(times.len() - points);
        let near = &times[from..from + points];
        let weights: Vec<f64> = (0..points)
            .map(|i| {
                (0..points)
                    .filter(|&j| j != i)
                    .map(|j| (time - near[j]) / (near[i] - near[j]))
                    .product()
            })
            .collect();
        for (evened, channel) in evened.iter_mut().zip(channels) {
            let values = &channel[from..from + points];
            evened.push(weights.iter().zip(values).map(|(w, x)| w * x).sum());
        }
    }
    evened
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Steps of 0.13 and 0.21 ms, like those of an accelerometer that is read in turn with other sensors.
        #[test]
        fn a_tone_at_uneven_times_comes_out_as_at_even_ones(
            hz in 20.0..1000.0f64,
            long in prop::collection::vec(prop::bool::ANY, 4000),
        ) {
            let mut time = 3.0;
            let times: Vec<f64> = long
                .iter()
                .map(|is_long| {
                    time += if *is_long { 0.000_13 } else { 0.000_21 } * 0.68;
                    time
                })
                .collect();
            let steps = Steps::of(&times, 1);
            prop_assert!(times.windows(2).all(|pair| steps.hold(pair[1] - pair[0])));
            prop_assert!(!steps.hold(9.0 * steps.usual_s) && !steps.hold(0.0));
            let tone = |time: f64| (core::f64::consts::TAU * hz * (time - 3.0)).sin();
            let channel: Vec<f64> = times.iter().map(|&t| tone(t)).collect();
            let there = evened(&[channel], &times, 8600.0).remove(0);
            prop_assert!((there.len() as f64 / 8600.0 - (times[3999] - times[0])).abs() < 1e-3);
            for (n, x) in there.iter().enumerate().skip(3).take(there.len() - 6) {
                let error = x - tone(times[0] + n as f64 / 8600.0);
                prop_assert!(error.abs() < 0.01, "{} {} {}", hz, n, error);
            }
        }
    }
}
