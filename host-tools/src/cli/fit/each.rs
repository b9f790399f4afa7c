//! `stylus fit --each`: a library of its own for each texture, for sets that no library holds.

use std::path::Path;

use host_tools::fit;
use host_tools::fit::TrialReport;
use host_tools::fit::parts::{Merged, Shard};
use host_tools::fit::record::FitRecord;
use host_tools::recording::RecordingSet;
use host_tools::support::error::{Error, Result};
use host_tools::support::file_name::Stems;
use host_tools::support::progress;

use super::parts::{LargeSet, merged};
use crate::cli::output::{print, print_json, warn};
use crate::cli::table::table;

/// Folder of partial results in that of the libraries, unless --parts names another.
const PARTS: &str = "parts";

/// A library that was written.
#[derive(serde::Serialize)]
struct Written {
    texture: String,
    library: String,
    bytes: usize,
    trials: usize,
    /// Trials with a finding of triage.
    doubtful: usize,
    warnings: Vec<String>,
}

pub fn run(
    set: &RecordingSet,
    options: &fit::Options,
    out: &Path,
    (large, is_json): (&LargeSet, bool),
) -> Result<()> {
    std::fs::create_dir_all(out).map_err(Error::io("create", out))?;
    let merged = merged(set, options, Some(out.join(PARTS)), large)?;
    let share = large.shard.unwrap_or(Shard::WHOLE);
    let mut stems = Stems::default();
    let textures: Vec<(usize, &str, String, Vec<usize>)> = set
        .by_texture()
        .into_iter()
        .enumerate()
        .map(|(index, (name, members))| (index, name, stems.of(name), members))
        .collect();
    let own = || textures.iter().filter(|(index, ..)| share.has(*index));
    let bar = progress::bar(own().count() as u64, "fitting textures");
    let mut libraries = Vec::new();
    for (_, name, stem, members) in own() {
        let path = out.join(format!("{stem}.lib"));
        libraries.push(library(&merged, members, name, &path, options)?);
        bar.inc(1);
    }
    bar.finish_and_clear();
    if is_json {
        return print_json(&serde_json::json!({ "libraries": libraries }));
    }
    for written in &libraries {
        written.warnings.iter().for_each(|warning| warn(warning));
    }
    let rows: Vec<Vec<String>> = libraries.iter().map(row).collect();
    let header = ["texture", "trials", "with a verdict", "bytes", "library"];
    print(&table(&header, &rows))?;
    let trials: usize = libraries.iter().map(|written| written.trials).sum();
    let count = libraries.len();
    print(&format!(
        "\n{trials} trials -> {count} libraries in {}",
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

/// Writes the library of the texture with the trials `members`.
fn library(
    merged: &Merged<'_>,
    members: &[usize],
    name: &str,
    path: &Path,
    options: &fit::Options,
) -> Result<Written> {
    let (set, contents, fit) = merged.fit_texture(members)?;
    let bytes = fit.library()?;
    let record = FitRecord::with_contents(&set, options, &bytes, &contents);
    record.with_account_of(&fit).write_with(path, &bytes)?;
    let doubtful = |trial: &&TrialReport| !trial.verdicts.is_empty();
    Ok(Written {
        texture: name.to_owned(),
        library: path.display().to_string(),
        bytes: bytes.len(),
        trials: members.len(),
        doubtful: fit.trials.iter().filter(doubtful).count(),
        warnings: fit.warnings,
    })
}
