//! The half of a scene that the tick runs.

use model_format::OutputSample;

use super::block::{Block, SLOTS, Stage, VoiceStage};
use super::equaliser::EqualiserState;
use super::stick_slip::StickSlipState;
use super::tap::TapState;
use crate::fixed::{saturate, shift_toward_zero};

/// Whether the parts of a scene ring, which the [`super::Director`] needs to know.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Ringing {
    /// True if a tap rings.
    pub tap: bool,
    /// True if the equaliser rings.
    pub equaliser: bool,
}

/// State of a scene without its voices.
#[derive(Clone, Copy, Debug, Default)]
pub struct ScenePlayback {
    tap: TapState,
    equaliser: EqualiserState,
    stick_slip: [StickSlipState; SLOTS],
    /// Samples of the block's ramps that remain.
    left: u32,
    saturations: u32,
}

impl ScenePlayback {
    /// Silence.
    pub const fn new() -> Self {
        Self {
            tap: TapState::new(),
            equaliser: EqualiserState::new(),
            stick_slip: [const { StickSlipState::new() }; SLOTS],
            left: 0,
            saturations: 0,
        }
    }

    /// Begins `block`, which was not played before. `begin_voice` is called with each voice whose frame begins with the
    /// block, for [`crate::Playback::begin_frame`].
    #[inline]
    pub fn begin_block(&mut self, block: &Block, mut begin_voice: impl FnMut(VoiceStage)) {
        self.left = block.samples;
        // Before the strike, which belongs to the new plan.
        if block.resets {
            self.tap = TapState::new();
            self.equaliser = EqualiserState::new();
        }
        if let Some(strike) = block.strike {
            self.tap.strike(strike);
        }
        for voice in block.stages.iter().filter_map(Stage::voice) {
            if voice.begins {
                begin_voice(voice);
            }
        }
    }

    /// The next sample of `block`. `voice` returns the next sample of a voice, see [`crate::Playback::next_sample`].
    #[inline]
    pub fn next_sample(&mut self, block: &Block, mut voice: impl FnMut(VoiceStage) -> OutputSample) -> OutputSample {
        self.left = self.left.saturating_sub(1);
        let mut mix = 0i64;
        let mut saturated = false;
        for stage in &block.stages {
            match stage {
                Stage::Voice(stage) => mix += i64::from(voice(*stage).0),
                Stage::StickSlip(stage, frame) => {
                    let state = &mut self.stick_slip[usize::from(stage.slot) % SLOTS];
                    mix += i64::from(state.modulate(frame, voice(*stage), self.left).0);
                }
                Stage::Lines(slot) => mix += block.lines_of(*slot, self.left),
                Stage::Tap(resonance) => mix += i64::from(self.tap.next_sample(*resonance).0),
                Stage::Wave => mix += block.wave_of(self.left),
                Stage::Equaliser => {
                    let (input, over) = saturate(mix);
                    let input = OutputSample(input);
                    let (output, full) = self.equaliser.process(&block.equaliser, input);
                    mix = i64::from(output.0);
                    saturated |= over | full;
                }
                // Two voices, eight lines of half a full scale in each slot, and a tap are at most eleven full scales,
                // which times 2¹⁶ are far from the end of 64 bits.
                Stage::FadeOut(ramp) => {
                    mix = shift_toward_zero(mix * i64::from(ramp.value(self.left)), 16);
                }
            }
        }
        let (output, over) = saturate(mix);
        self.saturations = self.saturations.saturating_add(u32::from(saturated | over));
        OutputSample(output)
    }

    /// Returns which parts ring. Call it after [`ScenePlayback::begin_block`] and before the director's next decision.
    pub fn ringing(&self) -> Ringing {
        Ringing {
            tap: !self.tap.is_silent(),
            equaliser: !self.equaliser.is_silent(),
        }
    }

    /// Samples of the block's ramps that remain.
    pub fn left(&self) -> u32 {
        self.left
    }

    /// Number of samples that reached full scale in the sum or the equaliser. Voices count their own.
    pub fn saturations(&self) -> u32 {
        self.saturations
    }
}
