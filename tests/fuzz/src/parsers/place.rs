//! Files for the parsers, and checks that errors name these files.

use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use host_tools::support::error::Error;
use tempfile::TempDir;

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
