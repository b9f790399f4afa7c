//! `stylus page`

use std::path::{Path, PathBuf};

use stylus_evaluation::evaluate;
use stylus_fit::fit;
use stylus_fit::fit::conditioning::Conditioning;
use stylus_fit::fit::record::FitRecord;
use stylus_report::rub_page::{self, Clips, Inputs, JudgedRecordings, Written};
use stylus_signals::recording::{Assumed, Kind, RecordingSet};
use stylus_support::progress;
use stylus_support::{Error, Result};

use super::files::{Overwrite, read_plant};
use super::fit::Strokes;
use super::input::{positive, tell_nominal_motion};
use crate::cli::evaluate::{as_fitted, choose};
use crate::cli::output::print;
use stylus_fit::texture::library::{decode_library, read_library};
use stylus_plant::Plant;

#[derive(clap::Args)]
pub struct Arguments {
    /// Library, or recordings to fit one to as `stylus fit` does: a folder with trials.csv, such a list, or WAV, CSV or
    /// LabVIEW files
    #[arg(required = true, value_name = "LIB|DIR|FILES")]
    inputs: Vec<PathBuf>,
    #[command(flatten)]
    assumed: Assumed,
    #[command(flatten)]
    strokes: Strokes,
    /// HTML file to write
    #[arg(long, value_name = "HTML")]
    out: PathBuf,
    #[command(flatten)]
    overwrite: Overwrite,
    /// Recordings behind a library, as a folder or a list: their clips, their spectra and C of each node come too
    #[arg(long, value_name = "DIR", conflicts_with = "strokes")]
    recordings: Option<PathBuf>,
    /// Duration of the clip of each recording, in seconds [default: 0.5 to 1.5, as the page's size allows, and
    /// not at every node of a large grid]
    #[arg(long, value_name = "S", value_parser = clip, conflicts_with = "strokes")]
    clips: Option<f64>,
    #[command(flatten)]
    conditioning: Conditioning,
    /// Let the page switch from the pin to the tip by this actuator model: a TOML file, or haptuator or mark-ii-d
    #[arg(long, value_name = "FILE")]
    plant: Option<PathBuf>,
    /// Seed that the page begins with
    #[arg(long, default_value_t = 1)]
    seed: u32,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let given = &arguments.inputs;
    arguments.overwrite.file(&arguments.out)?;
    let is_strokes = arguments.strokes.strokes;
    // A library is one file, so several inputs can only be recordings.
    let is_recordings = !is_strokes && (given.len() > 1 || is_recordings(&given[0]));
    check(arguments, is_recordings)?;
    let plant = arguments.plant.as_deref().map(named_plant).transpose()?;
    let plant = plant.as_ref().map(|(name, plant)| (name.as_str(), plant));
    let recordings = if is_recordings {
        given.as_slice()
    } else {
        arguments.recordings.as_slice()
    };
    let set = (!recordings.is_empty())
        .then(|| RecordingSet::open_with(recordings, &arguments.assumed))
        .transpose()?;
    let (bytes, record) = match &set {
        Some(set) if is_recordings => fitted(set, arguments)?,
        None if is_strokes => fitted_to_strokes(arguments)?,
        _ => {
            let bytes = read_library(&given[0])?;
            let record = FitRecord::beside(&given[0], &bytes)?;
            (bytes, record)
        }
    };
    // The path only names the library in an error. The bytes may have been fitted just now.
    let library = decode_library(&given[0], &bytes)?;
    let out = &arguments.out;
    let inputs = Inputs {
        library: &library,
        bytes: &bytes,
        recordings: None,
        seed: u64::from(arguments.seed),
        plant,
    };
    let Some(set) = set else {
        return print(&summary(out, &write(&inputs, out)?));
    };
    let set = as_fitted(record.as_ref(), set)?;
    let options = evaluate::Options {
        conditioning: arguments.conditioning,
        seed: u64::from(arguments.seed),
        ..evaluate::Options::default()
    };
    let judges = choose(&set, None, record.as_ref(), arguments.conditioning)?.judges;
    let evaluation = super::evaluate::evaluate_set(&set, &library, judges, record.as_ref(), &options)?;
    let recordings = JudgedRecordings {
        set: &set,
        evaluation: &evaluation,
        conditioning: arguments.conditioning,
        clips: arguments.clips.map_or(Clips::Budget, Clips::Seconds),
    };
    let inputs = Inputs {
        recordings: Some(recordings),
        ..inputs
    };
    print(&summary(out, &write(&inputs, out)?))
}

/// Fits a library to strokes with the defaults of `stylus fit`. Returns its bytes and its record.
fn fitted_to_strokes(arguments: &Arguments) -> Result<(Vec<u8>, Option<FitRecord>)> {
    let options = fit::Options {
        conditioning: arguments.conditioning,
        ..fit::Options::default()
    };
    let fitted = (arguments.strokes).fitted(&arguments.inputs, &arguments.assumed, &options)?;
    let (fit, bytes, record) = fitted;
    super::fit::show_verdicts(&fit);
    Ok((bytes, Some(record)))
}

/// Returns an error if options for recordings are given without recordings, or options for a library although one is
/// fitted.
fn check(arguments: &Arguments, is_recordings: bool) -> Result<()> {
    if is_recordings && arguments.recordings.is_some() {
        return Err(Error::Request(format!(
            "{} is recordings already, to which a library is fitted: give --recordings beside a library only",
            arguments.inputs[0].display()
        )));
    }
    if arguments.clips.is_some() && !is_recordings && arguments.recordings.is_none() {
        return Err(Error::Request(
            "--clips are of recordings: give --recordings beside the library".into(),
        ));
    }
    Ok(())
}

/// Reads a plant. Its name is that of its file without extension, or that of the preset with its hand, such as
/// `haptuator/light`.
fn named_plant(path: &Path) -> Result<(String, Plant)> {
    let plant = Plant::new(&read_plant(path)?, 0);
    let name = path
        .file_stem()
        // A preset's name has no extension, and its stem would lack the part before the slash.
        .filter(|_| path.extension().is_some())
        .unwrap_or(path.as_os_str());
    Ok((name.to_string_lossy().into_owned(), plant))
}

/// Returns true if `path` holds recordings: a folder, a list or a file of samples. Anything else is read as a library;
/// if it is not one, the error says so.
fn is_recordings(path: &Path) -> bool {
    path.is_dir() || Kind::of(path).is_some()
}

/// Fits a library to `set` with the defaults of `stylus fit`. Returns its bytes and its record.
fn fitted(set: &RecordingSet, arguments: &Arguments) -> Result<(Vec<u8>, Option<FitRecord>)> {
    let options = fit::Options {
        conditioning: arguments.conditioning,
        ..fit::Options::default()
    };
    let (fit, bytes) = super::fit::fit_library(set, &options)?;
    tell_nominal_motion(set, &arguments.assumed);
    super::fit::show_verdicts(&fit);
    let record = FitRecord::of(set, &options, &bytes)?.with_account_of(&fit);
    Ok((bytes, Some(record)))
}

/// Writes the page with a progress bar.
pub fn write(inputs: &Inputs<'_>, path: &Path) -> Result<Written> {
    let bar = progress::bar(inputs.library.len() as u64, "page");
    let written = rub_page::write(inputs, path, || bar.inc(1))?;
    bar.finish_and_clear();
    Ok(written)
}

/// Number of digests that are printed.
const SHOWN_DIGESTS: usize = 4;

/// Describes the page in words, with digests of the first textures to compare with those that a browser shows.
pub fn summary(path: &Path, written: &Written) -> String {
    let origin = if written.simulated {
        ", of SIMULATED recordings"
    } else {
        ""
    };
    let clips = match written.clips {
        0 => "no clips of recordings".to_owned(),
        1 => "1 clip of a recording".to_owned(),
        many => format!("{many} clips of recordings"),
    };
    let shown: Vec<String> = written
        .digests
        .iter()
        .take(SHOWN_DIGESTS)
        .map(|(name, digest)| format!("{name} {digest}"))
        .collect();
    let more = match written.digests.len() - shown.len() {
        0 => String::new(),
        more => format!(" and {more} more, which the page shows"),
    };
    format!(
        "{}: {:.1} MB, {clips}{origin}\ndigest of the first 50 000 words: {}{more}",
        path.display(),
        written.bytes as f64 / 1e6,
        shown.join(", ")
    )
}

/// Parses the duration of clips, s.
fn clip(text: &str) -> std::result::Result<f64, String> {
    match positive(text) {
        Ok(seconds) if (0.1..=10.0).contains(&seconds) => Ok(seconds),
        _ => Err("must be 0.1 to 10 seconds".into()),
    }
}
