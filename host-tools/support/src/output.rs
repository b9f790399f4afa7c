//! The rule for outputs, which is checked before a command starts its work, and folders that are written whole or not
//! at all.
//!
//! An existing output is replaced only if the user asks for it (`overwrite`). An input, pipe, device or folder is never
//! replaced by a file. A folder that a command wrote contains [`LIST`], the list of its files. A folder with any other
//! file is refused, so that nothing is removed that no command wrote. Files that file managers leave in a folder are
//! kept.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::{fs, io};

use super::atomic_file::{REMEDY, appeared, expect_new, target};
use super::bounded_file::Format;
use super::names::portable;
use super::temporaries::{self, Earlier, Temporary, folder_of, left_aside};
use crate::{Error, Result};

/// Name of the list of the files that a command wrote into its folder.
pub const LIST: &str = ".made-by-stylus";

/// Files that file managers leave in any folder.
const LITTER: [&str; 3] = [".DS_Store", "Thumbs.db", "desktop.ini"];

/// Checks that a file can be written as `path`. There must be no file or an empty one; with `overwrite`, there may be a
/// regular file that is none of `inputs`. The folder must accept files. Without `overwrite`, a file that appears there
/// before this process writes it is not replaced either.
///
/// # Errors
/// The first of these conditions that does not hold, with the remedy.
pub fn check_file(path: &Path, overwrite: bool, inputs: &[PathBuf]) -> Result<()> {
    // `Path` ignores a separator at the end, with which the user means a folder.
    let last = path.as_os_str().as_encoded_bytes().last();
    if last.is_none_or(|&last| std::path::is_separator(last as char)) {
        let problem = "names a folder, where a file is to be written: name a file in it";
        return Err(Error::file(path, problem));
    }
    let target = target(path)?;
    check_place(path, folder_of(&target))?;
    expect_new(&target, !overwrite);
    let Ok(found) = fs::metadata(&target) else {
        return Ok(());
    };
    if let Some(input) = inputs.iter().find(|input| is_same(input, &target)) {
        let problem = format!(
            "is an input of the command ({}): name another file to write",
            input.display()
        );
        return Err(Error::file(path, problem));
    }
    if found.len() > 0 && !overwrite {
        return Err(Error::file(path, format!("is there already: {REMEDY}")));
    }
    Ok(())
}

/// Returns true if both paths lead to the same file, by another spelling, a link or, on Unix, a hard link.
fn is_same(one: &Path, other: &Path) -> bool {
    #[cfg(unix)]
    if let (Ok(one), Ok(other)) = (fs::metadata(one), fs::metadata(other)) {
        use std::os::unix::fs::MetadataExt;
        return (one.dev(), one.ino()) == (other.dev(), other.ino());
    }
    matches!((fs::canonicalize(one), fs::canonicalize(other)), (Ok(one), Ok(other)) if one == other)
}

/// Checks that `folder` exists and accepts files, for the output that is named `path`.
fn check_place(path: &Path, folder: &Path) -> Result<()> {
    let shown = folder.display();
    let problem = if !folder.exists() {
        format!("there is no folder {shown}: make it, or name another place")
    } else if !folder.is_dir() {
        format!("{shown} is a file and no folder: name another place")
    } else if let Err(reason) = temporaries::try_in(folder) {
        format!("nothing can be written to the folder {shown} ({reason}): name another place")
    } else {
        return Ok(());
    };
    Err(Error::file(path, problem))
}

/// Checks that a folder can be written as `path`. There must be no folder or an empty one; with `overwrite`, there may
/// be a folder with an earlier result and nothing else, which contains none of `inputs`.
///
/// # Errors
/// The first of these conditions that does not hold, with the remedy.
pub fn check_folder(path: &Path, overwrite: bool, inputs: &[PathBuf]) -> Result<()> {
    if path.is_symlink() && !path.exists() {
        let problem = "is a link to a folder that is not there: remove the link, or name another folder";
        return Err(Error::file(path, problem));
    }
    let Ok(folder) = fs::canonicalize(path) else {
        if let Some(aside) = left_aside(path) {
            let problem = format!(
                "its earlier result is in {}, because a command was killed as it replaced it: rename that to {}, or \
                 remove it",
                aside.display(),
                path.display()
            );
            return Err(Error::file(path, problem));
        }
        return check_place(path, folder_of(path));
    };
    if !folder.is_dir() {
        let problem = "is no folder, and a folder is to be written: name another";
        return Err(Error::file(path, problem));
    }
    check_place(path, &folder)?;
    let content = Content::of(&folder)?;
    if content.files.is_empty() && content.empty.is_empty() {
        return Ok(());
    }
    let is_within = |input: &&PathBuf| fs::canonicalize(input).is_ok_and(|input| input.starts_with(&folder));
    if let Some(input) = inputs.iter().find(is_within) {
        let problem = format!(
            "holds an input of the command ({}): name another folder",
            input.display()
        );
        return Err(Error::file(path, problem));
    }
    // A list that leads to a device without an end is refused here, before it is read.
    let list = match Format::Listing.open(&folder.join(LIST)) {
        Ok(_) => Format::Listing.read_text(&folder.join(LIST))?,
        Err(Error::Io { source, .. }) if source.kind() == io::ErrorKind::NotFound => String::new(),
        Err(failure) => return Err(failure),
    };
    let listed: BTreeSet<&Path> = list.lines().map(Path::new).collect();
    // An empty folder belongs to the earlier run if the list names it, or files in it.
    let is_own = |inner: &&PathBuf| {
        listed
            .range(inner.as_path()..)
            .next()
            .is_some_and(|listed| listed.starts_with(inner))
    };
    let mut files = content.files.iter();
    let foreign = files.find(|file| !listed.contains(file.as_path()));
    if let Some(file) = foreign.or(content.empty.iter().find(|inner| !is_own(inner))) {
        let problem = format!(
            "the folder holds `{}`, which no earlier run wrote, and results are not mixed with other files: name a new \
             or empty folder",
            file.display()
        );
        return Err(Error::file(path, problem));
    }
    if !overwrite {
        return Err(Error::file(
            path,
            format!("an earlier result is there already: {REMEDY}"),
        ));
    }
    Ok(())
}

/// Content of a folder and its subfolders, as paths relative to the folder. Links are not followed.
#[derive(Default)]
struct Content {
    /// Files and links, except the list and litter.
    files: Vec<PathBuf>,
    /// Folders that contain nothing, or only litter.
    empty: Vec<PathBuf>,
    litter: Vec<PathBuf>,
}

impl Content {
    fn of(folder: &Path) -> Result<Self> {
        let mut content = Self::default();
        let mut folders = vec![PathBuf::new()];
        while let Some(inner) = folders.pop() {
            let path = folder.join(&inner);
            let failed = |failure| Error::io("list", &path)(failure);
            let mut is_empty = true;
            for entry in fs::read_dir(&path).map_err(failed)? {
                let entry = entry.map_err(failed)?;
                let (name, kind) = (entry.file_name(), entry.file_type().map_err(failed)?);
                let relative = inner.join(&name);
                // A folder of such a name may hold a user's own files.
                if kind.is_file() && LITTER.iter().any(|litter| name == *litter) {
                    content.litter.push(relative);
                    continue;
                }
                is_empty = false;
                if kind.is_dir() {
                    folders.push(relative);
                } else if !(kind.is_file() && name == LIST) {
                    content.files.push(relative);
                }
            }
            if is_empty && !inner.as_os_str().is_empty() {
                content.empty.push(inner);
            }
        }
        content.files.sort();
        Ok(content)
    }
}

/// A folder that is written under a temporary name next to its final place, and renamed at the end.
pub struct OutputFolder {
    named: PathBuf,
    overwrite: bool,
    hidden: Temporary,
}

impl OutputFolder {
    /// Begins to write the folder `path`. With `overwrite`, it will replace an earlier result.
    pub fn begin(path: &Path, overwrite: bool) -> Result<Self> {
        check_folder(path, overwrite, &[])?;
        let place = fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
        let hidden = Temporary::folder_in(folder_of(&place)).map_err(Error::io("create", path))?;
        Ok(Self {
            named: path.to_owned(),
            overwrite,
            hidden,
        })
    }

    /// Returns the folder to write to. It is renamed at the end.
    pub fn path(&self) -> &Path {
        self.hidden.path()
    }

    /// Returns the final path of `inner`, a path in [`OutputFolder::path`].
    pub fn named(&self, inner: &Path) -> PathBuf {
        match inner.strip_prefix(self.path()) {
            Ok(inner) => self.named.join(inner),
            Err(_) => inner.to_owned(),
        }
    }

    /// Writes the folder by `work`, and then renames it to its final name, which replaces an earlier result.
    ///
    /// # Errors
    /// The errors of `work`, with final paths; other files that were added at the place meanwhile; or a folder that
    /// cannot be renamed. After an error, nothing of the new result is left, and the earlier result stays.
    pub fn fill<T>(self, work: impl FnOnce(&Self) -> Result<T>) -> Result<T> {
        let value = work(&self).map_err(|failure| failure.with_path(|path| self.named(path)))?;
        self.finish()?;
        Ok(value)
    }

    fn finish(self) -> Result<()> {
        let Self {
            named,
            overwrite,
            hidden,
        } = self;
        let Content { files, empty, .. } = Content::of(hidden.path())?;
        let mut list = String::new();
        for file in files.iter().chain(&empty) {
            list.push_str(&format!("{}\n", portable(file)));
        }
        fs::write(hidden.path().join(LIST), list).map_err(Error::io("write", &named))?;
        check_folder(&named, overwrite, &[])?;
        let failed = |failure: io::Error| appeared(&named, failure);
        if !named.exists() {
            synced(hidden.path()).map_err(failed)?;
            return hidden.persist(&named, Earlier::Nothing).map_err(failed);
        }
        let place = fs::canonicalize(&named).map_err(failed)?;
        for litter in Content::of(&place)?.litter {
            let kept = hidden.path().join(&litter);
            fs::create_dir_all(folder_of(&kept)).map_err(failed)?;
            fs::copy(place.join(&litter), kept).map_err(failed)?;
        }
        synced(hidden.path()).map_err(failed)?;
        hidden.persist(&place, Earlier::Folder).map_err(failed)
    }
}

/// Brings all files of `folder` and its subfolders to the disk, and the folders themselves where a system can.
fn synced(folder: &Path) -> io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let entry = entry?;
        let kind = entry.file_type()?;
        if kind.is_dir() {
            synced(&entry.path())?;
        } else if kind.is_file() && cfg!(unix) {
            fs::File::open(entry.path())?.sync_all()?;
        }
    }
    if cfg!(unix) {
        fs::File::open(folder)?.sync_all()
    } else {
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use test_helpers::holds;

    fn result(path: &Path, overwrite: bool, names: &[&str]) -> Result<()> {
        OutputFolder::begin(path, overwrite)?.fill(|folder| {
            for name in names {
                let path = folder.path().join(name);
                fs::create_dir_all(path.parent().unwrap()).unwrap();
                fs::write(path, names.concat()).unwrap();
            }
            Ok(())
        })
    }

    fn refusal(outcome: Result<()>) -> String {
        outcome.unwrap_err().to_string()
    }

    #[test]
    fn a_folder_appears_whole_and_replaces_its_earlier_result_alone() {
        let home = tempfile::tempdir().unwrap();
        let path = home.path().join("out");
        result(&path, false, &["x", "y/z"]).unwrap();
        assert!(refusal(result(&path, false, &["x"])).contains("--overwrite"));
        fs::write(path.join(".DS_Store"), "").unwrap();
        result(&path, true, &["x"]).unwrap();
        assert!(path.join("x").is_file() && !path.join("y").exists());
        fs::write(path.join("notes.txt"), "mine").unwrap();
        assert!(refusal(result(&path, true, &["x"])).contains("notes.txt"));
        fs::remove_file(path.join("notes.txt")).unwrap();
        assert!(refusal(check_folder(&path, true, &[path.join("x")])).contains("holds an input"));
        let outcome = OutputFolder::begin(&path, true).unwrap().fill(|folder| {
            fs::write(folder.path().join("half"), "").unwrap();
            Err::<(), _>(Error::file(&folder.path().join("half"), "stopped"))
        });
        assert!(refusal(outcome).contains("out/half"));
        assert_eq!(Content::of(&path).unwrap().files, [Path::new("x")]);
        assert_eq!(fs::read_dir(home.path()).unwrap().count(), 1);
    }

    #[test]
    fn nothing_that_no_run_wrote_is_lost_by_a_replacement() {
        for mine in [
            ".stylus-mine/a",
            ".stylus-notes.txt",
            "Thumbs.db/a",
            ".made-by-stylus-too",
            "y/.made-by-stylus/a",
            "y/.stylus-a",
            "mine/",
            "y/mine/",
        ] {
            let home = tempfile::tempdir().unwrap();
            let path = home.path().join("out");
            result(&path, false, &["x", "y/z"]).unwrap();
            if let Some(folder) = mine.strip_suffix('/') {
                fs::create_dir(path.join(folder)).unwrap();
            } else {
                fs::create_dir_all(folder_of(&path.join(mine))).unwrap();
                fs::write(path.join(mine), "mine").unwrap();
            }
            assert!(refusal(result(&path, true, &["x"])).contains(mine.trim_end_matches('/')));
            assert!(path.join(mine).exists() && path.join("y/z").exists());
        }
    }

    #[test]
    fn what_file_managers_left_is_kept_and_a_folder_whose_files_are_gone_is_no_reason_to_refuse() {
        let home = tempfile::tempdir().unwrap();
        let path = home.path().join("out");
        result(&path, false, &["x", "y/z"]).unwrap();
        fs::write(path.join("Thumbs.db"), "views").unwrap();
        fs::write(path.join("y/.DS_Store"), "places").unwrap();
        fs::remove_file(path.join("y/z")).unwrap();
        result(&path, true, &["x"]).unwrap();
        fs::write(path.join("z"), "mine").unwrap();
        fs::write(path.join(LIST), "x\nz/deep\n").unwrap();
        assert!(refusal(result(&path, true, &["x"])).contains("`z`"));
        assert_eq!(fs::read(path.join("Thumbs.db")).unwrap(), b"views");
        assert_eq!(fs::read(path.join("y/.DS_Store")).unwrap(), b"places");
    }

    #[cfg(unix)]
    #[test]
    fn a_list_without_an_end_is_refused_and_not_read() {
        let home = tempfile::tempdir().unwrap();
        let path = home.path().join("out");
        result(&path, false, &["x"]).unwrap();
        fs::remove_file(path.join(LIST)).unwrap();
        std::os::unix::fs::symlink("/dev/zero", path.join(LIST)).unwrap();
        holds(&refusal(result(&path, true, &["x"])), &[LIST]);
        fs::remove_file(path.join(LIST)).unwrap();
        fs::File::create(path.join(LIST))
            .unwrap()
            .set_len((16 << 20) + 1)
            .unwrap();
        holds(&refusal(result(&path, true, &["x"])), &["16777216 bytes"]);
    }

    #[test]
    fn an_empty_folder_is_filled() {
        let home = tempfile::tempdir().unwrap();
        result(home.path(), false, &["x"]).unwrap();
        assert!(home.path().join("x").is_file());
    }

    #[cfg(unix)]
    #[test]
    fn a_link_to_a_folder_is_followed_and_one_to_nothing_is_refused() {
        let home = tempfile::tempdir().unwrap();
        let at = |name: &str| home.path().join(name);
        fs::create_dir(at("real")).unwrap();
        std::os::unix::fs::symlink("real", at("link")).unwrap();
        std::os::unix::fs::symlink("nothing", at("dangling")).unwrap();
        result(&at("link"), false, &["x"]).unwrap();
        assert!(at("link").is_symlink() && at("real/x").is_file());
        assert!(refusal(result(&at("dangling"), true, &["x"])).contains("not there"));
    }
}
