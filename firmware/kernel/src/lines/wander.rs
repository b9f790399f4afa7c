//! Wander of lines: a displacement that is a stationary Gaussian process over the position.
//!
//! ```text
//! d(x) = rms · Σ g(k) B(x / h - k) / √(∫ B²)      B the cubic B-spline, g(k) a random number per lattice point k
//! ```
//! The random numbers are a hash of the lattice point, so that nothing is stored. A position has the same displacement
//! whenever and however the tool comes to it, so the tool feels the same threads in both directions. The spacing of the
//! lattice is h = ℓ √1.5: the autocorrelation of B is nearly Gaussian with a variance of 2 h² / 3, so that ℓ is the
//! correlation length. Between lattice points the RMS varies by ±2 %. A random number is the sum of four uniform ones.

use model_format::Wander;

use super::turns::Turns;
use crate::excitation::hashed;
use crate::position::{Passage, Position, distance_steps};

/// Wander of a voice's lines, with its clock.
#[derive(Clone, Copy, Debug)]
pub(super) struct VoiceWander {
    /// Lattice points per mm.
    lattice: Turns,
    /// Displacement per unit of [`sum_at`], in steps of 2⁻¹⁶ of a step of a position.
    scale: i64,
    /// Seed of the lattice's random numbers.
    seed: u64,
    /// Speed of the clock that moves along the lattice, mm/s; 0 if the hand moves along it.
    clock_mm_s: f32,
    /// Position of the clock at the end of the previous block.
    clock: Position,
}

/// RMS of [`sum_at`]: 6 for the weights' denominator, √(2416/5040) for ∫ B², 2¹⁶/√3 for four uniform numbers.
const UNIT_RMS: f32 = 6.0 * 0.692_364_4 * 37_837.23;

/// Lattice spacing over correlation length, √1.5.
const SPACING: f32 = 1.224_744_9;

impl VoiceWander {
    /// The wander with this index among the wanders of its texture.
    pub fn new(wander: &Wander, index: usize) -> Self {
        const UNIT: f32 = (1u64 << (Position::FRACTION_BITS + 16)) as f32;
        Self {
            lattice: Turns::of(wander.correlation_mm * SPACING),
            scale: (wander.rms_mm * (UNIT / UNIT_RMS)) as i64,
            seed: hashed(index as u64),
            clock_mm_s: wander.clock_mm_s,
            clock: Position::ORIGIN,
        }
    }

    /// Returns the path of lines in a block of `samples` samples in which the tool moves along `passage`, if `left`
    /// samples of the previous block are not played.
    pub fn passage(&mut self, passage: Passage, samples: u32, left: u32, sample_rate_hz: u32) -> Passage {
        let passage = if self.clock_mm_s > 0.0 {
            let steps = |samples| distance_steps(self.clock_mm_s, samples, sample_rate_hz);
            // Like the tool, the clock goes on from where the block before was cut.
            let from = self.clock.ahead(-steps(left));
            self.clock = from.ahead(steps(samples));
            Passage {
                from,
                to: self.clock,
                jumps: false,
            }
        } else {
            passage
        };
        Passage {
            from: self.moved(passage.from),
            to: self.moved(passage.to),
            ..passage
        }
    }

    /// Returns `place`, displaced.
    fn moved(&self, place: Position) -> Position {
        let sum = sum_at(self.lattice.turns(place), self.seed);
        // With the largest RMS, 250 mm, the product is below 2⁶⁰.
        place.ahead((sum * self.scale) >> 16)
    }
}

/// Σ g(k) · 6 B(x - k) at x, in steps of 2⁻¹⁶: at most 6 · 2¹⁷ in magnitude.
fn sum_at(x: i64, seed: u64) -> i64 {
    const ONE: u64 = 1 << 48;
    let (first, t) = (x >> 16, (x & 0xffff).cast_unsigned());
    let u = (1 << 16) - t;
    // 6 B at the four points, in steps of 2⁻⁴⁸; they add up to 6.
    let (before, after) = (u * u * u, t * t * t);
    let here = 4 * ONE + 3 * after - ((6 * t * t) << 16);
    let next = 6 * ONE - before - here - after;
    let weights = [before, here, next, after];
    let terms = weights.into_iter().zip(first - 1..);
    let sum: i64 = terms
        .map(|(weight, point)| number(point, seed) * (weight >> 24).cast_signed())
        .sum();
    sum >> 24
}

/// Returns the random number of a lattice point: the sum of four uniform ones in ±2¹⁵.
fn number(point: i64, seed: u64) -> i64 {
    let bits = hashed(point.cast_unsigned() ^ seed);
    let part = |index: u32| i64::from((bits >> (16 * index)) as u16);
    // The mean of each part is half a step below 2¹⁵, so that the 2 makes the mean of the sum zero.
    part(0) + part(1) + part(2) + part(3) - 4 * 0x8000 + 2
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wander(rms_mm: f32, correlation_mm: f32) -> VoiceWander {
        let wander = Wander {
            rms_mm,
            correlation_mm,
            clock_mm_s: 0.0,
        };
        VoiceWander::new(&wander, 1)
    }

    fn displacement_mm(wander: &VoiceWander, mm: f64) -> f64 {
        let place = Position::from_exact_mm(mm);
        wander.moved(place).since(place) as f64 / libm::exp2(32.0)
    }

    /// Over 20 000 correlation lengths, also at positions far from the origin.
    #[test]
    fn a_displacement_has_the_stated_rms_and_correlation() {
        for (origin, rms_mm, correlation_mm) in [(0.0, 0.07, 3.0), (-9e8, 0.012, 0.05), (1e6, 250.0, 1000.0)] {
            let wander = wander(rms_mm, correlation_mm);
            let step = f64::from(correlation_mm) / 4.0;
            let values: [f64; 80_000] = core::array::from_fn(|n| displacement_mm(&wander, origin + step * n as f64));
            let mean_of = |lag: usize| {
                let pairs = values.iter().zip(&values[lag..]);
                pairs.map(|(a, b)| a * b).sum::<f64>() / (values.len() - lag) as f64
            };
            let power = mean_of(0);
            let rms = libm::sqrt(power) / f64::from(rms_mm);
            assert!((rms - 1.0).abs() < 0.03, "{rms}");
            for lag in [2, 4, 6, 8, 12] {
                let lengths = lag as f64 / 4.0;
                let expected = libm::exp(-0.5 * lengths * lengths);
                let found = mean_of(lag) / power;
                assert!((found - expected).abs() < 0.04, "{lag}: {found}, not {expected}");
            }
        }
    }

    /// Checks also across the lattice's points that no step of the position moves a line by more than its slope allows.
    #[test]
    fn a_displacement_is_smooth_and_at_most_five_times_its_rms() {
        let wander = wander(0.5, 2.0);
        let step = 1e-3;
        let mut before = displacement_mm(&wander, 50.0);
        for n in 1..200_000 {
            let here = displacement_mm(&wander, 50.0 + step * f64::from(n));
            assert!(here.abs() < 2.51, "{here}");
            assert!((here - before).abs() < 1.3 * step, "{here} after {before}");
            before = here;
        }
    }
}
