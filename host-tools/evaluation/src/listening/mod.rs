//! Listening tests of three designs. In trials of A, B and X, X is of the same kind as A or B, and a listener says
//! which. In ratings, a listener says how alike two sounds are. Staircases find the strength of a part that a listener
//! can just notice.
//!
//! Two excerpts of one noise differ in every sample. If X were the same excerpt as A or B, a listener could recognise
//! it by its waveform. So X is another excerpt of the same kind, at the same speed and force, and no two syntheses of a
//! trial are from the same window of their common noise. All excerpts of a page have the same RMS, so that level gives
//! no hint, unless the level itself is tested. Recordings are excerpts of what was held out from the fit.
//!
//! A listener who hears no difference answers right in half of the trials. The exact interval of the proportion
//! ([`clopper_pearson`](stylus_dsp::binomial::clopper_pearson)) shows whether the listener heard a difference.

mod abx;
mod answers;
mod excerpts;
mod kinds;
mod plan;
mod similarity;
mod staircase;

pub use abx::Trial;
pub use answers::{Answers, CHANCE, CONFIDENCE, Field, Score, score};
pub use excerpts::{FADE_S, SHORTEST_EXCERPT_S};
pub use kinds::{Kind, Pair, once};
pub use plan::{Compared, Design, Options, Plan, Task, plan};
pub use similarity::Ratings;
pub use staircase::{Part, Staircases};
