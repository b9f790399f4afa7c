//! Playing a texture.

use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

use super::{MuteReasons, TextureName};

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

/// Asks for a texture of the active library.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Schema)]
pub struct PlayRequest {
    /// Its name.
    pub texture: TextureName,
    /// What to multiply the amplitude by, 0 to [`MAX_PLAY_GAIN`]; 1 is as recorded.
    pub gain: f32,
    /// Where speed and force come from.
    pub motion: MotionSource,
    /// Seed of the excitation: the same one gives the same samples.
    pub seed: u64,
}

/// A texture that is being played.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Schema)]
pub struct Playing {
    /// What is played, as the device has understood it.
    pub request: PlayRequest,
    /// What still keeps the output at mid-scale.
    pub mute: MuteReasons,
}

/// Why a texture is not played. What was played before goes on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Schema, thiserror::Error)]
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
    /// The texture was made for another rate than the device's.
    #[error(
        "the texture was made for {texture_hz} Hz and this device plays {device_hz} Hz: fit it again at that rate"
    )]
    SampleRate {
        /// The texture's.
        texture_hz: u32,
        /// The device's.
        device_hz: u32,
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
