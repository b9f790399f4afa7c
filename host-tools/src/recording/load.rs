//! The samples of a trial: read, cut, resampled to the models' rate and scaled to m/s².

use std::path::Path;

use super::set::Trial;
use super::{MODEL_RATE_HZ, TRIAL_DURATION_S, csv_file, resample, wav};
use crate::error::{Error, Result};
use crate::triage;

/// Which part of a file to use, s.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cut {
    /// Where it begins.
    pub start_s: f64,
    /// How long it is at most.
    pub duration_s: f64,
}

impl Cut {
    /// First frame and the one after the last, at `rate_hz`.
    pub(super) fn frames(&self, rate_hz: f64) -> (usize, usize) {
        let first = (self.start_s * rate_hz).round() as usize;
        let count = (self.duration_s * rate_hz).round() as usize;
        (first, first.saturating_add(count))
    }
}

/// What a file holds, at its own rate, from the cut's first frame on.
#[derive(Clone, Debug)]
pub struct Source {
    /// Its sample rate, Hz.
    pub rate_hz: f64,
    /// The frame that the channels begin at.
    pub first_frame: usize,
    /// One to three channels of one length.
    pub channels: Vec<Vec<f64>>,
}

/// The samples of a trial.
#[derive(Clone, Debug)]
pub struct Samples {
    /// One to three axes of one length, at [`MODEL_RATE_HZ`], m/s².
    pub axes: Vec<Vec<f64>>,
    /// The file's own sample rate, Hz.
    pub source_rate_hz: f64,
    /// Share of the file's own samples that are cut off at the ends of their range, of the worst axis.
    pub clipped_share: f64,
}

/// Reads the samples of `trial`.
///
/// # Errors
/// A file that cannot be read, that holds nothing in the part asked for, or whose samples are not all finite, with the
/// place of the first that is not.
pub fn read(trial: &Trial) -> Result<Samples> {
    let path = trial.file.as_path();
    let cut = Cut {
        start_s: trial.start_s,
        duration_s: trial.duration_s.unwrap_or(TRIAL_DURATION_S),
    };
    let source = match extension(path).as_str() {
        "wav" | "wave" => wav::read(path, &cut)?,
        "csv" | "txt" => csv_file::read(path, &cut, trial.sample_rate_hz)?,
        other => {
            // A name that was mistyped is a file that is not there before it is one of the wrong kind.
            std::fs::metadata(path).map_err(Error::io("read", path))?;
            let problem = format!("'{other}' files are not known; give .wav or .csv");
            return Err(Error::file(path, problem));
        }
    };
    let mut axes = source.channels;
    if axes.first().is_none_or(Vec::is_empty) {
        let problem = format!("holds no samples after {} s", cut.start_s);
        return Err(Error::file(path, problem));
    }
    check_finite(path, &axes, source.first_frame)?;
    let clipped_share = triage::clipped_share(&axes);
    let rate_hz = source.rate_hz;
    if (rate_hz - f64::from(MODEL_RATE_HZ)).abs() > 0.0 {
        axes = at_model_rate(path, &axes, rate_hz)?;
    }
    // Exactly one where a trial says nothing of a scale.
    if trial.scale_m_s2.to_bits() != 1.0f64.to_bits() {
        for sample in axes.iter_mut().flatten() {
            *sample *= trial.scale_m_s2;
        }
    }
    Ok(Samples {
        axes,
        source_rate_hz: rate_hz,
        clipped_share,
    })
}

fn extension(path: &Path) -> String {
    let extension = path.extension().unwrap_or_default();
    extension.to_string_lossy().to_lowercase()
}

fn check_finite(path: &Path, channels: &[Vec<f64>], first_frame: usize) -> Result<()> {
    for (channel, samples) in channels.iter().enumerate() {
        // A sum is finite only if all of its terms are; looking for the place costs time only where there is one.
        if samples.iter().sum::<f64>().is_finite() {
            continue;
        }
        if let Some(index) = samples.iter().position(|sample| !sample.is_finite()) {
            let problem = format!(
                "sample {} of channel {} is not a finite number; cut it out (start_s, duration_s) or record it again",
                first_frame + index,
                channel + 1
            );
            return Err(Error::file(path, problem));
        }
    }
    Ok(())
}

fn at_model_rate(path: &Path, axes: &[Vec<f64>], rate_hz: f64) -> Result<Vec<Vec<f64>>> {
    let whole = rate_hz.round();
    if (rate_hz - whole).abs() > 1e-9 * rate_hz || whole < 1.0 || whole > f64::from(u32::MAX) {
        let problem = format!("a sample rate of {rate_hz} Hz is not a whole number of hertz");
        return Err(Error::file(path, problem));
    }
    resample::resample(axes, whole as u32, MODEL_RATE_HZ)
        .map_err(|problem| Error::file(path, problem))
}
