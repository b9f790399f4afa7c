//! Verdicts on trials: each has a name, and one line with the numbers and the remedy.

use std::fmt;
use std::ops::Range;

use model_format::SAMPLE_RATE_HZ;
use serde::{Deserialize, Serialize, Serializer};
use stylus_support::number::counted;

/// Range of samples at 5 kHz, from the start of the trial. The end is not included.
pub type Span = Range<usize>;

/// Declares [`Kind`] from one row per kind: its meaning, its name, and its remedy in the imperative.
macro_rules! kinds {
    ($($(#[$meaning:meta])* $kind:ident: $name:literal, $remedy:expr;)*) => {
        /// A kind of verdict.
        #[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
        pub enum Kind {
            $($(#[$meaning])* $kind,)*
        }

        impl Kind {
            /// Names of all kinds, as users write them on the command line.
            pub const NAMES: &[&str] = &[$($name),*];

            /// Returns the name and the remedy.
            fn words(self) -> (&'static str, &'static str) {
                match self {
                    $(Self::$kind => ($name, $remedy),)*
                }
            }
        }
    };
}

kinds! {
    /// No signal, apart from a constant.
    Silent: "silent", "check contact, cable and scale_m_s2, unless it is meant to be silent";
    /// Too few samples for a good model.
    TooShort: "too-short", "record at least 0.4 s, better 2 s";
    /// Samples at the limits of the range.
    Clipped: "clipped", "record again with less gain";
    /// Stretches of zeros, because samples were lost.
    Dropouts: "dropouts", "record again; check the link and the disk for lost blocks";
    /// Stretches of one value, because a converter stood still.
    Stuck: "stuck", "record again; check the converter and its clock";
    /// Single samples that deviate strongly from their neighbours.
    Spikes: "spikes", "check cable and connectors, or cut it out with start_s and duration_s";
    /// Corrupted samples on only one axis.
    Bursts: "bursts", "check cable, connectors and the sensor's driver: a queue that slips gives such samples";
    /// Held values: the actual sample rate is lower than the file states.
    Repeated: "repeated", "record at the sensor's own rate, or find the original file";
    /// Steps of the converter that are too coarse for the level.
    Coarse: "coarse", "record again with more gain, or export with more digits";
    /// A file that ends before the length that its header states.
    Truncated: "truncated", "copy or record it again";
    /// A part without a signal, in a trial that has a signal elsewhere.
    PartlySilent: "partly-silent", "right if the tool rested there; else record again in steady contact";
    /// One to three events with a large share of the energy.
    Tap: "tap", "cut it with start_s and duration_s, or record again in steady contact";
    /// A level in one part that differs from that of the rest.
    LevelChange: "level-change",
        "cut the steady part with start_s and duration_s, or record again at one speed and force";
    /// A linear trend under the vibration.
    Drifting: "drifting", "record again after the sensor has warmed up, or remove the trend";
    /// Slow motion under the vibration.
    Wandering: "wandering", "the motion of hand or rig: a fit filters it out, unless --high-pass is none";
    /// A spectral line at a mains frequency.
    Hum: "hum", "check ground and shield, and record again";
    /// A level that no texture has, because of wrong units or a wrong scale.
    Scale: "scale",
        "name the unit with --scale, such as g, mm/s^2 or g/256, or give scale_m_s2 in the list; a g is 9.80665 m/s²";
    /// An axis that measures nothing.
    DeadAxis: "dead-axis", "check its cable, or choose an axis with --reduce";
    /// A copy of an earlier trial, equal or scaled.
    Duplicate: "duplicate", "remove one of the two, or record it anew";
    /// A spectrum that deviates from those of both neighbours in speed.
    Unlike: "unlike", "check filter, sensor and gain of this recording, and record it again";
    /// A sample rate that is too low for what skin feels.
    WrongRate: "wrong-rate", "record at 5 kHz or more, as with a contact microphone";
    /// Times whose unit follows only from their steps.
    TimeUnit: "time-unit", "give --time-unit, or the unit in the column's name, such as time_ms";
    /// Rows of other sensors, which repeat the last sample.
    Joined: "joined", "export the accelerometer's rows alone";
    /// Times in bunches, because a queue was read.
    Bunches: "bunches", "give --even-times if samples are even, and the times are those of reading a queue";
}

/// A verdict on a trial.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Verdict {
    kind: Kind,
    finding: String,
    spans: Vec<Span>,
}

impl Verdict {
    /// Creates a verdict of this kind; `finding` states in words what was found.
    pub(super) fn new(kind: Kind, finding: impl Into<String>) -> Self {
        Self {
            kind,
            finding: finding.into(),
            spans: Vec::new(),
        }
    }

    /// Creates a verdict on parts of a trial; `name` states in words what was found there.
    pub(super) fn on(kind: Kind, name: &str, spans: Vec<Span>) -> Self {
        let seconds = |samples: usize| samples as f64 / f64::from(SAMPLE_RATE_HZ);
        let total: usize = spans.iter().map(ExactSizeIterator::len).sum();
        let finding = format!(
            "{name}: {}, {:.3} s in all, from {:.3} s",
            counted(spans.len(), "stretch"),
            seconds(total),
            seconds(spans.first().map_or(0, |span| span.start))
        );
        Self { kind, finding, spans }
    }

    /// Returns the same verdict with `words` appended to its finding.
    pub(super) fn with(mut self, words: &str) -> Self {
        self.finding.push_str(words);
        self
    }

    /// Returns the verdict on a trial without a signal. Its level depends on the reduction.
    pub fn silent() -> Self {
        Self::new(Kind::Silent, "silent")
    }

    /// Kind of the verdict.
    pub fn kind(&self) -> Kind {
        self.kind
    }

    /// Name of the verdict's kind, as users write it on the command line.
    pub fn name(&self) -> &'static str {
        self.kind.words().0
    }

    /// Size of the finding, larger for worse findings of a kind: the number of samples that the verdict would leave
    /// out, or else a number in its words, negative where less is worse; 0 for kinds whose words have no size.
    pub fn size(&self) -> f64 {
        let is_of_number = |c: char| c.is_ascii_digit() || c == '.';
        let mut numbers = self
            .finding
            .split(|c| !is_of_number(c))
            .filter_map(|word| word.parse().ok());
        let first = numbers.next().unwrap_or(0.0);
        match self.kind {
            _ if !self.spans.is_empty() => self.spans.iter().map(ExactSizeIterator::len).sum::<usize>() as f64,
            // Fewer samples, a lower rate, and a smaller ratio of the signal to its steps are worse.
            Kind::TooShort | Kind::Truncated | Kind::WrongRate | Kind::Repeated | Kind::Coarse => -first,
            // The first number is the axis. A constant axis has no second one.
            Kind::DeadAxis => numbers.next().unwrap_or(f64::INFINITY),
            // The first two numbers are deviations, of either sign.
            Kind::Unlike => numbers.next().unwrap_or(0.0).max(first),
            // The number is the original's, or a frequency.
            Kind::Duplicate | Kind::Hum => 0.0,
            _ => first,
        }
    }

    /// Parts of the trial that the verdict would leave out of a fit.
    pub fn spans(&self) -> &[Span] {
        &self.spans
    }
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}; {}", self.finding, self.kind.words().1)
    }
}

/// Serialises verdicts as lines of text.
pub fn in_words<S: Serializer>(verdicts: &[Verdict], serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_seq(verdicts.iter().map(ToString::to_string))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_worse_of_two_findings_has_the_larger_size() {
        for (kind, better, worse) in [
            (
                Kind::Coarse,
                "coarse: its steps are 18 dB below it",
                "coarse: its steps are 9 dB below it",
            ),
            (
                Kind::DeadAxis,
                "dead axis 3: 61 dB below the strongest",
                "dead axis 1: 80 dB below the strongest",
            ),
            (
                Kind::DeadAxis,
                "dead axis 3: 61 dB below the strongest",
                "dead axis 1: constant",
            ),
            (
                Kind::Repeated,
                "repeated: values of 2000 Hz held at 5000 Hz",
                "repeated: values of 400 Hz held at 5000 Hz",
            ),
            (
                Kind::Unlike,
                "spectrum: -5 to +12 dB off, from 90 to 700 Hz",
                "spectrum: -13 to -2 dB off, from 20 to 80 Hz",
            ),
            (Kind::Drifting, "drifting: 6 % of energy", "drifting: 30 % of energy"),
        ] {
            let size = |words: &str| Verdict::new(kind, words).size();
            assert!(size(better) < size(worse), "{worse}");
        }
        let hum = |hz: &str| Verdict::new(Kind::Hum, format!("hum at {hz} Hz")).size();
        assert_eq!(hum("50.0"), hum("180.0"));
    }
}
