//! The folder that a simulated set is written to: new, empty, or an earlier simulated set and nothing else.

use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};

use crate::support::error::{Error, Result};
use crate::support::output_folder;
use crate::support::temporaries::PREFIX;
use crate::support::toml_field::TEXT;

/// The note that the set is simulated; written before any recording.
pub(super) const MARKER: &str = "SIMULATED.txt";
/// The marker's first words, so that another file of that name is not mistaken for it.
pub(super) const MARKER_START: &str = "SIMULATED. Nothing in this folder was measured.";
/// The table of trials; written after everything else.
pub(super) const TRIALS: &str = "trials.csv";
/// The copy of the rig file.
pub(super) const RIG: &str = "rig.toml";
/// Prefix of the name of every recording.
pub(super) const RECORDING_PREFIX: &str = "simulated_";

/// Returns the files of the earlier simulated set in `out`, relative to it: none if the folder is empty.
///
/// # Errors
/// A folder that holds anything but an earlier simulated set.
pub(super) fn earlier(out: &Path) -> Result<Vec<PathBuf>> {
    let Contents { recordings, others } = list(out)?;
    if recordings.is_empty() && others.is_empty() {
        return Ok(Vec::new());
    }
    let marker = out.join(MARKER);
    let marked =
        others.contains(&marker) && TEXT.read(&marker)?.starts_with(MARKER_START.as_bytes());
    if !marked {
        return Err(Error::file(
            out,
            format!(
                "the folder is not empty and is no simulated set (its {MARKER} is missing, or was not written by \
                 simulate-rig); name a new or empty folder"
            ),
        ));
    }
    let files = recordings.iter().chain(&others);
    let files = files.filter_map(|file| file.strip_prefix(out).ok());
    Ok(files.map(Path::to_owned).collect())
}

/// Checks that a simulated set can be written to `out`.
///
/// # Errors
/// As [`output_folder::check`], and a folder that holds anything but an earlier simulated set.
pub fn check(out: &Path) -> Result<()> {
    output_folder::check(out, &earlier).map(drop)
}

/// The files of a simulated set.
struct Contents {
    recordings: Vec<PathBuf>,
    others: Vec<PathBuf>,
}

/// Lists the files of a simulated set.
///
/// # Errors
/// A file that a simulated set does not have.
fn list(out: &Path) -> Result<Contents> {
    let mut contents = Contents {
        recordings: Vec::new(),
        others: Vec::new(),
    };
    for path in entries(out)? {
        let name = path.file_name().and_then(OsStr::to_str).unwrap_or("");
        if name.starts_with(PREFIX) {
            // Another run's, or left behind when the machine stopped.
        } else if is_plain(&path, fs::FileType::is_dir)? {
            for inner in entries(&path)? {
                if !is_recording(&inner)? {
                    return Err(foreign(out, &inner));
                }
                contents.recordings.push(inner);
            }
        } else if is_plain(&path, fs::FileType::is_file)? && [MARKER, TRIALS, RIG].contains(&name) {
            contents.others.push(path);
        } else {
            return Err(foreign(out, &path));
        }
    }
    Ok(contents)
}

fn is_recording(path: &Path) -> Result<bool> {
    let name = path.file_name().and_then(OsStr::to_str).unwrap_or("");
    Ok(name.starts_with(RECORDING_PREFIX)
        && path.extension() == Some(OsStr::new("wav"))
        && is_plain(path, fs::FileType::is_file)?)
}

/// Returns true if `path` itself is of this kind. Links are not followed, because their targets may belong to others.
fn is_plain(path: &Path, kind: impl Fn(&fs::FileType) -> bool) -> Result<bool> {
    let metadata = fs::symlink_metadata(path).map_err(Error::io("read", path))?;
    Ok(kind(&metadata.file_type()))
}

fn entries(folder: &Path) -> Result<Vec<PathBuf>> {
    let read = |source| Error::io("list", folder)(source);
    let mut paths = fs::read_dir(folder)
        .map_err(read)?
        .map(|entry| entry.map(|entry| entry.path()).map_err(read))
        .collect::<Result<Vec<_>>>()?;
    paths.sort();
    Ok(paths)
}

fn foreign(out: &Path, path: &Path) -> Error {
    let name = path.strip_prefix(out).unwrap_or(path);
    Error::file(
        out,
        format!(
            "the folder holds `{}`, which is no part of a simulated set, and simulated files are not mixed with \
             others; name a new or empty folder",
            name.display()
        ),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    fn put(folder: &Path, name: &str, content: &str) {
        let path = folder.join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, content).unwrap();
    }

    fn files(folder: &Path) -> Vec<PathBuf> {
        let mut all = Vec::new();
        for path in entries(folder).unwrap() {
            if path.is_dir() {
                all.extend(files(&path));
            } else {
                all.push(path);
            }
        }
        all
    }

    fn simulated_set() -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        put(folder.path(), MARKER, MARKER_START);
        put(folder.path(), TRIALS, "");
        put(folder.path(), RIG, "");
        put(folder.path(), "denim/simulated_20mm_s_0.0N.wav", "");
        folder
    }

    #[test]
    fn an_earlier_simulated_set_is_known_with_all_its_files() {
        let folder = simulated_set();
        put(folder.path(), ".stylus-abcdef/new/half.wav", "");
        let mut found = earlier(folder.path()).unwrap();
        found.sort();
        let expected = [MARKER, "denim/simulated_20mm_s_0.0N.wav", RIG, TRIALS].map(PathBuf::from);
        assert_eq!(found, expected);
    }

    #[test]
    fn a_folder_with_anything_else_is_refused_and_left_alone() {
        for stray in [
            "notes.txt",
            "denim/measured.wav",
            "denim/deeper/simulated_1.wav",
            "denim/simulated_1.txt",
        ] {
            let folder = simulated_set();
            put(folder.path(), stray, "mine");
            let before = files(folder.path());
            let message = earlier(folder.path()).unwrap_err().to_string();
            let named = stray.split("/simulated_1.wav").next().unwrap();
            assert!(message.contains(named), "{message}");
            assert_eq!(files(folder.path()), before);
        }
    }

    #[test]
    fn without_its_marker_a_set_is_not_taken_for_a_simulated_one() {
        let folder = simulated_set();
        fs::remove_file(folder.path().join(MARKER)).unwrap();
        assert!(
            earlier(folder.path())
                .unwrap_err()
                .to_string()
                .contains(MARKER)
        );
        put(folder.path(), MARKER, "I wrote this");
        assert!(earlier(folder.path()).is_err());
        assert_eq!(files(folder.path()).len(), 4);
    }

    #[cfg(unix)]
    #[test]
    fn links_are_not_followed() {
        let elsewhere = simulated_set();
        let folder = simulated_set();
        std::os::unix::fs::symlink(
            elsewhere.path().join("denim"),
            folder.path().join("organza"),
        )
        .unwrap();
        assert!(earlier(folder.path()).is_err());
        assert_eq!(files(elsewhere.path()).len(), 4);
    }
}
