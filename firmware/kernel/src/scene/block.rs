//! What the tick is handed for a block: the stages to run, and nothing about why.

use heapless::Vec;

use super::equaliser::Equaliser;
use super::stick_slip::StickSlipFrame;
use super::tap::{Resonance, Strike};
use crate::level::Ramp;

/// Voices that can sound at a time: two, while one surface fades into another.
pub const SLOTS: usize = 2;

/// Most stages of a block: two voices, a tap, the equaliser, and the fade when a scene is exchanged.
pub const MAX_STAGES: usize = SLOTS + 3;

/// A voice that sounds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct VoiceStage {
    /// Which voice.
    pub slot: u8,
    /// Which of its two frames.
    pub buffer: u8,
    /// Whether that frame begins with the block; otherwise it goes on from the block before.
    pub begins: bool,
}

/// One thing that the tick does at each sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// A voice.
    Voice(VoiceStage),
    /// A voice whose tool sticks and slips.
    StickSlip(VoiceStage, StickSlipFrame),
    /// What a tap left ringing.
    Tap(Resonance),
    /// The equaliser, over all before.
    Equaliser,
    /// All before fades by this ramp, which ends at nothing with the block.
    FadeOut(Ramp),
}

impl Stage {
    /// The voice of the stage, if it is one.
    pub fn voice(&self) -> Option<VoiceStage> {
        match *self {
            Self::Voice(voice) | Self::StickSlip(voice, _) => Some(voice),
            Self::Tap(_) | Self::Equaliser | Self::FadeOut(_) => None,
        }
    }
}

/// The stages of a block, in their order.
#[derive(Clone, Debug)]
pub struct Block {
    pub(super) stages: Vec<Stage, MAX_STAGES>,
    pub(super) strike: Option<Strike>,
    /// Whether what rings is forgotten before the first sample.
    pub(super) resets: bool,
    pub(super) samples: u32,
    pub(super) equaliser: Equaliser,
    /// Of which plan that is the equaliser, counted.
    pub(super) equaliser_of: u32,
}

impl Block {
    /// Silence, without an end.
    pub const fn silent() -> Self {
        Self {
            stages: Vec::new(),
            strike: None,
            resets: false,
            samples: 0,
            equaliser: Equaliser::NONE,
            equaliser_of: 0,
        }
    }

    /// What the tick runs at each sample.
    pub fn stages(&self) -> &[Stage] {
        &self.stages
    }

    /// Samples of the block, over which all ramps go.
    pub fn samples(&self) -> u32 {
        self.samples
    }
}
