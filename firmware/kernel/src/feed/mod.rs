//! The excitation of a fed texture, which has codebooks of its recordings' residual, or a track of their level.
//!
//! ```text
//! excitation(n) = source(n) · level(n)
//! source = Gaussian noise, or pieces of a codebook       level = 1, or pieces of a level track
//! ```
//! Both factors have a mean square of 1 and are independent, so that the product also has a mean square of 1; see
//! [`model_format::limits::MIN_FED_POWER`]. A [`Feed`] computes the excitation below the tick's priority, because
//! codebooks lie in the library's memory, which no tick reads. The excitation goes to the tick with the frame of its
//! block, one word per sample; see [`crate::Frame::feed`].
//!
//! **Scale.** A step is 2⁻²⁵ standard deviations, and full scale is 64 standard deviations, eight times that of a plain
//! texture. The highest peak of a codebook is 40 standard deviations ([`model_format::limits::MAX_CODEBOOK_PEAK`]).
//!
//! **Same bits.** The samples follow from the seed, the texture and the motion at each sample. They do not depend on
//! the lengths of blocks. Random choices come from a separate generator, so that the Gaussian noise is the same as it
//! would be without them.

mod draws;
mod level;
mod pieces;
mod scale;
mod snippets;

use model_format::{Excitation as Codebooks, Modulation, Texture};

use crate::excitation::Excitation;
use crate::fixed::{saturate, shift_toward_zero};
use crate::grid::GridPoint;
use draws::Draws;
use level::Level;
use model_format::LEVEL_FRACTION_BITS;
use pieces::Pieces;
pub(crate) use scale::gaussian_sample;
pub use scale::{FED_FRACTION_BITS, FED_HEADROOM_BITS};
use snippets::Snippets;

/// The content of a texture that a [`Feed`] plays from, parsed once for a block.
#[derive(Clone, Copy, Debug)]
pub struct Material<'a> {
    codebooks: Option<Codebooks<'a>>,
    modulation: Option<Modulation<'a>>,
    sample_rate_hz: u32,
}

impl<'a> Material<'a> {
    /// The content of `texture`.
    pub fn of(texture: &Texture<'a>) -> Self {
        Self {
            codebooks: texture.excitation(),
            modulation: texture.modulation(),
            sample_rate_hz: texture.sample_rate_hz(),
        }
    }
}

/// The source of a fed texture's excitation.
#[derive(Clone, Debug)]
pub struct Feed {
    gaussian: Excitation,
    draws: Draws,
    pieces: Pieces,
    snippets: Snippets,
    level: Level,
    /// Frames that were fed.
    frames: u32,
}

impl Feed {
    /// A source that gives the same excitation for the same seed, always and everywhere.
    pub fn new(seed: u64) -> Self {
        Self {
            gaussian: Excitation::new(seed),
            draws: Draws::new(seed),
            pieces: Pieces::NONE,
            snippets: Snippets::NONE,
            level: Level::NONE,
            frames: 0,
        }
    }

    /// Begins another texture, whose Gaussian noise is `gaussian`. The random choices continue.
    pub fn begin(&mut self, gaussian: Excitation) {
        self.gaussian = gaussian;
        // Their places are those in the codebooks and the track of the texture before.
        (self.pieces, self.snippets, self.level) = (Pieces::NONE, Snippets::NONE, Level::NONE);
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

    /// Returns the next sample at `point` of the texture with this `material`: mean 0, variance 1, in steps of 2⁻²⁵,
    /// saturated at full scale.
    // Not inlined, so that its code exists only once, because the memory that holds it is small.
    #[inline(never)]
    pub fn next_sample(&mut self, material: &Material<'_>, point: &GridPoint) -> i32 {
        let source = match &material.codebooks {
            Some(codebooks) => {
                let (gaussian, draws) = (&mut self.gaussian, &mut self.draws);
                let rate = material.sample_rate_hz;
                if codebooks.moment_samples().is_some() {
                    self.snippets.next_sample(codebooks, rate, point, gaussian, draws)
                } else {
                    self.pieces.next_sample(codebooks, rate, point, gaussian, draws)
                }
            }
            None => gaussian_sample(&mut self.gaussian),
        };
        let Some(modulation) = &material.modulation else {
            return source;
        };
        let rate = material.sample_rate_hz;
        let level = self.level.next_sample(modulation, rate, &mut self.draws);
        let product = i64::from(source) * i64::from(level);
        // The highest peak, 40, times the highest level, 10^(127 / 80), is far above the full scale of 64.
        saturate(shift_toward_zero(product, LEVEL_FRACTION_BITS)).0
    }
}
