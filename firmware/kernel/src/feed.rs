//! The excitation of a fed texture, which has codebooks of its recordings' residual: Gaussian noise, and snippets of
//! the codebooks at their recorded level.
//!
//! Each has a mean square of 1; see [`model_format::limits::MIN_CODEBOOK_POWER`]. A [`Feed`] computes the excitation
//! below the tick's priority, because codebooks lie in the library's memory, which no tick reads. The excitation goes
//! to the tick with the frame of its block, one word per sample; see [`crate::Frame::feed`].
//!
//! **Scale.** A step is 2⁻²⁵ standard deviations, and full scale is 64 standard deviations, eight times that of a plain
//! texture. The highest peak of a codebook is 40 standard deviations ([`model_format::limits::MAX_CODEBOOK_PEAK`]).
//!
//! **Same bits.** The samples follow from the seed, the texture and the motion at each sample. They do not depend on
//! the lengths of blocks. Random choices come from a separate generator, so that the Gaussian noise is the same as it
//! would be without them.
//!
//! **Snippets.** A snippet takes 0.12 to 0.48 s. Its codebook belongs to one of the four nodes around the motion,
//! chosen with the interpolation weights as probabilities; a node without a codebook gives a snippet of Gaussian noise.
//! Each codebook keeps its place, so that a snippet goes on with what follows the last snippet of its codebook: a wave
//! that lasts longer than a snippet is played as it was recorded. After the codebook's end follows its beginning.
//!
//! A pass of a codebook plays each of its eight parts once, in a random order, and each pass divides it at other
//! places. Nothing comes twice before all was played. In one order, a motion at one speed and force would repeat itself
//! at the distance of a codebook. A part is not faded in. The excitation is white, and a joint of white noise is none:
//! the filter's ringing makes the transition.

use model_format::limits::MAX_CODEBOOKS;
use model_format::{Codebook, Excitation as Codebooks, SHARE_FRACTION_BITS, Texture};
use rand_core::Rng;
use rand_pcg::Pcg32;

use crate::excitation::{self, Excitation, hashed};
use crate::fixed::shift_toward_zero;
use crate::grid::{GridPoint, ONE};

/// The content of a texture that a [`Feed`] plays from, parsed once for a block.
#[derive(Clone, Copy, Debug)]
pub struct Material<'a> {
    codebooks: Option<Codebooks<'a>>,
    sample_rate_hz: u32,
}

impl<'a> Material<'a> {
    /// The content of `texture`.
    pub fn of(texture: &Texture<'a>) -> Self {
        Self {
            codebooks: texture.excitation(),
            sample_rate_hz: texture.sample_rate_hz(),
        }
    }
}

/// The source of a fed texture's excitation.
#[derive(Clone, Debug)]
pub struct Feed {
    gaussian: Excitation,
    draws: Draws,
    snippets: Snippets,
    /// Frames that were fed.
    frames: u32,
}

impl Feed {
    /// A source that gives the same excitation for the same seed, always and everywhere.
    pub fn new(seed: u64) -> Self {
        Self {
            gaussian: Excitation::new(seed),
            draws: Draws::new(seed),
            snippets: Snippets::NONE,
            frames: 0,
        }
    }

    /// Begins another texture, whose Gaussian noise is `gaussian`. The random choices continue.
    pub fn begin(&mut self, gaussian: Excitation) {
        self.gaussian = gaussian;
        // Its places are those in the codebooks of the texture before.
        self.snippets = Snippets::NONE;
    }

    /// Returns the number of the next frame, which differs from the numbers of earlier frames.
    pub(crate) fn next_frame(&mut self) -> u32 {
        self.frames = self.frames.wrapping_add(1);
        self.frames
    }

    /// The Gaussian noise, as far as it was used.
    pub fn gaussian(&self) -> &Excitation {
        &self.gaussian
    }

    /// Returns the next sample at `point` of the texture with this `material`: mean 0, variance 1, in steps of 2⁻²⁵.
    // Not inlined, so that its code exists only once, because the memory that holds it is small.
    #[inline(never)]
    pub fn next_sample(&mut self, material: &Material<'_>, point: &GridPoint) -> i32 {
        let Some(codebooks) = &material.codebooks else {
            return gaussian_sample(&mut self.gaussian);
        };
        let rate = material.sample_rate_hz;
        self.snippets
            .next_sample(codebooks, rate, point, &mut self.gaussian, &mut self.draws)
    }
}

/// The random choices of a feed.
#[derive(Clone, Debug)]
struct Draws(Pcg32);

impl Draws {
    /// Choices that are the same for the same seed.
    fn new(seed: u64) -> Self {
        /// Any odd increment gives the full period; this one differs from the Gaussian noise's.
        const STREAM: u64 = 0x5851_f42d_4c95_7f2d;
        /// Digits of √2, so that the state also differs from the Gaussian noise's, for this or a related seed.
        const OTHER: u64 = 0x6a09_e667_f3bc_c908;
        Self(Pcg32::new(hashed(seed ^ OTHER), STREAM))
    }

    /// Returns a random number below `count`, uniform within a relative 2⁻³² · `count`; 0 if `count` is 0.
    fn below(&mut self, count: u32) -> u32 {
        ((u64::from(self.0.next_u32()) * u64::from(count)) >> 32) as u32
    }
}

/// Binary digits after the point of a fed excitation: one standard deviation is 2²⁵, a 64th of full scale.
pub const FED_FRACTION_BITS: u32 = 25;

/// Number of binary digits after the point that a fed excitation has fewer than a Gaussian one.
pub const FED_HEADROOM_BITS: u32 = excitation::FRACTION_BITS - FED_FRACTION_BITS;

/// The next sample of Gaussian noise in the steps of a fed excitation, rounded.
#[inline]
pub(crate) fn gaussian_sample(source: &mut Excitation) -> i32 {
    const HALF: i32 = 1 << (FED_HEADROOM_BITS - 1);
    (source.next_sample() + HALF) >> FED_HEADROOM_BITS
}

/// Shortest and longest snippet, ms.
const SHORTEST_MS: u32 = 120;
const LONGEST_MS: u32 = 480;

/// Parts of a codebook that a pass plays in a random order.
const PARTS: u32 = u8::BITS;

/// What plays now, the samples until the next snippet, and the place in each codebook.
#[derive(Clone, Copy, Debug)]
struct Snippets {
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
    const NONE: Self = Self {
        source: 0,
        left: 0,
        places: [Place::NONE; MAX_CODEBOOKS],
    };

    /// Returns the next sample in steps of 2⁻²⁵, at most the highest peak.
    #[inline]
    fn next_sample(
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
