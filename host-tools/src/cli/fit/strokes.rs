//! `stylus fit --strokes`: a library from all of a free hand's strokes.

use std::path::PathBuf;

use host_tools::fit::record::{FitRecord, FoundLines};
use host_tools::fit::{Fit, fit_strokes};
use host_tools::recording::freehand::{self, Freehand};
use host_tools::recording::{RecordingSet, Trial};
use host_tools::support::error::{Error, Result};
use host_tools::support::progress;

use super::Arguments;
use crate::cli::input::texture_name;
use crate::cli::output::warn;

/// Options for recordings of a free hand.
#[derive(clap::Args)]
pub struct Strokes {
    /// The recordings are a free hand's: CSV with speed_mm_s, force_n, one to three accelerations, and time_s
    #[arg(long, conflicts_with_all = ["densify", "each", "parts"])]
    pub strokes: bool,
    /// With --strokes: name of the texture [default: that of the first file]
    #[arg(long, value_name = "NAME", value_parser = texture_name, requires = "strokes")]
    pub texture: Option<String>,
}

/// The fit of one texture to all strokes, its library, and its record.
pub fn fitted(arguments: &Arguments) -> Result<(Fit, Vec<u8>, FitRecord)> {
    let (files, assumed) = (
        arguments.recordings.inputs(),
        arguments.recordings.assumed(),
    );
    if let Some(folder) = files.iter().find(|path| path.is_dir()) {
        let problem = "is a folder: with --strokes give CSVs, such as stroke-1.csv";
        return Err(Error::file(folder, problem));
    }
    let read = |path: &PathBuf| {
        let recording = freehand::read(path, assumed.sample_rate_hz, assumed.scale_m_s2)?;
        recording.notes(path).iter().for_each(|text| warn(text));
        Ok((path.clone(), recording))
    };
    let strokes: Vec<(PathBuf, Freehand)> = files.iter().map(read).collect::<Result<_>>()?;
    let first = files
        .first()
        .and_then(|path| path.file_stem())
        .unwrap_or_default();
    let name =
        (arguments.strokes.texture.clone()).unwrap_or_else(|| first.to_string_lossy().into_owned());
    let bar = progress::bar(strokes.len() as u64, "fitting");
    let fit = fit_strokes(&name, &strokes, &arguments.options, |steps| {
        bar.inc(steps as u64);
    })?;
    bar.finish_and_clear();
    let bytes = fit.library()?;
    // The trials of the fit are in no file; the strokes are.
    let trials = files.iter().map(|path| Trial::of(path, &name, 0.0, 0.0));
    let set = RecordingSet {
        trials: trials.collect(),
        is_listed: true,
    };
    let record = FitRecord {
        excitations: fit.excitations(),
        lines: FoundLines::of(&fit),
        ..FitRecord::of(&set, &arguments.options, &bytes)?
    };
    Ok((fit, bytes, record))
}
