//! Blocks of a page that a command writes: the lines between `<!-- table: NAME, made by ... -->` and `<!-- end -->`.
//!
//! This file uses only the standard library and anyhow, because the tests on the virtual stylus include it by its path:
//! their workspace does not build the tasks.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};

/// The beginning of a line that opens a block; the block's name follows.
pub const OPENING: &str = "<!-- table: ";

/// The line that closes a block.
pub const CLOSING: &str = "<!-- end -->";

/// A page in memory.
#[derive(Debug)]
pub struct Page {
    path: PathBuf,
    text: String,
}

impl Page {
    /// Reads the page at `path`.
    pub fn read(path: &Path) -> Result<Self> {
        let text = std::fs::read_to_string(path).with_context(|| path.display().to_string())?;
        let path = path.to_owned();
        Ok(Self { path, text })
    }

    /// Returns the content of block `name`, which consists of whole lines.
    pub fn block(&self, name: &str) -> Result<&str> {
        let (begin, end) = self.range(name)?;
        Ok(&self.text[begin..end])
    }

    /// Compares block `name` with `expected`, the lines that its command writes.
    pub fn check(&self, name: &str, expected: &str) -> Result<()> {
        let found = self.block(name)?;
        if found == expected {
            return Ok(());
        }
        let line = |text: &str, row| text.lines().nth(row).unwrap_or("(no line)").to_owned();
        let rows = 0..=found.lines().count();
        let differ = |row: &usize| line(found, *row) != line(expected, *row);
        let row = rows.clone().find(differ).unwrap_or(*rows.end());
        bail!(
            "{}, table '{name}', row {}: the page says\n  {}\nand it is\n  {}\nwrite it again: \
             `cargo tasks tables {name}`",
            self.path.display(),
            row + 1,
            line(found, row),
            line(expected, row)
        );
    }

    /// Writes `content` into block `name`. If the content changes, writes the page to its file and returns true.
    pub fn write(&mut self, name: &str, content: &str) -> Result<bool> {
        let (begin, end) = self.range(name)?;
        if self.text[begin..end] == *content {
            return Ok(false);
        }
        self.text.replace_range(begin..end, content);
        std::fs::write(&self.path, &self.text)?;
        Ok(true)
    }

    /// Returns the begin and the end of the content of block `name`.
    fn range(&self, name: &str) -> Result<(usize, usize)> {
        let missing = || {
            let (path, opening) = (self.path.display(), opening(name));
            format!("{path}: no table '{name}'; give it the lines `{opening}` and `{CLOSING}`")
        };
        let opening = opening(name);
        let begin = self.text.find(&opening).with_context(missing)? + opening.len() + 1;
        let rest = self.text.get(begin..).with_context(missing)?;
        let end = rest.find(CLOSING).with_context(missing)?;
        // If another block opens before this one closes, this one was left open.
        if rest[..end].contains(OPENING) {
            bail!(missing());
        }
        Ok((begin, begin + end))
    }
}

/// Returns the line that opens block `name`.
fn opening(name: &str) -> String {
    format!("{OPENING}{name}, made by `cargo tasks tables {name}` -->")
}
