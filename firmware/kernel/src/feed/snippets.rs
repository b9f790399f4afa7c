//! Recorded snippets: codebooks that are played on.
//!
//! A snippet takes 0.12 to 0.48 s. Its codebook belongs to one of the four nodes around the motion, chosen with the
//! interpolation weights as probabilities; a node without a codebook gives a snippet of Gaussian noise. Each codebook
//! keeps its place, so that a snippet goes on with what follows the last snippet of its codebook: a wave that lasts
//! longer than a snippet is played as it was recorded. After the codebook's end follows its beginning.
//!
//! A pass of a codebook plays each of its eight parts once, in a random order, and each pass divides it at other
//! places. Nothing comes twice before all was played. In one order, a motion at one speed and force would repeat itself
//! at the distance of a codebook. A part is not faded in. The excitation is white, and a joint of white noise is none:
//! the filter's ringing makes the transition.

use model_format::limits::MAX_CODEBOOKS;
use model_format::{Codebook, Excitation as Codebooks, SHARE_FRACTION_BITS};

use super::draws::Draws;
use super::scale::{FED_FRACTION_BITS, gaussian_sample};
use crate::excitation::Excitation;
use crate::fixed::shift_toward_zero;
use crate::grid::{GridPoint, ONE};

/// Shortest and longest snippet, ms.
const SHORTEST_MS: u32 = 120;
const LONGEST_MS: u32 = 480;

/// Parts of a codebook that a pass plays in a random order.
const PARTS: u32 = u8::BITS;

/// What plays now, the samples until the next snippet, and the place in each codebook.
#[derive(Clone, Copy, Debug)]
pub(super) struct Snippets {
    /// The source that is played: 0 for Gaussian noise, k for codebook number k, from 1.
    source: usize,
    /// Samples until the next snippet begins.
    left: u32,
    /// The place in each codebook.
    places: [Place; MAX_CODEBOOKS],
}

/// A place in a codebook.
#[derive(Clone, Copy, Debug)]
struct Place {
    /// Index of the next sample.
    at: u32,
    /// Samples that are left of the part.
    left: u32,
    /// Index of the sample at which the first part of this pass begins.
    first: u32,
    /// Parts that this pass has not played, a bit each.
    unplayed: u8,
}

impl Snippets {
    /// No snippet.
    pub const NONE: Self = Self {
        source: 0,
        left: 0,
        places: [Place::NONE; MAX_CODEBOOKS],
    };

    /// Returns the next sample in steps of 2⁻²⁵, at most the highest peak.
    #[inline]
    pub fn next_sample(
        &mut self,
        codebooks: &Codebooks<'_>,
        sample_rate_hz: u32,
        point: &GridPoint,
        gaussian: &mut Excitation,
        draws: &mut Draws,
    ) -> i32 {
        if self.left == 0 {
            self.source = source_at(codebooks, point, draws.below(ONE));
            let [shortest, longest] = [SHORTEST_MS, LONGEST_MS].map(|ms| sample_rate_hz * ms / 1000);
            // At the lowest sample rates a snippet has one sample.
            self.left = (shortest + draws.below(longest - shortest + 1)).max(1);
        }
        self.left -= 1;
        let index = self.source.wrapping_sub(1);
        let (Some(codebook), Some(place)) = (codebooks.codebooks().get(index), self.places.get_mut(index)) else {
            return gaussian_sample(gaussian);
        };
        place.next_sample(codebook, draws)
    }
}

impl Place {
    /// No pass.
    const NONE: Self = Self {
        at: 0,
        left: 0,
        first: 0,
        unplayed: 0,
    };

    #[inline]
    fn next_sample(&mut self, codebook: &Codebook<'_>, draws: &mut Draws) -> i32 {
        let samples = codebook.samples() as u32;
        if self.left == 0 {
            self.begin_part(samples, draws);
        }
        self.left -= 1;
        let sample = value(codebook, self.at);
        self.at += 1;
        if self.at >= samples {
            self.at = 0;
        }
        sample
    }

    /// Begins a part that this pass has not played, or one of a new pass.
    fn begin_part(&mut self, samples: u32, draws: &mut Draws) {
        if self.unplayed == 0 {
            self.unplayed = u8::MAX;
            self.first = draws.below(samples);
        }
        let mut parts = self.unplayed;
        for _ in 0..draws.below(parts.count_ones()) {
            // Clears the lowest bit that is set.
            parts &= parts.wrapping_sub(1);
        }
        let part = parts.trailing_zeros();
        self.unplayed &= !(1 << part);
        let [begin, end] = [part, part + 1].map(|part| part * samples / PARTS);
        self.at = (self.first + begin) % samples;
        self.left = end - begin;
    }
}

/// Value of sample number `at` in steps of 2⁻²⁵.
#[inline]
fn value(codebook: &Codebook<'_>, at: u32) -> i32 {
    // A power of two scales a float exactly.
    let peak = (codebook.peak() * (1u32 << FED_FRACTION_BITS) as f32) as i32;
    let product = i64::from(codebook.share(at as usize)) * i64::from(peak);
    shift_toward_zero(product, SHARE_FRACTION_BITS) as i32
}

/// Returns the source of the node at `point` that `place`, below [`ONE`], falls on when the weights of the four nodes
/// are lined up: 0 for Gaussian noise, k for codebook number k, from 1.
fn source_at(codebooks: &Codebooks<'_>, point: &GridPoint, place: u32) -> usize {
    let mut end = 0;
    for (&(speed, force), &weight) in point.nodes.iter().zip(&point.weights) {
        end += weight;
        if place < end {
            return codebooks.of_node(speed, force);
        }
    }
    // Never reached, because the weights add up to [`ONE`].
    0
}
