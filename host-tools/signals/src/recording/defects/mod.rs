//! Defects of a recording that are visible only at the file's own sample rate, because resampling smears them.
//!
//! Measures of an axis that are used to find several defects are computed once, in [`Axis`].
//!
//! Invariant: samples in, findings out; times are in seconds from the first sample. Nothing here decides on a
//! recording; triage does.

mod bursts;
mod clipping;
mod holds_and_spikes;

pub use bursts::Burst;
pub use clipping::Clip;
pub use holds_and_spikes::{Hold, Spike};
use holds_and_spikes::{REACH, holds, spikes};
use stylus_dsp::sums::{extremes, steps, variance};
use stylus_dsp::wide;

use super::times::TimeUnit;

/// Declared and actual length of a file that ends early.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Truncation {
    /// Frames that the header declares.
    pub declared: u64,
    /// Frames that the file contains.
    pub held: u64,
}

/// Samples that are missing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gap {
    /// Start, s.
    pub start_s: f64,
    /// Duration, s.
    pub seconds: f64,
}

/// Faults in the times of a file's samples.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Timing {
    /// The unit that was assumed for the times, because it gives a rate that a recording can have.
    pub guessed_unit: Option<TimeUnit>,
    /// Number of rows that were removed because they repeat other rows.
    pub joined_rows: usize,
    /// Number of single samples that were missing and were interpolated; 0 if they are more than 1 % and count as gaps.
    pub lost: usize,
    /// Number of samples, including those that were missing; may be 0 if none are missing.
    pub samples: usize,
    /// Gaps, in order of time.
    pub gaps: Vec<Gap>,
    /// Usual number of samples in a bunch, if the times come in bunches.
    pub bunch: Option<usize>,
}

/// Findings at the file's own rate.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Defects {
    /// Fraction of clipped samples on the worst axis.
    pub clipped_share: f64,
    /// Fraction of samples at tops that were clipped before a filter, on the worst axis.
    pub rounded_share: f64,
    /// Stretches of clipped samples, of all axes.
    pub clips: Vec<Clip>,
    /// Stretches in which the value does not change, of all axes, in order of time.
    pub holds: Vec<Hold>,
    /// Single samples that deviate strongly from their neighbours, of all axes, in order of time.
    pub spikes: Vec<Spike>,
    /// Corrupted samples on one axis that are none of the above, in order of the axes.
    pub bursts: Vec<Burst>,
    /// The rate at which a sensor's values were read, Hz, if it was above the sensor's own rate, so that values are
    /// held.
    pub read_at_hz: Option<f64>,
    /// Ratio of the signal's power to the round-off power of its steps, on the best axis, dB; infinity for a constant.
    pub quantisation_snr_db: f64,
    /// Lengths, if the file ends before the length that its header states.
    pub truncation: Option<Truncation>,
    /// Faults in the times.
    pub timing: Timing,
}

impl Defects {
    /// Finds the defects of `axes`, finite samples at `rate_hz`.
    pub fn of(axes: &[Vec<f64>], rate_hz: f64) -> Self {
        let axes: Vec<Axis<'_>> = axes.iter().map(|axis| Axis::of(axis)).collect();
        let mut holds: Vec<Hold> = axes.iter().flat_map(|axis| holds(axis, rate_hz)).collect();
        holds.sort_by(|a, b| a.start_s.total_cmp(&b.start_s));
        // A gap of the converter occurs on all axes.
        holds.dedup_by(|next, first| first.joins(next));
        let mut spikes: Vec<Spike> = axes.iter().flat_map(|axis| spikes(axis, rate_hz)).collect();
        spikes.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
        // Spikes on several axes at once are one.
        spikes.dedup_by(|next, first| next.time_s - first.time_s < REACH as f64 / rate_hz);
        let clips: Vec<Clip> = axes.iter().flat_map(|axis| clipping::clips(axis, rate_hz)).collect();
        let mut bursts = bursts::bursts(&axes, rate_hz);
        // Clipped peaks, holds and spikes are unpredictable, too.
        bursts.retain(|burst| {
            let reach_s = REACH as f64 / rate_hz;
            let overlaps = |start_s: f64, seconds: f64| {
                start_s < burst.start_s + burst.seconds + reach_s && burst.start_s < start_s + seconds + reach_s
            };
            !clips.iter().any(|clip| overlaps(clip.start_s, clip.seconds))
                && !holds.iter().any(|hold| overlaps(hold.start_s, hold.seconds))
                && !spikes.iter().any(|spike| overlaps(spike.time_s, 0.0))
        });
        Self {
            clipped_share: clipping::clipped_share(&axes),
            rounded_share: clipping::rounded_share(&axes),
            clips,
            holds,
            spikes,
            bursts,
            read_at_hz: None,
            quantisation_snr_db: axes.iter().map(snr_db).fold(f64::NEG_INFINITY, f64::max),
            truncation: None,
            timing: Timing::default(),
        }
    }
}

/// Number of samples that are measured in parallel, in vector registers.
const LANES: usize = 8;

/// Number of samples per block. A block is searched for samples at a limit only if it contains some.
const BLOCK: usize = 64;

/// The samples of an axis, all finite, with their measures.
pub(super) struct Axis<'a> {
    /// The samples.
    pub samples: &'a [f64],
    /// Lowest sample; `f64::MAX` if there are no samples.
    pub low: f64,
    /// Highest sample; `f64::MIN` if there are no samples.
    pub high: f64,
    /// Difference up to which two samples count as equal at a limit, because round-off from a gain or an offset makes a
    /// clipped top not exactly flat.
    pub tolerance: f64,
    /// Indices, ascending, of the samples that are within the tolerance of the lowest or the highest. They may be
    /// nearly all, so that they are kept in 32 bits, which hold the length of any recording.
    pub at_limits: Vec<u32>,
    /// Smallest step between neighbours that is not zero; infinity if there is none.
    pub least_step: f64,
    /// Number of pairs of neighbours that are not equal.
    pub changes: usize,
    /// RMS about the mean.
    pub deviation: f64,
}

impl<'a> Axis<'a> {
    /// Measures `samples`.
    pub fn of(samples: &'a [f64]) -> Self {
        let (low, high) = extremes(samples);
        let (least_step, _) = steps(samples);
        let tolerance = 1e-6 * (high - low);
        Self {
            samples,
            low,
            high,
            tolerance,
            at_limits: beyond(samples, low + tolerance, high - tolerance),
            least_step,
            changes: changes(samples),
            deviation: variance(samples).sqrt(),
        }
    }
}

/// Returns the indices, ascending, of the samples that are at most `low` or at least `high`.
fn beyond(samples: &[f64], low: f64, high: f64) -> Vec<u32> {
    let is_beyond = |x: f64| x <= low || x >= high;
    wide(
        #[inline(always)]
        || {
            let mut found = Vec::new();
            for (block, samples) in samples.chunks(BLOCK).enumerate() {
                let count: u64 = samples.iter().map(|&x| u64::from(is_beyond(x))).sum();
                if count > 0 {
                    let here = samples.iter().enumerate().filter(|(_, x)| is_beyond(**x));
                    found.extend(here.map(|(at, _)| (block * BLOCK + at) as u32));
                }
            }
            found
        },
    )
}

/// Returns the number of pairs of neighbours that are not equal.
fn changes(samples: &[f64]) -> usize {
    wide(
        #[inline(always)]
        || {
            samples
                .iter()
                .zip(samples.get(1..).unwrap_or_default())
                .map(|(before, after)| u64::from(before != after))
                .sum::<u64>() as usize
        },
    )
}

/// Returns a sixth of the magnitude of the fourth difference around each sample, except the first two and the last two.
pub(super) fn fourth_differences(samples: &[f64]) -> Vec<f64> {
    wide(
        #[inline(always)]
        || samples.windows(5).map(|w| fourth_difference(w) / 6.0).collect(),
    )
}

/// Returns the largest of [`fourth_differences`]; 0 if there are none.
pub(super) fn largest_fourth_difference(samples: &[f64]) -> f64 {
    wide(
        #[inline(always)]
        || {
            let mut most = [0.0; LANES];
            let mut rest = samples;
            while let Some(here) = rest.first_chunk::<{ LANES + 4 }>() {
                for (lane, most) in most.iter_mut().enumerate() {
                    let difference = fourth_difference(&here[lane..lane + 5]);
                    *most = if difference > *most { difference } else { *most };
                }
                rest = &rest[LANES..];
            }
            let last = rest.windows(5).map(fourth_difference);
            most.into_iter().chain(last).fold(0.0, f64::max) / 6.0
        },
    )
}

#[inline(always)]
fn fourth_difference(w: &[f64]) -> f64 {
    (w[0] - 4.0 * w[1] + 6.0 * w[2] - 4.0 * w[3] + w[4]).abs()
}

/// Returns the ratio, in dB, of the power of `axis` about its mean to the round-off power of its steps, which is a
/// twelfth of the squared step; infinity for a constant.
pub(super) fn snr_db(axis: &Axis<'_>) -> f64 {
    let step = axis.least_step;
    if step.is_finite() {
        20.0 * (axis.deviation * 12f64.sqrt() / step).log10()
    } else {
        f64::INFINITY
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use test_helpers::near;

    use super::*;

    proptest! {
        /// Reference: loops over the single samples.
        #[test]
        fn measures_are_those_of_their_definitions(
            values in prop::collection::vec(prop_oneof![-1e3f64..1e3, Just(1e3), Just(-1e3), Just(0.0)], 0..300),
        ) {
            let axis = Axis::of(&values);
            let at_limit = |x: f64| x >= axis.high - axis.tolerance || x <= axis.low + axis.tolerance;
            let places: Vec<u32> = (0..values.len()).filter(|&at| at_limit(values[at])).map(|at| at as u32).collect();
            prop_assert_eq!(&axis.at_limits, &places);
            let changes = values.windows(2).filter(|pair| pair[0] != pair[1]).count();
            prop_assert_eq!(axis.changes, changes);
            let differences: Vec<f64> = values
                .windows(5)
                .map(|w| (w[0] - 4.0 * w[1] + 6.0 * w[2] - 4.0 * w[3] + w[4]).abs() / 6.0)
                .collect();
            prop_assert_eq!(&fourth_differences(&values), &differences);
            let largest = differences.into_iter().fold(0.0, f64::max);
            prop_assert_eq!(largest_fourth_difference(&values), largest);
        }
    }

    #[test]
    fn steps_of_a_tenth_of_the_level_are_thirty_decibels_below_it() {
        let wave = (0..5000).map(|n| (2f64.sqrt() * (0.1237 * f64::from(n)).sin() * 10.0).round() / 10.0);
        let snr = snr_db(&Axis::of(&wave.collect::<Vec<_>>()));
        near(snr, 30.8, 0.3);
        assert_eq!(snr_db(&Axis::of(&[2.0; 100])), f64::INFINITY);
    }
}
