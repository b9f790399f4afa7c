//! Playing a scene: at each moment only the stages that it needs.
//!
//! ```text
//! below the tick, once per block         in the tick, per sample
//!
//! Interaction --> Director --> Block --> ScenePlayback: voice 0 --> stick-slip --+
//!                    |        (whole)                   voice 1 --> stick-slip --+
//!                    v                                  tap ---------------------+--> equaliser --> output
//!              frames of voices
//! ```
//! A [`Plan`] is the compiled scene; it does not change. Once per block, the [`Director`] decides from it which voices
//! sound, whether a tap rings, and whether the tool sticks. The result is a [`Block`], a list of stages. The tick runs
//! only that list, so that a stage that is not in it costs nothing. Without contact, and once nothing rings any more,
//! the list is empty.
//!
//! Gains and the weights of a transition are part of the voices' levels, which ramp across each block. They cost no
//! instruction in the tick, and no change of region, gain or contact is faster than a block.
//!
//! The equaliser's sections are those of the scene, followed by those of the device's response, if it has one. A
//! [`Wave`] is played instead of voices: it is the waveform of a probe, which measures that response.
//!
//! [`ScenePlayer`] joins both halves, for programs that compute blocks and samples in one thread. A scene of one
//! surface without effects plays, bit for bit, what [`crate::Synthesis`] plays of its texture.

mod block;
pub mod cost;
mod director;
mod equaliser;
mod interaction;
mod path;
mod plan;
mod playback;
mod player;
mod slots;
mod stick_slip;
mod tap;
mod wave;

pub use block::{Block, MAX_STAGES, SLOTS, Stage, VoiceStage};
pub use director::Director;
pub use equaliser::{Equaliser, EqualiserState};
pub use interaction::{ContactDetector, ContactThreshold, Interaction, InteractionError};
pub use path::{Located, Path};
pub use plan::Plan;
pub use playback::{Ringing, ScenePlayback};
pub use player::ScenePlayer;
pub use slots::Voices;
pub use stick_slip::{StickSlipFrame, StickSlipState, StickSlipWindow};
pub use tap::{Resonance, Strike, TapState};
pub use wave::Wave;
