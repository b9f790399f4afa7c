//! Playing a scene: only what it calls for at the moment.
//!
//! ```text
//! below the tick, once a block           in the tick, at each sample
//!
//! Interaction --> Director --> Block --> ScenePlayback: voice 0 --> stick-slip --+
//!                    |        (whole)                   voice 1 --> stick-slip --+
//!                    v                                  tap ---------------------+--> equaliser --> output
//!              frames of voices
//! ```
//! A [`Plan`] is what a scene compiles to; it does not change. The [`Director`] decides from it, once a block, what the
//! block takes: which voices sound, whether a tap rings, whether the tool sticks. What it decides is a [`Block`], a list of
//! stages; the tick runs down that list and knows of nothing else, so that what is not in it costs nothing. Without
//! contact, and with everything rung out, the list is empty.
//!
//! Gains and the weights of a transition are in the voices' levels, which ramp across each block: they cost no
//! instruction in the tick either, and no change of region, gain or contact is faster than a block.
//!
//! [`ScenePlayer`] is both halves in one, for where there is no hurry. A scene of one surface without effects plays, bit for
//! bit, what [`crate::Synthesis`] plays of its texture.

mod block;
pub mod cost;
mod director;
mod equaliser;
mod interaction;
mod path;
mod plan;
mod playback;
mod player;
mod stick_slip;
mod tap;

pub use block::{Block, MAX_STAGES, SLOTS, Stage, VoiceStage};
pub use director::{Director, Voices};
pub use equaliser::{Equaliser, EqualiserState};
pub use interaction::{ContactDetector, Interaction, InteractionError};
pub use path::{Located, Path};
pub use plan::Plan;
pub use playback::{Ringing, ScenePlayback};
pub use player::ScenePlayer;
pub use stick_slip::{StickSlipFrame, StickSlipState, StickSlipWindow};
pub use tap::{Resonance, Strike, TapState};
