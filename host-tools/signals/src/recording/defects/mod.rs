//! Defects of a recording that are visible only at the file's own sample rate, because resampling smears them.
//!
//! Invariant: samples in, findings out; times are in seconds from the first sample. Nothing here decides on a
//! recording; triage does.

mod axis;
mod bursts;
mod clipping;
mod holds;
mod spikes;

use super::time_unit::TimeUnit;
use axis::Axis;
pub use bursts::Burst;
pub use clipping::Clip;
pub use holds::Hold;
pub use spikes::Spike;

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
        let mut holds: Vec<Hold> = axes.iter().flat_map(|axis| holds::holds(axis, rate_hz)).collect();
        holds.sort_by(|a, b| a.start_s.total_cmp(&b.start_s));
        // A gap of the converter occurs on all axes.
        holds.dedup_by(|next, first| first.joins(next));
        let mut spikes: Vec<Spike> = axes.iter().flat_map(|axis| spikes::spikes(axis, rate_hz)).collect();
        spikes.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
        // Spikes on several axes at once are one.
        spikes.dedup_by(|next, first| next.time_s - first.time_s < spikes::REACH as f64 / rate_hz);
        let clips: Vec<Clip> = axes.iter().flat_map(|axis| clipping::clips(axis, rate_hz)).collect();
        let mut bursts = bursts::bursts(&axes, rate_hz);
        // Clipped peaks, holds and spikes are unpredictable, too.
        bursts.retain(|burst| {
            let reach_s = spikes::REACH as f64 / rate_hz;
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
            quantisation_snr_db: axes.iter().map(axis::snr_db).fold(f64::NEG_INFINITY, f64::max),
            truncation: None,
            timing: Timing::default(),
        }
    }
}
