//! The measured response of an actuator: from a table, or from a recording of a sweep.

use std::f64::consts::TAU;
use std::path::{Path, PathBuf};

use realfft::RealFftPlanner;
use realfft::num_complex::Complex;

use crate::recording::{self, Trial};
use crate::support::bounded_file::{Limit, MIB};
use crate::support::csv_table::CsvTable;
use crate::support::error::{Error, Result};

/// A response: some frequencies with their levels.
const RESPONSE: Limit = Limit {
    of: "a response",
    bytes: 16 * MIB,
};

/// Least number of points of a response.
const FEWEST_POINTS: usize = 4;

/// Length of a window on a sweep, samples; its lines are 2.4 Hz apart at 5 kHz.
const WINDOW: usize = 2048;

/// Length up to which a sweep is read, s.
const LONGEST_SWEEP_S: f64 = 600.0;

/// Number of points per octave that a sweep's response is averaged to.
const POINTS_PER_OCTAVE: f64 = 24.0;

/// Coherence of drive and acceleration below which a frequency is left out, because its response is mostly noise.
const LEAST_COHERENCE: f64 = 0.5;

/// Level of an actuator over frequency.
#[derive(Clone, Debug, PartialEq)]
pub struct Response {
    path: PathBuf,
    /// Frequency, Hz, ascending, and level, dB.
    points: Vec<(f64, f64)>,
}

impl Response {
    /// Reads a response.
    ///
    /// A CSV file has the columns `frequency_hz`, ascending, and `magnitude_db`; comments begin with `#`. A WAV file is
    /// a recording of a sweep, or of noise, in two channels: the drive, and the acceleration in response. The response
    /// is H1, the cross-spectrum over the drive's power spectrum (Bendat and Piersol, *Random Data*, 2010, ch. 6), at
    /// frequencies of sufficient coherence.
    ///
    /// # Errors
    /// A file that cannot be read, or is neither of these.
    pub fn read(path: &Path) -> Result<Self> {
        let extension = path.extension().unwrap_or_default().to_string_lossy();
        if extension.eq_ignore_ascii_case("wav") {
            let trial = Trial {
                duration_s: Some(LONGEST_SWEEP_S),
                ..Trial::of(path.to_owned(), String::new(), 0.0, 0.0)
            };
            let samples = recording::read(&trial)?;
            let [drive, acceleration] = samples.axes.as_slice() else {
                let problem = format!(
                    "has {} channel(s); a sweep has two, the drive and the acceleration",
                    samples.axes.len()
                );
                return Err(Error::file(path, problem));
            };
            let rate_hz = f64::from(model_format::SAMPLE_RATE_HZ);
            let points = of_sweep(drive, acceleration, rate_hz);
            return Self::of_points(path, points);
        }
        let text = RESPONSE.read_text(path)?;
        Self::from_csv(path, &text)
    }

    /// Reads a response from CSV `text`; `path` is only named in errors.
    ///
    /// # Errors
    /// A missing column, a value that is no finite number, frequencies that do not ascend, or too few of them.
    pub fn from_csv(path: &Path, text: &str) -> Result<Self> {
        let table = CsvTable::of(path, text.to_owned());
        let header = table.header()?;
        let (frequency_name, magnitude_name) = ("frequency_hz", "magnitude_db");
        let needed =
            |name: &str| header.needed(name, "a response has frequency_hz and magnitude_db");
        let (frequency, magnitude) = (needed(frequency_name)?, needed(magnitude_name)?);
        let mut points: Vec<(f64, f64)> = Vec::new();
        let mut rows = table.rows_below_header()?;
        while let Some(row) = rows.next_row()? {
            let frequency_hz = row.finite(frequency, frequency_name)?;
            let level_db = row.finite(magnitude, magnitude_name)?;
            let before_hz = points.last().map_or(0.0, |point| point.0);
            if frequency_hz <= before_hz {
                let problem = format!(
                    "frequency_hz is {frequency_hz} after {before_hz}; frequencies must be above 0 and ascend"
                );
                return Err(row.error(problem));
            }
            points.push((frequency_hz, level_db));
        }
        Self::of_points(path, points)
    }

    fn of_points(path: &Path, points: Vec<(f64, f64)>) -> Result<Self> {
        if points.len() < FEWEST_POINTS {
            let problem = format!(
                "has the response at {} frequencies; at least {FEWEST_POINTS} are needed",
                points.len()
            );
            return Err(Error::file(path, problem));
        }
        Ok(Self {
            path: path.to_owned(),
            points,
        })
    }

    /// File that the response was read from.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Frequency, Hz, ascending, and level, dB.
    pub fn points(&self) -> &[(f64, f64)] {
        &self.points
    }

    /// Level at `frequency_hz`, dB: linear over the logarithm of the frequency, constant beyond both ends.
    pub fn level_db(&self, frequency_hz: f64) -> f64 {
        let after = self.points.partition_point(|point| point.0 <= frequency_hz);
        match (after.checked_sub(1), self.points.get(after)) {
            (Some(before), Some(next)) => {
                let before = self.points[before];
                let share = (frequency_hz / before.0).ln() / (next.0 / before.0).ln();
                before.1 + (next.1 - before.1) * share
            }
            (None, Some(first)) => first.1,
            (_, None) => self.points[self.points.len() - 1].1,
        }
    }
}

/// H1 of `acceleration` over `drive`, averaged over windows, and its power averaged over fractions of an octave.
pub(super) fn of_sweep(drive: &[f64], acceleration: &[f64], rate_hz: f64) -> Vec<(f64, f64)> {
    let forward = RealFftPlanner::<f64>::new().plan_fft_forward(WINDOW);
    let bins = WINDOW / 2 + 1;
    let spectrum = |signal: &[f64]| {
        let mut windowed: Vec<f64> = signal
            .iter()
            .enumerate()
            .map(|(n, x)| x * (0.5 - 0.5 * (TAU * n as f64 / WINDOW as f64).cos()))
            .collect();
        let mut spectrum = forward.make_output_vec();
        forward
            .process(&mut windowed, &mut spectrum)
            .expect("the lengths are the plan's own");
        spectrum
    };
    let mut cross = vec![Complex::<f64>::default(); bins];
    let (mut of_drive, mut of_acceleration) = (vec![0.0; bins], vec![0.0; bins]);
    for begin in (0..(drive.len() + 1).saturating_sub(WINDOW)).step_by(WINDOW / 4) {
        let x = spectrum(&drive[begin..begin + WINDOW]);
        let y = spectrum(&acceleration[begin..begin + WINDOW]);
        for bin in 0..bins {
            cross[bin] += x[bin].conj() * y[bin];
            of_drive[bin] += x[bin].norm_sqr();
            of_acceleration[bin] += y[bin].norm_sqr();
        }
    }
    let loudest = of_drive.iter().copied().fold(0.0, f64::max);
    let coherent = |bin: &usize| {
        let bin = *bin;
        // At frequencies without drive the response is noise, which can be coherent by chance.
        of_drive[bin] > 1e-6 * loudest
            && cross[bin].norm_sqr() >= LEAST_COHERENCE * of_drive[bin] * of_acceleration[bin]
    };
    let band = |bin: &usize| ((*bin as f64).log2() * POINTS_PER_OCTAVE).round() as i64;
    let kept: Vec<usize> = (1..bins - 1).filter(coherent).collect();
    kept.chunk_by(|a, b| band(a) == band(b))
        .map(|bins| {
            let count = bins.len() as f64;
            let log_hz: f64 = bins.iter().map(|&bin| (bin as f64).ln()).sum();
            let power: f64 = bins
                .iter()
                .map(|&bin| (cross[bin] / of_drive[bin]).norm_sqr())
                .sum();
            let frequency_hz = (log_hz / count).exp() * rate_hz / WINDOW as f64;
            (frequency_hz, 10.0 * (power / count).log10())
        })
        .filter(|point| point.1.is_finite())
        .collect()
}
