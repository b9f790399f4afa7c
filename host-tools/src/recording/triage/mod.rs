//! Verdicts on a recording before it is fitted.
//!
//! | verdict | found when | what `fit` does |
//! |---|---|---|
//! | ok | nothing below | uses it |
//! | silent | the RMS about the mean is below the silence floor | makes a silent node |
//! | too short | fewer than [`SHORT_SAMPLES`] samples | uses it with a lower order, warns |
//! | clipped | at least [`CLIPPED_SHARE`] of an axis's samples are at its extreme, in runs | uses it, warns |
//! | drifting | a straight line explains at least [`DRIFT_SHARE`] of an axis's energy | uses it, warns |
//! | hum | a mains line is [`HUM_RATIO_DB`] above its surroundings at half of the speeds or more | uses it, warns |
//! | duplicate | every sample equals that of an earlier trial | uses it, warns |
//! | wrong rate | the file's sample rate is below the models' | uses it, warns: its band ends at half that rate |
//!
//! A texture of one or two speeds cannot tell hum from a line of its own, so there every such line counts as hum. A
//! sample that is not finite has no verdict: [`read`](super::read) fails on it, and the whole fit with it.
//!
//! A trial that is used in spite of a verdict other than silent marks its node as doubtful. Silent trials are not
//! compared for copies. The option `--drop` leaves trials out, and `--strict` refuses the set.
//!
//! Invariant: samples in (m/s² at 5 kHz, cut and scaled), verdicts out. Nothing here reads a file or drops a trial.

mod fingerprint;
mod hum;
mod single_trial;
#[cfg(test)]
mod test_signals;
mod verdict;

pub use fingerprint::{COPY_CORRELATION, Fingerprint, Likeness, copies, fingerprint, likeness};
pub use hum::{HUM_RATIO_DB, confirmed_hum, mains_line};
pub use single_trial::{CLIPPED_SHARE, DRIFT_SHARE, SHORT_SAMPLES, SILENCE_FLOOR_M_S2, samples};
pub use verdict::Verdict;
