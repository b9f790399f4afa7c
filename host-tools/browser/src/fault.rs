//! Faults of a call, with their numbers and their texts.

use core::fmt;

use model_format::DecodeError;
use stylus_player::ChoiceError;

/// Blocks that one call plays at most: half a second.
pub const MOST_BLOCKS: usize = 256;

/// A call that was refused. What played before goes on.
#[derive(Clone, Debug, PartialEq)]
pub enum Fault {
    /// No library is loaded.
    NoLibrary,
    /// Bytes that are no library, or a damaged one.
    Library(DecodeError),
    /// A library is loaded already.
    Loaded,
    /// A texture or scene that is not there, or cannot be played.
    Choice(ChoiceError),
    /// Nothing is chosen.
    NothingChosen,
    /// More blocks than one call plays.
    TooManyBlocks(usize),
    /// A speed, force or position that cannot be played.
    Motion {
        /// The block of the call, from 0.
        block: usize,
        /// The column and its fault.
        problem: &'static str,
    },
}

impl Fault {
    /// Number of the fault, as exports return it; never 0.
    pub const fn status(&self) -> u32 {
        match self {
            Self::NoLibrary => 1,
            Self::Library(_) => 2,
            Self::Loaded => 3,
            Self::Choice(ChoiceError::NoTexture { .. }) => 4,
            Self::Choice(_) => 5,
            Self::NothingChosen => 6,
            Self::TooManyBlocks(_) => 7,
            Self::Motion { .. } => 8,
        }
    }
}

impl fmt::Display for Fault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NoLibrary => f.write_str("no library is loaded: call reserve, write it there, and call load"),
            Self::Library(error) => write!(f, "this is no library that can be played: {error}"),
            Self::Loaded => f.write_str("a library is loaded already: make another instance of the module"),
            Self::Choice(error) => error.fmt(f),
            Self::NothingChosen => f.write_str("nothing is chosen: call choose_texture or choose_scene"),
            Self::TooManyBlocks(blocks) => {
                write!(
                    f,
                    "{blocks} blocks are more than one call plays: ask for at most {MOST_BLOCKS}"
                )
            }
            Self::Motion { block, problem } => write!(f, "block {block} of the motion: {problem}"),
        }
    }
}

impl core::error::Error for Fault {}

impl From<ChoiceError> for Fault {
    fn from(error: ChoiceError) -> Self {
        Self::Choice(error)
    }
}
