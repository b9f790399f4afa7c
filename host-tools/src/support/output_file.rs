//! The rule for files that are about to be written, checked before the work for them begins.

use std::fs;
use std::path::Path;

use super::atomic_file::{folder_of, target};
use super::error::{Error, Result};
use super::file_kind::{Content, FileKind};
use super::temporaries;

/// Checks that a file of this `kind` can be written as `path`: it would replace nothing but a regular file of the same
/// kind or an empty one, and its folder takes files. With `replaces_other_kinds`, the kind of the earlier file does not
/// matter.
///
/// `remedy` is another way out than a file of another name, such as an option.
///
/// # Errors
/// The first of these that does not hold.
pub fn check(path: &Path, kind: FileKind, replaces_other_kinds: bool, remedy: &str) -> Result<()> {
    if path.file_name().is_none() || ends_as_a_folder(path) {
        let problem = "names a folder, where a file is to be written: name a file in it";
        return Err(Error::file(path, problem));
    }
    let target = target(path)?;
    check_folder(path, folder_of(&target))?;
    let Ok(found) = fs::metadata(&target) else {
        return Ok(());
    };
    if found.permissions().readonly() {
        let problem =
            "is there, and must not be written: name another file, or change its permissions";
        return Err(Error::file(path, problem));
    }
    let held = match FileKind::of_file(&target) {
        Ok(Content::Empty) => return Ok(()),
        Ok(Content::Of(held)) if held == kind => return Ok(()),
        _ if replaces_other_kinds => return Ok(()),
        Ok(Content::Of(held)) => held.name(),
        Ok(Content::Unknown) => "something of another kind",
        // It is not known what would be lost.
        Err(_) => "something that cannot be read",
    };
    let problem = format!(
        "holds {held}, and {} would replace it: name another file{remedy}",
        kind.name()
    );
    Err(Error::file(path, problem))
}

/// Checks that `folder` is there and takes files, for the output that is named `path`.
///
/// # Errors
/// A folder that is missing, is none, or takes no files.
pub fn check_folder(path: &Path, folder: &Path) -> Result<()> {
    let problem = if !folder.exists() {
        format!(
            "there is no folder {}: make it, or name another place",
            folder.display()
        )
    } else if !folder.is_dir() {
        format!(
            "{} is a file and no folder: name another place",
            folder.display()
        )
    } else if let Err(reason) = temporaries::try_in(folder) {
        format!(
            "nothing can be written to the folder {} ({reason}): name another place",
            folder.display()
        )
    } else {
        return Ok(());
    };
    Err(Error::file(path, problem))
}

/// Returns true for a path with a separator at its end.
fn ends_as_a_folder(path: &Path) -> bool {
    path.as_os_str()
        .as_encoded_bytes()
        .last()
        .is_some_and(|&last| std::path::is_separator(last as char))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_nothing_empty_files_and_files_of_the_kind_are_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        fs::write(at("json"), "{}").unwrap();
        fs::write(at("empty"), "").unwrap();
        fs::write(at("diary"), "today\n").unwrap();
        for (name, kind, is_fine) in [
            ("new", FileKind::Wav, true),
            ("empty", FileKind::Wav, true),
            ("json", FileKind::Json, true),
            ("json", FileKind::Wav, false),
            ("diary", FileKind::Csv, false),
        ] {
            assert_eq!(check(&at(name), kind, false, "").is_ok(), is_fine, "{name}");
            assert!(check(&at(name), kind, true, "").is_ok(), "{name}");
        }
        assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 3);
    }

    #[test]
    fn the_folder_that_is_missing_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("nowhere/page.html");
        let message = check(&path, FileKind::Html, true, "").unwrap_err();
        let expected = format!(
            "there is no folder {}",
            folder.path().join("nowhere").display()
        );
        assert!(message.to_string().contains(&expected), "{message}");
        fs::write(folder.path().join("nowhere"), "").unwrap();
        let message = check(&path, FileKind::Html, true, "").unwrap_err();
        assert!(message.to_string().contains("no folder: name"), "{message}");
        let slash = folder.path().join("page.html/");
        assert!(check(&slash, FileKind::Html, true, "").is_err());
    }
}
