//! Choice of what a texture plays: all of it, or without the parts that are stored in addition to its filter.

use model_format::{PartsSpec, Texture, TextureSpec, encode};
use serde::Serialize;
use stylus_fit::scene::texture_spec;
use stylus_fit::texture::library::decoded;
use stylus_support::{Error, Result};

/// A choice of a texture's parts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, clap::ValueEnum)]
#[serde(rename_all = "snake_case")]
pub enum Played {
    /// All parts, as fitted.
    #[default]
    Fitted,
    /// The filter alone, excited by Gaussian noise.
    Gaussian,
    /// The recording's own excitation and its level, without the lines that are tied to position.
    Residual,
}

/// A version of a texture that was played in addition to the synthesis.
#[derive(Clone, Debug)]
pub struct Version {
    /// The choice.
    pub played: Played,
    /// The parts that are left, in words.
    pub parts: String,
    /// The synthesis, m/s², after warming up.
    pub synthesised: Vec<f64>,
}

impl Played {
    /// Returns those of the stored parts that are played.
    pub fn of(self, stored: &PartsSpec) -> PartsSpec {
        match self {
            Self::Fitted => stored.clone(),
            Self::Gaussian => PartsSpec::default(),
            Self::Residual => PartsSpec {
                lines: None,
                ..stored.clone()
            },
        }
    }

    /// Returns the choices whose parts differ from those of this choice and from each other.
    pub fn beside(self, stored: &PartsSpec) -> Vec<Self> {
        let mut known = vec![self.of(stored)];
        let mut beside = Vec::new();
        // Gaussian comes first: a choice that leaves no parts is called by that name.
        for choice in [Self::Gaussian, Self::Residual, Self::Fitted] {
            let parts = choice.of(stored);
            if !known.contains(&parts) {
                known.push(parts);
                beside.push(choice);
            }
        }
        beside
    }
}

/// The parts that a texture has.
pub fn parts(texture: &Texture<'_>) -> PartsSpec {
    texture_spec(texture).parts
}

/// Parts in words: `Gaussian` where no excitation is stored.
pub fn in_words(parts: &PartsSpec) -> String {
    let PartsSpec { excitation, lines } = parts;
    [
        ("recorded snippets", excitation.is_some()),
        ("Gaussian", excitation.is_none()),
        ("lines", lines.is_some()),
    ]
    .iter()
    .filter(|(_, is_there)| *is_there)
    .map(|(name, _)| *name)
    .collect::<Vec<_>>()
    .join(" + ")
}

/// Calls `work` with the parts of `texture` that `played` selects.
pub fn with<T>(texture: &Texture<'_>, played: Played, work: impl FnOnce(Texture<'_>) -> Result<T>) -> Result<T> {
    let spec = texture_spec(texture);
    let parts = played.of(&spec.parts);
    // The same parts need no other library.
    if parts == spec.parts {
        return work(*texture);
    }
    let bytes = encode(&[TextureSpec { parts, ..spec }]).map_err(|failure| Error::Model(failure.to_string()))?;
    let library = decoded(&bytes)?;
    work(library.textures().next().expect("one was encoded"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use model_format::{CodebookSpec, ExcitationSpec, LineSpec, LinesSpec};

    fn all() -> PartsSpec {
        PartsSpec {
            excitation: Some(ExcitationSpec {
                codebooks: vec![CodebookSpec {
                    peak: 8.0,
                    blocks: vec![0; 400],
                }],
                of_nodes: vec![1],
            }),
            lines: Some(LinesSpec {
                lines: vec![LineSpec {
                    wavelength_mm: 0.5,
                    phase: 0,
                    amplitudes: vec![1.0],
                    ..LineSpec::default()
                }],
                ..LinesSpec::default()
            }),
        }
    }

    #[test]
    fn a_choice_leaves_out_its_parts_and_nothing_is_played_twice() {
        let stored = all();
        assert_eq!(Played::Fitted.of(&stored), stored);
        assert_eq!(Played::Gaussian.of(&stored), PartsSpec::default());
        let residual = Played::Residual.of(&stored);
        assert!(residual.lines.is_none() && residual.excitation == stored.excitation);
        let beside = |played: Played, stored: &PartsSpec| played.beside(stored);
        assert_eq!(beside(Played::Fitted, &stored), [Played::Gaussian, Played::Residual]);
        assert_eq!(beside(Played::Fitted, &residual), [Played::Gaussian]);
        assert_eq!(beside(Played::Gaussian, &residual), [Played::Residual]);
        assert_eq!(beside(Played::Fitted, &PartsSpec::default()), []);
    }

    #[test]
    fn parts_are_named_as_they_are_played() {
        let stored = all();
        let words = |played: Played| in_words(&played.of(&stored));
        assert_eq!(words(Played::Fitted), "recorded snippets + lines");
        assert_eq!(words(Played::Residual), "recorded snippets");
        assert_eq!(words(Played::Gaussian), "Gaussian");
    }
}
