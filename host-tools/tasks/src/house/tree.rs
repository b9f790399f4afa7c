//! The repository's own files: those that git tracks or would track.
//!
//! Without git, as in an unpacked archive, all files below the root are taken except the folders of outputs.

use std::collections::BTreeMap;
use std::path::Path;
use std::process::Command;
use std::{fs, io};

/// Folders of outputs, which belong to no repository.
const OUTPUTS: [&str; 5] = [".git", "target", "demo-out", "corpus", "artifacts"];

/// File names' ends whose text is read. A name without a dot is read too, because it may be a script.
const TEXTS: [&str; 6] = [".rs", ".toml", ".md", ".x", ".sh", ".py"];

/// Paths from the repository's root, with `/` between folders, and the texts that the rules read.
#[derive(Clone, Debug, Default)]
pub struct Tree {
    files: BTreeMap<String, Option<String>>,
}

impl Tree {
    /// Reads the files below `root`.
    ///
    /// # Errors
    /// A file or folder cannot be read.
    pub fn read(root: &Path) -> io::Result<Self> {
        let paths = match listed_by_git(root) {
            Some(paths) => paths,
            None => walked(root)?,
        };
        let mut files = BTreeMap::new();
        for path in paths {
            let file = root.join(&path);
            if !file.is_file() {
                continue;
            }
            let text = if is_text(&path) {
                String::from_utf8(fs::read(file)?).ok()
            } else {
                None
            };
            files.insert(path, text);
        }
        Ok(Self { files })
    }

    /// A tree of `files`, each a path and its text.
    pub fn of(files: &[(&str, &str)]) -> Self {
        let file = |&(path, text): &(&str, &str)| (path.to_owned(), Some(text.to_owned()));
        Self {
            files: files.iter().map(file).collect(),
        }
    }

    /// All paths.
    pub fn paths(&self) -> impl Iterator<Item = &str> {
        self.files.keys().map(String::as_str)
    }

    /// All files whose text was read.
    pub fn texts(&self) -> impl Iterator<Item = (&str, &str)> {
        let texts = self.files.iter();
        texts.filter_map(|(path, text)| Some((path.as_str(), text.as_deref()?)))
    }

    /// True for a file, and for a folder that holds one.
    pub fn has(&self, path: &str) -> bool {
        let path = path.trim_end_matches('/');
        let below = format!("{path}/");
        path.is_empty()
            || self.files.contains_key(path)
            || self
                .files
                .range(below.clone()..)
                .next()
                .is_some_and(|(file, _)| file.starts_with(&below))
    }
}

fn is_text(path: &str) -> bool {
    let name = path.rsplit('/').next().unwrap_or(path);
    !name.contains('.') || TEXTS.iter().any(|end| name.ends_with(end))
}

/// `None` where git is missing, `root` is no repository of its own, or git lists nothing.
fn listed_by_git(root: &Path) -> Option<Vec<String>> {
    let output = Command::new("git")
        .args([
            "ls-files",
            "-z",
            "--cached",
            "--others",
            "--exclude-standard",
        ])
        .current_dir(root)
        .output()
        .ok()?;
    let text = String::from_utf8(output.stdout).ok()?;
    let paths = text.split_terminator('\0').map(str::to_owned);
    let paths: Vec<String> = paths.collect();
    (output.status.success() && !paths.is_empty()).then_some(paths)
}

fn walked(root: &Path) -> io::Result<Vec<String>> {
    let mut paths = Vec::new();
    let mut folders = vec![String::new()];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(root.join(&folder))? {
            let entry = entry?;
            let name = entry.file_name().to_string_lossy().into_owned();
            let path = format!("{folder}{name}");
            if !entry.file_type()?.is_dir() {
                paths.push(path);
            } else if !OUTPUTS.contains(&name.as_str()) {
                folders.push(format!("{path}/"));
            }
        }
    }
    Ok(paths)
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

/// The folder of `path`, empty for the root.
pub fn folder(path: &str) -> &str {
    path.rsplit_once('/').map_or("", |(folder, _)| folder)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_without_git_is_walked_but_for_outputs() {
        let root = tempfile::tempdir().unwrap();
        for file in ["a/b.rs", "a/c.svg", "target/d.rs", "run"] {
            let file = root.path().join(file);
            fs::create_dir_all(file.parent().unwrap()).unwrap();
            fs::write(file, "text").unwrap();
        }
        let mut paths = walked(root.path()).unwrap();
        paths.sort();
        assert_eq!(paths, ["a/b.rs", "a/c.svg", "run"]);
        let tree = Tree::read(root.path()).unwrap();
        let texts: Vec<_> = tree.texts().collect();
        assert_eq!(texts, [("a/b.rs", "text"), ("run", "text")]);
        assert!(tree.has("a") && tree.has("a/") && tree.has("a/c.svg"));
        assert!(!tree.has("a/b") && !tree.has("target/d.rs"));
    }

    #[test]
    fn a_relative_path_is_taken_from_its_folder() {
        assert_eq!(joined("a/b", "../c/./d.rs"), Some("a/c/d.rs".to_owned()));
        assert_eq!(joined("", "c"), Some("c".to_owned()));
        assert_eq!(joined("a", "../../c"), None);
    }
}
