//! Blocks of a page that a command writes: lines between `<!-- table: NAME, made by ... -->` and `<!-- end -->`.
//!
//! This file uses the standard library and thiserror alone, because the tests on the virtual stylus include it by its
//! path: their workspace does not build the tasks.

use std::path::{Path, PathBuf};

/// The beginning of a line that opens a block; the block's name follows.
pub const OPENING: &str = "<!-- table: ";

/// The line that closes a block.
pub const CLOSING: &str = "<!-- end -->";

/// A page whose block is not what its command writes.
#[derive(Debug, thiserror::Error)]
pub enum PageError {
    /// The page cannot be read or written.
    #[error("{path}: {source}", path = path.display())]
    Io {
        /// The page.
        path: PathBuf,
        /// The reason.
        source: std::io::Error,
    },
    /// The page has no block of this name.
    #[error(
        "{path}: no table '{name}'; give it the lines `{}` and `{CLOSING}`", opening(name),
        path = path.display()
    )]
    Missing {
        /// The page.
        path: PathBuf,
        /// The table.
        name: String,
    },
    /// The block's content is not what its command writes.
    #[error(
        "{path}, table '{name}', row {row}: the page says\n  {found}\nand it is\n  {expected}\n\
         write it anew: `cargo tasks tables {name}`",
        path = path.display()
    )]
    Stale {
        /// The page.
        path: PathBuf,
        /// The table.
        name: String,
        /// The first line that differs, from 1, counted from the opening line.
        row: usize,
        /// That line of the page.
        found: String,
        /// The line that the command writes.
        expected: String,
    },
}

/// A page in memory.
#[derive(Debug)]
pub struct Page {
    path: PathBuf,
    text: String,
}

impl Page {
    /// Reads the page at `path`.
    ///
    /// # Errors
    /// It cannot be read.
    pub fn read(path: &Path) -> Result<Self, PageError> {
        let text = std::fs::read_to_string(path).map_err(|source| PageError::Io {
            path: path.to_owned(),
            source,
        })?;
        Ok(Self {
            path: path.to_owned(),
            text,
        })
    }

    /// The content of block `name`: whole lines.
    ///
    /// # Errors
    /// The page has no such block, or the block does not end.
    pub fn block(&self, name: &str) -> Result<&str, PageError> {
        let (begin, end) = self.range(name)?;
        Ok(&self.text[begin..end])
    }

    /// Compares block `name` with `expected`, the lines that its command writes.
    ///
    /// # Errors
    /// There is no such block, or a line differs.
    pub fn check(&self, name: &str, expected: &str) -> Result<(), PageError> {
        let found = self.block(name)?;
        if found == expected {
            return Ok(());
        }
        let (mut found, mut expected) = (found.lines(), expected.lines());
        let mut row = 0;
        loop {
            row += 1;
            let pair = (found.next(), expected.next());
            if pair.0 != pair.1 || pair == (None, None) {
                let line = |line: Option<&str>| line.unwrap_or("(no line)").to_owned();
                return Err(PageError::Stale {
                    path: self.path.clone(),
                    name: name.to_owned(),
                    row,
                    found: line(pair.0),
                    expected: line(pair.1),
                });
            }
        }
    }

    /// Writes `content` into block `name`, and the page to its file if that changes it. Returns whether it did.
    ///
    /// # Errors
    /// There is no such block, or the page cannot be written.
    pub fn write(&mut self, name: &str, content: &str) -> Result<bool, PageError> {
        let (begin, end) = self.range(name)?;
        if self.text[begin..end] == *content {
            return Ok(false);
        }
        self.text.replace_range(begin..end, content);
        std::fs::write(&self.path, &self.text).map_err(|source| PageError::Io {
            path: self.path.clone(),
            source,
        })?;
        Ok(true)
    }

    /// Where the content of block `name` begins and ends.
    fn range(&self, name: &str) -> Result<(usize, usize), PageError> {
        let missing = || PageError::Missing {
            path: self.path.clone(),
            name: name.to_owned(),
        };
        let opening = opening(name);
        let begin = self.text.find(&opening).ok_or_else(missing)? + opening.len() + 1;
        let rest = self.text.get(begin..).ok_or_else(missing)?;
        let end = rest.find(CLOSING).ok_or_else(missing)?;
        // Another block that opens before this one closes is one that was left open.
        if rest[..end].contains(OPENING) {
            return Err(missing());
        }
        Ok((begin, begin + end))
    }
}

/// The line that opens block `name`.
fn opening(name: &str) -> String {
    format!("{OPENING}{name}, made by `cargo tasks tables {name}` -->")
}
