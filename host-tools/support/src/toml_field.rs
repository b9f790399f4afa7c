//! TOML texts: parsing, the fields of a text, and checks of values with errors that name the field.

use std::path::Path;

use model_format::limits::MAX_NAME_BYTES;
use serde::de::DeserializeOwned;
use toml::de::DeTable;

use crate::names;
use crate::{Error, Result};

/// Parses TOML `text`; errors name `path`.
///
/// # Errors
/// The text is not TOML, or a field is unknown, missing or of the wrong type. The error states the line.
pub fn from_toml<T: DeserializeOwned>(path: &Path, text: &str) -> Result<T> {
    toml::from_str(text).map_err(|failure| parse_failure(path, text, &failure))
}

/// Returns the error that `text`, the content of `path`, cannot be parsed, with its line.
fn parse_failure(path: &Path, text: &str, failure: &toml::de::Error) -> Error {
    let start = failure.span().map_or(0, |span| span.start);
    // A message of this project is one line.
    let problem = failure.message().trim_end().replace('\n', "; ");
    Error::line(path, line_at(text, start), problem)
}

/// A field of a TOML text, as the path of keys and indices that leads to it.
#[derive(Debug, Clone, Default)]
pub struct Field(Vec<Step>);

#[derive(Debug, Clone, Copy)]
enum Step {
    Key(&'static str),
    Item(usize),
}

impl Field {
    /// Returns the field `key` of this table.
    #[must_use]
    pub fn key(&self, key: &'static str) -> Self {
        self.with(Step::Key(key))
    }

    /// Returns the entry of this list at `index`, from 0.
    #[must_use]
    pub fn item(&self, index: usize) -> Self {
        self.with(Step::Item(index))
    }

    /// Returns an error about this field of `text`, the content of `path`.
    pub fn error(&self, path: &Path, text: &str, problem: impl std::fmt::Display) -> Error {
        Error::line(path, line_of(text, self), format!("{self}: {problem}"))
    }

    fn with(&self, step: Step) -> Self {
        let mut steps = self.0.clone();
        steps.push(step);
        Self(steps)
    }
}

impl std::fmt::Display for Field {
    /// Writes a field such as `texture[2].roughness.rms_um`, with indices from 1 for a reader of the file.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        for (position, step) in self.0.iter().enumerate() {
            match step {
                Step::Key(key) if position > 0 => write!(f, ".{key}")?,
                Step::Key(key) => f.write_str(key)?,
                Step::Item(index) => write!(f, "[{}]", index + 1)?,
            }
        }
        Ok(())
    }
}

/// A value outside its range.
pub struct Fault {
    /// The field with this value.
    pub field: Field,
    /// The range and the value, in words that follow the field's name.
    pub problem: String,
}

/// The result of a check of a field.
pub type Checked = std::result::Result<(), Fault>;

impl Field {
    fn fault(&self, problem: impl Into<String>) -> Fault {
        Fault {
            field: self.clone(),
            problem: problem.into(),
        }
    }

    /// Requires that a condition holds.
    pub fn require(&self, holds: bool, problem: impl FnOnce() -> String) -> Checked {
        if holds { Ok(()) } else { Err(self.fault(problem())) }
    }

    /// Requires a value above `low` and at most `high`; NaN is outside.
    pub fn over(&self, value: f64, low: f64, high: f64) -> Checked {
        self.require(value > low && value <= high, || {
            format!("must be above {low} and at most {high}, but is {value}")
        })
    }

    /// Requires a value from `low` to `high`; NaN is outside.
    pub fn within(&self, value: f64, low: f64, high: f64) -> Checked {
        self.require((low..=high).contains(&value), || {
            format!("must be from {low} to {high}, but is {value}")
        })
    }

    /// Requires values from `low` to `high`; NaN is outside.
    ///
    /// # Errors
    /// The first value that is outside, with its index in the list.
    pub fn each_within(&self, values: &[f64], low: f64, high: f64) -> Checked {
        values
            .iter()
            .enumerate()
            .try_for_each(|(index, value)| self.item(index).within(*value, low, high))
    }

    /// Requires a list of `least` to `most` entries.
    pub fn count(&self, count: usize, least: usize, most: usize) -> Checked {
        self.require((least..=most).contains(&count), || {
            format!("must have {least} to {most} entries, but has {count}")
        })
    }

    /// Requires values in ascending order without repeats.
    ///
    /// # Errors
    /// The first value that is not above the previous one.
    pub fn ascending(&self, values: &[f64]) -> Checked {
        for (index, pair) in values.windows(2).enumerate() {
            self.item(index + 1).require(pair[0] < pair[1], || {
                format!("must ascend without repeats, and {} follows {}", pair[1], pair[0])
            })?;
        }
        Ok(())
    }

    /// Requires a name that every system accepts as the name of a folder and that a table can hold as a field.
    ///
    /// # Errors
    /// The name is empty or too long, some system refuses it, or it begins with neither a letter nor a digit.
    pub fn name(&self, name: &str) -> Checked {
        self.require(!name.is_empty(), || "must not be empty".into())?;
        self.require(name.len() <= MAX_NAME_BYTES, || {
            format!("must be at most {MAX_NAME_BYTES} bytes long, but is {}", name.len())
        })?;
        if let Some(fault) = names::fault(name) {
            return Err(self.fault(format!("is {name:?}; {fault}")));
        }
        self.require(name.starts_with(char::is_alphanumeric), || {
            format!("is {name:?}; must start with a letter or a digit")
        })
    }
}

/// Returns the line, from 1, of the byte at the index `byte` of `text`.
fn line_at(text: &str, byte: usize) -> u64 {
    let before = text.get(..byte).unwrap_or(text);
    1 + before.matches('\n').count() as u64
}

/// Returns the line, from 1, of a field, or of the nearest enclosing field that the text contains; 1 if it contains
/// none.
pub fn line_of(text: &str, field: &Field) -> u64 {
    let Ok(document) = DeTable::parse(text) else {
        return 1;
    };
    let Some((Step::Key(first), rest)) = field.0.split_first() else {
        return 1;
    };
    let Some(mut value) = document.get_ref().get(*first) else {
        return 1;
    };
    let mut start = value.span().start;
    for step in rest {
        let inner = match step {
            Step::Key(key) => value.get_ref().get(*key),
            Step::Item(index) => value.get_ref().get(*index),
        };
        let Some(inner) = inner else { break };
        value = inner;
        start = value.span().start;
    }
    line_at(text, start)
}
