//! `stylus fit --parts`: partial results in a folder, computed by one process or by many.

use std::path::{Path, PathBuf};

use host_tools::fit;
use host_tools::fit::Fit;
use host_tools::fit::shard::{Mapped, Merged, Shard, map};
use host_tools::recording::RecordingSet;
use host_tools::support::error::Result;
use host_tools::support::progress;

use crate::cli::output::{print, print_json};

/// Options for sets that one library, one run or one machine is too small for.
#[derive(clap::Args)]
pub struct LargeSet {
    /// Write a library of its own for each texture, for sets of more textures than one library holds
    #[arg(long, conflicts_with_all = ["densify", "budget_cycles"])]
    pub each: bool,
    /// Folder of partial results: what was computed of a trial is kept there, and not computed again
    #[arg(long, value_name = "DIR")]
    pub parts: Option<PathBuf>,
    /// Compute shard I of N only, and leave its partial results in --parts; with --merge --each, write the libraries of
    /// every N-th texture
    #[arg(long, value_name = "I/N", requires = "parts")]
    pub shard: Option<Shard>,
    /// Join the shards in --parts instead of computing them
    #[arg(long, requires = "parts", requires = "out")]
    pub merge: bool,
}

impl LargeSet {
    fn folder(&self) -> Option<PathBuf> {
        self.parts.clone()
    }

    /// The shard to compute and leave in --parts, if that is all there is to do.
    pub fn shard_to_map(&self) -> Option<Shard> {
        self.shard.filter(|_| !self.merge)
    }
}

/// Report of a shard, as JSON.
#[derive(serde::Serialize)]
struct ShardReport {
    shard: String,
    part: String,
    trials: usize,
    reused: usize,
}

/// Computes one shard.
pub fn map_shard(
    set: &RecordingSet,
    options: &fit::Options,
    shard: Shard,
    (large, is_json): (&LargeSet, bool),
) -> Result<()> {
    let folder = large.folder().unwrap_or_default();
    let Mapped {
        path,
        trials,
        reused,
    } = mapped(set, options, shard, &folder)?;
    if is_json {
        return print_json(&ShardReport {
            shard: shard.to_string(),
            part: path.display().to_string(),
            trials,
            reused,
        });
    }
    print(&format!(
        "shard {shard}: {trials} of {} trials -> {} ({reused} were there)",
        set.trials.len(),
        path.display()
    ))
}

fn mapped(
    set: &RecordingSet,
    options: &fit::Options,
    shard: Shard,
    folder: &Path,
) -> Result<Mapped> {
    // The units of a shard are of different sizes, so that its share is known to a few trials only.
    let share = (set.trials.len() as u64).div_ceil(u64::from(shard.of));
    let bar = progress::bar(share, "analysing trials");
    let mapped = map(set, options, shard, folder, |trials| bar.inc(trials as u64))?;
    bar.finish_and_clear();
    Ok(mapped)
}

/// Joins the shards of --parts, or of `default`; computes what is not there first, unless --merge says that all is.
pub fn merged<'s>(
    set: &'s RecordingSet,
    options: &fit::Options,
    default: Option<PathBuf>,
    large: &LargeSet,
) -> Result<Merged<'s>> {
    let folder = large.folder().or(default).unwrap_or_default();
    let whole = if large.merge {
        None
    } else {
        Some(mapped(set, options, Shard::WHOLE, &folder)?.path)
    };
    let bar = progress::bar(set.trials.len() as u64, "reading partial results");
    let progress = |trials| bar.inc(trials as u64);
    let merged = match whole {
        Some(path) => Merged::of_files(set, options, &[path], progress)?,
        None => Merged::of_folder(set, options, &folder, progress)?,
    };
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
