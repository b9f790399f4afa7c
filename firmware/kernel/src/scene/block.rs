//! The block that the director hands to the tick: a list of stages.

use heapless::Vec;

use super::equaliser::Equaliser;
use super::stick_slip::StickSlipFrame;
use super::tap::{Resonance, Strike};
use super::wave::MAX_BLOCK_SAMPLES;
use crate::level::Ramp;
use crate::lines::LinesFrame;

/// Number of voices that can sound at a time: two, while one surface fades into another.
pub const SLOTS: usize = 2;

/// Largest number of stages of a block: two voices with their lines, a tap, the equaliser, and the fade while scenes
/// change.
pub const MAX_STAGES: usize = 2 * SLOTS + 3;

/// A voice that sounds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct VoiceStage {
    /// Index of the slot.
    pub slot: u8,
    /// Index of the frame within the slot.
    pub buffer: u8,
    /// True if that frame begins with the block; otherwise it continues from the previous block.
    pub begins: bool,
}

/// A stage that the tick runs per sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// A voice.
    Voice(VoiceStage),
    /// A voice whose tool sticks and slips.
    StickSlip(VoiceStage, StickSlipFrame),
    /// The lines of the voice in this slot, which are tied to position.
    Lines(u8),
    /// A tap that rings.
    Tap(Resonance),
    /// A probe's waveform.
    Wave,
    /// The equaliser, for the sum of all earlier stages.
    Equaliser,
    /// A fade of the sum of all earlier stages, by a ramp that ends at zero with the block.
    FadeOut(Ramp),
}

impl Stage {
    /// The voice of the stage, if it has one.
    pub fn voice(&self) -> Option<VoiceStage> {
        match *self {
            Self::Voice(voice) | Self::StickSlip(voice, _) => Some(voice),
            Self::Lines(_) | Self::Tap(_) | Self::Wave | Self::Equaliser | Self::FadeOut(_) => None,
        }
    }
}

/// The stages of a block, in their order.
#[derive(Clone, Debug)]
pub struct Block {
    pub(super) stages: Vec<Stage, MAX_STAGES>,
    /// Lines of each slot's voice.
    pub(super) lines: [LinesFrame; SLOTS],
    pub(super) strike: Option<Strike>,
    /// Samples of a probe's waveform, the last one first.
    pub(super) wave: [i32; MAX_BLOCK_SAMPLES],
    /// True if tap and equaliser are reset before the first sample.
    pub(super) resets: bool,
    pub(super) samples: u32,
    pub(super) equaliser: Equaliser,
    /// Number of the plan whose equaliser this is.
    pub(super) equaliser_of: u32,
}

impl Block {
    /// Silence of unlimited length.
    pub const fn silent() -> Self {
        Self {
            stages: Vec::new(),
            lines: [const { LinesFrame::new() }; SLOTS],
            strike: None,
            wave: [0; MAX_BLOCK_SAMPLES],
            resets: false,
            samples: 0,
            equaliser: Equaliser::NONE,
            equaliser_of: 0,
        }
    }

    /// Adds a stage to the list.
    pub(super) fn push(&mut self, stage: Stage) {
        // The list has space for one of each.
        let _ = self.stages.push(stage);
    }

    /// The sample of the lines of `slot`, when `left` samples of the block remain.
    ///
    /// This is a separate function, marked as rare, because its registers would cost a tick without lines some
    /// instructions.
    #[cold]
    #[inline(never)]
    pub(super) fn lines_of(&self, slot: u8, left: u32) -> i64 {
        self.lines[usize::from(slot) % SLOTS].sample(left)
    }

    /// The sample of the probe's waveform, when `left` samples of the block remain. This is a separate function for the
    /// same reason as [`Block::lines_of`].
    #[cold]
    #[inline(never)]
    pub(super) fn wave_of(&self, left: u32) -> i64 {
        self.wave.get(left as usize).copied().unwrap_or(0).into()
    }

    /// The stages that the tick runs per sample, in their order.
    pub fn stages(&self) -> &[Stage] {
        &self.stages
    }

    /// Number of samples of the block, which all ramps take.
    pub fn samples(&self) -> u32 {
        self.samples
    }
}
