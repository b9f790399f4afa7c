//! Interpolation from the samples of a tick to [`OVERSAMPLING`] codes, so that the images of the signal around
//! multiples of the sample rate are not heard.
//!
//! # At 5 kHz
//! Three FIR filters in a row, each of which doubles the rate: 5, 10, 20, 40 kHz. Every content up to 2 kHz passes
//! within 0.2 dB, up to 1 kHz within 0.05 dB. Its images are at least 65 dB lower. Content above 2 kHz has its first
//! image as far above 2.5 kHz as the content lies below. The first filter attenuates there only partly: the image of
//! 2.1 kHz is 40 dB lower, of 2.2 kHz 27 dB, of 2.3 kHz 17 dB, of 2.4 kHz 8 dB, and the image of 2.5 kHz is as strong
//! as the content.
//!
//! **Delay: 13.7 codes, 0.34 ms, at 100 Hz**, and at most 0.40 ms up to 1 kHz; the output has died away after 99 codes.
//! A symmetric filter with images as low would delay by 2.0 ms, and a tap is felt as late from 5.5 ms on. The first
//! filter therefore has minimum phase. This cannot be felt, because its delay varies by only 0.05 ms up to 1 kHz.
//! All-pass filters would be as fast with fewer products, but they are recursive, whereas a FIR filter is exactly
//! silent a fixed time after its input.
//!
//! # At 10 kHz
//! The first two of these filters, each at twice its rate: 10, 20, 40 kHz. Their responses therefore lie at twice the
//! frequencies. Every content up to 4 kHz passes within 0.6 dB, up to 2 kHz within 0.11 dB, up to 1 kHz within 0.05 dB.
//! These deviations are larger than at 5 kHz because the first filter compensates the loss of the third one, which is
//! missing here. Images are at least 63 dB lower. **Delay: 5.7 codes, 0.14 ms, at 100 Hz**, and at most 0.16 ms up to 1
//! kHz; the output has died away after 48 codes.
//!
//! # Design
//! - The two upper filters only remove images of 2 kHz around the middle of a wide band. Their zeros lie on the unit
//!   circle, within 0.2 π and 0.1 π of half their output rate, at Chebyshev points: with z = exp(i (π + 2 asin(sin(h /
//!   2) x))), h the half width of the band and x the roots of the Chebyshev polynomial T5 or T4.
//! - The first filter has 22 taps. Its autocorrelation r minimises, by linear programming, the largest |H|² of all
//!   three filters from 3 to 5 kHz, while |H| of all three stays within 0.04 dB up to 1 kHz and 0.2 dB up to 2 kHz, and
//!   below 0.2 dB up to 3 kHz. The filter is the minimum-phase factor of r, by its cepstrum.
//! - Taps are rounded to 2^-31. The tests compute responses and delays from the rounded taps.

use core::hint::black_box;

use super::{CODE_BITS, OVERSAMPLING, STEP_BITS};

/// Binary digits of a tap after the point.
const TAP_BITS: u32 = 31;

/// Lower binary digits of a sum that are dropped. The upper of the sum's two words remains, which takes no instruction
/// to extract. After each filter, values therefore have one binary digit fewer after the point.
const SUM_BITS: u32 = 32;

/// Binary digits that an input is shifted up before the first filter: as many as fit in 32 bits.
const HEADROOM_BITS: u32 = 2;

const _: () = assert!(
    STEP_BITS + HEADROOM_BITS == CODE_BITS + 3 * (SUM_BITS - TAP_BITS),
    "three filters lead from the unit of the inputs to that of the outputs"
);

/// Like [`HEADROOM_BITS`], for the two filters at 10 kHz.
const HEADROOM_BITS_OF_PAIR: u32 = 1;

const _: () = assert!(
    STEP_BITS + HEADROOM_BITS_OF_PAIR == CODE_BITS + 2 * (SUM_BITS - TAP_BITS),
    "two filters lead from the unit of the inputs to that of the outputs"
);

/// Taps of a filter that doubles a rate, in pairs: the even taps give the first of two samples, the odd taps the
/// second.
type Pairs<const COUNT: usize> = [[i32; 2]; COUNT];

/// From 5 to 10 kHz, or from 10 to 20 kHz; minimum phase.
static FIRST: Pairs<11> = [
    [208_552_727, 896_268_715],
    [1_802_854_731, 1_916_999_587],
    [681_042_604, -837_525_615],
    [-1_007_227_649, 97_304_816],
    [775_180_686, 215_003_834],
    [-488_116_274, -291_096_170],
    [272_111_097, 272_805_815],
    [-122_480_078, -218_022_724],
    [16_628_125, 137_130_407],
    [34_842_437, -52_521_828],
    [-35_773_952, 1_269_593],
];

/// From 10 to 20 kHz, or from 20 to 40 kHz.
static SECOND: Pairs<3> = [
    [151_918_481, 687_057_783],
    [1_308_507_385, 1_308_507_385],
    [687_057_783, 151_918_481],
];

/// From 20 to 40 kHz, five taps.
static THIRD: Pairs<3> = [
    [275_148_215, 1_073_659_436],
    [1_597_351_995, 1_073_659_436],
    [275_148_215, 0],
];

/// Number of codes that one input affects: the length of the response of the three filters in a row.
const LENGTH: usize = ((2 * FIRST.len() - 1) * 2 + 2 * SECOND.len() - 1) * 2 + 2 * THIRD.len() - 1;

/// Number of ticks whose codes an input affects, including its own. At 10 kHz an input affects about half as many.
pub const TICKS: u32 = LENGTH.div_ceil(OVERSAMPLING) as u32;

/// Largest magnitude of an input: twice the converter's full scale to one side.
const LARGEST_INPUT: i64 = 2 << (11 + STEP_BITS);

/// Largest magnitude of the outputs, converter steps.
pub const LARGEST_OUTPUT: i32 = {
    let first = through(LARGEST_INPUT << HEADROOM_BITS, &FIRST);
    assert!(first <= i32::MAX as i64, "every sum fits in 32 bits");
    let three = through(through(first, &SECOND), &THIRD);
    let first = through(LARGEST_INPUT << HEADROOM_BITS_OF_PAIR, &FIRST);
    let two = through(first, &SECOND);
    let largest = if two > three { two } else { three };
    (largest >> CODE_BITS) as i32 + 1
};

/// Largest magnitude of the outputs of a filter for inputs of at most `largest`.
const fn through<const COUNT: usize>(largest: i64, pairs: &Pairs<COUNT>) -> i64 {
    // A sum is rounded down by less than one.
    ((largest * peak(pairs)) >> SUM_BITS) + 2
}

/// Largest sum of magnitudes of the taps that give one sample.
const fn peak<const COUNT: usize>(pairs: &Pairs<COUNT>) -> i64 {
    let (mut sums, mut n) = ([0; 2], 0);
    while n < COUNT {
        sums[0] += pairs[n][0].unsigned_abs() as i64;
        sums[1] += pairs[n][1].unsigned_abs() as i64;
        n += 1;
    }
    if sums[0] > sums[1] { sums[0] } else { sums[1] }
}

/// A filter that doubles a rate, with its last inputs, one fewer than its pairs of taps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Doubler<const HELD: usize> {
    inputs: [i32; HELD],
}

impl<const HELD: usize> Doubler<HELD> {
    const fn new() -> Self {
        Self { inputs: [0; HELD] }
    }

    /// The two next samples, which have one binary digit fewer after the point than the input, rounded down.
    #[inline(always)]
    fn next<const COUNT: usize>(&mut self, pairs: &Pairs<COUNT>, input: i32) -> [i32; 2] {
        const { assert!(COUNT == HELD + 1, "an input is held for each further pair") };
        let (mut sums, mut input) = ([0; 2], input);
        for (index, pair) in pairs.iter().enumerate() {
            for (sum, &tap) in sums.iter_mut().zip(pair) {
                *sum += i64::from(input) * i64::from(tap);
            }
            if let Some(held) = self.inputs.get_mut(index) {
                core::mem::swap(&mut input, held);
            }
        }
        sums.map(|sum| (sum >> SUM_BITS) as i32)
    }
}

/// The three filters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Interpolator {
    first: Doubler<10>,
    second: Doubler<2>,
    third: Doubler<2>,
    /// Number of ticks since the last input that was not exactly zero, at most [`TICKS`].
    silent: u32,
}

impl Interpolator {
    /// Filters that hold nothing but zeros.
    pub const fn new() -> Self {
        Self {
            first: Doubler::new(),
            second: Doubler::new(),
            third: Doubler::new(),
            silent: TICKS,
        }
    }

    /// The next outputs, converter steps of 2^-15, for an input in steps of 2^-16 that is at most twice the converter's
    /// full scale.
    #[inline(always)]
    pub fn next(&mut self, input: i32) -> [i32; OVERSAMPLING] {
        // A product in place of a branch: the path does not depend on the input.
        self.silent = (self.silent + 1).min(TICKS) * u32::from(input == 0);
        // The boxes hide the taps from the compiler, which would otherwise build each in two instructions instead of
        // loading it.
        let (second, third) = (black_box(&SECOND), black_box(&THIRD));
        let mut outputs = [0; OVERSAMPLING];
        let mut left = outputs.as_chunks_mut::<2>().0.iter_mut();
        // Without this box the compiler computes the second half in the same way as the first, and keeps every tap for
        // it.
        let halves = black_box(self.first.next(black_box(&FIRST), input << HEADROOM_BITS));
        for half in halves {
            for quarter in self.second.next(second, half) {
                if let Some(pair) = left.next() {
                    *pair = self.third.next(third, quarter);
                }
            }
        }
        outputs
    }

    /// Like [`Interpolator::next`], for the two inputs of a tick at 10 kHz. Only an empty interpolator may change
    /// between one input and two per tick.
    #[inline(always)]
    pub fn next_of_pair(&mut self, inputs: [i32; 2]) -> [i32; OVERSAMPLING] {
        self.silent = (self.silent + 1).min(TICKS) * u32::from(inputs == [0; 2]);
        let (first, second) = (black_box(&FIRST), black_box(&SECOND));
        let mut outputs = [0; OVERSAMPLING];
        let mut left = outputs.as_chunks_mut::<2>().0.iter_mut();
        for input in inputs {
            for half in self.first.next(first, input << HEADROOM_BITS_OF_PAIR) {
                if let Some(pair) = left.next() {
                    *pair = self.second.next(second, half);
                }
            }
        }
        outputs
    }

    /// Returns true if the last output was exactly zero, and all further ones are until an input is not zero.
    #[inline(always)]
    pub fn is_empty(&self) -> bool {
        self.silent == TICKS
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use core::f64::consts::TAU;
    use core::ops::Range;
    use proptest::prelude::*;
    use std::vec::Vec;

    const PIN_HZ: f64 = 40_000.0;

    /// Response of filters in a row to one input, computed from their taps. A zero at the end only fills the last pair.
    fn response_of(filters: &[&[[i32; 2]]]) -> Vec<f64> {
        let unit = (1u32 << TAP_BITS) as f64;
        filters.iter().fold(std::vec![1.0], |inputs, pairs| {
            let taps = pairs.iter().flatten().map(|&tap| f64::from(tap) / unit);
            let mut taps: Vec<f64> = taps.collect();
            taps.pop_if(|tap| *tap == 0.0);
            // The inputs of each filter lie two of its outputs apart.
            let mut outputs = std::vec![0.0; 2 * inputs.len() - 2 + taps.len()];
            for (n, input) in inputs.iter().enumerate() {
                for (k, tap) in taps.iter().enumerate() {
                    outputs[2 * n + k] += input * tap;
                }
            }
            outputs
        })
    }

    /// Response of the three filters at 5 kHz.
    fn response() -> Vec<f64> {
        response_of(&[&FIRST, &SECOND, &THIRD])
    }

    /// Response of the two filters at 10 kHz: half as many codes per input, and so half of the gain that [`at`] divides
    /// by.
    fn response_of_pair() -> Vec<f64> {
        response_of(&[&FIRST, &SECOND]).iter().map(|code| 2.0 * code).collect()
    }

    /// What one rate's filters do.
    struct Passed {
        response: Vec<f64>,
        length: usize,
        /// Largest error of the gain in dB, up to each frequency.
        gains: &'static [(f64, f64)],
        images: &'static [f64],
        image_db: f64,
        /// In codes, at 100 Hz.
        delay: f64,
        /// In codes, up to 1 kHz.
        delays: Range<f64>,
    }

    #[test]
    fn contents_pass_as_they_are_with_one_delay_and_without_images() {
        let at_five_kilohertz = Passed {
            response: response(),
            length: 99,
            gains: &[(1000.0, 0.05), (2000.0, 0.21)],
            images: &[5e3, 10e3, 15e3, 20e3],
            image_db: -65.0,
            delay: 13.7,
            delays: 13.2..16.0,
        };
        let at_ten_kilohertz = Passed {
            response: response_of_pair(),
            length: 48,
            gains: &[(1000.0, 0.05), (2000.0, 0.11), (4000.0, 0.6)],
            images: &[10e3, 20e3],
            image_db: -63.0,
            delay: 5.7,
            delays: 5.6..6.2,
        };
        assert_eq!((LENGTH, TICKS), (99, 13));
        for passed in [at_five_kilohertz, at_ten_kilohertz] {
            assert_eq!(passed.response.len(), passed.length);
            let (_, delay) = at(&passed.response, 100.0);
            assert!((delay - passed.delay).abs() < 0.1, "{delay} codes");
            let mut hertz = 0.0;
            for &(highest, error) in passed.gains {
                while hertz <= highest {
                    let (content, delay) = at(&passed.response, hertz);
                    let gain = decibels(content);
                    assert!(gain.abs() <= error, "{gain} dB at {hertz} Hz");
                    let has_delay = !(20.0..=1000.0).contains(&hertz) || passed.delays.contains(&delay);
                    assert!(has_delay, "{delay} codes at {hertz} Hz");
                    for image in passed
                        .images
                        .iter()
                        .flat_map(|multiple| [multiple - hertz, multiple + hertz])
                    {
                        let down = decibels(at(&passed.response, image).0 / content);
                        assert!(down <= passed.image_db, "{down} dB at {image} Hz, of {hertz} Hz");
                    }
                    hertz += 5.0;
                }
            }
        }
    }

    /// Amplitude and group delay, in codes, at `hertz`; the amplitude is one where the signal passes unchanged.
    fn at(response: &[f64], hertz: f64) -> (f64, f64) {
        let (mut sum, mut weighted) = ([0.0; 2], [0.0; 2]);
        for (n, value) in response.iter().enumerate() {
            let phase = TAU * hertz / PIN_HZ * n as f64;
            for (part, of) in [phase.cos(), -phase.sin()].into_iter().enumerate() {
                sum[part] += value * of;
                weighted[part] += value * of * n as f64;
            }
        }
        let square = sum[0].powi(2) + sum[1].powi(2);
        let delay = (weighted[0] * sum[0] + weighted[1] * sum[1]) / square;
        (square.sqrt() / OVERSAMPLING as f64, delay)
    }

    fn decibels(ratio: f64) -> f64 {
        20.0 * ratio.log10()
    }

    /// Outputs to `inputs`, from the response.
    fn exactly(inputs: &[i32]) -> Vec<f64> {
        let response = response();
        let mut outputs = std::vec![0.0; inputs.len() * OVERSAMPLING + response.len()];
        for (tick, &input) in inputs.iter().enumerate() {
            for (n, value) in response.iter().enumerate() {
                outputs[tick * OVERSAMPLING + n] += f64::from(input) * value;
            }
        }
        outputs.truncate(inputs.len() * OVERSAMPLING);
        outputs
    }

    const HIGHEST: i32 = LARGEST_INPUT as i32;
    const INPUT_STEP: f64 = (1 << STEP_BITS) as f64;
    const OUTPUT_STEP: f64 = (1 << CODE_BITS) as f64;

    #[test]
    fn the_largest_output_is_that_of_the_worst_signs_and_below_the_bound() {
        let response = response();
        let bound = f64::from(LARGEST_OUTPUT) * OUTPUT_STEP;
        for phase in 0..OVERSAMPLING {
            let signs = response.iter().skip(phase).step_by(OVERSAMPLING);
            let mut inputs: Vec<i32> = signs.map(|tap| HIGHEST * tap.signum() as i32).collect();
            inputs.reverse();
            let mut interpolator = Interpolator::new();
            let last = inputs.iter().map(|&input| interpolator.next(input)).last();
            let reached = f64::from(last.expect("there are inputs")[phase]);
            let expected: f64 = response
                .iter()
                .skip(phase)
                .step_by(OVERSAMPLING)
                .map(|tap| tap.abs())
                .sum();
            let ratio = reached / OUTPUT_STEP / (f64::from(HIGHEST) / INPUT_STEP) / expected;
            assert!((ratio - 1.0).abs() < 1e-6, "{ratio}");
            assert!(reached <= bound, "{reached} of {bound}");
            assert!(reached > bound / 1.5, "{reached} of {bound}");
        }
    }

    proptest! {
        #[test]
        fn outputs_are_those_of_the_response_to_the_last_digit_but_three(
            inputs in prop::collection::vec(prop_oneof![-HIGHEST..=HIGHEST, Just(HIGHEST), Just(-HIGHEST)], 1..100),
        ) {
            let mut interpolator = Interpolator::new();
            let outputs = inputs.iter().flat_map(|&input| interpolator.next(input));
            for (output, exact) in outputs.zip(exactly(&inputs)) {
                let exact = exact * OUTPUT_STEP / INPUT_STEP;
                prop_assert!((f64::from(output) - exact).abs() < 3.0, "{} {}", output, exact);
            }
        }

        #[test]
        fn outputs_of_pairs_are_those_of_their_response_to_the_last_digit_but_three(
            inputs in prop::collection::vec(
                (-HIGHEST..=HIGHEST, prop_oneof![Just(HIGHEST), Just(-HIGHEST)]), 1..60,
            ),
        ) {
            let response = response_of_pair();
            let flat: Vec<i32> = inputs.iter().flat_map(|&(a, b)| [a, b]).collect();
            let bound = f64::from(LARGEST_OUTPUT) * OUTPUT_STEP;
            let mut interpolator = Interpolator::new();
            let outputs = inputs.iter().flat_map(|&pair| interpolator.next_of_pair(pair.into()));
            for (n, output) in outputs.enumerate() {
                let exact: f64 = (0..=n / 4)
                    .filter_map(|input| Some(f64::from(flat[input]) * response.get(n - 4 * input)?))
                    .sum();
                let exact = exact / 2.0 * OUTPUT_STEP / INPUT_STEP;
                prop_assert!((f64::from(output) - exact).abs() < 3.0, "{} {}", output, exact);
                prop_assert!(f64::from(output).abs() <= bound);
            }
        }

        #[test]
        fn after_pairs_the_interpolator_is_empty_before_another_rate_begins(
            pairs in prop::collection::vec([-HIGHEST..=HIGHEST, -HIGHEST..=HIGHEST], 1..40), next: i16,
        ) {
            let mut interpolator = Interpolator::new();
            for pair in pairs {
                interpolator.next_of_pair(pair);
            }
            for _ in 0..TICKS {
                interpolator.next_of_pair([0; 2]);
            }
            prop_assert!(interpolator.is_empty());
            prop_assert_eq!(interpolator.next(next.into()), Interpolator::new().next(next.into()));
        }

        #[test]
        fn the_interpolator_is_empty_exactly_when_nothing_is_left(
            inputs in prop::collection::vec(-HIGHEST..=HIGHEST, 1..40), last in 1..=HIGHEST,
        ) {
            let mut interpolator = Interpolator::new();
            prop_assert!(interpolator.is_empty());
            for input in inputs.into_iter().chain([last]) {
                interpolator.next(input);
            }
            for tick in 1..TICKS + 10 {
                prop_assert_eq!(interpolator.is_empty(), tick > TICKS);
                let outputs = interpolator.next(0);
                prop_assert!(tick < TICKS || outputs == [0; OVERSAMPLING]);
            }
        }
    }
}
