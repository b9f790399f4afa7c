//! Stick-slip: an amplitude modulation whose phase advances with the path.
//!
//! ```text
//! envelope = 1 - amount · (1 - w(x / duty))     w(y) = (4y(1 - y))² for y in 0..1, else 0;  x the phase, 0..1
//! ```
//! The window's value and slope are zero at both ends of a slip, and the amount ramps across each block, so that the
//! envelope has no step. It is never above one, so that no sample is larger than without stick-slip.

use model_format::OutputSample;
use model_format::scene::StickSlip;

use crate::fixed::shift_toward_zero;
use crate::grid::{Motion, ONE};
use crate::level::Ramp;

/// Least number of samples per slip; on a faster path the phase lags. The envelope changes by at most a fifth of the
/// amount from sample to sample, because the window's slope is at most 3.08.
const FEWEST_SAMPLES_PER_SLIP: f32 = 16.0;

/// A whole turn of the phase, in steps of the phase.
const TURN: f32 = 4_294_967_296.0;

/// Width of the onset of sticking, as a fraction of the threshold.
const ONSET_SHARE: f32 = 0.25;

/// The constants of a surface's stick-slip.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StickSlipWindow {
    stick_slip: StickSlip,
    /// 1 / duty in steps of 2⁻¹⁶.
    inverse_duty: u32,
    /// Largest advance of the phase per sample, in steps of 2⁻³² of a turn.
    fastest: f32,
}

/// Stick-slip of a block.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct StickSlipFrame {
    amount: Ramp,
    advance: u32,
    inverse_duty: u32,
}

/// State of a stick-slip.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct StickSlipState {
    /// Phase in steps of 2⁻³² of a period.
    phase: u32,
}

impl StickSlipWindow {
    /// The window of a valid surface's stick-slip.
    pub fn new(stick_slip: &StickSlip) -> Self {
        Self {
            stick_slip: *stick_slip,
            inverse_duty: (ONE as f32 / stick_slip.duty + 0.5) as u32,
            fastest: TURN * stick_slip.duty / FEWEST_SAMPLES_PER_SLIP,
        }
    }

    /// Amount of sticking at `motion`, in steps of 2⁻¹⁶.
    pub fn amount(&self, motion: Motion) -> u32 {
        let StickSlip {
            below_mm_s: below,
            above_n: above,
            ..
        } = self.stick_slip;
        let onset = |beyond: f32, threshold: f32| (beyond / (ONSET_SHARE * threshold)).min(1.0);
        let slow = onset((below - motion.speed_mm_s()).max(0.0), below);
        let pressed = onset((motion.force_n() - above).max(0.0), above);
        ((self.stick_slip.depth * slow * pressed * ONE as f32) as u32).min(ONE)
    }

    /// Returns the frame of a block of `samples` samples in which the tool moves by `distance_mm` and the amount goes
    /// from `from` to the amount at `motion`.
    pub fn frame(&self, motion: Motion, distance_mm: f32, from: i32, samples: u32) -> StickSlipFrame {
        let turns = distance_mm.abs() / self.stick_slip.period_mm / samples.max(1) as f32;
        StickSlipFrame {
            amount: Ramp::between(from, self.amount(motion), samples),
            // A cast of too large a number saturates, and `fastest` is far below that.
            advance: (turns * TURN).min(self.fastest) as u32,
            inverse_duty: self.inverse_duty,
        }
    }
}

impl StickSlipFrame {
    /// The amount when `left` samples of its ramp remain, in steps of 2⁻¹⁶.
    #[inline(always)]
    pub fn amount(&self, left: u32) -> i32 {
        self.amount.value(left)
    }
}

impl StickSlipState {
    /// The state at the beginning of a slip.
    pub const fn new() -> Self {
        Self { phase: 0 }
    }

    /// Returns `sample` times the envelope, when `left` samples of the frame's ramp remain.
    #[inline(always)]
    pub fn modulate(&mut self, frame: &StickSlipFrame, sample: OutputSample, left: u32) -> OutputSample {
        let envelope = self.envelope(frame, left);
        self.phase = self.phase.wrapping_add(frame.advance);
        let modulated = shift_toward_zero(i64::from(sample.0) * i64::from(envelope), 16);
        OutputSample(modulated as i32)
    }

    /// The envelope of the next sample, 0 to [`ONE`].
    #[inline(always)]
    pub fn envelope(&self, frame: &StickSlipFrame, left: u32) -> u32 {
        let turned = u64::from(self.phase >> 16) * u64::from(frame.inverse_duty);
        // Beyond the slip y stays at one, where the window is zero.
        let y = (turned >> 16).min(u64::from(ONE));
        let parabola = (y * (u64::from(ONE) - y)) >> 14;
        let window = (parabola * parabola) >> 16;
        let amount = frame.amount(left) as u64;
        ONE - ((amount * (u64::from(ONE) - window)) >> 16) as u32
    }
}
