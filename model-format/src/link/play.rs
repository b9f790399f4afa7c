//! Playing a texture or a scene: request, motion, and reasons for silence.

use heapless::String;
use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

use super::{LinkId, QUICK_FAULT_MS, Reason, SettingSet, SettingsState, TextureName};
use crate::scene::SceneName;
use crate::{MillimetresPerSecond, Newton, PlayRate};

/// Largest gain of a play request.
pub const MAX_PLAY_GAIN: f32 = 4.0;

/// Source of speed and force.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub enum MotionSource {
    /// The encoder and the force sensor.
    Sensors,
    /// [`super::MotionTopic`] and [`super::MotionEndpoint`].
    Host,
}

/// A texture or a scene of a library, by its name.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub enum Selection {
    /// A texture, at every position and without effects. It fades only with speed and force.
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

/// The terms of a plan's cost, as text.
pub type Arithmetic = String<384>;

/// Request to play a texture or a scene of the active library.
///
/// If a texture or scene is already played with the same gain at the same sample rate, the new one takes over within
/// some milliseconds and without a mute. The noise of the excitation then continues, and `seed` has no effect.
/// Otherwise the output fades out first.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Schema)]
pub struct PlayRequest {
    /// The texture or scene.
    pub selection: Selection,
    /// Factor of the amplitude, 0 to [`MAX_PLAY_GAIN`]; 1 is as recorded.
    pub gain: f32,
    /// Source of speed and force.
    pub motion: MotionSource,
    /// Seed of the excitation: the same seed gives the same samples.
    pub seed: u64,
}

/// State of playing.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Schema)]
pub struct Playing {
    /// The request, as the device has understood it.
    pub request: PlayRequest,
    /// Reasons that still keep the output at mid-scale.
    pub mute: MuteReasons,
}

/// Reason for which a request is not played. What was played before continues.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, Schema, thiserror::Error)]
#[expect(
    clippy::large_enum_variant,
    reason = "without allocation the longest text is part of the whole"
)]
#[expect(missing_docs, reason = "each message says it")]
pub enum PlayError {
    #[error("no library is active: upload one and activate it")]
    NoLibrary,
    #[error("the active library has no texture \"{name}\": list what it has")]
    NoSuchTexture { name: TextureName },
    #[error(
        "it was made for {texture_hz} Hz, and a stylus plays {} and {} Hz: fit the textures again at one of these",
        PlayRate::Hz5000.hz(),
        PlayRate::Hz10000.hz()
    )]
    SampleRate {
        /// Sample rate of the texture or scene, Hz.
        texture_hz: u32,
    },
    #[error("the active library has no scene \"{name}\": list what it has")]
    NoSuchScene { name: SceneName },
    #[error("the scene cannot be played: {reason}")]
    InvalidScene {
        /// Place and fault, as text.
        reason: Reason,
    },
    #[error(
        "the scene takes {instructions} instructions per sample, of {budget} available ({arithmetic}): \
         use fewer effects or lower orders"
    )]
    OverBudget {
        /// Instructions of a sample in the worst case.
        instructions: u32,
        /// Instructions that a sample may take: all of a tick's budget at 5 kHz, half of it at 10 kHz.
        budget: u32,
        /// Terms of the cost.
        arithmetic: Arithmetic,
    },
    #[error(
        "with the {sections} sections of the stored response it takes {instructions} instructions per sample, of \
         {budget} available: use fewer effects or lower orders, or calibrate with fewer sections"
    )]
    EqualiserOverBudget {
        /// Instructions of a sample in the worst case.
        instructions: u32,
        /// Instructions that a sample may take.
        budget: u32,
        /// Sections of the response's equaliser at this rate.
        sections: u8,
    },
    #[error("a gain of {gain}; it must be 0 to {MAX_PLAY_GAIN}")]
    Gain { gain: f32 },
    #[error("a library is being activated or settings are being stored: try again in a moment")]
    Busy,
    #[error("{by} plays: stop it first, by `stylus stop` on any link")]
    Held {
        /// The link that plays.
        by: LinkId,
    },
    #[error("the output is off after a fault: read the status, then restart the device")]
    Fault,
    #[error(
        "{missing} not set, and nothing plays with guessed values: measure the coil and its amplifier, then run \
         `stylus calibrate`, or `stylus settings set coil-resistance OHM amplifier-gain V/V power-limit W`"
    )]
    SettingsNotSet {
        /// The settings that are missing.
        missing: SettingSet,
    },
    #[error(
        "settings were lost from flash ({lost}): set each again with `stylus settings set`, or begin anew with \
         `stylus settings reset`, then `stylus calibrate`"
    )]
    SettingsLost {
        /// The settings that were lost.
        lost: SettingSet,
    },
    #[error(
        "the device is in safe mode after {quick_faults} faults, each within {} s of a start: read the status, \
         remove the cause, then switch the power off and on, or press the reset button",
        QUICK_FAULT_MS / 1_000
    )]
    SafeMode {
        /// Quick faults in succession.
        quick_faults: u8,
    },
}

impl SettingsState {
    /// Checks that the coil's settings are known, so that something may be played.
    ///
    /// # Errors
    /// Settings were lost, or required ones were never set; the error names them.
    #[expect(
        clippy::result_large_err,
        reason = "without allocation the error is as large as its longest text"
    )]
    pub fn check_playable(&self) -> Result<(), PlayError> {
        if !self.lost.is_empty() {
            return Err(PlayError::SettingsLost { lost: self.lost });
        }
        let missing = SettingSet::REQUIRED.without(self.set);
        if !missing.is_empty() {
            return Err(PlayError::SettingsNotSet { missing });
        }
        Ok(())
    }
}

/// Reason for which playing does not stop.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema, thiserror::Error)]
pub enum StopError {
    /// Nothing is played.
    #[error("nothing is being played: there is nothing to stop")]
    NotPlaying,
}

/// Motion of the tool at a moment, as the host knows it. It is sent at up to 1 kHz.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, Schema)]
pub struct MotionSample {
    /// Tangential speed. Its sign matters only to lines that are tied to position, and only if `position_mm` is none.
    pub speed: MillimetresPerSecond,
    /// Normal force; a negative one is no contact.
    pub force: Newton,
    /// Position on the path of a scene, mm from where playing began. If it is none, the scene follows the device's
    /// encoder. Lines that are tied to position follow this position too; if it is none, they follow the speed.
    pub position_mm: Option<f32>,
    /// Contact of the tool. If it is none, the force determines contact.
    pub contact: Option<bool>,
}

/// Reason for which a motion is not followed. The previous motion remains in use until it is stale.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema, thiserror::Error)]
pub enum MotionRefused {
    /// The speed is NaN or infinite.
    #[error("the speed is not finite: send a number of mm/s")]
    Speed,
    /// The force is NaN or infinite.
    #[error("the force is not finite: send a number of N")]
    Force,
    /// The position is NaN or infinite.
    #[error("the position is not finite: send a number of mm, or none")]
    Position,
    /// The other link plays, and only that link may send motions.
    #[error("{by} plays, and it alone gives the motion: stop it first")]
    Held {
        /// The link that plays.
        by: LinkId,
    },
}

/// A reason for the output to be at mid-scale.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
#[repr(u8)]
pub enum MuteReason {
    /// Nothing is played.
    NotPlaying,
    /// The speed or the force is older than [`super::STALE_AFTER_MS`].
    Stale,
    /// The link that plays has sent no play, motion or keep-alive for [`super::LINK_LOST_AFTER_MS`].
    LinkLost,
    /// A library is being activated, or another texture or scene is about to take over.
    Changing,
    /// A fault was found; only a restart ends this mute.
    Fault,
    /// The force sensor is at a rail of its converter: not connected, or overloaded.
    ForceRail,
    /// Safe mode after quick faults; only switching the power off and on or the reset button ends this mute.
    SafeMode,
}

/// Number of reasons.
pub const MUTE_REASON_COUNT: usize = 7;

impl MuteReason {
    /// All reasons, in the order of the counters in [`super::OutputStatus`].
    pub const ALL: [Self; MUTE_REASON_COUNT] = [
        Self::NotPlaying,
        Self::Stale,
        Self::LinkLost,
        Self::Changing,
        Self::Fault,
        Self::ForceRail,
        Self::SafeMode,
    ];
}

impl core::fmt::Display for MuteReason {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::NotPlaying => "not playing",
            Self::Stale => "speed or force out of date",
            Self::LinkLost => "link lost",
            Self::Changing => "changing texture or library",
            Self::Fault => "fault",
            Self::ForceRail => "force sensor at its rail: connect it, or press less",
            Self::SafeMode => "safe mode",
        })
    }
}

/// A set of reasons, one bit each.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct MuteReasons(u8);

impl MuteReasons {
    /// No reason: the output is on.
    pub const NONE: Self = Self(0);

    /// Bits of the set: bit n for the nth of [`MuteReason::ALL`].
    pub const fn bits(self) -> u8 {
        self.0
    }

    /// The set of these [`MuteReasons::bits`]. Bits that stand for no reason are dropped.
    pub const fn from_bits(bits: u8) -> Self {
        Self(bits & ((1 << MUTE_REASON_COUNT) - 1))
    }

    /// The set with or without `reason`.
    #[must_use]
    pub const fn set(self, reason: MuteReason, on: bool) -> Self {
        let bit = 1 << reason as u8;
        Self(if on { self.0 | bit } else { self.0 & !bit })
    }

    /// Returns whether `reason` is in the set.
    pub const fn contains(self, reason: MuteReason) -> bool {
        self.0 & (1 << reason as u8) != 0
    }

    /// Returns whether the set is empty.
    pub const fn is_empty(self) -> bool {
        self.0 == 0
    }

    /// The reasons in the set.
    pub fn iter(self) -> impl Iterator<Item = MuteReason> {
        MuteReason::ALL.into_iter().filter(move |&reason| self.contains(reason))
    }
}

impl core::fmt::Display for MuteReasons {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        for (index, reason) in self.iter().enumerate() {
            let separator = if index == 0 { "" } else { ", " };
            write!(f, "{separator}{reason}")?;
        }
        Ok(())
    }
}
