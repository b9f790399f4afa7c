//! `stylus fit --parts` and `--each`. Partial results are kept in a folder, and one process or many compute them. With
//! `--each`, each texture gets a separate library.

use std::path::{Path, PathBuf};

use stylus_fit::fit::parts::{Mapped, Merged, Shard, map};
use stylus_fit::fit::record::FitRecord;
use stylus_fit::fit::{self, Fit, TrialReport};
use stylus_signals::recording::RecordingSet;
use stylus_support::Warning;
use stylus_support::names::Stems;
use stylus_support::number::counted;
use stylus_support::progress;
use stylus_support::{Error, Result};

use crate::cli::files::check_in_growing_folder;
use crate::cli::output::{print, print_json, warn_of};
use crate::cli::table::table;

/// Options for sets that one library, one run or one machine is too small for.
#[derive(clap::Args)]
pub struct LargeSet {
    /// Write a library of its own for each texture, for sets of more textures than one library holds
    #[arg(long, conflicts_with = "strokes")]
    pub each: bool,
    /// Folder of partial results: what was computed of a trial is kept there, and not computed again
    #[arg(long, value_name = "DIR", conflicts_with = "strokes")]
    pub parts: Option<PathBuf>,
    /// Compute shard I of N only, and leave its partial results in --parts; with --merge --each, write the libraries of
    /// every N-th texture
    #[arg(long, value_name = "I/N", requires = "parts")]
    pub shard: Option<Shard>,
    /// Join what all shards have left in --parts, without computing any of it again
    #[arg(long, requires = "parts", requires = "out")]
    pub merge: bool,
}

impl LargeSet {
    fn folder(&self) -> Option<PathBuf> {
        self.parts.clone()
    }

    /// Returns the shard to compute and leave in --parts, if nothing else is requested.
    pub fn shard_to_map(&self) -> Option<Shard> {
        self.shard.filter(|_| !self.merge)
    }
}

/// Computes one shard.
pub fn map_shard(
    set: &RecordingSet,
    options: &fit::Options,
    shard: Shard,
    large: &LargeSet,
    is_json: bool,
) -> Result<()> {
    let folder = large.folder().unwrap_or_default();
    let Mapped { trials, reused } = mapped(set, options, shard, &folder)?;
    if is_json {
        return print_json(&serde_json::json!({
            "shard": shard.to_string(),
            "parts": folder.display().to_string(),
            "trials": trials,
            "reused": reused,
        }));
    }
    print(&format!(
        "shard {shard}: {trials} of {} -> {} ({reused} already there)",
        counted(set.trials.len(), "trial"),
        folder.display()
    ))
}

fn mapped(set: &RecordingSet, options: &fit::Options, shard: Shard, folder: &Path) -> Result<Mapped> {
    // Units have different sizes, so the number of trials in a shard is known only approximately.
    let share = (set.trials.len() as u64).div_ceil(u64::from(shard.of));
    let bar = progress::bar(share, "analysing trials");
    let mapped = map(set, options, shard, folder, |trials| bar.inc(trials as u64))?;
    bar.finish_and_clear();
    Ok(mapped)
}

/// Merges the partial results in --parts, or in `default`. Missing results are computed first, unless --merge states
/// that all exist.
pub fn merged<'s>(
    set: &'s RecordingSet,
    options: &fit::Options,
    default: Option<PathBuf>,
    large: &LargeSet,
) -> Result<Merged<'s>> {
    let folder = large.folder().or(default).unwrap_or_default();
    if !large.merge {
        mapped(set, options, Shard::WHOLE, &folder)?;
    }
    let bar = progress::bar(set.trials.len() as u64, "reading partial results");
    let merged = Merged::of_folder(set, options, &folder, |trials| bar.inc(trials as u64))?;
    bar.finish_and_clear();
    Ok(merged)
}

/// Fits all textures of a merge, with a progress bar, and encodes the library.
pub fn fit_merged(merged: &Merged<'_>, trials: usize) -> Result<(Fit, Vec<u8>)> {
    let bar = progress::bar(trials as u64, "fitting excitations");
    let fit = merged.fit(|| bar.inc(1))?;
    bar.finish_and_clear();
    let bytes = fit.library()?;
    Ok((fit, bytes))
}

/// Name of the folder of partial results in the folder of the libraries, unless --parts names another.
const PARTS: &str = "parts";

/// A library that was written.
#[derive(serde::Serialize)]
struct Written {
    texture: String,
    library: String,
    bytes: usize,
    trials: usize,
    /// Number of trials with a verdict of triage.
    doubtful: usize,
    warnings: Vec<Warning>,
}

/// Fits each texture of the set, or of the shard, and writes its library and record into the folder `out`, which is
/// made if it is not there.
pub fn write_each(
    set: &RecordingSet,
    options: &fit::Options,
    out: &Path,
    large: &LargeSet,
    is_json: bool,
) -> Result<()> {
    // Made before the checks below, which need a folder that accepts files.
    std::fs::create_dir_all(out).map_err(Error::io("create", out))?;
    let share = large.shard.unwrap_or(Shard::WHOLE);
    let mut stems = Stems::default();
    // Names of all textures, also of other shards' ones, so that each shard gives a texture the same file.
    let textures: Vec<(usize, &str, String)> = set
        .textures()
        .into_iter()
        .enumerate()
        .map(|(index, name)| (index, name, stems.of(name)))
        .collect();
    let own = || textures.iter().filter(|(index, ..)| share.has(*index));
    let path = |stem: &str| out.join(format!("{stem}.lib"));
    for (_, _, stem) in own() {
        check_in_growing_folder(&path(stem))?;
        check_in_growing_folder(&FitRecord::path_for(&path(stem)))?;
    }
    let merged = merged(set, options, Some(out.join(PARTS)), large)?;
    let bar = progress::bar(own().count() as u64, "fitting textures");
    let mut libraries = Vec::new();
    for (index, name, stem) in own() {
        libraries.push(library(&merged, *index, name, &path(stem), options)?);
        bar.inc(1);
    }
    bar.finish_and_clear();
    if is_json {
        return print_json(&serde_json::json!({ "libraries": libraries }));
    }
    let warnings = libraries.iter().flat_map(|written| written.warnings.clone());
    warn_of(&warnings.collect::<Vec<_>>());
    let rows: Vec<Vec<String>> = libraries.iter().map(row).collect();
    let header = ["texture", "trials", "with a verdict", "bytes", "library"];
    print(&table(&header, &rows))?;
    let trials: usize = libraries.iter().map(|written| written.trials).sum();
    let count = libraries.len();
    print(&format!(
        "\n{} -> {} in {}",
        counted(trials, "trial"),
        counted(count, "library"),
        out.display()
    ))
}

fn row(written: &Written) -> Vec<String> {
    vec![
        written.texture.clone(),
        written.trials.to_string(),
        written.doubtful.to_string(),
        written.bytes.to_string(),
        written.library.clone(),
    ]
}

/// Writes the library of the texture `index`.
fn library(merged: &Merged<'_>, index: usize, name: &str, path: &Path, options: &fit::Options) -> Result<Written> {
    let (set, contents, fit) = merged.fit_texture(index)?;
    let bytes = fit.library()?;
    FitRecord::with_contents(&set, options, &bytes, &contents)
        .with_account_of(&fit)
        .write_with(path, &bytes)?;
    let doubtful = |trial: &&TrialReport| trial.is_doubtful();
    Ok(Written {
        texture: name.to_owned(),
        library: path.display().to_string(),
        bytes: bytes.len(),
        trials: fit.trials.len(),
        doubtful: fit.trials.iter().filter(doubtful).count(),
        warnings: fit.warnings(),
    })
}
