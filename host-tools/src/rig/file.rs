//! A rig file: its text, and its description after the checks.

use std::path::Path;

use super::description::RigDescription;
use super::validate::check;
use crate::support::error::Result;
use crate::support::toml_field::from_toml;

/// The copy of the rig file.
pub(super) const RIG: &str = "rig.toml";

/// A rig file that was read and checked. It can only be made from its text, which it keeps.
#[derive(Debug, Clone, PartialEq)]
pub struct RigFile {
    description: RigDescription,
    text: String,
}

impl RigFile {
    /// Reads a rig from TOML `text`; `path` is only named in errors.
    ///
    /// # Errors
    /// [`Error::Line`](crate::support::error::Error::Line): text that is not TOML, a field that is unknown, missing, or
    /// of the wrong type, or a value out of its range, with the line and the field.
    pub fn from_toml(path: &Path, text: &str) -> Result<Self> {
        let description: RigDescription = from_toml(path, text)?;
        check(&description).map_err(|fault| fault.field.error(path, text, fault.problem))?;
        Ok(Self {
            description,
            text: text.to_owned(),
        })
    }

    /// The paper's protocol, 15 speeds by 8 forces by 4 textures, with surfaces and a tool of our own choosing.
    pub fn paper() -> Self {
        Self::from_toml(Path::new("rigs/paper-rig.toml"), PAPER_RIG)
            .expect("the rig file that comes with the program is sound; a test reads it")
    }

    /// The content of the file.
    pub fn description(&self) -> &RigDescription {
        &self.description
    }

    /// The text that it was read from, comments included.
    pub fn text(&self) -> &str {
        &self.text
    }
}

const PAPER_RIG: &str = include_str!("../../rigs/paper-rig.toml");
