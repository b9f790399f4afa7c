//! One departure from the drawn house.

use std::fmt;

/// A place and the rule that it breaks.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Finding {
    /// The file, from the repository's root.
    pub path: String,
    /// The line, from 1; 0 stands for the whole file.
    pub line: usize,
    /// The broken rule, with the remedy.
    pub problem: String,
}

impl Finding {
    /// A finding at `line` of `path`.
    pub fn new(path: &str, line: usize, problem: impl Into<String>) -> Self {
        Self {
            path: path.to_owned(),
            line,
            problem: problem.into(),
        }
    }
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            path,
            line,
            problem,
        } = self;
        if *line == 0 {
            write!(f, "{path}: {problem}")
        } else {
            write!(f, "{path}:{line}: {problem}")
        }
    }
}
