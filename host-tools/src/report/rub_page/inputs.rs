//! Contents of a page: a library, and the recordings behind it.

use model_format::Library;

use crate::dsp::reduction::Reduction;
use crate::evaluation::evaluate::Evaluation;
use crate::recording::RecordingSet;

/// Duration of the clips of recordings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Clips {
    /// As long as a budget of the page's size allows, at fewer nodes if they are many.
    Budget,
    /// So many seconds at every recorded node, however large the page becomes.
    Seconds(f64),
}

/// Recordings behind a library, and what they say of it.
#[derive(Clone, Copy)]
pub struct Recordings<'a> {
    /// The recordings.
    pub set: &'a RecordingSet,
    /// The library's comparison with them.
    pub evaluation: &'a Evaluation,
    /// Reduction from three axes to one; as for the fit.
    pub reduction: Reduction,
    /// Duration of their clips.
    pub clips: Clips,
}

/// The contents of a page.
#[derive(Clone, Copy)]
pub struct Inputs<'a> {
    /// The library.
    pub library: &'a Library<'a>,
    /// Its bytes.
    pub bytes: &'a [u8],
    /// Recordings, where there are any.
    pub recordings: Option<Recordings<'a>>,
    /// Seed that the page begins with.
    pub seed: u64,
}
