//! Folders that are written whole or not at all.
//!
//! A new folder is written beside its place and renamed. In a folder that is there, where a shell may stand or a disk
//! be mounted, the result is written to a hidden folder, and its entries are renamed at the end. An earlier result of
//! the same command goes then, and only then. A list of what was written, [`LIST`], tells it from anything else, which
//! is never removed and never mixed with a result.
//!
//! The content of a result is on the disk before the result has its name, and the name is before it counts as done. So
//! a new folder is whole or not there also where the power fails. In a folder that is there, entries get their names
//! one after another, those last without which a result does not look whole.

use std::collections::BTreeSet;
use std::ffi::OsStr;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};

use super::atomic_file::folder_of;
use super::disk::{Disk, Steps, sync_tree};
use super::error::{Error, Result};
use super::output_file::check_folder;
use super::temporaries::{self, MadeFolders, TemporaryFolder};

/// Name of the list of the files that a command wrote into its folder.
pub const LIST: &str = ".made-by-stylus";

/// Entries that file managers leave in any folder.
const LITTER: [&str; 3] = [".DS_Store", "Thumbs.db", "desktop.ini"];

/// Entries that get their names last, because a result without them does not look whole.
const LAST: [&str; 3] = ["trials.csv", "index.html", LIST];

/// Folders in the hidden folder: the new result, and the earlier one while it is replaced.
const NEW: &str = "new";
const EARLIER: &str = "earlier";

/// Longest list that is read, bytes.
const MOST_LIST_BYTES: u64 = 64 << 20;

/// Finds the files of an earlier result in a folder, relative to it.
pub type Find<'a> = &'a dyn Fn(&Path) -> Result<Vec<PathBuf>>;

/// As [`Find`], kept.
type OwnedFind<'a> = Box<dyn Fn(&Path) -> Result<Vec<PathBuf>> + 'a>;

/// Checks that a folder can be written as `path`, and returns the files of the earlier result that it holds, by `find`.
///
/// # Errors
/// A file at the path, a folder that takes no files, and the errors of `find`.
pub fn check(path: &Path, find: Find<'_>) -> Result<Vec<PathBuf>> {
    match fs::symlink_metadata(path) {
        Ok(found) if found.is_symlink() && !path.exists() => {
            let problem =
                "is a link to a folder that is not there: remove the link, or name another folder";
            Err(Error::file(path, problem))
        }
        Ok(_) if path.is_dir() => {
            check_folder(path, path)?;
            find(path)
        }
        Ok(_) => {
            let problem = "is no folder, and a folder is to be written: name another";
            Err(Error::file(path, problem))
        }
        Err(failure) if failure.kind() == io::ErrorKind::NotFound => {
            let mut above = folder_of(path);
            while !above.exists() {
                above = folder_of(above);
            }
            check_folder(path, above).map(|()| Vec::new())
        }
        Err(failure) if failure.kind() == io::ErrorKind::NotADirectory => {
            let problem = "lies in a file, which is no folder: name another place";
            Err(Error::file(path, problem))
        }
        Err(failure) => Err(Error::io("write", path)(failure)),
    }
}

/// Returns the files of an earlier result of `command` in `folder`, relative to it: none in an empty folder.
///
/// # Errors
/// A folder with anything else, which is named.
pub fn earlier_of(folder: &Path, command: &str) -> Result<Vec<PathBuf>> {
    let files = files_in(folder)?;
    let Some(first) = files.iter().find(|file| !file.ends_with(LIST)) else {
        return Ok(files);
    };
    let refused = |file: &Path, why: &str| {
        let problem = format!(
            "the folder holds `{}`, {why}, and results are not mixed with other files: name a new or empty folder",
            file.display()
        );
        Err(Error::file(folder, problem))
    };
    let Some(listed) = list(folder, command)? else {
        return refused(first, &format!("and no earlier result of stylus {command}"));
    };
    let stranger = |file: &&PathBuf| !listed.contains(*file) && !file.ends_with(LIST);
    match files.iter().find(stranger) {
        Some(file) => refused(file, &format!("which stylus {command} did not write")),
        None => Ok(files),
    }
}

/// Reads the list of the files that `command` wrote into `folder`; `None` if there is none of that command.
fn list(folder: &Path, command: &str) -> Result<Option<BTreeSet<PathBuf>>> {
    let path = folder.join(LIST);
    let is_list = fs::symlink_metadata(&path)
        .is_ok_and(|found| found.is_file() && found.len() <= MOST_LIST_BYTES);
    if !is_list {
        return Ok(None);
    }
    let text = fs::read_to_string(&path).map_err(Error::io("read", &path))?;
    let mut lines = text.lines();
    let is_own = lines.next() == Some(&heading(command));
    Ok(is_own.then(|| lines.map(PathBuf::from).collect()))
}

fn heading(command: &str) -> String {
    format!(
        "# Written by stylus {command}, which replaces these files when it is run again; no other file is touched."
    )
}

/// Files in `folder` and below, relative to it, without temporaries and litter. Links are not followed.
fn files_in(folder: &Path) -> Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    let mut folders = vec![PathBuf::new()];
    while let Some(inner) = folders.pop() {
        let path = folder.join(&inner);
        let failed = |failure| Error::io("list", &path)(failure);
        for entry in fs::read_dir(&path).map_err(failed)? {
            let entry = entry.map_err(failed)?;
            let name = entry.file_name();
            let text = name.to_string_lossy();
            if text.starts_with(temporaries::PREFIX) || LITTER.contains(&&*text) {
                continue;
            }
            let relative = inner.join(&name);
            if entry.file_type().map_err(failed)?.is_dir() {
                folders.push(relative);
            } else {
                files.push(relative);
            }
        }
    }
    files.sort();
    Ok(files)
}

/// A folder that is being written.
pub struct OutputFolder<'a> {
    named: PathBuf,
    /// The result before it has its name.
    written: PathBuf,
    hidden: TemporaryFolder,
    /// The files of the earlier result in a folder that is there; none for a new folder.
    earlier: Option<Vec<PathBuf>>,
    made: MadeFolders,
    find: OwnedFind<'a>,
    command: Option<&'a str>,
}

impl<'a> OutputFolder<'a> {
    /// Begins the folder `path` of a result of `command`, which gets a [`LIST`].
    ///
    /// # Errors
    /// As [`check`] and [`earlier_of`].
    pub fn begin(path: &Path, command: &'a str) -> Result<Self> {
        let begun = Self::begin_over(path, move |folder: &Path| earlier_of(folder, command))?;
        Ok(Self {
            command: Some(command),
            ..begun
        })
    }

    /// Begins the folder `path`, where `find` knows the files of an earlier result.
    ///
    /// # Errors
    /// As [`check`].
    pub fn begin_over(
        path: &Path,
        find: impl Fn(&Path) -> Result<Vec<PathBuf>> + 'a,
    ) -> Result<Self> {
        let there = check(path, &find)?;
        let failed = |failure| Error::io("create", path)(failure);
        let is_new = !path.exists();
        let (home, made) = if is_new {
            let home = folder_of(path);
            (home, MadeFolders::make(home).map_err(failed)?)
        } else {
            (path, MadeFolders::default())
        };
        let hidden = TemporaryFolder::new_in(home).map_err(failed)?;
        let written = if is_new {
            hidden.path().to_owned()
        } else {
            let new = hidden.path().join(NEW);
            fs::create_dir(&new).map_err(failed)?;
            new
        };
        Ok(Self {
            named: path.to_owned(),
            written,
            hidden,
            earlier: (!is_new).then_some(there),
            made,
            find: Box::new(find),
            command: None,
        })
    }

    /// The folder to write to, which gets its name at the end.
    pub fn path(&self) -> &Path {
        &self.written
    }

    /// The path of `inner`, a path in [`OutputFolder::path`], after the end.
    pub fn named(&self, inner: &Path) -> PathBuf {
        match inner.strip_prefix(&self.written) {
            Ok(inner) => self.named.join(inner),
            Err(_) => inner.to_owned(),
        }
    }

    /// Writes the folder by `work`, and then gives it its name, in place of an earlier result.
    ///
    /// # Errors
    /// Those of `work`, with paths as they would be after the end, and a folder that has changed meanwhile or cannot be
    /// renamed. Nothing is left then, and the earlier result stays.
    pub fn fill<T>(self, work: impl FnOnce(&Self) -> Result<T>) -> Result<T> {
        let value = work(&self).map_err(|failure| failure.with_path(|path| self.named(path)))?;
        self.finish()?;
        Ok(value)
    }

    fn finish(self) -> Result<()> {
        self.finish_by(&Disk)
    }

    fn finish_by(self, steps: &impl Steps) -> Result<()> {
        // What is bound first is dropped last: the folders that were made are empty then, where it fails.
        let Self {
            named,
            written,
            made,
            hidden,
            earlier,
            find,
            command,
        } = self;
        if let Some(command) = command {
            let files = files_in(&written)?;
            let lines = files.iter().map(|file| format!("{}\n", file.display()));
            let text = format!("{}\n{}", heading(command), lines.collect::<String>());
            let list = written.join(LIST);
            fs::write(&list, text).map_err(Error::io("write", &named))?;
        }
        sync_tree(steps, &written).map_err(Error::io("bring to the disk", &named))?;
        let unnamed = Error::io("bring to the disk the name of", &named);
        let Some(earlier) = earlier else {
            steps
                .name(&named, || hidden.persist(&named))
                .map_err(Error::io("create", &named))?;
            let new = made.paths().iter().map(PathBuf::as_path).rev();
            let synced = std::iter::once(named.as_path())
                .chain(new)
                .try_for_each(|folder| steps.sync_folder(folder_of(folder)));
            made.keep();
            return synced.map_err(unnamed);
        };
        if find(&named)? != earlier {
            let problem =
                "the folder changed while the result was computed: name a new or empty folder";
            return Err(Error::file(&named, problem));
        }
        let aside = hidden.path().join(EARLIER);
        fs::create_dir(&aside).map_err(Error::io("create", &named))?;
        let replaced = temporaries::undisturbed(|| {
            steps.name(&named, || replace(&named, &earlier, &written, &aside))
        });
        replaced.map_err(Error::io("replace", &named))?;
        // Before the earlier result is removed.
        steps.sync_folder(&named).map_err(unnamed)
    }
}

/// Moves the `earlier` files' entries from `folder` to `aside`, and those of `written` to `folder`; undoes it where it
/// fails.
fn replace(folder: &Path, earlier: &[PathBuf], written: &Path, aside: &Path) -> io::Result<()> {
    let old: BTreeSet<&OsStr> = earlier
        .iter()
        .filter_map(|file| file.iter().next())
        .collect();
    let mut new = Vec::new();
    for entry in fs::read_dir(written)? {
        new.push(entry?.file_name());
    }
    new.sort_by_key(|name| (LAST.iter().any(|last| name == last), name.clone()));
    let moves = (old.iter().map(|name| (folder.join(name), aside.join(name)))).chain(
        new.iter()
            .map(|name| (written.join(name), folder.join(name))),
    );
    let mut done: Vec<(PathBuf, PathBuf)> = Vec::new();
    for (from, to) in moves {
        if let Err(failure) = fs::rename(&from, &to) {
            for (from, to) in done.iter().rev() {
                // Nothing better can be done where the way back is closed too.
                let _ = fs::rename(to, from);
            }
            return Err(failure);
        }
        done.push((from, to));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::super::disk::watched::Watched;
    use super::*;

    const COMMAND: &str = "demo";

    fn write(folder: &OutputFolder<'_>, names: &[&str]) {
        for name in names {
            let path = folder.path().join(name);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, names.concat()).unwrap();
        }
    }

    fn result(path: &Path, names: &[&str]) -> Result<()> {
        let folder = OutputFolder::begin(path, COMMAND)?;
        write(&folder, names);
        folder.finish()
    }

    /// All files below `folder` but the list, with those that are hidden.
    fn all(folder: &Path) -> Vec<String> {
        let mut found = Vec::new();
        for entry in fs::read_dir(folder).unwrap() {
            let entry = entry.unwrap();
            let name = entry.file_name().into_string().unwrap();
            if entry.path().is_dir() {
                let inner = all(&entry.path());
                found.extend(inner.iter().map(|inner| format!("{name}/{inner}")));
            } else if name != LIST {
                found.push(name);
            }
        }
        found.sort();
        found
    }

    #[test]
    fn a_folder_appears_whole_at_its_end_with_those_above_it() {
        let home = tempfile::tempdir().unwrap();
        let path = home.path().join("a/b");
        let folder = OutputFolder::begin(&path, COMMAND).unwrap();
        write(&folder, &["x", "y/z"]);
        assert!(!path.exists());
        folder.finish().unwrap();
        assert_eq!(all(home.path()), ["a/b/x", "a/b/y/z"]);
    }

    /// Writes a result to `path`, and gives the steps by which it came to the disk: relative to `home`, with `written`
    /// for the folder before it has its name.
    fn watched_steps(home: &Path, path: &Path, names: &[&str]) -> Vec<String> {
        let folder = OutputFolder::begin(path, COMMAND).unwrap();
        write(&folder, names);
        let written = folder.path().to_owned();
        let watched = Watched::default();
        folder.finish_by(&watched).unwrap();
        let steps = watched.steps().into_iter().map(|(step, path)| {
            let place = match path.strip_prefix(&written) {
                Ok(inner) => Path::new("written").join(inner),
                Err(_) => Path::new("home").join(path.strip_prefix(home).unwrap()),
            };
            format!("{step} {}", place.display())
                .trim_end_matches('/')
                .to_owned()
        });
        steps.collect()
    }

    #[test]
    fn all_content_is_on_the_disk_before_its_name_and_all_names_before_the_end() {
        let home = tempfile::tempdir().unwrap();
        let content = [
            "file written/.made-by-stylus",
            "file written/x",
            "file written/y/z",
            "folder written",
            "folder written/y",
        ];
        for (path, names) in [
            // A new folder, and one above it that is new as well.
            (
                "a/b",
                &["name home/a/b", "folder home/a", "folder home"][..],
            ),
            // In the place of an earlier result.
            ("a/b", &["name home/a/b", "folder home/a/b"]),
        ] {
            let steps = watched_steps(home.path(), &home.path().join(path), &["x", "y/z"]);
            let (before, after) = steps.split_at(content.len().min(steps.len()));
            let mut before = before.to_vec();
            assert_eq!(before.last().map(String::as_str), Some("folder written"));
            before.sort();
            assert_eq!(
                (before, after.to_vec()),
                (content.map(str::to_owned).to_vec(), {
                    names.iter().map(|&name| name.to_owned()).collect()
                })
            );
        }
    }

    #[test]
    fn content_that_does_not_come_to_the_disk_leaves_the_earlier_result() {
        let home = tempfile::tempdir().unwrap();
        let path = home.path().join("a/b");
        let failed = |step, end| {
            let folder = OutputFolder::begin(&path, COMMAND).unwrap();
            write(&folder, &["new", "y/z"]);
            let watched = Watched::failing_at(step, end);
            folder.finish_by(&watched).unwrap_err().to_string()
        };
        let message = failed("file", "y/z");
        assert!(message.contains("bring to the disk"), "{message}");
        assert_eq!(fs::read_dir(home.path()).unwrap().count(), 0);
        result(&path, &["x"]).unwrap();
        for (step, end) in [("file", "new"), ("folder", "y"), ("name", "b")] {
            let message = failed(step, end);
            assert!(message.contains("full"), "{message}");
            assert_eq!(all(home.path()), ["a/b/x"], "{step}");
        }
        // It has its name by then.
        failed("folder", "a/b");
        assert_eq!(all(home.path()), ["a/b/new", "a/b/y/z"]);
    }

    #[test]
    fn a_folder_that_is_given_up_leaves_nothing_new() {
        let home = tempfile::tempdir().unwrap();
        let path = home.path().join("a/b");
        drop(OutputFolder::begin(&path, COMMAND));
        assert_eq!(fs::read_dir(home.path()).unwrap().count(), 0);
        result(&path, &["x"]).unwrap();
        let folder = OutputFolder::begin(&path, COMMAND).unwrap();
        write(&folder, &["other"]);
        drop(folder);
        assert_eq!(all(home.path()), ["a/b/x"]);
    }

    #[test]
    fn the_same_command_replaces_its_own_result_in_the_same_folder() {
        let home = tempfile::tempdir().unwrap();
        let path = home.path().join("out");
        fs::create_dir(&path).unwrap();
        result(&path, &["x", "y/z", "index.html"]).unwrap();
        let before = super::super::same_file::Identity::of(&path);
        fs::write(path.join(".DS_Store"), "").unwrap();
        result(&path, &["w", "y/v", "index.html"]).unwrap();
        assert_eq!(all(&path), [".DS_Store", "index.html", "w", "y/v"]);
        // A shell that stands in it is still there.
        assert_eq!(super::super::same_file::Identity::of(&path), before);
    }

    #[test]
    fn other_files_are_named_and_left_alone() {
        let home = tempfile::tempdir().unwrap();
        let path = home.path().join("out");
        fs::create_dir(&path).unwrap();
        fs::write(path.join("mine"), "").unwrap();
        let message = result(&path, &["x"]).unwrap_err().to_string();
        assert!(
            message.contains("`mine`") && message.contains("no earlier result"),
            "{message}"
        );
        fs::remove_file(path.join("mine")).unwrap();
        result(&path, &["x", "y/z"]).unwrap();
        assert!(OutputFolder::begin(&path, "frontier").is_err());
        fs::write(path.join("y/mine"), "").unwrap();
        let message = result(&path, &["x"]).unwrap_err().to_string();
        assert!(
            message.contains("mine`, which stylus demo did not write"),
            "{message}"
        );
        assert_eq!(all(&path), ["x", "y/mine", "y/z"]);
    }

    #[test]
    fn a_file_that_comes_meanwhile_stops_the_end_and_stays() {
        let home = tempfile::tempdir().unwrap();
        let path = home.path().join("out");
        result(&path, &["x"]).unwrap();
        let folder = OutputFolder::begin(&path, COMMAND).unwrap();
        write(&folder, &["w"]);
        fs::write(path.join("mine"), "").unwrap();
        assert!(folder.finish().is_err());
        assert_eq!(all(&path), ["mine", "x"]);
        let new = home.path().join("new");
        let folder = OutputFolder::begin(&new, COMMAND).unwrap();
        write(&folder, &["w"]);
        fs::create_dir(&new).unwrap();
        fs::write(new.join("mine"), "").unwrap();
        assert!(folder.finish().is_err());
        assert_eq!(all(&new), ["mine"]);
    }

    #[test]
    fn a_file_in_the_way_is_refused() {
        let home = tempfile::tempdir().unwrap();
        fs::write(home.path().join("file"), "").unwrap();
        for path in ["file", "file/inner", "file/inner/deeper"] {
            assert!(result(&home.path().join(path), &["x"]).is_err(), "{path}");
        }
    }

    #[cfg(unix)]
    #[test]
    fn a_link_to_a_folder_is_followed_and_links_in_it_are_not() {
        let home = tempfile::tempdir().unwrap();
        let (path, elsewhere) = (home.path().join("out"), home.path().join("elsewhere"));
        fs::create_dir(&elsewhere).unwrap();
        std::os::unix::fs::symlink("elsewhere", &path).unwrap();
        result(&path, &["x"]).unwrap();
        assert_eq!(all(&elsewhere), ["x"]);
        assert!(path.is_symlink());
        std::os::unix::fs::symlink("/", elsewhere.join("root")).unwrap();
        assert!(result(&path, &["x"]).is_err());
    }
}
