//! Lines that are tied to position: sines over the position of the tool, in addition to the model's output.
//!
//! ```text
//! line = a(v, F) · sin(2π (x / λ + φ))        x the position, λ the wavelength, φ the phase at the origin
//! ```
//! A [`LinesFrame`] holds the lines of a block: phase and amplitude go linearly from their values at the block's
//! beginning to those at its end. So a line's frequency is v/λ at every instant, and the line retraces when the tool
//! reverses. At rest the line stands still, and its amplitude is exactly zero by the texture's law below the grid, so
//! there is no constant output. [`VoiceLines`] computes the frames, below the tick's priority.
//!
//! **Amplitude** is the weighted mean of the amplitudes of the four nodes around the motion, times the fade below the
//! grid and the voice's gain. It fades out between 0.40 and 0.44 of the sample rate.
//!
//! **A wander** displaces lines by a random function of the position, or of a clock, so that a weave's amplitude is
//! steady and its phase is not (`wander`). It is computed once per block, at both ends of the block's path.
//!
//! **A jump** of the position gives no chirp: the line fades out within the block at its previous frequency, and begins
//! at the new position with the next block. So does a line that is too fast to be played.

mod sine;
mod turns;
mod voice;
mod wander;

pub use sine::{SINE_FRACTION_BITS, sine};
pub use voice::VoiceLines;

use heapless::Vec;
use model_format::limits::MAX_LINES;

use crate::fixed::shift_toward_zero;
use crate::level::Ramp;

/// Largest amplitude of a line in steps of an output sample: 1024 m/s². With it, eight lines times the digits of their
/// sines fit in 64 bits.
const MAX_AMPLITUDE: u32 = 1 << 30;

/// A line of a block.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct LineFrame {
    /// Phase at the block's last sample, in steps of 2⁻³² of a turn.
    end: u32,
    /// Advance of the phase per sample, in the same steps; a backward advance is a negative number modulo 2³².
    step: u32,
    /// Amplitude in steps of an output sample.
    amplitude: Ramp,
}

/// The lines of a block.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct LinesFrame {
    lines: Vec<LineFrame, MAX_LINES>,
}

impl LineFrame {
    #[inline(always)]
    fn phase(&self, left: u32) -> u32 {
        self.end.wrapping_sub(self.step.wrapping_mul(left))
    }
}

impl LinesFrame {
    /// No lines.
    pub const fn new() -> Self {
        Self { lines: Vec::new() }
    }

    /// Sum of all lines when `left` samples of the block remain, in steps of an output sample.
    ///
    /// The number of instructions depends only on the number of lines.
    #[inline(always)]
    pub fn sample(&self, left: u32) -> i64 {
        let mut sum = 0;
        for line in &self.lines {
            sum += i64::from(line.amplitude.value(left)) * i64::from(sine(line.phase(left)));
        }
        shift_toward_zero(sum, SINE_FRACTION_BITS)
    }

    /// Number of lines.
    pub fn len(&self) -> usize {
        self.lines.len()
    }

    /// Returns whether there are no lines.
    pub fn is_empty(&self) -> bool {
        self.lines.is_empty()
    }
}
