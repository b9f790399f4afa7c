//! The direct form, the paper's own structure: `a[n] = σ e[n] + Σ h[i] a[n-i]`.
//!
//! Interpolating the coefficients of four nodes and summing once over the history is the same as four sums over the one
//! history and a weighted mean of those; the latter needs no pass over the coefficients when the motion changes.
//!
//! The history is kept in fixed point at a scale of the texture's own: its loudest node's RMS lies between a sixteenth
//! and an eighth of full scale. Sums are exact in 64 bits, and truncated toward zero once a sample. Unlike the lattice's, this
//! structure's stability depends on its coefficients: between two stable nodes it may be unstable, then it saturates.

use core::hint::black_box;
use core::sync::atomic::{Ordering, compiler_fence};

use model_format::limits::{MAX_ORDER, MAX_OUTPUT_POWER};
use model_format::{Coefficients, OutputSample, Texture};

use crate::arithmetic::{Arithmetic, pack};
use crate::excitation;
use crate::fixed::{saturate, shift_toward_zero};
use crate::grid::{GridPoint, ONE};
use crate::level::{Levels, Ramp, rms_in_steps};

/// Digits after the point of a node's prediction, in steps of the 32-bit history.
const PREDICTION_FRACTION_BITS: u32 = 4;

/// Digits after the point of the weighted sum of predictions.
const SUM_FRACTION_BITS: u32 = PREDICTION_FRACTION_BITS + 16;

/// Steps in one turn of a sum's loop: enough that the loop itself costs little.
const TURN_STEPS: usize = 20;

/// Turns that no sum exceeds.
const MAX_TURNS: usize = MAX_ORDER / TURN_STEPS;

/// The coefficients that one turn takes of `LANES` nodes.
type Turn<W, const LANES: usize> = [[<W as Word>::Step; LANES]; TURN_STEPS];

/// How coefficients and history are stored and multiplied: in 16 or in 32 bits.
pub trait Word: Copy {
    /// One sample of the history.
    type Sample: Copy + Default;
    /// The coefficients that one step of the sum takes: one, or a pair.
    type Step: Copy + Default + core::fmt::Debug;
    /// Samples that one step takes.
    const SAMPLES_A_STEP: usize;

    /// A sample of the history from the 32-bit result.
    fn store(result: i32) -> Self::Sample;

    /// The coefficients of step `index` of a node; zero beyond its order.
    fn step(coefficients: Coefficients<'_>, index: usize) -> Self::Step;

    /// Sums `LANES` nodes' products with the newest samples, newest first; a sample of the history for each coefficient.
    fn sums<const LANES: usize>(
        coefficients: &[Turn<Self, LANES>],
        history: &[Self::Sample; MAX_ORDER],
    ) -> [i64; LANES];

    /// A node's sum as its factor multiplies it.
    fn prediction(sum: i64, exponent: u8) -> i64;

    /// What a node's [`Word::prediction`] is multiplied by for a weight in steps of 2⁻¹⁶, so that the product is in steps of
    /// the 32-bit history with `SUM_FRACTION_BITS` digits.
    fn factor(weight: u32, exponent: u8) -> u32;
}

/// Coefficients and history in 32 bits.
#[derive(Clone, Copy, Debug)]
pub struct Word32;

/// Coefficients and history in 16 bits, multiplied two by two.
///
/// The history's steps are those of the loudest node, and truncation takes from what is quieter: 0.2 dB from a node 20 dB
/// below the loudest, some 15 dB from one 60 dB below. The other structures do not have this.
#[derive(Clone, Copy, Debug)]
pub struct Word16<M>(core::marker::PhantomData<M>);

impl Word for Word32 {
    type Sample = i32;
    type Step = i32;
    const SAMPLES_A_STEP: usize = 1;

    #[inline(always)]
    fn store(result: i32) -> i32 {
        result
    }

    fn step(coefficients: Coefficients<'_>, index: usize) -> i32 {
        match coefficients {
            Coefficients::Direct32 { codes, .. } => {
                codes.get(index).map_or(0, |&code| i32::from_le_bytes(code))
            }
            _ => 0,
        }
    }

    #[inline(never)]
    fn sums<const LANES: usize>(
        coefficients: &[Turn<Self, LANES>],
        history: &[i32; MAX_ORDER],
    ) -> [i64; LANES] {
        /// Neighbouring words are loaded two at a time.
        const PAIR: usize = 2;
        let mut sums = [0i64; LANES];
        for turn in coefficients.iter().zip(history.as_chunks().0) {
            let (steps, samples): (&_, &[_; TURN_STEPS]) = in_registers(turn);
            let pairs = steps.as_chunks::<PAIR>().0.iter();
            for (steps, samples) in pairs.zip(samples.as_chunks::<PAIR>().0) {
                for (step, &sample) in steps.iter().zip(samples) {
                    for (sum, &coefficient) in sums.iter_mut().zip(step) {
                        *sum = sum.wrapping_add(i64::from(coefficient) * i64::from(sample));
                    }
                }
                keep_order();
            }
        }
        sums
    }

    #[inline(always)]
    fn prediction(sum: i64, exponent: u8) -> i64 {
        sum >> (31 - PREDICTION_FRACTION_BITS - u32::from(exponent))
    }

    fn factor(weight: u32, _exponent: u8) -> u32 {
        weight
    }
}

impl<M: Arithmetic> Word for Word16<M> {
    type Sample = i16;
    type Step = u32;
    const SAMPLES_A_STEP: usize = 2;

    #[inline(always)]
    fn store(result: i32) -> i16 {
        shift_toward_zero(i64::from(result), 16) as i16
    }

    fn step(coefficients: Coefficients<'_>, index: usize) -> u32 {
        let Coefficients::Direct16 { codes, .. } = coefficients else {
            return 0;
        };
        let code = |at: usize| codes.get(at).map_or(0, |&code| i16::from_le_bytes(code));
        pack([code(2 * index), code(2 * index + 1)])
    }

    #[inline(never)]
    fn sums<const LANES: usize>(
        coefficients: &[Turn<Self, LANES>],
        history: &[i16; MAX_ORDER],
    ) -> [i64; LANES] {
        /// The compiler lays out a turn in two halves; as a whole it is too much for it.
        const HALF: usize = TURN_STEPS / 2;
        let mut sums = [0i64; LANES];
        let history = history.as_chunks::<2>().0;
        for turn in coefficients.iter().zip(history.as_chunks().0) {
            let (steps, samples): (&_, &[_; TURN_STEPS]) = in_registers(turn);
            let halves = steps.as_chunks::<HALF>().0.iter();
            for (steps, samples) in halves.zip(samples.as_chunks::<HALF>().0) {
                for (step, &samples) in steps.iter().zip(samples) {
                    let samples = pack(samples);
                    for (sum, &pair) in sums.iter_mut().zip(step) {
                        *sum = M::multiply_accumulate(*sum, pair, samples);
                    }
                    keep_order();
                }
            }
        }
        sums
    }

    #[inline(always)]
    fn prediction(sum: i64, _exponent: u8) -> i64 {
        sum
    }

    /// There is room for the exponent here, which saves a shift by a variable amount at every sample: the sum is at most
    /// 2^(40 - exponent), the factor 2^(21 + exponent).
    fn factor(weight: u32, exponent: u8) -> u32 {
        weight << (16 - 15 + PREDICTION_FRACTION_BITS + u32::from(exponent))
    }
}

/// The two addresses of a turn as the compiler must take them, from two registers. Left to itself it adds both up from one
/// counter, at the cost of registers that a sum on a Cortex-M4 does not have.
#[inline(always)]
fn in_registers<'a, T, U>(addresses: (&'a T, &'a U)) -> (&'a T, &'a U) {
    black_box(addresses)
}

/// No instruction; it keeps the compiler from loading far ahead of use, which takes more registers than there are.
#[inline(always)]
fn keep_order() {
    compiler_fence(Ordering::SeqCst);
}

/// What a (speed, force) calls for: coefficients of `PASSES` × `LANES` nodes, their weights, and the level.
///
/// Nodes go in passes of `LANES`, as many as a processor has registers for.
#[derive(Clone, Debug)]
pub struct DirectFrame<W: Word, const LANES: usize, const PASSES: usize> {
    coefficients: [[Turn<W, LANES>; MAX_TURNS]; PASSES],
    /// The nodes that `coefficients` holds, so that they are unpacked only when the cell changes.
    nodes: Option<[(usize, usize); 4]>,
    turns: usize,
    exponents: [[u8; LANES]; PASSES],
    /// See [`Word::factor`].
    factors: [[u32; LANES]; PASSES],
    /// Output steps a history step, as a power of two.
    scale_bits: u32,
    deviation: Ramp,
    fade: Ramp,
}

/// What was played: the last outputs.
#[derive(Clone, Debug)]
pub struct DirectState<W: Word> {
    /// The newest [`MAX_ORDER`] samples from `newest` on, written twice so that they never wrap.
    history: [W::Sample; 2 * MAX_ORDER],
    newest: usize,
}

impl<W: Word, const LANES: usize, const PASSES: usize> DirectFrame<W, LANES, PASSES> {
    /// A silent frame for `texture`.
    pub fn silent(texture: &Texture<'_>) -> Self {
        const {
            assert!(LANES * PASSES == 1 || LANES * PASSES == 4);
            assert!(MAX_ORDER.is_multiple_of(W::SAMPLES_A_STEP * TURN_STEPS));
        }
        Self {
            coefficients: [[[[W::Step::default(); LANES]; TURN_STEPS]; MAX_TURNS]; PASSES],
            nodes: None,
            turns: texture.max_order().div_ceil(W::SAMPLES_A_STEP * TURN_STEPS),
            exponents: [[0; LANES]; PASSES],
            factors: [[0; LANES]; PASSES],
            scale_bits: scale_bits(texture.max_output_power()),
            deviation: Ramp::new(),
            fade: Ramp::new(),
        }
    }

    /// Makes this frame that of `point` on the grid of `texture`, the one that it was made for; levels go there from
    /// `from`, those of the frame before, in `samples` samples.
    pub fn update(&mut self, texture: &Texture<'_>, point: &GridPoint, from: Levels, samples: u32) {
        if self.nodes != Some(point.nodes) {
            self.nodes = Some(point.nodes);
            self.unpack(texture, point);
        }
        let weights = if LANES * PASSES == 1 {
            [ONE, 0, 0, 0]
        } else {
            point.weights
        };
        let factors = self.factors.as_flattened_mut().iter_mut();
        let exponents = self.exponents.as_flattened();
        for ((factor, &exponent), weight) in factors.zip(exponents).zip(weights) {
            *factor = W::factor(weight, exponent);
        }
        let power = point.mean(|speed, force| texture.node(speed, force).prediction_error_power);
        let deviation = rms_in_steps(power, OutputSample::FRACTION_BITS + self.scale_bits);
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

    fn unpack(&mut self, texture: &Texture<'_>, point: &GridPoint) {
        for (lane, &(speed, force)) in point.nodes.iter().enumerate().take(LANES * PASSES) {
            let coefficients = texture.node(speed, force).coefficients;
            let (pass, lane) = (lane / LANES, lane % LANES);
            self.exponents[pass][lane] = match coefficients {
                Coefficients::Direct16 { exponent, .. }
                | Coefficients::Direct32 { exponent, .. } => exponent,
                Coefficients::Lattice(_) => 0,
            };
            let steps = self.coefficients[pass][..self.turns].as_flattened_mut();
            for (index, step) in steps.iter_mut().enumerate() {
                step[lane] = W::step(coefficients, index);
            }
        }
    }
}

/// How many binary digits finer than the output's the history's steps are, for a texture of this highest power.
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

impl<W: Word> DirectState<W> {
    /// A filter at rest.
    pub fn new() -> Self {
        Self {
            history: [W::Sample::default(); 2 * MAX_ORDER],
            newest: 0,
        }
    }

    /// A filter that has put out `history`, newest first.
    pub fn from_history(history: &[W::Sample; MAX_ORDER]) -> Self {
        let mut state = Self::new();
        let (first, second) = state.history.split_at_mut(MAX_ORDER);
        first.copy_from_slice(history);
        second.copy_from_slice(history);
        state
    }

    /// What was put out last, newest first, as it is kept.
    pub fn history(&self) -> &[W::Sample] {
        &self.history[self.newest..][..MAX_ORDER]
    }

    /// The next sample of a texture: `excitation` through the filter of `frame`, with `left` samples of its ramps to
    /// come; and whether it had to be saturated.
    #[inline]
    pub fn next_sample<const LANES: usize, const PASSES: usize>(
        &mut self,
        frame: &DirectFrame<W, LANES, PASSES>,
        excitation: i32,
        left: u32,
    ) -> (OutputSample, bool) {
        let deviation = i64::from(frame.deviation.value(left));
        let mut sum =
            (i64::from(excitation) * deviation) >> (excitation::FRACTION_BITS - SUM_FRACTION_BITS);
        let window = self.history[self.newest..]
            .first_chunk()
            .expect("the newest sample lies in the first half");
        for pass in 0..PASSES {
            let sums = W::sums(&frame.coefficients[pass][..frame.turns], window);
            for (lane, &sum_of_node) in sums.iter().enumerate() {
                let prediction = W::prediction(sum_of_node, frame.exponents[pass][lane]);
                sum += prediction * i64::from(frame.factors[pass][lane]);
            }
        }
        let (result, saturated) = saturate(shift_toward_zero(sum, SUM_FRACTION_BITS));
        self.push(W::store(result));
        let faded = i64::from(result) * i64::from(frame.fade.value(left));
        // Two exact powers of two in one truncation: the fade's 2¹⁶ and the history's scale.
        let output = shift_toward_zero(faded, 16 + frame.scale_bits);
        (OutputSample(output as i32), saturated)
    }

    #[inline(always)]
    fn push(&mut self, sample: W::Sample) {
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

impl<W: Word> Default for DirectState<W> {
    fn default() -> Self {
        Self::new()
    }
}
