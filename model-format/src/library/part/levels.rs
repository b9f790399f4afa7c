//! Part of kind 1: the laws of a texture's level between nodes and below the grid.
//!
//! The content is two bytes: the [`LevelLaw`], then the [`FadeLaw`]. A texture without this part has the default laws.

use crate::error::Problem;
use crate::wire::NodeRecord;

#[cfg(feature = "alloc")]
use super::PartSpec;

/// Kind of this part.
pub(crate) const KIND: u32 = 1;

/// Law of the level between the four nodes of a cell, whose weights add up to one.
///
/// At a node, every law gives the node's own level. Between nodes, no law gives a higher level than that of the loudest
/// node. Of the three laws, `Logarithm` gives the lowest level and `Power` the highest.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum LevelLaw {
    /// Weighted mean of the output powers.
    #[default]
    Power,
    /// Weighted mean of the RMS amplitudes.
    Amplitude,
    /// Weighted mean of the level in dB, which is the geometric mean of the amplitudes. No node may be silent.
    Logarithm,
}

/// Law of the level below the lowest speed or the lowest force of the grid, down to silence at zero. The factors of the
/// two axes are multiplied.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum FadeLaw {
    /// The amplitude is proportional to speed or force.
    #[default]
    Amplitude,
    /// The power is proportional to speed or force, and so the amplitude to the square root of speed or force. The
    /// published HaTT models have this law, because their variance is interpolated towards 0, the variance of a model
    /// of zeros.
    Power,
}

/// The two laws of a texture's level.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct Laws {
    /// Law between nodes.
    pub level: LevelLaw,
    /// Law below the grid.
    pub fade: FadeLaw,
}

impl LevelLaw {
    /// All laws, in the order of their stored codes.
    pub const ALL: [Self; 3] = [Self::Power, Self::Amplitude, Self::Logarithm];
}

impl FadeLaw {
    /// All laws, in the order of their stored codes.
    pub const ALL: [Self; 2] = [Self::Amplitude, Self::Power];
}

impl core::fmt::Display for LevelLaw {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::Power => "mean power",
            Self::Amplitude => "mean amplitude",
            Self::Logarithm => "mean dB",
        })
    }
}

impl core::fmt::Display for FadeLaw {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::Amplitude => "linear amplitude",
            Self::Power => "linear power",
        })
    }
}

/// The part's content.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LevelsPart<'a>(pub &'a [u8]);

impl LevelsPart<'_> {
    /// The laws.
    fn read(self) -> Result<Laws, Problem> {
        let &[level, fade] = self.0 else {
            return Err(Problem::Malformed("the part with the laws of the level"));
        };
        let unknown = |what, code: u8| Problem::Unknown {
            what,
            code: code.into(),
        };
        Ok(Laws {
            level: *LevelLaw::ALL
                .get(usize::from(level))
                .ok_or(unknown("a law of the level", level))?,
            fade: *FadeLaw::ALL
                .get(usize::from(fade))
                .ok_or(unknown("a law of the fade", fade))?,
        })
    }

    /// The laws of a part that was found valid.
    pub fn laws(self) -> Laws {
        self.read().unwrap_or_default()
    }

    pub fn check(self) -> Result<(), Problem> {
        if self.read()? == Laws::default() {
            return Err(Problem::Needless("the part with the laws of the level"));
        }
        Ok(())
    }
}

/// Checks that a node has a level that `law` can average.
pub(in crate::library) fn check_node(law: LevelLaw, node: &NodeRecord) -> Result<(), Problem> {
    if law == LevelLaw::Logarithm && node.output_power <= 0.0 {
        return Err(Problem::Rule(
            "a silent node has no level in dB: give the texture the level law of power or amplitude, or leave speed 0 \
             and force 0 out of its grid",
        ));
    }
    Ok(())
}

/// Creates the part for these laws, unless they are the default.
#[cfg(feature = "alloc")]
pub(crate) fn part(laws: Laws) -> Option<PartSpec> {
    let content = || alloc::vec![laws.level as u8, laws.fade as u8];
    (laws != Laws::default()).then(|| (KIND, content()))
}
