//! The repository's own files: those that git tracks or would add.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;
use std::{fs, io};

/// Paths relative to the repository's root, with `/` between folders, and the files' texts. A file that is not text has
/// an empty text.
#[derive(Debug)]
pub struct Tree(BTreeMap<String, String>);

impl Tree {
    /// Reads the files below `root`.
    pub fn read(root: &Path) -> io::Result<Self> {
        let mut git = Command::new("git");
        git.args("ls-files -z --cached --others --exclude-standard".split(' '));
        let listed = git.current_dir(root).output()?.stdout;
        let mut files = BTreeMap::new();
        for path in String::from_utf8_lossy(&listed).split_terminator('\0') {
            let file = root.join(path);
            // Git also lists files whose removal is not committed yet, and links to folders.
            if file.is_file() {
                let text = String::from_utf8(fs::read(file)?).unwrap_or_default();
                files.insert(path.to_owned(), text);
            }
        }
        if files.is_empty() {
            return Err(io::Error::other("git lists no files here"));
        }
        Ok(Self(files))
    }

    /// Returns a tree of `files`, each a path and its text.
    #[cfg(test)]
    pub fn of(files: &[(&str, &str)]) -> Self {
        let file = |&(path, text): &(&str, &str)| (path.to_owned(), text.to_owned());
        Self(files.iter().map(file).collect())
    }

    /// All paths.
    pub fn paths(&self) -> impl Iterator<Item = &str> {
        self.0.keys().map(String::as_str)
    }

    /// Returns all files whose name has this `ending`.
    pub fn texts_of(&self, ending: &str) -> impl Iterator<Item = (&str, &str)> {
        (self.0.iter())
            .map(|(path, text)| (path.as_str(), text.as_str()))
            .filter(move |(path, _)| path.ends_with(ending))
    }

    /// Returns true if `path` is a file, or a folder that contains one.
    pub fn has(&self, path: &str) -> bool {
        let below = format!("{path}/");
        let mut after = self.paths().skip_while(|file| *file < path);
        path.is_empty() || after.any(|file| file == path || file.starts_with(&below))
    }
}

/// Resolves `path` relative to `folder`, without `.` and `..`; `None` if it leaves the repository.
pub fn joined(folder: &str, path: &str) -> Option<String> {
    let mut parts: Vec<&str> = folder.split('/').filter(|part| !part.is_empty()).collect();
    for part in path.split('/') {
        match part {
            "" | "." => {}
            ".." => drop(parts.pop()?),
            part => parts.push(part),
        }
    }
    Some(parts.join("/"))
}

/// Returns the folder of `path`; empty for the root.
pub fn folder(path: &str) -> &str {
    path.rsplit_once('/').map_or("", |(folder, _)| folder)
}
