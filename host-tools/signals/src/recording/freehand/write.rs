//! Writes the segments of a free hand's recording as a recording set for `fit`.

use std::path::Path;

use super::read::Freehand;
use super::segment::{Placed, Segmentation};
use crate::recording::TRIALS_FILE;
use crate::support::atomic_file;
use crate::support::csv_table::written;
use crate::support::error::{Error, Result};
use crate::support::float_wav::float_wav;
use crate::support::output::OutputFolder;

/// Writes every segment as a WAV file (32-bit float, m/s²) into `folder`, and then the list of the trials of `texture`.
/// Either everything is written or nothing. With `overwrite`, an earlier result in `folder` is replaced.
pub fn write(
    folder: &Path,
    texture: &str,
    recordings: &[Freehand],
    segmentation: &Segmentation,
    overwrite: bool,
) -> Result<()> {
    OutputFolder::begin(folder, overwrite)?.fill(|folder| write_into(folder.path(), texture, recordings, segmentation))
}

fn write_into(folder: &Path, texture: &str, recordings: &[Freehand], segmentation: &Segmentation) -> Result<()> {
    let list = folder.join(TRIALS_FILE);
    let header = ["file", "texture", "speed_mm_s", "force_n", "duration_s", "simulated"];
    let mut rows = vec![header.map(str::to_owned)];
    for (index, placed) in segmentation.placed.iter().enumerate() {
        let recording = &recordings[placed.segment.recording];
        let name = format!("segment_{:04}.wav", index + 1);
        // A WAV file states a whole rate, and the list's duration is a duration at this rate.
        let rate_hz = recording.rate_hz.round();
        write_segment(&folder.join(&name), recording, placed, rate_hz as u32)?;
        let seconds = (placed.segment.end - placed.segment.first) as f64 / rate_hz;
        rows.push([
            name,
            texture.to_owned(),
            placed.speed_mm_s.to_string(),
            placed.force_n.to_string(),
            seconds.to_string(),
            recording.is_simulated.to_string(),
        ]);
    }
    let text = written(rows.iter().map(|row| row.iter().map(String::as_str)));
    atomic_file::write(&list, text.as_bytes())
}

fn write_segment(path: &Path, recording: &Freehand, placed: &Placed, rate_hz: u32) -> Result<()> {
    let part = placed.segment.first..placed.segment.end;
    let samples = part.flat_map(|sample| recording.axes.iter().map(move |axis| axis[sample]));
    let bytes = float_wav(recording.axes.len(), rate_hz, samples);
    let bytes = bytes.map_err(|failure| Error::file(path, failure.to_string()))?;
    atomic_file::write(path, &bytes)
}

#[cfg(test)]
mod tests {
    use super::super::segment::{self, Options};
    use super::*;
    use crate::recording::source::Cut;
    use crate::recording::wav;

    #[test]
    fn a_segment_of_a_fractional_rate_is_read_whole() {
        let samples = 3003;
        let hand = Freehand {
            rate_hz: 1000.6,
            axes: vec![vec![0.1; samples]],
            speed_mm_s: vec![100.0; samples],
            is_backward: vec![false; samples],
            force_n: vec![1.0; samples],
            is_outlier: vec![false; samples],
            outliers: Vec::new(),
            is_simulated: false,
            remarks: Vec::new(),
        };
        let hands = [hand];
        let options = Options::of(&hands, (None, None), 0.1, (0.2, 0.5)).unwrap();
        let segmentation = segment::segment(&hands, &options);
        let folder = tempfile::tempdir().unwrap();
        write(folder.path(), "felt", &hands, &segmentation, true).unwrap();
        let list = std::fs::read_to_string(folder.path().join(TRIALS_FILE)).unwrap();
        let fields: Vec<&str> = list.lines().nth(1).unwrap().split(',').collect();
        let cut = Cut {
            start_s: 0.0,
            duration_s: fields[4].parse().unwrap(),
        };
        let source = wav::read(&folder.path().join(fields[0]), None, &cut).unwrap();
        let segment = &segmentation.placed[0].segment;
        assert_eq!(source.rate.hz(), 1001.0);
        assert_eq!(source.channels[0].len(), segment.end - segment.first);
    }
}
