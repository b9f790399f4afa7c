//! The repository's own files: those that git tracks or would track.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;
use std::{fs, io};

/// Extensions of the files whose text is read. A file without one is read too, because it may be a script.
const TEXTS: [&str; 7] = ["", "rs", "toml", "md", "x", "sh", "py"];

/// Paths from the repository's root, with `/` between folders, and the texts that the rules read.
#[derive(Debug)]
pub struct Tree(BTreeMap<String, Option<String>>);

impl Tree {
    /// Reads the files below `root`.
    ///
    /// # Errors
    /// Git is missing or lists nothing, or a file cannot be read.
    pub fn read(root: &Path) -> io::Result<Self> {
        let mut git = Command::new("git");
        git.args([
            "ls-files",
            "-z",
            "--cached",
            "--others",
            "--exclude-standard",
        ]);
        let listed = git.current_dir(root).output()?.stdout;
        let mut files = BTreeMap::new();
        for path in String::from_utf8_lossy(&listed).split_terminator('\0') {
            let file = root.join(path);
            if file.is_file() {
                let is_text = TEXTS.contains(&extension(path));
                let bytes = is_text.then(|| fs::read(file)).transpose()?;
                let text = bytes.and_then(|bytes| String::from_utf8(bytes).ok());
                files.insert(path.to_owned(), text);
            }
        }
        if files.is_empty() {
            return Err(io::Error::other("git lists no files here"));
        }
        Ok(Self(files))
    }

    /// A tree of `files`, each a path and its text.
    #[cfg(test)]
    pub fn of(files: &[(&str, &str)]) -> Self {
        let file = |&(path, text): &(&str, &str)| (path.to_owned(), Some(text.to_owned()));
        Self(files.iter().map(file).collect())
    }

    /// All paths.
    pub fn paths(&self) -> impl Iterator<Item = &str> {
        self.0.keys().map(String::as_str)
    }

    /// All files whose text was read.
    pub fn texts(&self) -> impl Iterator<Item = (&str, &str)> {
        let texts = self.0.iter();
        texts.filter_map(|(path, text)| Some((path.as_str(), text.as_deref()?)))
    }

    /// All texts of the kind that `extension` names, without the dot.
    pub fn texts_of(&self, extension: &str) -> impl Iterator<Item = (&str, &str)> {
        self.texts()
            .filter(move |(path, _)| self::extension(path) == extension)
    }

    /// True for a file, and for a folder that holds one.
    pub fn has(&self, path: &str) -> bool {
        let path = path.trim_end_matches('/');
        let below = format!("{path}/");
        let mut after = self.paths().skip_while(|file| *file < path);
        path.is_empty() || after.any(|file| file == path || file.starts_with(&below))
    }
}

/// `path` as seen from `folder`, without `.` and `..`; `None` where it leaves the repository.
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

/// The extension of a file's name, empty if it has none.
pub fn extension(path: &str) -> &str {
    let name = path.rsplit('/').next().unwrap_or(path);
    name.rsplit_once('.').map_or("", |(_, extension)| extension)
}

/// The folder of `path`, empty for the root.
pub fn folder(path: &str) -> &str {
    path.rsplit_once('/').map_or("", |(folder, _)| folder)
}
