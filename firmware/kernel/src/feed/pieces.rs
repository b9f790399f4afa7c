//! Pieces of codebooks, joined by cross-fades of equal power.
//!
//! A piece takes 20 to 80 ms. It begins anywhere in its codebook, continues at the codebook's beginning after its end,
//! and has a random sign. The codebook belongs to one of the four nodes around the motion, chosen with the
//! interpolation weights as probabilities; a node without a codebook gives a piece of Gaussian noise. Two neighbouring
//! pieces overlap for 5 ms, in which their amplitudes are the cosine and the sine of an angle from 0 to a quarter turn.
//! They are independent, so that the variance stays 1.

use model_format::Excitation as Codebooks;

use super::draws::{Draws, share};
use super::scale::gaussian_sample;
use super::snippets::{source_at, value};
use crate::excitation::Excitation;
use crate::fixed::shift_toward_zero;
use crate::grid::{GridPoint, ONE};
use crate::rotation::{Rotation, THETA_QUARTER_TURN};

/// Largest number of pieces per second, for the shortest piece of 20 ms, and length of the longest piece, ms.
const SHORTEST_PER_S: u32 = 50;
const LONGEST_MS: u32 = 80;

/// Cross-fades per second; one takes 5 ms.
const FADES_PER_S: u32 = 200;

/// A piece that is played.
#[derive(Clone, Copy, Debug)]
enum Piece {
    /// Gaussian noise.
    Gaussian,
    /// Samples of a codebook.
    Codebook {
        /// Index of the codebook.
        index: u8,
        /// Index of the next sample.
        at: u32,
        /// True if the samples are negated.
        negative: bool,
    },
}

/// The state of the pieces.
#[derive(Clone, Copy, Debug)]
pub(super) struct Pieces {
    /// The piece that is played; none before the first sample.
    piece: Option<Piece>,
    /// Samples until the next piece begins.
    left: u32,
    /// The piece that is fading in, with the number of samples of the cross-fade so far.
    next: Option<(Piece, u32)>,
}

impl Pieces {
    /// No piece.
    pub const NONE: Self = Self {
        piece: None,
        left: 0,
        next: None,
    };

    /// Returns the next sample in steps of 2⁻²⁵, of at most √2 times the highest peak.
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
            self.draw(codebooks, sample_rate_hz, point, draws);
        }
        self.left -= 1;
        let piece = self.piece.get_or_insert(Piece::Gaussian);
        let sample = piece.next_sample(codebooks, gaussian);
        let Some((next, done)) = &mut self.next else {
            return sample;
        };
        let samples = fade_samples(sample_rate_hz);
        // The middle of this sample's part of the quarter turn, so that the fade is symmetrical.
        let steps = u64::from(2 * *done + 1) * THETA_QUARTER_TURN as u64;
        let rotation = Rotation::from_theta((steps / u64::from(2 * samples)) as i32);
        let other = next.next_sample(codebooks, gaussian);
        let (fading, rising) = (i64::from(sample), i64::from(other));
        let sum = i64::from(rotation.cos) * fading + i64::from(rotation.sin) * rising;
        *done += 1;
        if *done >= samples {
            (self.piece, self.next) = (Some(*next), None);
        }
        shift_toward_zero(sum, 31) as i32
    }

    /// Draws the next piece and its length.
    #[inline(never)]
    fn draw(&mut self, codebooks: &Codebooks<'_>, sample_rate_hz: u32, point: &GridPoint, draws: &mut Draws) {
        // Every piece takes three numbers, noise too, so that the choices do not depend on the codebooks.
        let source = source_at(codebooks, point, draws.below(ONE));
        let at = draws.bits();
        let length_and_sign = draws.bits();
        let drawn = match source.checked_sub(1).and_then(|index| codebooks.codebooks().get(index)) {
            Some(codebook) => Piece::Codebook {
                index: (source - 1) as u8,
                at: share(at, codebook.samples() as u32),
                negative: length_and_sign >> 31 == 1,
            },
            None => Piece::Gaussian,
        };
        let (shortest, longest) = piece_samples(sample_rate_hz);
        // The sign is shifted out, so that the length does not depend on it.
        self.left = shortest + share(length_and_sign << 1, longest - shortest + 1);
        match self.piece {
            // Noise continues as noise, without a cross-fade.
            Some(Piece::Gaussian) if matches!(drawn, Piece::Gaussian) => {}
            Some(_) => self.next = Some((drawn, 0)),
            None => self.piece = Some(drawn),
        }
    }
}

impl Piece {
    #[inline]
    fn next_sample(&mut self, codebooks: &Codebooks<'_>, gaussian: &mut Excitation) -> i32 {
        let Self::Codebook { index, at, negative } = self else {
            return gaussian_sample(gaussian);
        };
        let Some(codebook) = codebooks.codebooks().get(usize::from(*index)) else {
            return 0;
        };
        let sample = value(codebook, *at);
        *at += 1;
        if *at as usize >= codebook.samples() {
            *at = 0;
        }
        if *negative { -sample } else { sample }
    }
}

/// Samples of a cross-fade.
fn fade_samples(sample_rate_hz: u32) -> u32 {
    (sample_rate_hz / FADES_PER_S).max(1)
}

/// Fewest and most samples from one piece's beginning to the next one's. A piece is longer than its cross-fade.
fn piece_samples(sample_rate_hz: u32) -> (u32, u32) {
    let (shortest, longest) = (sample_rate_hz / SHORTEST_PER_S, sample_rate_hz * LONGEST_MS / 1000);
    let shortest = shortest.max(fade_samples(sample_rate_hz) + 1);
    (shortest, longest.max(shortest))
}
