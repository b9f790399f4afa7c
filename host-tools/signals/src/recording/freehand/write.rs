//! Writes the segments of a free hand's recording as a recording set for `fit`.

use std::path::Path;

use super::read::Freehand;
use super::segment::{Placed, Segmentation};
use crate::recording::TRIALS_FILE;
use crate::support::atomic_file;
use crate::support::error::{Error, Result};
use crate::support::float_wav::float_wav;
use crate::support::output::OutputFolder;

/// Writes every segment as a WAV file (32-bit float, m/s²) into `folder`, and then the list of the trials of `texture`.
/// Either everything is written or nothing. With `overwrite`, an earlier result in `folder` is replaced.
///
/// # Errors
/// The folder contains other files, or cannot be written to.
pub fn write(
    folder: &Path,
    texture: &str,
    recordings: &[Freehand],
    segmentation: &Segmentation,
    overwrite: bool,
) -> Result<()> {
    OutputFolder::begin(folder, overwrite)?
        .fill(|folder| write_into(folder.path(), texture, recordings, segmentation))
}

fn write_into(
    folder: &Path,
    texture: &str,
    recordings: &[Freehand],
    segmentation: &Segmentation,
) -> Result<()> {
    let list = folder.join(TRIALS_FILE);
    let mut writer = csv::Writer::from_writer(Vec::new());
    let header = [
        "file",
        "texture",
        "speed_mm_s",
        "force_n",
        "duration_s",
        "simulated",
    ];
    let failed = |failure: csv::Error| Error::file(&list, failure.to_string());
    writer.write_record(header).map_err(failed)?;
    for (index, placed) in segmentation.placed.iter().enumerate() {
        let recording = &recordings[placed.segment.recording];
        let name = format!("segment_{:04}.wav", index + 1);
        write_segment(&folder.join(&name), recording, placed)?;
        let seconds = (placed.segment.end - placed.segment.first) as f64 / recording.rate_hz;
        let fields = [
            name,
            texture.to_owned(),
            placed.speed_mm_s.to_string(),
            placed.force_n.to_string(),
            seconds.to_string(),
            recording.is_simulated.to_string(),
        ];
        writer.write_record(fields).map_err(failed)?;
    }
    let bytes = writer
        .into_inner()
        .map_err(|failure| Error::file(&list, failure.to_string()))?;
    atomic_file::write(&list, &bytes)
}

fn write_segment(path: &Path, recording: &Freehand, placed: &Placed) -> Result<()> {
    let part = placed.segment.first..placed.segment.end;
    let samples = part.flat_map(|sample| recording.axes.iter().map(move |axis| axis[sample]));
    let bytes = float_wav(recording.axes.len(), recording.rate_hz as u32, samples);
    let bytes = bytes.map_err(|failure| Error::file(path, failure.to_string()))?;
    atomic_file::write(path, &bytes)
}
