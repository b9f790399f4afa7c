//! `stylus fit --each`: a library of its own for each texture, for sets that no library holds.

use std::path::Path;

use host_tools::fit;
use host_tools::fit::TrialReport;
use host_tools::fit::record::FitRecord;
use host_tools::fit::shard::{Merged, Shard};
use host_tools::recording::RecordingSet;
use host_tools::support::error::{Error, Result};
use host_tools::support::file_name::Stems;
use host_tools::support::{fnv::Fnv, progress};

use super::parts::{LargeSet, merged};
use crate::cli::output::{print, print_json, warn};
use crate::cli::table::table;
use host_tools::texture::library_file::read_library;

/// Folder of partial results in that of the libraries, unless --parts names another.
const PARTS: &str = "parts";

/// A library that was written, or was there.
#[derive(serde::Serialize)]
struct Written {
    texture: String,
    library: String,
    bytes: usize,
    trials: usize,
    /// Trials with a finding of triage.
    doubtful: usize,
    /// True if it was there of the same inputs.
    reused: bool,
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
    let header = [
        "texture",
        "trials",
        "with a verdict",
        "bytes",
        "library",
        "",
    ];
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
        if written.reused { "was there" } else { "" }.to_owned(),
    ]
}

/// Writes the library of the texture with the trials `members`, unless it is there of the same inputs.
fn library(
    merged: &Merged<'_>,
    members: &[usize],
    name: &str,
    path: &Path,
    options: &fit::Options,
) -> Result<Written> {
    let inputs = inputs(merged, members, options)?;
    let doubtful = |trial: &&TrialReport| !trial.verdicts.is_empty();
    let own = || members.iter().map(|&member| &merged.trials[member]);
    let written = |bytes: usize, reused: bool, warnings: Vec<String>| Written {
        texture: name.to_owned(),
        library: path.display().to_string(),
        bytes,
        trials: members.len(),
        doubtful: own().filter(doubtful).count(),
        reused,
        warnings,
    };
    if let Some(bytes) = reusable(path, &inputs) {
        return Ok(written(bytes, true, Vec::new()));
    }
    let (set, contents, fit) = merged.fit_texture(members)?;
    let bytes = fit.library()?;
    let record = FitRecord::with_contents(&set, options, &bytes, &contents);
    let record = FitRecord {
        inputs: Some(inputs),
        ..record.with_account_of(&fit)
    };
    record.write_with(path, &bytes)?;
    Ok(written(bytes.len(), false, fit.warnings))
}

/// Size of the library at `path`, if it and its record are of these `inputs`.
fn reusable(path: &Path, inputs: &str) -> Option<usize> {
    let bytes = read_library(path).ok()?;
    let record = FitRecord::beside(path, &bytes).ok()??;
    (record.inputs.as_deref() == Some(inputs)).then_some(bytes.len())
}

/// Hash of all that a texture's library comes from: program, options, and its trials with their verdicts.
fn inputs(merged: &Merged<'_>, members: &[usize], options: &fit::Options) -> Result<String> {
    let text = |value: serde_json::Result<String>| {
        value.map_err(|failure| Error::Model(format!("an input cannot be written: {failure}")))
    };
    let mut hash = Fnv::default()
        .then(env!("CARGO_PKG_VERSION").as_bytes())
        .then(text(serde_json::to_string(options))?.as_bytes());
    for &member in members {
        hash = hash
            .then(&merged.identity_of(member).to_le_bytes())
            .then(text(serde_json::to_string(&merged.trials[member]))?.as_bytes());
    }
    Ok(format!("{:016x}", hash.value()))
}
