//! A rig file: its text, and its description after the checks.

use std::path::Path;

use super::description::RigDescription;
use super::validate::check;
use crate::support::error::Result;
use crate::support::toml_field::{TEXT, from_toml};

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

/// Returns whether `recording` belongs to a simulated set whose rig has the surface `texture`, the drum, the tool and
/// the errors of measuring of [`RigFile::paper`]. Speeds, forces and durations may differ.
///
/// It looks for the copy of the rig file two folders above the recording, where
/// [`simulate_to_folder`](super::simulate_to_folder) puts it; without one the answer is no.
pub fn is_of_the_papers_rig(recording: &Path, texture: &str) -> bool {
    let Some(folder) = recording.parent().and_then(Path::parent) else {
        return false;
    };
    let path = folder.join(RIG);
    let Ok(text) = TEXT.read_text(&path) else {
        return false;
    };
    let Ok(rig) = RigFile::from_toml(&path, &text) else {
        return false;
    };
    let paper = RigFile::paper();
    let (rig, paper) = (rig.description(), paper.description());
    let named = |rig: &super::RigDescription| {
        let mut textures = rig.textures.iter();
        textures.find(|known| known.name == texture).cloned()
    };
    let surface = named(rig);
    surface.is_some()
        && surface == named(paper)
        && (&rig.drum, &rig.tool, &rig.measurement)
            == (&paper.drum, &paper.tool, &paper.measurement)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_surface_is_the_papers_by_its_description_and_not_by_its_name() {
        let folder = tempfile::tempdir().unwrap();
        let recording = folder.path().join("paper/simulated_100mm_s_1N.wav");
        let is_papers = |texture| is_of_the_papers_rig(&recording, texture);
        assert!(!is_papers("paper"));
        let put = |text: &str| std::fs::write(folder.path().join(RIG), text).unwrap();
        let paper = RigFile::paper();
        put(paper.text());
        assert!(is_papers("paper") && is_papers("denim") && !is_papers("felt"));
        let fewer = paper.text().replace("1.2, 1.4]", "1.2]");
        assert_ne!(fewer, paper.text());
        put(&fewer);
        assert!(is_papers("paper"));
        let other = paper
            .text()
            .replace("tip_radius_mm = 1.5", "tip_radius_mm = 1.6");
        assert_ne!(other, paper.text());
        put(&other);
        assert!(!is_papers("paper"));
        put("not a rig");
        assert!(!is_papers("paper"));
    }
}
