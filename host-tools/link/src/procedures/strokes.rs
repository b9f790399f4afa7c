//! Recordings of a free hand: the record stream with the speed and force at each sample, as input of
//! [`stylus_signals::recording::freehand`].

use std::fmt::Write;
use std::path::Path;

use model_format::Provenance;
use model_format::link::RecordSample;
use stylus_support::atomic_file;

use crate::link::Device;
use crate::link::Result;
use crate::link::capture::{Calibration, Loss, Stream};

/// Window over which the encoder's counts are averaged, s. A slow hand moves the encoder by less than one count per
/// sample at 5 kHz.
const SPEED_WINDOW_S: f64 = 0.02;

/// Strokes of a free hand, tick by tick.
#[derive(Clone, Debug, PartialEq)]
pub struct Strokes {
    /// One sample per tick; `None` where it was lost or torn.
    pub samples: Vec<Option<RecordSample>>,
    /// Sample rate, Hz.
    pub rate_hz: u32,
    /// Losses of the recording.
    pub loss: Loss,
}

/// Records for `seconds`, or until `goes_on` returns false. Lost and torn samples leave a hole of their length.
///
/// After each block, `heard` is called with all samples so far, the number of samples that the recording will have, and
/// the sample rate in Hz.
///
/// # Errors
/// A lost link, a recording that another program has stopped, more samples than a recording can have, or no block
/// within the timeout of an answer.
pub fn record(
    device: &Device,
    seconds: f64,
    mut goes_on: impl FnMut() -> bool,
    mut heard: impl FnMut(&[Option<RecordSample>], usize, u32),
) -> Result<Strokes> {
    let mut stream = Stream::start(device)?;
    let rate_hz = stream.rate_hz();
    let wanted = stream.samples_in(seconds)?.max(1);
    let mut samples = Vec::new();
    let mut start = None;
    while samples.len() < wanted && goes_on() {
        let arrival = stream.wait()?;
        let start = *start.get_or_insert(arrival.first_tick);
        let offset = arrival.first_tick.saturating_sub(start) as usize;
        // Ticks that did not arrive become samples without a value, so that each sample stays at its time.
        samples.resize(offset.clamp(samples.len(), wanted), None);
        let rows = arrival.samples.into_iter().zip(arrival.whole);
        samples.extend(rows.map(|(sample, whole)| whole.then_some(sample)));
        samples.truncate(wanted);
        heard(&samples, wanted, rate_hz);
    }
    let loss = stream.stop()?;
    Ok(Strokes { samples, rate_hz, loss })
}

impl Strokes {
    /// Returns the tangential speed at each sample, in mm/s, from the encoder's counts in a window of 20 ms around it.
    /// The speed is 0 where the whole window was lost.
    pub fn speeds_mm_s(&self, calibration: &Calibration) -> Vec<f64> {
        let half = (0.5 * SPEED_WINDOW_S * f64::from(self.rate_hz)) as usize;
        // Sums up to each sample make each window two subtractions, whatever its length.
        let mut path = vec![0i64];
        let mut known = vec![0usize];
        for sample in &self.samples {
            let count = sample.map_or(0, |s| i64::from(s.encoder_delta));
            path.push(path.last().copied().unwrap_or(0) + count);
            known.push(known.last().copied().unwrap_or(0) + usize::from(sample.is_some()));
        }
        (0..self.samples.len())
            .map(|n| {
                let (first, end) = (n.saturating_sub(half), (n + half + 1).min(self.samples.len()));
                let counts = (path[end] - path[first]) as f64;
                // Only samples that arrived count, because the counts of lost ones are missing, too.
                let seconds = (known[end] - known[first]).max(1) as f64 / f64::from(self.rate_hz);
                counts * calibration.mm_per_count / seconds
            })
            .collect()
    }

    /// Writes a CSV file for [`stylus_signals::recording::freehand::read`]: `time_s`, three axes in m/s², `speed_mm_s`,
    /// `force_n`. A lost sample is written as not a number, so that no stretch includes it.
    pub fn write(&self, path: &Path, calibration: &Calibration, provenance: Provenance) -> stylus_support::Result<()> {
        let mut text = match provenance {
            Provenance::Simulated => String::from("# SIMULATED\n"),
            Provenance::Recorded | Provenance::Unscaled => String::new(),
        };
        text.push_str("time_s,x_m_s2,y_m_s2,z_m_s2,speed_mm_s,force_n\n");
        let speeds = self.speeds_mm_s(calibration);
        for (n, (sample, speed)) in self.samples.iter().zip(speeds).enumerate() {
            let time = n as f64 / f64::from(self.rate_hz);
            let written = match sample {
                Some(sample) => {
                    let [x, y, z] = calibration.acceleration(sample);
                    let force = calibration.force(sample);
                    // A tick is a whole number of microseconds, so six digits are exact.
                    writeln!(text, "{time:.6},{x:.5},{y:.5},{z:.5},{speed:.3},{force:.4}")
                }
                None => writeln!(text, "{time:.6},nan,nan,nan,nan,nan"),
            };
            written.expect("a string takes whatever is written");
        }
        atomic_file::write(path, text.as_bytes())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use model_format::AdcCode;
    use test_helpers::{near, new_file};

    const CALIBRATION: Calibration = Calibration {
        acceleration_zero: [32_768.0; 3],
        m_s2_per_code: [0.001; 3],
        force_zero: 0.0,
        n_per_code: 0.0001,
        mm_per_count: 0.01,
    };

    /// A hand at 45 mm/s: nine counts in ten ticks.
    fn strokes(lost: std::ops::Range<usize>) -> Strokes {
        let sample = |n: usize| RecordSample {
            acceleration: [AdcCode(32_768 + n as u16), AdcCode(32_768), AdcCode(32_668)],
            force: AdcCode(10_000),
            encoder_delta: i16::from(!n.is_multiple_of(10)),
        };
        Strokes {
            samples: (0..1000).map(|n| (!lost.contains(&n)).then(|| sample(n))).collect(),
            rate_hz: 5000,
            loss: Loss::default(),
        }
    }

    #[test]
    fn speeds_are_the_encoders_also_beside_a_hole() {
        for speed in strokes(400..450).speeds_mm_s(&CALIBRATION) {
            near(speed, 45.0, 1.0);
        }
    }

    #[test]
    fn what_is_written_is_read_and_holes_are_no_data() {
        let (_folder, path) = new_file("strokes.csv");
        strokes(400..450)
            .write(&path, &CALIBRATION, Provenance::Simulated)
            .unwrap();
        let read = stylus_signals::recording::freehand::read(&path, None, None).unwrap();
        assert!(read.is_simulated);
        assert_eq!((read.rate_hz, read.axes.len()), (5000.0, 3));
        for n in 0..1000 {
            let lost = (400..450).contains(&n);
            assert_eq!(read.is_outlier[n], lost, "sample {n}");
            if !lost {
                near(read.axes[0][n], 0.001 * n as f64, 1e-5);
                assert!((read.axes[2][n] + 0.1).abs() < 1e-5);
                near(read.force_n[n], 1.0, 1e-4);
            }
        }
    }
}
