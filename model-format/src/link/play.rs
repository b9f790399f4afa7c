//! Playing a texture or a scene.

use heapless::String;
use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

use super::{MuteReasons, Reason, TextureName};
use crate::scene::SceneName;

/// Largest gain of a play request.
pub const MAX_PLAY_GAIN: f32 = 4.0;

/// Where speed and force come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub enum MotionSource {
    /// The encoder and the force sensor.
    Sensors,
    /// [`super::MotionTopic`] and [`super::MotionEndpoint`].
    Host,
}

/// Something that a library has to be played.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub enum Selection {
    /// A texture, everywhere and without effects: it is heard whatever the position, and fades with speed and force alone.
    Texture(TextureName),
    /// A scene.
    Scene(SceneName),
}

impl core::fmt::Display for Selection {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Texture(name) => write!(f, "texture '{name}'"),
            Self::Scene(name) => write!(f, "scene '{name}'"),
        }
    }
}

/// The lines of a plan's cost, in words.
pub type Arithmetic = String<384>;

/// Asks for a texture or a scene of the active library.
///
/// While something is played with the same gain, the new one takes over within some milliseconds and without a mute; the noise
/// then goes on, and the seed does not count. Otherwise what is played fades out first.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Schema)]
pub struct PlayRequest {
    /// Which one.
    pub selection: Selection,
    /// What to multiply the amplitude by, 0 to [`MAX_PLAY_GAIN`]; 1 is as recorded.
    pub gain: f32,
    /// Where speed and force come from.
    pub motion: MotionSource,
    /// Seed of the excitation: the same one gives the same samples.
    pub seed: u64,
}

/// What is being played.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Schema)]
pub struct Playing {
    /// What is played, as the device has understood it.
    pub request: PlayRequest,
    /// What still keeps the output at mid-scale.
    pub mute: MuteReasons,
}

/// Why something is not played. What was played before goes on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Schema, thiserror::Error)]
#[expect(
    clippy::large_enum_variant,
    reason = "without allocation the longest text is part of the whole"
)]
pub enum PlayError {
    /// No library is active.
    #[error("no library is active: upload one and activate it")]
    NoLibrary,
    /// The active library has no texture of this name.
    #[error("the active library has no texture \"{name}\": list what it has")]
    NoSuchTexture {
        /// What was asked for.
        name: TextureName,
    },
    /// The texture or scene was made for another rate than the device's.
    #[error(
        "it was made for {texture_hz} Hz and this device plays {device_hz} Hz: fit the textures again at that rate"
    )]
    SampleRate {
        /// The texture's or scene's.
        texture_hz: u32,
        /// The device's.
        device_hz: u32,
    },
    /// The active library has no scene of this name.
    #[error("the active library has no scene \"{name}\": list what it has")]
    NoSuchScene {
        /// What was asked for.
        name: SceneName,
    },
    /// A scene that cannot be played with the library's textures.
    #[error("the scene cannot be played: {reason}")]
    InvalidScene {
        /// Where and why not.
        reason: Reason,
    },
    /// A scene whose worst case takes more of a tick than there is.
    #[error(
        "the scene takes {instructions} instructions a tick of {budget} there are for it ({arithmetic}): use fewer effects or lower orders"
    )]
    OverBudget {
        /// What it takes.
        instructions: u32,
        /// What there is.
        budget: u32,
        /// How that comes about.
        arithmetic: Arithmetic,
    },
    /// A gain that is not finite or out of range.
    #[error("a gain of {gain}; it must be 0 to {MAX_PLAY_GAIN}")]
    Gain {
        /// What was asked for.
        gain: f32,
    },
    /// A library is being activated.
    #[error("a library is being activated: try again in a moment")]
    Busy,
    /// The output is off after a fault.
    #[error("the output is off after a fault: read the status, then restart the device")]
    Fault,
}

/// Why playing does not stop.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema, thiserror::Error)]
pub enum StopError {
    /// Nothing is being played.
    #[error("nothing is being played: there is nothing to stop")]
    NotPlaying,
}
