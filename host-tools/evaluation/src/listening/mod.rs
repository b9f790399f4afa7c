//! Listening tests: trials of A, B and X in which X is of the kind of A or of B, and a listener says which; ratings of
//! how alike two sounds are; and staircases, which find the strength of a part that a listener can just tell.
//!
//! Two excerpts of one noise differ in every sample, and a listener who compares waveforms would tell any two apart. So
//! X is never the excerpt that A or B is: it is another excerpt of the same kind, at the same speed and force. All
//! excerpts of a page have one RMS, so that level does not tell. What is compared is not fitted: recordings are
//! excerpts of what was held out.
//!
//! A listener who hears no difference answers right in half of the trials. The exact interval of the proportion
//! ([`clopper_pearson`](crate::dsp::binomial::clopper_pearson)) says whether more than that was heard.

mod abx;
mod answers;
mod excerpts;
mod kinds;
mod plan;
mod similarity;
mod staircase;

pub use abx::Trial;
pub use answers::{Answers, CHANCE, CONFIDENCE, Score, score};
pub use excerpts::{FADE_S, SHORTEST_EXCERPT_S};
pub use kinds::{Kind, Pair, once};
pub use plan::{Compared, Design, Options, Plan, Task, plan};
pub use similarity::Ratings;
pub use staircase::{Part, Staircases};
