//! `--strokes`: a library that is fitted to all strokes of a free hand.

use std::path::PathBuf;

use stylus_fit::fit::record::FitRecord;
use stylus_fit::fit::{Fit, Options, fit_strokes};
use stylus_signals::recording::freehand::{self, Freehand};
use stylus_signals::recording::{Assumed, texture_fault};
use stylus_support::progress;
use stylus_support::{Error, Result};

use crate::cli::input::texture_name;
use crate::cli::output::warn;

/// Options for recordings of a free hand.
#[derive(clap::Args)]
pub struct Strokes {
    /// The recordings are a free hand's: CSV with speed_mm_s, force_n, one to three accelerations, and time_s
    #[arg(
        long,
        conflicts_with_all = ["start_s", "duration_s", "time_unit", "even_times", "speed_mm_s", "force_n"]
    )]
    pub strokes: bool,
    /// With --strokes: name of the texture of all files [default: that of the first, if they are named alike]
    #[arg(long, value_name = "NAME", value_parser = texture_name, requires = "strokes")]
    texture: Option<String>,
}

impl Strokes {
    /// Fits one texture to all strokes in `files`. Returns the fit, its library and its record.
    ///
    /// # Errors
    /// A path is a folder; the first file's name is no valid name of a texture; a file is not a recording of a free
    /// hand; or an error of [`fit_strokes`].
    pub fn fitted(&self, files: &[PathBuf], assumed: &Assumed, options: &Options) -> Result<(Fit, Vec<u8>, FitRecord)> {
        // A fit of trials takes folders. Reading one as a stroke would fail without a remedy.
        if let Some(folder) = files.iter().find(|path| path.is_dir()) {
            let problem = "is a folder: with --strokes give CSVs, such as stroke-1.csv";
            return Err(Error::file(folder, problem));
        }
        let name = self.name(files)?;
        let read = |path: &PathBuf| {
            let recording = freehand::read(path, assumed.sample_rate_hz, assumed.scale_m_s2)?;
            recording.notes(path).iter().for_each(|text| warn(text));
            Ok((path.clone(), recording))
        };
        let strokes: Vec<(PathBuf, Freehand)> = files.iter().map(read).collect::<Result<_>>()?;
        let bar = progress::bar(strokes.len() as u64, "fitting");
        let fit = fit_strokes(&name, &strokes, options, |steps| bar.inc(steps as u64))?;
        bar.finish_and_clear();
        let bytes = fit.library()?;
        let record = FitRecord::of_strokes(files, assumed.scale_m_s2, &fit, options, &bytes)?;
        Ok((fit, bytes, record))
    }

    /// Returns the texture's name: as given, or that of the first file if the files' names differ only at the end, as
    /// in `stroke-1` and `stroke-2`.
    fn name(&self, files: &[PathBuf]) -> Result<String> {
        let (None, Some(first)) = (&self.texture, files.first()) else {
            return Ok(self.texture.clone().unwrap_or_default());
        };
        let stem = |path: &PathBuf| path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let word = |path: &PathBuf| {
            stem(path)
                .trim_end_matches(|end: char| !end.is_alphabetic())
                .to_lowercase()
        };
        // Several materials in one call would become one texture that jumps between them.
        if let Some(other) = files.iter().find(|path| word(path) != word(first)) {
            let problem = format!(
                "is not named like {}, and with --strokes all files are of one texture: give --texture, or fit each \
                 texture alone and `stylus join` the libraries",
                first.display()
            );
            return Err(Error::file(other, problem));
        }
        let stem = stem(first);
        match texture_fault(&stem) {
            None => Ok(stem),
            Some(fault) => {
                let problem = format!("its name as that of a texture {fault}: give --texture");
                Err(Error::file(first, problem))
            }
        }
    }
}
