//! Properties of the host's parsers of files, tables, texts and frames; files for the parsers, and checks that errors
//! name these files. Also the files that are judged by nothing else: an update, and the list of a result's files.

mod fitted;
mod frame;
mod large;
pub mod seeds;
mod texts;

use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use host_tools::link::upload::UpdateFile;
use host_tools::support::Error;
use host_tools::support::bounded_file::Format;
use host_tools::support::output::{LIST, check_folder};
use tempfile::TempDir;

use crate::Judge;

/// The targets by their names.
pub const TARGETS: [(&str, Judge); 12] = [
    ("trials", fitted::list),
    ("recordings", fitted::recording),
    ("tables", texts::tables),
    ("scenes", texts::scene),
    ("rigs", texts::rig),
    ("hatt", fitted::hatt),
    ("frames", frame::judge),
    ("settings", texts::settings),
    ("records", texts::record),
    ("updates", update),
    ("listings", listing),
    ("large", large::judge),
];

/// Returns the target that reads `format`; none for a partial result, whose hash refuses any changed byte.
// Without a pattern for the rest, so that a new format does not compile before it has a target.
pub const fn target_of(format: Format) -> Option<&'static str> {
    Some(match format {
        Format::Wave | Format::Table | Format::LabView => "recordings",
        Format::Strokes | Format::Plan | Format::Motion | Format::Answers => "tables",
        Format::Trials => "trials",
        Format::Scene => "scenes",
        Format::Rig => "rigs",
        Format::Hatt => "hatt",
        Format::Library => "decode",
        Format::Record => "records",
        Format::Update => "updates",
        Format::Listing => "listings",
        Format::Partial => return None,
    })
}

/// The folder of this run. It stays after the run, because a fuzzer ends without cleaning up; `smoke` removes it with
/// the folder around it.
fn folder() -> &'static Path {
    static FOLDER: OnceLock<TempDir> = OnceLock::new();
    FOLDER
        .get_or_init(|| TempDir::new().expect("there is room for a folder"))
        .path()
}

/// Path of a file of this run.
pub fn path(name: &str) -> PathBuf {
    folder().join(name)
}

/// Writes a file of this run.
pub fn written(name: &str, content: &[u8]) -> PathBuf {
    let path = path(name);
    std::fs::write(&path, content).expect("there is room for a file");
    path
}

/// Returns `text` with the sign before it that lists have before a formula.
pub fn guarded(text: &str) -> String {
    let is_formula = text.trim_start_matches('\'').starts_with(['=', '+', '-', '@']);
    format!("{}{text}", if is_formula { "'" } else { "" })
}

/// Checks that `error` names the file at `path`, and a line that exists in `content`.
pub fn check(error: &Error, path: &Path, content: &[u8]) {
    let text = error.to_string();
    assert!(text.starts_with(&path.display().to_string()), "no file in: {text}");
    assert!(text.len() < 100 * content.len() + 2000, "{} bytes of error", text.len());
    if let Error::Line { line, .. } = error {
        let lines = content.split(|&byte| byte == b'\n').count() as u64;
        assert!((1..=lines).contains(line), "line {line} of {lines}: {text}");
    }
}

/// Checks `input` as an update.
pub fn update(input: &[u8]) {
    let path = written("new.image", input);
    match UpdateFile::read(&path) {
        Ok(file) => assert!(file.header.length as usize <= input.len()),
        Err(error) => check(&error, &path, input),
    }
}

/// Checks `input` as the list of the files of a result that a command is to replace. A file that is not in the list
/// is the user's own, so that the folder is refused.
pub fn listing(input: &[u8]) {
    let result = path("result");
    std::fs::create_dir_all(&result).expect("there is room for a folder");
    written("result/own", b"");
    written(&format!("result/{LIST}"), input);
    // A line is a path, so that `own/` is the same file.
    let names = String::from_utf8_lossy(input);
    let lists_own = names.lines().any(|line| Path::new(line) == Path::new("own"));
    match check_folder(&result, true, &[]) {
        Ok(()) => assert!(lists_own),
        Err(error) => check(&error, &result, input),
    }
}
