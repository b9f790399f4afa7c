//! The direct form, the paper's own structure: `a[n] = σ e[n] + Σ h[i] a[n-i]`.
//!
//! Coefficients between nodes are the weighted mean of the four nodes around the motion. The mean is computed with the
//! frame when the motion changes, and not at every sample. Four sums over one history, weighted at every sample, would
//! give the same number without that pass, but a sample would cost 3.4 times as much and a frame four times the memory.
//! In 32 bits the mean is within 2⁻³¹ of the largest coefficient, whatever width they are stored in.
//!
//! The law of the level between nodes is applied to the prediction error's power σ², and not to the output's. σ² and
//! the filter of a node together give the node's output power, so that the level is right at nodes. Between nodes the
//! output's power is what the mean filter makes of the mean σ, as in the paper; to set it directly an update would have
//! to find the power gain of every mean filter.
//!
//! The history is kept in fixed point at the texture's own scale: its loudest node's RMS lies between a sixteenth and
//! an eighth of full scale; that of a fed texture, whose peaks are higher, an eighth of that. Sums are exact in 64
//! bits, and truncated toward zero once per sample. Unlike the lattice's, this structure's stability depends on its
//! coefficients: between two stable nodes it may be unstable, and then it saturates.
//!
//! A state is stationary for one set of coefficients only. To draw it would take the reflection coefficients of the
//! moment, by a recursion that divides by 1 - k² at each order: it loses digits with each pole near the unit circle,
//! and has no result where the mean of two nodes is unstable. The state is therefore run up from zero by the filter
//! itself, unheard; see [`RUN_UP_SAMPLES`].

use model_format::limits::{MAX_EXPONENT, MAX_ORDER, MAX_OUTPUT_POWER};
use model_format::{Coefficients, OutputSample, Texture};

use crate::arithmetic::{Arithmetic, TURN_TAPS, Turn};
use crate::excitation;
use crate::feed::{FED_FRACTION_BITS, FED_HEADROOM_BITS};
use crate::fixed::{is_full_scale, saturate, shift_toward_zero};
use crate::grid::{GridPoint, ONE};
use crate::level::{Levels, Ramp, rms_at};

/// Digits after the point of a sample's sum, in steps of the history.
pub const SUM_FRACTION_BITS: u32 = 20;

/// Number of samples that the filter runs from zero before it is heard: 1 s at 5 kHz.
///
/// After n samples from zero, a line of pole radius r has the share 1 - r^(2n) of its variance. It lacks less than
/// 0.5 dB, which is 11 %, if r is at most 0.11^(1/10 000) = 0.99978, and its width, (1 - r)/π of the sample rate, at
/// least 0.35 Hz. The radius 0.9995 lacks 0.03 dB.
pub const RUN_UP_SAMPLES: u32 = 5000;

/// Digits after the point of a coefficient at exponent 0.
const COEFFICIENT_FRACTION_BITS: u32 = 31;

/// Number of turns that no sum exceeds.
const MAX_TURNS: usize = MAX_ORDER / TURN_TAPS;

const _: () = assert!(MAX_ORDER.is_multiple_of(TURN_TAPS));
const _: () = assert!(MAX_EXPONENT as u32 <= COEFFICIENT_FRACTION_BITS - SUM_FRACTION_BITS);

/// The frame of a motion: coefficients and the level.
#[derive(Clone, Debug)]
pub struct DirectFrame {
    /// h₁ first; h = code · 2^(exponent - 31). Their magnitudes add up to less than
    /// [`model_format::limits::CODE_SUM_LIMIT`], so that the 64-bit sum of products cannot overflow, whatever the
    /// history.
    coefficients: [Turn; MAX_TURNS],
    /// Number of them that a sample takes.
    turns: usize,
    exponent: u32,
    /// Position for which `coefficients` were computed, so that an unchanged motion costs no interpolation.
    point: Option<GridPoint>,
    /// Steps of the history per step of the output, as a power of two.
    scale_bits: u32,
    deviation: Ramp,
    fade: Ramp,
}

/// The state of a direct form: the last outputs.
#[derive(Clone, Debug)]
pub struct DirectState {
    /// The newest [`MAX_ORDER`] samples from `newest` on, written twice so that they never wrap.
    history: [i32; 2 * MAX_ORDER],
    newest: usize,
}

impl DirectFrame {
    /// A silent frame for `texture`.
    pub fn silent(texture: &Texture<'_>) -> Self {
        Self::silent_at(texture, exponent(texture))
    }

    /// A silent frame for `texture`, whose [`exponent`] is known.
    pub(crate) fn silent_at(texture: &Texture<'_>, exponent: u32) -> Self {
        Self {
            coefficients: [[0; TURN_TAPS]; MAX_TURNS],
            turns: texture.max_order().div_ceil(TURN_TAPS),
            exponent,
            point: None,
            scale_bits: if texture.is_fed() {
                scale_bits(texture.max_output_power()).saturating_sub(FED_HEADROOM_BITS)
            } else {
                scale_bits(texture.max_output_power())
            },
            deviation: Ramp::new(),
            fade: Ramp::new(),
        }
    }

    /// Makes this the frame of `point` on the grid of `texture`, the one that it was made for. Levels go from `from`,
    /// those of the frame before, to their new values in `samples` samples.
    pub fn update(&mut self, texture: &Texture<'_>, point: &GridPoint, from: Levels, samples: u32) {
        let rests = |last: GridPoint| (last.nodes, last.weights) == (point.nodes, point.weights);
        if !self.point.replace(*point).is_some_and(rests) {
            self.interpolate(texture, point);
        }
        let power = |speed, force| texture.node(speed, force).prediction_error_power;
        let bits = OutputSample::FRACTION_BITS + self.scale_bits;
        let deviation = rms_at(point, texture.level_law(), bits, power);
        self.deviation = Ramp::between(from.amplitude, deviation, samples);
        self.fade = Ramp::between(from.fade, point.fade, samples);
    }

    /// The levels with `left` samples of their ramps to come.
    pub fn levels(&self, left: u32) -> Levels {
        Levels {
            amplitude: self.deviation.value(left),
            fade: self.fade.value(left),
        }
    }

    /// The weighted mean of the four nodes' coefficients. Taps that a node's model lacks have h = 0.
    fn interpolate(&mut self, texture: &Texture<'_>, point: &GridPoint) {
        /// Binary digits of a weight of one: a product with a code is then one of two 32-bit words, and four of them
        /// fit in 64 bits.
        const FACTOR_BITS: u32 = 30;
        /// Digits that a weight lacks of these. They are added below, so that nothing is lost where a node's exponent
        /// is smaller than the texture's.
        const MORE_BITS: u32 = FACTOR_BITS - ONE.ilog2();
        const { assert!(MAX_EXPONENT as u32 <= MORE_BITS) }
        let mut sums = [1i64 << (FACTOR_BITS - 1); MAX_ORDER];
        for (&(speed, force), &weight) in point.nodes.iter().zip(&point.weights) {
            let factor = |exponent: u8| {
                i64::from((weight << MORE_BITS) >> (self.exponent - u32::from(exponent)))
            };
            match texture.node(speed, force).coefficients {
                Coefficients::Direct16 { exponent, codes } => {
                    let factor = factor(exponent);
                    for (sum, &code) in sums.iter_mut().zip(codes) {
                        *sum += i64::from(i32::from(i16::from_le_bytes(code)) << 16) * factor;
                    }
                }
                Coefficients::Direct32 { exponent, codes } => {
                    let factor = factor(exponent);
                    for (sum, &code) in sums.iter_mut().zip(codes) {
                        *sum += i64::from(i32::from_le_bytes(code)) * factor;
                    }
                }
                Coefficients::Lattice { .. } => {}
            }
        }
        for (coefficient, sum) in self.coefficients.as_flattened_mut().iter_mut().zip(sums) {
            *coefficient = (sum >> FACTOR_BITS) as i32;
        }
    }
}

/// The exponent at which every mean of a texture's nodes has room: h = code · 2^(exponent - 31). The round-off of a
/// mean is at most half a step of these.
pub fn exponent(texture: &Texture<'_>) -> u32 {
    u32::from(texture.common_exponent())
}

/// Binary digits by which the history's steps are finer than the output's, for a texture of this highest power.
fn scale_bits(max_output_power: f32) -> u32 {
    const FINEST: u32 = OutputSample::FRACTION_BITS;
    let mut bits = 0;
    let mut room = MAX_OUTPUT_POWER;
    while bits < FINEST && max_output_power <= room / 4.0 {
        room /= 4.0;
        bits += 1;
    }
    bits
}

impl DirectFrame {
    /// A sample of excitation at its deviation, in steps of the history with [`SUM_FRACTION_BITS`] digits.
    #[inline(always)]
    fn driven(&self, excitation: i32, left: u32) -> i64 {
        let driven = i64::from(excitation) * i64::from(self.deviation.value(left));
        driven >> (excitation::FRACTION_BITS - SUM_FRACTION_BITS)
    }

    /// As [`DirectFrame::driven`], in the steps of a fed excitation. It is below 2⁵⁷ in magnitude, and the sum of the
    /// predictor's products at most 2⁶², so that both together have room.
    #[inline(always)]
    fn fed(&self, excitation: i32, left: u32) -> i64 {
        let driven = i64::from(excitation) * i64::from(self.deviation.value(left));
        driven >> (FED_FRACTION_BITS - SUM_FRACTION_BITS)
    }

    /// The output of a filter at `filtered`, in steps of the history, at the fade with `left` samples of its ramp to
    /// come.
    #[inline(always)]
    fn output(&self, filtered: i32, left: u32) -> i64 {
        let faded = i64::from(filtered) * i64::from(self.fade.value(left));
        // Truncating twice toward zero is truncating once. A scene's gain may make the fade larger than one, and so the
        // product longer than a word. The mask tells the compiler that no shift is as wide as a word, which takes it
        // half the instructions.
        let faded = shift_toward_zero(faded, ONE.ilog2());
        shift_toward_zero(faded, self.scale_bits & 31)
    }
}

impl DirectState {
    /// A filter at rest.
    pub const fn new() -> Self {
        Self {
            history: [0; 2 * MAX_ORDER],
            newest: 0,
        }
    }

    /// A filter whose last outputs are `history`, newest first.
    pub fn from_history(history: &[i32; MAX_ORDER]) -> Self {
        let mut state = Self::new();
        let (first, second) = state.history.split_at_mut(MAX_ORDER);
        first.copy_from_slice(history);
        second.copy_from_slice(history);
        state
    }

    /// The last outputs, newest first, in steps of the history.
    pub fn history(&self) -> &[i32] {
        &self.history[self.newest..][..MAX_ORDER]
    }

    /// Passes one sample of excitation through the filter of `frame`.
    ///
    /// The excitation has steps of the history with [`SUM_FRACTION_BITS`] digits after the point; the output has
    /// steps of the history. The flag is true if the output was saturated.
    #[inline(always)]
    pub fn filter<A: Arithmetic>(&mut self, frame: &DirectFrame, excitation: i64) -> (i32, bool) {
        let window: &[i32; MAX_ORDER] = self.history[self.newest..]
            .first_chunk()
            .expect("the newest sample lies in the first half");
        let sum = A::sum_of_products(&frame.coefficients[..frame.turns], window.as_chunks().0);
        // The mask tells the compiler that no shift is as wide as a word, which takes it half the instructions.
        let shift = (COEFFICIENT_FRACTION_BITS - SUM_FRACTION_BITS - frame.exponent) & 31;
        let sum = excitation + (sum >> shift);
        let (output, saturated) = saturate(shift_toward_zero(sum, SUM_FRACTION_BITS));
        self.push(output);
        (output, saturated)
    }

    /// Passes one sample of excitation through, at the end of the frame's ramps, for nobody to hear.
    #[inline]
    pub fn run<A: Arithmetic>(&mut self, frame: &DirectFrame, excitation: i32) {
        self.filter::<A>(frame, frame.driven(excitation, 0));
    }

    /// The next sample of a texture: `excitation` through the filter of `frame`, with `left` samples of its ramps to
    /// come. The flag is true if the filter was saturated.
    #[inline]
    pub fn next_sample<A: Arithmetic>(
        &mut self,
        frame: &DirectFrame,
        excitation: i32,
        left: u32,
    ) -> (OutputSample, bool) {
        let (filtered, saturated) = self.filter::<A>(frame, frame.driven(excitation, left));
        (OutputSample(frame.output(filtered, left) as i32), saturated)
    }

    /// As [`DirectState::run`], of a fed texture: a step of `excitation` is 2⁻²⁵.
    #[inline]
    pub fn run_fed<A: Arithmetic>(&mut self, frame: &DirectFrame, excitation: i32) {
        self.filter::<A>(frame, frame.fed(excitation, 0));
    }

    /// As [`DirectState::next_sample`], of a fed texture: a step of `excitation` is 2⁻²⁵. The flag is true if
    /// excitation, filter or output are at full scale.
    #[inline]
    pub fn next_fed_sample<A: Arithmetic>(
        &mut self,
        frame: &DirectFrame,
        excitation: i32,
        left: u32,
    ) -> (OutputSample, bool) {
        let (filtered, saturated) = self.filter::<A>(frame, frame.fed(excitation, left));
        // A gain above one may take a history of full scale beyond the output's.
        let (output, over) = saturate(frame.output(filtered, left));
        let full = is_full_scale(excitation);
        (OutputSample(output), saturated | over | full)
    }

    #[inline(always)]
    fn push(&mut self, sample: i32) {
        let newest = if self.newest == 0 {
            MAX_ORDER - 1
        } else {
            self.newest - 1
        };
        self.newest = newest;
        self.history[newest] = sample;
        self.history[newest + MAX_ORDER] = sample;
    }
}

impl Default for DirectState {
    fn default() -> Self {
        Self::new()
    }
}
