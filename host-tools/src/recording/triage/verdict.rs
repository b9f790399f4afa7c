//! Verdicts, by name, and in one line with their numbers and the remedy.

use std::fmt;
use std::ops::Range;

use model_format::SAMPLE_RATE_HZ;
use serde::{Deserialize, Serialize, Serializer};

/// Frequency below which a vibration is motion of hand or rig, Hz; textures are played from there on.
pub const SLOW_HZ: f64 = 10.0;

/// Samples from the first to before the last, at 5 kHz, from the start of the trial.
pub type Span = Range<usize>;

/// A verdict on a trial.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub enum Verdict {
    /// No signal, apart from a constant.
    Silent,
    /// Too few samples for a good model.
    TooShort {
        /// Number of samples.
        samples: usize,
    },
    /// Samples at the limits of the range.
    Clipped {
        /// Share of clipped samples on the worst axis.
        share: f64,
    },
    /// Peaks that end at one value although the level varies: clipping before a filter, a resampling or a noise.
    ClippedBefore {
        /// Value at which the peaks end, m/s².
        level_m_s2: f64,
        /// Share of the 10 ms parts whose peak ends there.
        share: f64,
    },
    /// Jumps from one end of the range to the other.
    Overflow {
        /// Number of jumps.
        jumps: usize,
        /// Time of the first, s.
        first_s: f64,
    },
    /// Stretches of zeros: samples that were lost.
    Dropouts {
        /// Stretches.
        spans: Vec<Span>,
    },
    /// Stretches of one value: a converter that stood still.
    Stuck {
        /// Stretches.
        spans: Vec<Span>,
    },
    /// Single samples far off their neighbours.
    Spikes {
        /// Places.
        spans: Vec<Span>,
        /// Largest ratio to what is around, in fourth differences.
        ratio: f64,
    },
    /// Every value repeated: a lower sample rate than the file says.
    Repeated {
        /// Number of times.
        times: usize,
        /// Frequency up to which there is a signal, Hz.
        band_hz: f64,
    },
    /// Steps of the converter that are too coarse for the level.
    Coarse {
        /// Ratio of signal to round-off, dB.
        snr_db: f64,
    },
    /// A file that ends before its header says.
    Truncated {
        /// Frames that the header declares.
        declared: u64,
        /// Frames that the file holds.
        held: u64,
    },
    /// A part without a signal in a trial with one.
    PartlySilent {
        /// Parts without a signal.
        spans: Vec<Span>,
        /// Samples of the trial.
        samples: usize,
    },
    /// One to three events with a large share of the energy.
    Tap {
        /// Places.
        spans: Vec<Span>,
        /// Share of the trial's energy.
        share: f64,
        /// Ratio of the weakest of them to the next event, dB.
        above_db: f64,
    },
    /// Another level in one part than in the rest.
    LevelChange {
        /// Time of the step, s; `None` if the level changes steadily.
        at_s: Option<f64>,
        /// Change of the level, dB.
        change_db: f64,
    },
    /// A linear trend under the vibration.
    Drifting {
        /// Share of the trend in the energy of the worst axis.
        share: f64,
    },
    /// Slow motion under the vibration.
    Wandering {
        /// Share of the energy below [`SLOW_HZ`].
        share: f64,
    },
    /// A spectral line of the mains.
    Hum {
        /// Frequency of the line, Hz.
        frequency_hz: f64,
    },
    /// Nothing above a frequency below the one that the sample rate allows.
    EmptyBand {
        /// Frequency, Hz.
        above_hz: f64,
        /// Height of the edge, dB.
        edge_db: f64,
    },
    /// White, Gaussian and steady: the noise of a sensor without a signal.
    SensorNoise {
        /// RMS, m/s².
        rms_m_s2: f64,
    },
    /// A level that no texture has: wrong units, or a wrong scale.
    Scale(ScaleDoubt),
    /// An axis that measures nothing.
    DeadAxis {
        /// Number of the axis, from 1.
        axis: usize,
        /// Level below the strongest axis, dB; infinite for a constant.
        below_db: f64,
    },
    /// Two axes with the same signal.
    AlikeAxes {
        /// Numbers of the axes, from 1.
        axes: (usize, usize),
    },
    /// A copy of another trial, also one that is scaled.
    Duplicate {
        /// Index of the earlier trial.
        of: usize,
        /// Factor from that trial's samples to this one's.
        scale: f64,
    },
    /// A lower sample rate than that of the models.
    WrongRate {
        /// Sample rate of the file, Hz.
        rate_hz: f64,
    },
}

/// Reason to doubt a scale.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum ScaleDoubt {
    /// An RMS that no texture has, m/s².
    TooLarge(f64),
    /// A mean of one, which is gravity in units of itself.
    GravityOfOne,
    /// A level that differs from the median of the texture's trials, dB.
    UnlikeOthers(f64),
}

impl Verdict {
    /// Names of all verdicts, as users give them on the command line.
    pub const NAMES: [&str; 24] = [
        "silent",
        "too-short",
        "clipped",
        "clipped-before",
        "overflow",
        "dropouts",
        "stuck",
        "spikes",
        "repeated",
        "coarse",
        "truncated",
        "partly-silent",
        "tap",
        "level-change",
        "drifting",
        "wandering",
        "hum",
        "empty-band",
        "sensor-noise",
        "scale",
        "dead-axis",
        "alike-axes",
        "duplicate",
        "wrong-rate",
    ];

    /// Name of the verdict, as users give it on the command line.
    pub fn name(&self) -> &'static str {
        match self {
            Self::Silent => "silent",
            Self::TooShort { .. } => "too-short",
            Self::Clipped { .. } => "clipped",
            Self::ClippedBefore { .. } => "clipped-before",
            Self::Overflow { .. } => "overflow",
            Self::Dropouts { .. } => "dropouts",
            Self::Stuck { .. } => "stuck",
            Self::Spikes { .. } => "spikes",
            Self::Repeated { .. } => "repeated",
            Self::Coarse { .. } => "coarse",
            Self::Truncated { .. } => "truncated",
            Self::PartlySilent { .. } => "partly-silent",
            Self::Tap { .. } => "tap",
            Self::LevelChange { .. } => "level-change",
            Self::Drifting { .. } => "drifting",
            Self::Wandering { .. } => "wandering",
            Self::Hum { .. } => "hum",
            Self::EmptyBand { .. } => "empty-band",
            Self::SensorNoise { .. } => "sensor-noise",
            Self::Scale(_) => "scale",
            Self::DeadAxis { .. } => "dead-axis",
            Self::AlikeAxes { .. } => "alike-axes",
            Self::Duplicate { .. } => "duplicate",
            Self::WrongRate { .. } => "wrong-rate",
        }
    }

    /// Parts of the trial that it would leave out of a fit.
    pub fn spans(&self) -> &[Span] {
        match self {
            Self::Dropouts { spans }
            | Self::Stuck { spans }
            | Self::Spikes { spans, .. }
            | Self::Tap { spans, .. }
            | Self::PartlySilent { spans, .. } => spans,
            _ => &[],
        }
    }

    /// Remedy, in the imperative.
    pub fn remedy(&self) -> &'static str {
        match self {
            Self::Silent => "check contact, cable and scale_m_s2, unless it is meant to be silent",
            Self::TooShort { .. } => "record at least 0.4 s, better 2 s",
            Self::Clipped { .. } | Self::ClippedBefore { .. } | Self::Overflow { .. } => {
                "record again with less gain"
            }
            Self::Dropouts { .. } => "record again; check the link and the disk for lost blocks",
            Self::Stuck { .. } => "record again; check the converter and its clock",
            Self::Spikes { .. } => {
                "check cable and connectors, or cut it out with start_s and duration_s"
            }
            Self::Repeated { .. } => "find the original file, and give its rate as sample_rate_hz",
            Self::Coarse { .. } => "record again with more gain, or export with more digits",
            Self::Truncated { .. } => "copy or record it again",
            Self::PartlySilent { .. } | Self::Tap { .. } => {
                "cut it with start_s and duration_s, or record again in steady contact"
            }
            Self::LevelChange { .. } => {
                "cut the steady part with start_s and duration_s, or record again at one speed and force"
            }
            Self::Drifting { .. } => {
                "record again after the sensor has warmed up, or remove the trend"
            }
            Self::Wandering { .. } => "filter the motion of hand and rig out below 10 Hz",
            Self::Hum { .. } => "check ground and shield, and record again",
            Self::EmptyBand { .. } => {
                "find the original at its own rate; nothing is played above that frequency"
            }
            Self::SensorNoise { .. } => "check that the tool touched the surface, and scale_m_s2",
            Self::Scale(ScaleDoubt::GravityOfOne) => "give scale_m_s2 9.80665 if the file is in g",
            Self::Scale(_) => "check scale_m_s2: units of mm/s² or of g?",
            Self::DeadAxis { .. } => "check its cable, or choose an axis with --reduce",
            Self::AlikeAxes { .. } => {
                "keep one of them, or check the cables; both together are too loud"
            }
            Self::Duplicate { .. } => "remove one of the two, or record it anew",
            Self::WrongRate { .. } => "record at 5 kHz or more",
        }
    }
}

/// Writes number, total and place of stretches: `3 stretches, 0.012 s in all, from 0.400 s`.
fn write_spans(f: &mut fmt::Formatter<'_>, spans: &[Span]) -> fmt::Result {
    let seconds = |samples: usize| samples as f64 / f64::from(SAMPLE_RATE_HZ);
    let total: usize = spans.iter().map(ExactSizeIterator::len).sum();
    let first = spans.first().map_or(0, |span| span.start);
    let stretches = if spans.len() == 1 {
        "stretch"
    } else {
        "stretches"
    };
    write!(
        f,
        "{} {stretches}, {:.3} s in all, from {:.3} s",
        spans.len(),
        seconds(total),
        seconds(first)
    )
}

impl Verdict {
    /// Writes findings on samples and on the file.
    fn write_samples(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let per_cent = |share: f64| 100.0 * share;
        let seconds = |samples: usize| samples as f64 / f64::from(SAMPLE_RATE_HZ);
        match self {
            Self::Silent => f.write_str("silent"),
            Self::TooShort { samples } => write!(f, "too short: {samples} samples"),
            Self::Clipped { share } => write!(f, "clipped: {:.2} % of samples", per_cent(*share)),
            Self::ClippedBefore { level_m_s2, share } => write!(
                f,
                "clipped before it was filtered: the peaks of {:.0} % of its parts end at {level_m_s2:.3} m/s²",
                per_cent(*share)
            ),
            Self::Overflow { jumps, first_s } => {
                write!(
                    f,
                    "overflow: {jumps} jumps across the range, from {first_s:.3} s"
                )
            }
            Self::Dropouts { spans } => {
                f.write_str("dropouts: ")?;
                write_spans(f, spans)
            }
            Self::Stuck { spans } => {
                f.write_str("stuck: ")?;
                write_spans(f, spans)
            }
            Self::Spikes { spans, ratio } => write!(
                f,
                "spikes: {}, from {:.3} s, up to {ratio:.0} times what is around",
                spans.len(),
                spans
                    .first()
                    .map_or(0.0, |span| seconds(usize::midpoint(span.start, span.end)))
            ),
            Self::Repeated { times, band_hz } => {
                write!(
                    f,
                    "repeated: every value {times} times, nothing above {band_hz:.0} Hz"
                )
            }
            Self::Coarse { snr_db } => write!(f, "coarse: its steps are {snr_db:.0} dB below it"),
            Self::Truncated { declared, held } => {
                write!(f, "truncated: the file holds {held} of {declared} samples")
            }
            _ => self.write_signal(f),
        }
    }

    /// Writes findings on level, spectrum, axes and the set.
    fn write_signal(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let per_cent = |share: f64| 100.0 * share;
        let seconds = |samples: usize| samples as f64 / f64::from(SAMPLE_RATE_HZ);
        match self {
            Self::PartlySilent { spans, samples } => {
                f.write_str("partly silent: ")?;
                write_spans(f, spans)?;
                write!(f, ", of {:.3} s", seconds(*samples))
            }
            Self::Tap {
                spans,
                share,
                above_db,
            } => {
                f.write_str("tap: ")?;
                write_spans(f, spans)?;
                let share = per_cent(*share);
                write!(
                    f,
                    ", {share:.0} % of the energy, {above_db:.0} dB above the next event"
                )
            }
            Self::LevelChange {
                at_s: Some(at_s),
                change_db,
            } => {
                write!(f, "level change: {change_db:+.0} dB at {at_s:.2} s")
            }
            Self::LevelChange {
                at_s: None,
                change_db,
            } => {
                write!(f, "level change: {change_db:+.0} dB from beginning to end")
            }
            Self::Drifting { share } => write!(f, "drifting: {:.0} % of energy", per_cent(*share)),
            Self::Wandering { share } => {
                write!(
                    f,
                    "wandering: {:.0} % of energy below {} Hz",
                    per_cent(*share),
                    SLOW_HZ
                )
            }
            Self::Hum { frequency_hz } => write!(f, "hum at {frequency_hz:.1} Hz"),
            Self::EmptyBand { above_hz, edge_db } => {
                write!(
                    f,
                    "empty band: nothing above {above_hz:.0} Hz, behind an edge of {edge_db:.0} dB"
                )
            }
            Self::SensorNoise { rms_m_s2 } => {
                write!(
                    f,
                    "sensor noise alone: {rms_m_s2:.4} m/s², white and steady"
                )
            }
            Self::Scale(ScaleDoubt::TooLarge(rms)) => write!(f, "scale: an RMS of {rms:.0} m/s²"),
            Self::Scale(ScaleDoubt::GravityOfOne) => {
                f.write_str("scale: gravity is 1.00, as in units of g")
            }
            Self::Scale(ScaleDoubt::UnlikeOthers(db)) => {
                write!(
                    f,
                    "scale: {db:+.0} dB from the median of the texture's trials"
                )
            }
            Self::DeadAxis { axis, below_db } if below_db.is_finite() => {
                write!(f, "dead axis {axis}: {below_db:.0} dB below the strongest")
            }
            Self::DeadAxis { axis, .. } => write!(f, "dead axis {axis}: constant"),
            Self::AlikeAxes { axes: (a, b) } => {
                write!(f, "alike axes: {a} and {b} hold the same signal")
            }
            Self::Duplicate { of, scale } if (scale - 1.0).abs() > 1e-3 => {
                write!(f, "duplicate of trial {}, scaled by {scale:.3}", of + 1)
            }
            Self::Duplicate { of, .. } => write!(f, "duplicate of trial {}", of + 1),
            Self::WrongRate { rate_hz } => {
                write!(
                    f,
                    "wrong rate: {rate_hz} Hz, nothing above {} Hz",
                    rate_hz / 2.0
                )
            }
            _ => f.write_str(self.name()),
        }
    }
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.write_samples(f)?;
        write!(f, "; {}", self.remedy())
    }
}

/// Serialises verdicts as lines for a reader.
///
/// # Errors
/// Those of the serialiser.
pub fn in_words<S: Serializer>(verdicts: &[Verdict], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_seq(verdicts.iter().map(ToString::to_string))
}
