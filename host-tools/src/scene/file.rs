//! A scene's text, read from its file, and errors that name the line in it.

use std::path::{Path, PathBuf};

use super::description::SceneDescription;
use crate::support::error::{Error, Result};
use crate::support::toml_field::TEXT;
use crate::support::toml_field::{Field, from_toml};

/// The text of a scene with its description. Nothing is looked up in a library yet: [`SceneFile::compile`] does that.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneFile {
    pub(super) path: PathBuf,
    pub(super) text: String,
    pub(super) description: SceneDescription,
}

impl SceneFile {
    /// Reads the file at `path`.
    ///
    /// # Errors
    /// A file that cannot be read, and what [`SceneFile::from_toml`] refuses.
    pub fn read(path: &Path) -> Result<Self> {
        let text = TEXT.read_text(path)?;
        Self::from_toml(path, &text)
    }

    /// Reads a scene from TOML `text`. Files that it names are relative to the folder of `path`.
    ///
    /// # Errors
    /// [`Error::Line`]: text that is not TOML, a key that is unknown, missing, or of the wrong type.
    pub fn from_toml(path: &Path, text: &str) -> Result<Self> {
        Ok(Self {
            path: path.to_owned(),
            text: text.to_owned(),
            description: from_toml(path, text)?,
        })
    }

    /// The content of the file.
    pub fn description(&self) -> &SceneDescription {
        &self.description
    }

    /// An error at `place` of the text.
    pub(super) fn error(&self, place: &Field, problem: impl std::fmt::Display) -> Error {
        place.error(&self.path, &self.text, problem)
    }
}
