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
//! # Sums ahead
//! Outputs come in blocks of three. When one of a block is known, a third of the products of the next block's outputs
//! is summed: the last third of the predictor's taps after the first output, the middle one after the second, the first
//! one after the third. All outputs of the next block take the same coefficients in it, and samples that differ by one
//! place, so that one pass over both serves three outputs. The first [`NEAR_TAPS`] taps, whose samples are not known
//! by then, are summed with the output itself. Every sample takes the same number of instructions.
//!
//! The output is that of a single sum, to the bit, because integers add up to the same in any order. A change of frame
//! begins with [`DirectState::begin`], which makes the sums ahead anew with the new coefficients. Taps of two
//! predictors in one sum would be no predictor: where nodes have sharp resonances, the output would run to full scale.
//!
//! A state is stationary for one set of coefficients only. To draw it would take the reflection coefficients of the
//! moment, by a recursion that divides by 1 - k² at each order: it loses digits with each pole near the unit circle,
//! and has no result where the mean of two nodes is unstable. The state is therefore run up from zero by the filter
//! itself, unheard; see [`RUN_UP_SAMPLES`].

use core::ops::Range;

use model_format::limits::{MAX_EXPONENT, MAX_ORDER, MAX_OUTPUT_POWER};
use model_format::{Coefficients, OutputSample, Structure, Texture};

use crate::arithmetic::{Arithmetic, SUMS, TURN_TAPS, Turn};
use crate::excitation;
use crate::feed::{FED_FRACTION_BITS, FED_HEADROOM_BITS};
use crate::fixed::{is_full_scale, saturate, shift_toward_zero};
use crate::grid::{GridPoint, ONE};
use crate::level::{Levels, Ramp, rms_of};
use crate::taps::{Codes, FACTOR_BITS, Run};

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

/// Number of taps that are summed with the output: the lags of samples that were not known when the sums ahead began.
pub const NEAR_TAPS: usize = 2 * SUMS - 1;

/// Number of taps that one turn in each pass takes together.
pub const TAPS_PER_TURN: usize = SUMS * TURN_TAPS;

/// Turns per pass that no predictor exceeds.
const MAX_TURNS: usize = turns(MAX_ORDER);

/// Taps of a frame. Those beyond the order are zero.
const MAX_TAPS: usize = NEAR_TAPS + MAX_TURNS * TAPS_PER_TURN;

// A pass reads samples as old as the last tap's, and the oldest may be one beyond the history. There the history is
// written a second time, and the tap is zero.
const _: () = assert!(MAX_TAPS <= MAX_ORDER + 1);
const _: () = assert!(MAX_EXPONENT as u32 <= COEFFICIENT_FRACTION_BITS - SUM_FRACTION_BITS);

/// The frame of a motion: coefficients and the level.
#[derive(Clone, Debug)]
pub struct DirectFrame {
    /// h₁ first; h = code · 2^(exponent - 31). Their magnitudes add up to less than
    /// [`model_format::limits::CODE_SUM_LIMIT`], so that the 64-bit sum of products cannot overflow, whatever the
    /// history.
    coefficients: [i32; MAX_TAPS],
    /// Turns per pass.
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
    /// The sums ahead: of the present block and the next one in turn. The sum that an output took is zero again.
    ahead: [i64; 2 * SUMS],
    /// Place in `ahead` of the next output's sum.
    place: usize,
}

impl DirectFrame {
    /// A silent frame for `texture`.
    pub fn silent(texture: &Texture<'_>) -> Self {
        Self::silent_at(texture, exponent(texture))
    }

    /// A silent frame for `texture`, whose [`exponent`] is known.
    pub(crate) fn silent_at(texture: &Texture<'_>, exponent: u32) -> Self {
        Self {
            coefficients: [0; MAX_TAPS],
            turns: turns(texture.max_order()),
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
    pub fn update<A: Arithmetic>(
        &mut self,
        texture: &Texture<'_>,
        point: &GridPoint,
        from: Levels,
        samples: u32,
    ) {
        let rests = |last: GridPoint| (last.nodes, last.weights) == (point.nodes, point.weights);
        let nodes = Nodes::at(texture, point, self.exponent);
        if !self.point.replace(*point).is_some_and(rests) {
            self.interpolate::<A>(&nodes);
        }
        let bits = OutputSample::FRACTION_BITS + self.scale_bits;
        let deviation = rms_of(&point.weights, texture.level_law(), bits, &nodes.powers);
        self.deviation = Ramp::between(from.amplitude, deviation, samples);
        self.fade = Ramp::between(from.fade, point.fade, samples);
    }

    /// Makes this the frame of the point that it is of, as [`DirectFrame::update`] does, in some ten instructions.
    pub fn hold(&mut self, from: Levels, samples: u32) {
        self.deviation = self.deviation.again(from.amplitude, samples);
        self.fade = self.fade.again(from.fade, samples);
    }

    /// The levels with `left` samples of their ramps to come.
    pub fn levels(&self, left: u32) -> Levels {
        Levels {
            amplitude: self.deviation.value(left),
            fade: self.fade.value(left),
        }
    }

    /// The weighted mean of the four nodes' coefficients. Taps that a node's model lacks have h = 0.
    fn interpolate<A: Arithmetic>(&mut self, nodes: &Nodes<'_>) {
        let mut rest = &mut self.coefficients[..];
        let mut done = 0;
        while !rest.is_empty()
            && let Some((run, taps)) = nodes.run(done, rest.len())
        {
            let now;
            (now, rest) = rest.split_at_mut(taps);
            A::mean_coefficients(&run, now);
            done += taps;
        }
        rest.fill(0);
    }
}

/// The four nodes around a motion.
struct Nodes<'a> {
    codes: Codes<'a>,
    factors: [i32; 4],
    /// Powers of the prediction error, (m/s²)².
    powers: [f32; 4],
}

impl<'a> Nodes<'a> {
    /// The nodes of `texture` around `point` of its grid, with factors for the exponent `common`.
    fn at(texture: &Texture<'a>, point: &GridPoint, common: u32) -> Self {
        /// Digits that a weight lacks of a factor. They are added below, so that nothing is lost where a node's
        /// exponent is smaller than the texture's.
        const MORE_BITS: u32 = FACTOR_BITS - ONE.ilog2();
        const { assert!(MAX_EXPONENT as u32 <= MORE_BITS) }
        let (mut halves, mut words, mut factors) = ([&[][..]; 4], [&[][..]; 4], [0; 4]);
        let mut powers = [0.0; 4];
        for (index, (&(speed, force), &weight)) in
            point.nodes.iter().zip(&point.weights).enumerate()
        {
            let node = texture.node(speed, force);
            powers[index] = node.prediction_error_power;
            let factor = |exponent: u8| {
                ((weight << MORE_BITS) >> (common - u32::from(exponent))).cast_signed()
            };
            match node.coefficients {
                Coefficients::Direct16 { exponent, codes } => {
                    (halves[index], factors[index]) = (codes, factor(exponent));
                }
                Coefficients::Direct32 { exponent, codes } => {
                    (words[index], factors[index]) = (codes, factor(exponent));
                }
                Coefficients::Lattice { .. } => {}
            }
        }
        let codes = match texture.structure() {
            Structure::DirectForm16 => Codes::Halves(halves),
            Structure::DirectForm32 | Structure::NormalisedLattice => Codes::Words(words),
        };
        Self {
            codes,
            factors,
            powers,
        }
    }

    /// The run from tap `done` on with its number of taps, at most `most`; none where no node has a tap left.
    ///
    /// A node that has none has the factor 0 and another node's codes, so that a run needs no case for it.
    fn run(&self, done: usize, most: usize) -> Option<(Run<'a>, usize)> {
        match self.codes {
            Codes::Halves(codes) => self.run_of(&codes, Codes::Halves, done, most),
            Codes::Words(codes) => self.run_of(&codes, Codes::Words, done, most),
        }
    }

    fn run_of<T>(
        &self,
        codes: &[&'a [T]; 4],
        of: impl Fn([&'a [T]; 4]) -> Codes<'a>,
        done: usize,
        most: usize,
    ) -> Option<(Run<'a>, usize)> {
        let left = codes.iter().map(|codes| codes.len().saturating_sub(done));
        let taps = left.filter(|&left| left > 0).min()?.min(most);
        let other = codes
            .iter()
            .find_map(|codes| codes.get(done..done + taps))?;
        let mut run = Run {
            codes: self.codes,
            factors: [0; 4],
        };
        let mut taken = [other; 4];
        for index in 0..4 {
            if let Some(own) = codes[index].get(done..done + taps) {
                taken[index] = own;
                run.factors[index] = self.factors[index];
            }
        }
        run.codes = of(taken);
        (taps > 0).then_some((run, taps))
    }
}

/// Turns per pass of a predictor of `order` taps. Each takes [`TAPS_PER_TURN`] of them.
pub const fn turns(order: usize) -> usize {
    order.saturating_sub(NEAR_TAPS).div_ceil(TAPS_PER_TURN)
}

/// The most taps that cost no more than `order` of them.
pub const fn taps_at_the_cost_of(order: usize) -> usize {
    NEAR_TAPS + turns(order) * TAPS_PER_TURN
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
            ahead: [0; 2 * SUMS],
            place: 0,
        }
    }

    /// A filter whose last outputs are `history`, newest first, with the sums ahead of `frame`.
    pub fn from_history<A: Arithmetic>(history: &[i32; MAX_ORDER], frame: &DirectFrame) -> Self {
        let mut state = Self::new();
        let (first, second) = state.history.split_at_mut(MAX_ORDER);
        first.copy_from_slice(history);
        second.copy_from_slice(history);
        state.begin::<A>(frame);
        state
    }

    /// Begins the outputs of `frame`: the sums ahead are made anew with its coefficients.
    ///
    /// To be called before the first output of another frame, or of a frame that was updated. It takes the products of
    /// three outputs, and as many instructions if the coefficients are those of the frame before.
    pub fn begin<A: Arithmetic>(&mut self, frame: &DirectFrame) {
        (self.ahead, self.place) = ([0; 2 * SUMS], 0);
        // The samples of the block before are younger than those that the pass takes.
        self.sum_ahead::<A>(frame, 0..SUMS, SUMS, 0);
    }

    /// The last outputs, newest first, in steps of the history.
    pub fn history(&self) -> &[i32] {
        &self.history[self.newest..][..MAX_ORDER]
    }

    /// Passes one sample of excitation through the filter of `frame`, the one that [`DirectState::begin`] was last
    /// called with.
    ///
    /// The excitation has steps of the history with [`SUM_FRACTION_BITS`] digits after the point; the output has
    /// steps of the history. The flag is true if the output was saturated.
    #[inline(always)]
    pub fn filter<A: Arithmetic>(&mut self, frame: &DirectFrame, excitation: i64) -> (i32, bool) {
        let output = self.put_out(frame, excitation);
        self.look_ahead::<A>(frame);
        output
    }

    /// The first half of [`DirectState::filter`], at whose end the output is known.
    #[inline(always)]
    pub fn put_out(&mut self, frame: &DirectFrame, excitation: i64) -> (i32, bool) {
        let window: &[i32; NEAR_TAPS] = self.history[self.newest..]
            .first_chunk()
            .expect("the newest sample lies in the first half");
        let near = frame.coefficients[..NEAR_TAPS].iter().zip(window);
        let near = near.fold(0, |sum: i64, (&a, &b)| {
            sum.wrapping_add(i64::from(a) * i64::from(b))
        });
        let ahead = core::mem::take(&mut self.ahead[self.place]);
        // The mask tells the compiler that no shift is as wide as a word, which takes it half the instructions.
        let shift = (COEFFICIENT_FRACTION_BITS - SUM_FRACTION_BITS - frame.exponent) & 31;
        let sum = excitation + (near.wrapping_add(ahead) >> shift);
        let (output, saturated) = saturate(shift_toward_zero(sum, SUM_FRACTION_BITS));
        self.push(output);
        (output, saturated)
    }

    /// The second half of [`DirectState::filter`]: a third of the sums of the next block.
    #[inline(always)]
    pub fn look_ahead<A: Arithmetic>(&mut self, frame: &DirectFrame) {
        let (of_block, next_block) = if self.place < SUMS {
            (self.place, SUMS)
        } else {
            (self.place - SUMS, 0)
        };
        let third = SUMS - 1 - of_block;
        self.sum_ahead::<A>(frame, third..third + 1, of_block + 1, next_block);
        self.place = if self.place == 2 * SUMS - 1 {
            0
        } else {
            self.place + 1
        };
    }

    /// Adds the products of the taps of some thirds to the three sums from place `block` on. `known` samples are
    /// younger than the youngest that a sum takes.
    #[inline(always)]
    fn sum_ahead<A: Arithmetic>(
        &mut self,
        frame: &DirectFrame,
        thirds: Range<usize>,
        known: usize,
        block: usize,
    ) {
        let turns = thirds.start * frame.turns..thirds.end * frame.turns;
        let samples = &self.history[self.newest + known + turns.start * TURN_TAPS..];
        let coefficients: &[Turn] = frame.coefficients[NEAR_TAPS..].as_chunks().0;
        let sums = A::sums_of_products(&coefficients[turns], samples);
        for (ahead, sum) in self.ahead[block..][..SUMS].iter_mut().zip(sums) {
            // Products of one frame have room, see its coefficients.
            *ahead = ahead.wrapping_add(sum);
        }
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
