//! The samples of a trial: read, cut, resampled to the models' rate and scaled to m/s².

use std::path::Path;

use model_format::SAMPLE_RATE_HZ;

use super::defects::Defects;
use super::polled::polled;
use super::rate::length_fault;
use super::source::Samples;
use super::source::{Cut, Source};
use super::trial::Trial;
use super::{csv_file, resample, uneven, wav};
use crate::dsp::sums::sum;
use crate::support::error::{Error, Result};

/// Largest share by which a rate is taken for the whole number next to it.
const NEAR_WHOLE: f64 = 5e-4;

/// Reads the samples of `trial`: one to three axes at [`SAMPLE_RATE_HZ`], in m/s².
///
/// # Errors
/// A file that cannot be read, that holds no samples in the trial's part of it, or that holds a sample that is not
/// finite; the error names the first such sample.
pub fn read(trial: &Trial) -> Result<Samples> {
    read_at(trial, SAMPLE_RATE_HZ)
}

/// As [`read`], at `model_rate_hz`.
///
/// # Errors
/// As [`read`].
pub fn read_at(trial: &Trial, model_rate_hz: u32) -> Result<Samples> {
    let path = trial.file.as_path();
    let cut = Cut {
        start_s: trial.start_s,
        duration_s: trial.duration_s.unwrap_or(f64::INFINITY),
    };
    let source = match &trial.held {
        Some(held) => held.source(&cut),
        None => from_file(trial, &cut)?,
    };
    let (mut axes, mut times_s) = (source.channels, source.times_s);
    if axes.first().is_none_or(Vec::is_empty) {
        let problem = format!(
            "holds no samples after {} s: give an earlier start_s",
            cut.start_s
        );
        return Err(Error::file(path, problem));
    }
    check_finite(path, &axes, source.first_frame)?;
    let mut rate_hz = source.rate_hz;
    let polled = polled(&axes, rate_hz);
    let read_at_hz = polled.is_some().then_some(rate_hz);
    if let Some(sensor) = polled {
        (axes, rate_hz, times_s) = (sensor.channels, sensor.rate_hz, None);
    }
    let defects = Defects {
        truncation: source.truncation,
        timing: source.timing,
        read_at_hz,
        ..Defects::of(&axes, rate_hz)
    };
    let whole_hz = rate_hz.round();
    if times_s.is_none() && (rate_hz / whole_hz - 1.0).abs() > NEAR_WHOLE {
        let frames = 0..axes[0].len();
        times_s = Some(frames.map(|n| n as f64 / rate_hz).collect());
    }
    rate_hz = whole_hz;
    if let Some(times) = &times_s {
        axes = uneven::evened(&axes, times, rate_hz);
    }
    if (rate_hz - f64::from(model_rate_hz)).abs() > 0.0 {
        axes = at_model_rate(path, &axes, rate_hz, model_rate_hz)?;
    }
    let scale = trial.scale();
    if scale.to_bits() != 1.0f64.to_bits() {
        for sample in axes.iter_mut().flatten() {
            *sample *= scale;
        }
    }
    Ok(Samples {
        axes,
        source_rate_hz: rate_hz,
        defects,
    })
}

/// Reads the part of a trial's file within `cut`.
fn from_file(trial: &Trial, cut: &Cut) -> Result<Source> {
    let path = trial.file.as_path();
    if let Some(other) = named_alike(path) {
        let problem = format!("is not there, and '{other}' is: mend the letters' case in the list");
        return Err(Error::file(path, problem));
    }
    match extension(path).as_str() {
        "wav" | "wave" => wav::read(path, cut),
        "csv" | "txt" => csv_file::read(trial, cut),
        other => {
            // A mistyped name is reported as a missing file, not as a file of an unknown kind.
            std::fs::metadata(path).map_err(Error::io("read", path))?;
            let problem = format!("'{other}' files cannot be read: {}", conversion(other));
            Err(Error::file(path, problem))
        }
    }
}

/// The way from a file with this extension to one that can be read.
fn conversion(extension: &str) -> String {
    match extension {
        "xlsx" | "xls" | "ods" => "save the sheet as .csv".to_owned(),
        "aac" | "aif" | "aiff" | "flac" | "m4a" | "mp3" | "mp4" | "ogg" | "opus" | "wma" => {
            format!("give .wav or .csv; `ffmpeg -i FILE.{extension} FILE.wav` converts sound")
        }
        _ => "export the samples as .csv, or as .wav".to_owned(),
    }
}

/// The name of a file beside `path`, which is not there, that differs from it by capitals alone.
fn named_alike(path: &Path) -> Option<String> {
    if path.exists() {
        return None;
    }
    let wanted = path.file_name()?.to_string_lossy().to_lowercase();
    let folder = path.parent().filter(|folder| *folder != Path::new(""));
    let beside = std::fs::read_dir(folder.unwrap_or(Path::new("."))).ok()?;
    let names =
        beside.filter_map(|entry| Some(entry.ok()?.file_name().to_string_lossy().into_owned()));
    names.into_iter().find(|name| name.to_lowercase() == wanted)
}

fn extension(path: &Path) -> String {
    let extension = path.extension().unwrap_or_default();
    extension.to_string_lossy().to_lowercase()
}

fn check_finite(path: &Path, channels: &[Vec<f64>], first_frame: usize) -> Result<()> {
    for (channel, samples) in channels.iter().enumerate() {
        // A sum is finite only if all of its terms are, so that only a bad recording costs a search.
        if sum(samples).is_finite() {
            continue;
        }
        if let Some(index) = samples.iter().position(|sample| !sample.is_finite()) {
            let problem = format!(
                "sample {} of channel {} is not a finite number: cut it out (start_s, duration_s) or record it again",
                first_frame + index,
                channel + 1
            );
            return Err(Error::file(path, problem));
        }
    }
    Ok(())
}

fn at_model_rate(
    path: &Path,
    axes: &[Vec<f64>],
    rate_hz: f64,
    model_rate_hz: u32,
) -> Result<Vec<Vec<f64>>> {
    let frames = axes.first().map_or(0, Vec::len);
    if let Some(fault) = length_fault(frames as f64 * f64::from(model_rate_hz) / rate_hz) {
        let problem = format!("at {model_rate_hz} Hz it has {fault}");
        return Err(Error::file(path, problem));
    }
    Ok(resample::resample(axes, rate_hz as u32, model_rate_hz))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recording::HeldSamples;
    use crate::support::float_wav::float_wav;

    /// Samples of 2 s at 8 kHz in single precision, on two axes, with a clipped peak.
    fn axes() -> [Vec<f64>; 2] {
        [0.11, 0.023].map(|of: f64| {
            let sample = |n: u32| (of * f64::from(n)).sin().clamp(-0.9, 0.9);
            (0..16_000)
                .map(sample)
                .map(|x| f64::from(x as f32))
                .collect()
        })
    }

    #[test]
    fn samples_in_memory_are_read_as_those_of_a_wav_file() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("a.wav");
        let axes = axes();
        let samples = (0..16_000).flat_map(|n| [axes[0][n], axes[1][n]]);
        std::fs::write(&file, float_wav(2, 8000, samples).unwrap()).unwrap();
        let of_file = Trial {
            scale_m_s2: Some(3.0),
            start_s: 0.25,
            duration_s: Some(1.5),
            ..Trial::of(file, "felt", 100.0, 1.0)
        };
        let held = HeldSamples::new(8000.0, axes.into(), false).unwrap();
        let in_memory = Trial {
            held: Some(held.into()),
            ..of_file.clone()
        };
        let (of_file, in_memory) = (read(&of_file).unwrap(), read(&in_memory).unwrap());
        assert_eq!(of_file.axes, in_memory.axes);
        assert_eq!(of_file.defects, in_memory.defects);
        assert_eq!(in_memory.axes[0].len(), 7500);
    }
}
