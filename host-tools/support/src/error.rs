//! Failures and warnings in words for the user: the problem, its place, and the remedy. Warnings are shown once per
//! kind.

use std::borrow::Cow;
use std::fmt;
use std::path::{Path, PathBuf};

use serde::{Serialize, Serializer};

/// A failure of a host tool. Each message is one line that names the file, the place in it and the remedy.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file or folder could not be read or written.
    #[error("{path}: cannot {action}: {source}", path = path.display())]
    Io {
        /// The operation, as a verb.
        action: &'static str,
        /// The file or folder.
        path: PathBuf,
        /// The operating system's reason.
        source: std::io::Error,
    },
    /// The content of a file cannot be used.
    #[error("{path}: {problem}", path = path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// The problem and the remedy.
        problem: String,
    },
    /// A line of a text file cannot be used.
    #[error("{path}, line {line}: {problem}", path = path.display())]
    Line {
        /// The file.
        path: PathBuf,
        /// The line, from 1.
        line: u64,
        /// The problem and the remedy.
        problem: String,
    },
    /// The bytes of a texture library are not valid.
    #[error("{path}: {source}", path = path.display())]
    Library {
        /// The file.
        path: PathBuf,
        /// The problem and its place.
        source: model_format::DecodeError,
    },
    /// Models cannot be encoded as a library.
    #[error("{0}")]
    Model(String),
    /// A request cannot be fulfilled, for a reason that is not in a file.
    #[error("{0}")]
    Request(String),
}

/// Result of a host tool.
pub type Result<T> = std::result::Result<T, Error>;

impl Error {
    /// Returns a function for `map_err` that adds the operation and the file to an I/O error.
    pub fn io(action: &'static str, path: &Path) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.to_owned();
        move |source| Self::Io { action, path, source }
    }

    /// Returns an error about the content of a file.
    pub fn file(path: &Path, problem: impl Into<String>) -> Self {
        Self::File {
            path: path.to_owned(),
            problem: problem.into(),
        }
    }

    /// Returns an error about a line, from 1, of a file.
    pub fn line(path: &Path, line: u64, problem: impl Into<String>) -> Self {
        Self::Line {
            path: path.to_owned(),
            line,
            problem: problem.into(),
        }
    }
    /// Returns the error with its path, if it has one, replaced by the result of `of`.
    #[must_use]
    pub(crate) fn with_path(mut self, of: impl FnOnce(&Path) -> PathBuf) -> Self {
        if let Self::Io { path, .. } | Self::File { path, .. } | Self::Line { path, .. } | Self::Library { path, .. } =
            &mut self
        {
            *path = of(path);
        }
        self
    }
}

/// A doubt about a recording, a texture or a whole set. It is serialised as its text.
#[derive(Clone, Debug, PartialEq)]
pub struct Warning {
    /// Kind of the warning. Warnings of the same kind are shown as one.
    kind: Cow<'static, str>,
    /// Noun and name of the subject of the warning; `None` for a whole set.
    subject: Option<(&'static str, String)>,
    /// Size of the problem. Among warnings of a kind, the largest is the worst.
    magnitude: f64,
    /// The finding and the remedy.
    text: String,
}

impl Warning {
    /// Creates a warning about a whole set.
    pub fn of_set(kind: impl Into<Cow<'static, str>>, text: impl Into<String>) -> Self {
        Self {
            kind: kind.into(),
            subject: None,
            magnitude: 0.0,
            text: text.into(),
        }
    }

    /// Creates a warning about a texture.
    pub fn of_texture(kind: &'static str, name: &str, magnitude: f64, text: String) -> Self {
        Self::of(kind, ("texture", &format!("'{name}'")), magnitude, text)
    }

    /// Creates a warning about the subject with this noun and name, such as a recording.
    pub fn of(kind: &'static str, (noun, name): (&'static str, &str), magnitude: f64, text: impl Into<String>) -> Self {
        Self {
            subject: Some((noun, name.to_owned())),
            magnitude,
            ..Self::of_set(kind, text)
        }
    }
}

impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.subject {
            Some((noun, name)) => write!(f, "{noun} {name}: {}", self.text),
            None => f.write_str(&self.text),
        }
    }
}

impl Serialize for Warning {
    fn serialize<S: Serializer>(&self, serializer: S) -> std::result::Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

/// Returns one line per kind, in the order in which the kinds first occur: the count, the names of the two worst
/// subjects, and the text of the worst warning.
pub fn by_kind(warnings: &[Warning]) -> Vec<String> {
    let mut kinds: Vec<Vec<&Warning>> = Vec::new();
    for warning in warnings {
        match kinds.iter_mut().find(|alike| alike[0].kind == warning.kind) {
            Some(alike) => alike.push(warning),
            None => kinds.push(vec![warning]),
        }
    }
    let line = |alike: &mut Vec<&Warning>| {
        // The sort is stable, so that of equals the first stays the worst.
        alike.sort_by(|a, b| b.magnitude.total_cmp(&a.magnitude));
        let Some((noun, worst)) = alike[0].subject.as_ref().filter(|_| alike.len() > 1) else {
            return alike[0].to_string();
        };
        let next = alike[1].subject.as_ref().map_or("", |(_, name)| name);
        let text = &alike[0].text;
        format!("{} {noun}s, the worst {worst} and {next}: {text}", alike.len())
    };
    kinds.iter_mut().map(line).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_kind_is_one_line_with_its_count_and_its_two_worst_and_no_kind_is_lost() {
        let of = |kind, name: &str, size: f64| Warning::of_texture(kind, name, size, format!("{size} off"));
        let all = [
            of("loud", "a", 1.0),
            of("late", "b", 2.0),
            of("loud", "c", 3.0),
            Warning::of_set("scale", "no scale"),
            of("loud", "d", 2.0),
        ];
        let lines = [
            "3 textures, the worst 'c' and 'd': 3 off",
            "texture 'b': 2 off",
            "no scale",
        ];
        assert_eq!(by_kind(&all), lines);
        assert_eq!(by_kind(&all[..2]), ["texture 'a': 1 off", lines[1]]);
    }
}
