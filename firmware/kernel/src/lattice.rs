//! The normalised (four-multiplier) all-pole lattice.
//!
//! ```text
//! f[m-1] = cos θ[m] · f[m] - sin θ[m] · g[m-1]      for m = M .. 1, with g the backward signals of the sample before,
//! g[m]   = sin θ[m] · f[m] + cos θ[m] · g[m-1]      f[M] the excitation, f[0] = g[0] the output, k = sin θ
//! ```
//! Every stage is a rotation, so that `(f[M], g)` before and `(f[0], g)` after a sample have the same norm. The state
//! cannot grow, even if all θ change at every sample, and whatever the history (Laroche, J. Audio Eng. Soc. 55(6),
//! 2007). The same holds in integers, because cos² + sin² ≤ 1 holds in them and products are truncated toward zero: the
//! sum f² + g² never grows in any stage, and shrinks by at least one step in every stage whose signals are not zero.
//! Without excitation the state therefore decays to exactly zero. Saturation can also only shrink the norm. This holds
//! for any excitation, including words at full scale: no signal has more energy than state and excitation had together,
//! so that an impulse adds at most its own energy.
//!
//! From the excitation to each signal the gain, averaged over frequency, is at most 1. So with white excitation no
//! signal has a higher variance than the excitation, whatever the texture, and one scale fits all: one standard
//! deviation is 2²⁸, full scale is eight standard deviations. With any other excitation the variance is at most its
//! highest spectral density, relative to white noise. `fit` whitens its codebooks ([`crate::feed`]), so that this
//! density is nearly 1. Another program's codebook may be a tone on a resonance. Its pieces of at most 80 ms have
//! random signs, which keeps the density below 280 at 5 kHz and 560 at 10 kHz: signals of 17 or 24 standard deviations.
//! Snippets are played on, so that a tone in them lasts, and may reach more than a fed texture's full scale. Signals
//! that reach full scale saturate, and `status` counts this.
//!
//! A codebook has peaks of up to 40 standard deviations, and √2 times that in a cross-fade of two pieces. The lattice
//! of a fed texture therefore has steps of 2⁻²⁵ standard deviations, and a full scale of 64 standard deviations.
//! Round-off is 92 to 95 dB below such a signal for the models of order 400 in `tests/fixtures`, and 108 dB or more
//! with steps of 2⁻²⁸.

use model_format::limits::MAX_ORDER;
use model_format::{OutputSample, Texture};

use crate::arithmetic::Arithmetic;
use crate::excitation::Excitation;
use crate::feed::{FED_HEADROOM_BITS, gaussian_sample};
use crate::fixed::{is_full_scale, saturate, shift_toward_zero};
use crate::grid::{GridPoint, ONE};
use crate::level::{Levels, Ramp, rms_of};
use crate::nodes::Nodes;
use crate::rotation::Rotation;

/// Binary digits after the point of the gain, m/s². The lattice's full scale times full gain is the output's.
pub(crate) const GAIN_FRACTION_BITS: u32 = 23;

/// Bits by which a product of lattice and gain is shifted down to become a sample of the output.
const OUTPUT_SHIFT: u32 = 31;

/// The frame of a motion: rotations of all stages, and the level.
#[derive(Clone, Debug)]
pub struct LatticeFrame {
    rotations: [Rotation; MAX_ORDER],
    stages: usize,
    gain: Ramp,
}

/// The state of a lattice: the backward signals.
#[derive(Clone, Debug)]
pub struct LatticeState {
    /// g[0] to g[M]. The last one is written and never read.
    backward: [i32; MAX_ORDER + 1],
}

impl LatticeFrame {
    /// A silent frame of `stages` stages.
    /// Panics if there are more than [`MAX_ORDER`] stages.
    pub const fn silent(stages: usize) -> Self {
        assert!(stages <= MAX_ORDER);
        Self {
            rotations: [Rotation::NONE; MAX_ORDER],
            stages,
            gain: Ramp::new(),
        }
    }

    /// Makes this a silent frame of `stages` stages.
    /// Panics if there are more than [`MAX_ORDER`] stages.
    pub fn silence(&mut self, stages: usize) {
        assert!(stages <= MAX_ORDER);
        self.rotations.fill(Rotation::NONE);
        (self.stages, self.gain) = (stages, Ramp::new());
    }

    /// Makes this the frame of `point` on the grid of `texture`, a lattice with at most as many stages as this frame.
    /// The level goes from `from`, the level of the previous frame, to its new value in `samples` samples.
    pub fn update<A: Arithmetic>(&mut self, texture: &Texture<'_>, point: &GridPoint, from: Levels, samples: u32) {
        let nodes = Nodes::at(texture, point);
        nodes.interpolate::<A>(&mut self.rotations[..self.stages]);
        let law = texture.level_law();
        let rms = rms_of(&point.weights, law, GAIN_FRACTION_BITS, &nodes.powers);
        let gain = (u64::from(rms) * u64::from(point.fade)) / u64::from(ONE);
        // It fits in a word: a gain above 1 leaves at most half the highest RMS, 2³⁰ steps (`highest_gain` of
        // `model_format`).
        self.gain = Ramp::between(from.amplitude, gain as u32, samples);
    }

    /// Restarts the level's ramp at `from`, for a motion and a gain that have not changed. The frame is then the same
    /// as after [`LatticeFrame::update`], in some ten instructions.
    pub fn hold(&mut self, from: Levels, samples: u32) {
        self.gain = self.gain.again(from.amplitude, samples);
    }

    /// The level, including the fade, when `left` samples of the ramp remain.
    pub fn levels(&self, left: u32) -> Levels {
        Levels {
            amplitude: self.gain.value(left),
            fade: 0,
        }
    }

    /// The rotations of the stages, the first stage first.
    pub fn rotations(&self) -> &[Rotation] {
        &self.rotations[..self.stages]
    }

    /// Output of the lattice at the level when `left` samples of the ramp remain. The flag is true if the lattice is at
    /// full scale.
    #[inline(always)]
    fn output(&self, filtered: i32, left: u32) -> (OutputSample, bool) {
        let gain = self.gain.value(left);
        let output = shift_toward_zero(i64::from(filtered) * i64::from(gain), OUTPUT_SHIFT);
        // A signal times a gain below 2³¹ steps, shifted by 31 digits, fits in a word.
        (OutputSample(output as i32), is_full_scale(filtered))
    }

    /// Like [`LatticeFrame::output`], for a lattice in the steps of a fed excitation. The flag is true if excitation,
    /// lattice or output is at full scale.
    #[inline(always)]
    fn fed_output(&self, excitation: i32, filtered: i32, left: u32) -> (OutputSample, bool) {
        let product = i64::from(filtered) * i64::from(self.gain.value(left));
        let output = shift_toward_zero(product, OUTPUT_SHIFT - FED_HEADROOM_BITS);
        // A fed lattice's full scale is eight times a plain one's, so that its product may exceed a word.
        let (output, saturated) = saturate(output);
        let full = is_full_scale(excitation) | is_full_scale(filtered);
        (OutputSample(output), saturated | full)
    }
}

impl LatticeState {
    /// A lattice at rest.
    pub const fn new() -> Self {
        Self {
            backward: [0; MAX_ORDER + 1],
        }
    }

    /// A lattice of `stages` stages, at most [`MAX_ORDER`], as if it had been played forever: its backward signals are
    /// the next `stages` samples of `source`.
    ///
    /// This is the stationary state for any rotations. Each sample maps excitation and state, independent signals of
    /// unit variance, orthogonally to the next state and the signal that leaves the last stage. So these are
    /// independent and of unit variance, too. This holds at each single sample, so a state that was left while the
    /// coefficients moved, and continues with other coefficients, is stationary as well.
    pub fn stationary(stages: usize, source: &mut Excitation) -> Self {
        let mut state = Self::new();
        for backward in &mut state.backward[..stages.min(MAX_ORDER)] {
            *backward = source.next_sample();
        }
        state
    }

    /// Like [`LatticeState::stationary`], in the steps of a fed excitation.
    pub fn fed_stationary(stages: usize, source: &mut Excitation) -> Self {
        let mut state = Self::new();
        for backward in &mut state.backward[..stages.min(MAX_ORDER)] {
            *backward = gaussian_sample(source);
        }
        state
    }

    /// A lattice whose backward signals are `backward`, `g[0]` first.
    pub fn from_backward(backward: [i32; MAX_ORDER]) -> Self {
        let mut state = Self::new();
        state.backward[..MAX_ORDER].copy_from_slice(&backward);
        state
    }

    /// The backward signals that `stages` stages remember, `g[0]` first.
    pub fn backward(&self, stages: usize) -> &[i32] {
        &self.backward[..stages]
    }

    /// Returns whether the state of `stages` stages is zero, so that they output only zeros until the next excitation.
    pub fn is_silent(&self, stages: usize) -> bool {
        self.backward(stages).iter().all(|&g| g == 0)
    }

    /// Passes one sample of excitation through the lattice. The output has the steps of the excitation.
    #[inline]
    pub fn filter<A: Arithmetic>(&mut self, rotations: &[Rotation], excitation: i32) -> i32 {
        let rotations = &rotations[..rotations.len().min(MAX_ORDER)];
        let backward = &mut self.backward[..=rotations.len()];
        let output = A::rotate(rotations, backward, excitation);
        backward[0] = output;
        output
    }

    /// Passes a block of excitation through and replaces it by the outputs, like a call of [`LatticeState::filter`] per
    /// sample; see [`Arithmetic::rotate_block`].
    fn filter_block<A: Arithmetic>(&mut self, rotations: &[Rotation], samples: &mut [i32]) {
        let rotations = &rotations[..rotations.len().min(MAX_ORDER)];
        let backward = &mut self.backward[..=rotations.len()];
        A::rotate_block(rotations, backward, samples);
    }

    /// Returns the next sample of a texture: `excitation` through the lattice of `frame`, at its level when `left`
    /// samples of its ramp remain. The flag is true if the lattice is at full scale.
    #[inline]
    pub fn next_sample<A: Arithmetic>(
        &mut self,
        frame: &LatticeFrame,
        excitation: i32,
        left: u32,
    ) -> (OutputSample, bool) {
        let filtered = self.filter::<A>(frame.rotations(), excitation);
        frame.output(filtered, left)
    }

    /// Like [`LatticeState::next_sample`], for a fed texture: a step of `excitation` is 2⁻²⁵.
    #[inline]
    pub fn next_fed_sample<A: Arithmetic>(
        &mut self,
        frame: &LatticeFrame,
        excitation: i32,
        left: u32,
    ) -> (OutputSample, bool) {
        let filtered = self.filter::<A>(frame.rotations(), excitation);
        frame.fed_output(excitation, filtered, left)
    }

    /// Computes the next samples, like a call of [`LatticeState::next_sample`] for each. `samples` holds the excitation
    /// and then the output. Before the first sample, `left` samples of the ramp remained. Returns how many are at full
    /// scale.
    pub fn next_block<A: Arithmetic>(&mut self, frame: &LatticeFrame, samples: &mut [i32], left: u32) -> u32 {
        self.filter_block::<A>(frame.rotations(), samples);
        let outputs = samples.iter_mut().zip(ramp_from(left));
        outputs.fold(0, |full, (sample, left)| {
            let (output, is_full) = frame.output(*sample, left);
            *sample = output.0;
            full + u32::from(is_full)
        })
    }

    /// Like [`LatticeState::next_block`], for a fed texture: the samples of [`LatticeState::next_fed_sample`], written
    /// to `outputs`. `excitation` has the same length.
    pub fn next_fed_block<A: Arithmetic>(
        &mut self,
        frame: &LatticeFrame,
        excitation: &[i32],
        outputs: &mut [i32],
        left: u32,
    ) -> u32 {
        outputs.copy_from_slice(excitation);
        self.filter_block::<A>(frame.rotations(), outputs);
        let outputs = outputs.iter_mut().zip(excitation).zip(ramp_from(left));
        outputs.fold(0, |full, ((sample, &excitation), left)| {
            let (output, is_full) = frame.fed_output(excitation, *sample, left);
            *sample = output.0;
            full + u32::from(is_full)
        })
    }
}

/// Samples of a ramp that remain after each sample of a block, if `left` remained before the first.
fn ramp_from(left: u32) -> impl Iterator<Item = u32> {
    (1..).map(move |played| left.saturating_sub(played))
}

impl Default for LatticeState {
    fn default() -> Self {
        Self::new()
    }
}
