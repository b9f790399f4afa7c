//! Lines of a voice from block to block, below the tick.

use heapless::Vec;
use model_format::limits::{MAX_LINES, MAX_WANDERS};
use model_format::{Line, OutputSample, Texture};

use super::wander::VoiceWander;
use super::{LineFrame, LinesFrame, MAX_AMPLITUDE};
use crate::grid::{GridPoint, Motion, ONE};
use crate::level::Ramp;
use crate::position::{Passage, Position};

/// Binary digits after the point of turns per mm.
const TURNS_BITS: u32 = 48;

/// A turn in steps of a phase.
const TURN: i64 = 1 << 32;

/// Advance of the phase per sample at which a line begins to fade: 0.40 of the sample rate.
const FADE_BEGINS: i64 = TURN * 40 / 100;

/// Advance at and above which it is silent: 0.44 of the sample rate.
const FADE_ENDS: i64 = TURN * 44 / 100;

/// Longest way of a block whose turns are counted, in steps of a position: 256 mm.
const LONGEST: u64 = 256 << Position::FRACTION_BITS;

/// Lines of a voice.
#[derive(Clone, Debug)]
pub struct VoiceLines {
    lines: Vec<PlayedLine, MAX_LINES>,
    wanders: Vec<VoiceWander, MAX_WANDERS>,
    /// The block before.
    frame: LinesFrame,
}

/// A line that is played.
#[derive(Clone, Copy, Debug)]
struct PlayedLine {
    /// Turns per mm.
    turns: Turns,
    /// Phase at the origin of positions, in steps of 2⁻³² of a turn.
    phase: u32,
    /// Index of its wander; beyond them all if it does not wander.
    wander: usize,
    /// True if the block before left the position, because the line was too fast or the position jumped.
    astray: bool,
}

/// Turns of a line per mm, in steps of 2⁻⁴⁸. The smallest has 38 digits.
#[derive(Clone, Copy, Debug)]
pub(super) struct Turns(u64);

impl Turns {
    /// The turns of `wavelength_mm`, which a valid texture has.
    pub(super) fn of(wavelength_mm: f32) -> Self {
        // A float is an integer of 24 digits times a power of two, by which the quotient of integers is shifted.
        let bits = wavelength_mm.to_bits();
        let mantissa = u64::from(bits & 0x007f_ffff | 0x0080_0000);
        let exponent = (bits >> 23).cast_signed() - 150;
        // 2⁶² / mantissa is of 39 digits; 2⁴⁸ / wavelength is that times 2^-(14 + exponent).
        let quotient = (1 << 62) / mantissa;
        let shift = 14 + exponent;
        Self(if shift >= 0 {
            quotient >> shift.min(63)
        } else {
            quotient << (-shift).min(24)
        })
    }

    /// Phase of `position`, in steps of 2⁻³² of a turn.
    fn phase(self, position: Position) -> u32 {
        // Digits 48 to 79 of the product of 64 by 64 digits, in pieces of 32. What is beyond 64 bits here is whole
        // turns.
        let (high, low) = (position.steps() >> 32, position.steps() & 0xffff_ffff);
        let (turns_high, turns_low) = ((self.0 >> 32).cast_signed(), self.0 & 0xffff_ffff);
        let lowest = (low.cast_unsigned() * turns_low) >> 32;
        let middle = low
            .wrapping_mul(turns_high)
            .wrapping_add(lowest.cast_signed());
        let middle = middle.wrapping_add(high.wrapping_mul(turns_low.cast_signed()));
        let whole = high.wrapping_mul(turns_high) << 32;
        (middle.wrapping_add(whole) >> (TURNS_BITS - 32)) as u32
    }

    /// Turns at `position`, whole turns included, in steps of 2⁻¹⁶ of a turn, off by less than one step beyond the error
    /// of the turns per mm.
    pub(super) fn turns(self, position: Position) -> i64 {
        // Each product of 32 digits by 32 is brought to steps of 2⁻³² before they are added, so that the sum has room.
        let (high, low) = (position.steps() >> 32, position.steps() & 0xffff_ffff);
        let (turns_high, turns_low) = (
            (self.0 >> 32).cast_signed(),
            (self.0 & 0xffff_ffff).cast_signed(),
        );
        let middle = ((low * turns_high) >> 16) + ((high * turns_low) >> 16);
        high * turns_high + (middle >> 16)
    }

    /// Phase of a way of `steps` steps of a position, whole turns included, from the difference of the phases at its
    /// ends, `exact`.
    fn way(self, steps: i64, exact: u32) -> i64 {
        // It is off by less than a hundredth of a turn, so that the nearest number with the exact digits is right.
        let coarse = ((steps >> 16) * (self.0 >> 16).cast_signed()) >> 16;
        coarse + i64::from(exact.wrapping_sub(coarse as u32).cast_signed())
    }
}

impl PlayedLine {
    fn new(line: &Line<'_>) -> Self {
        Self {
            turns: Turns::of(line.wavelength_mm()),
            phase: u32::from(line.phase()) << 16,
            wander: line.wander().unwrap_or(MAX_WANDERS),
            astray: false,
        }
    }

    /// The line of the next block, whose way is `passage`: from `before`, of which `left` samples are not played, to
    /// `amplitude`.
    fn frame(
        &mut self,
        before: LineFrame,
        amplitude: u32,
        passage: Passage,
        samples: u32,
        left: u32,
    ) -> LineFrame {
        let from = before.amplitude.value(left);
        let end = self.turns.phase(passage.to).wrapping_add(self.phase);
        let advance = self.advance(passage, samples);
        let share = advance.map_or(0, share_of_speed);
        let lost = share == 0 || (self.astray && from > 0);
        self.astray = lost;
        if lost {
            // The frequency that it had, while it fades out.
            let end = before
                .phase(left)
                .wrapping_add(before.step.wrapping_mul(samples));
            return LineFrame {
                end,
                step: before.step,
                amplitude: Ramp::between(from, 0, samples),
            };
        }
        let target = (u64::from(amplitude) * u64::from(share)) / u64::from(ONE);
        LineFrame {
            end,
            step: advance.unwrap_or(0) as u32,
            amplitude: Ramp::between(from, target as u32, samples),
        }
    }

    /// Advance of the phase per sample along `passage`; none if it jumps.
    fn advance(&self, passage: Passage, samples: u32) -> Option<i64> {
        let steps = passage.to.since(passage.from);
        if passage.jumps || steps.unsigned_abs() > LONGEST {
            return None;
        }
        let [from, to] = [passage.from, passage.to].map(|position| self.turns.phase(position));
        let way = self.turns.way(steps, to.wrapping_sub(from));
        Some(way / i64::from(samples.max(1)))
    }
}

/// Factor of the amplitude of a line whose phase advances by `advance` per sample, in steps of 2⁻¹⁶: [`ONE`] up to 0.40
/// of the sample rate, and 0 from 0.44 on.
fn share_of_speed(advance: i64) -> u32 {
    let beyond = (FADE_ENDS - advance.abs()).clamp(0, FADE_ENDS - FADE_BEGINS);
    ((beyond << 16) / (FADE_ENDS - FADE_BEGINS)) as u32
}

impl VoiceLines {
    /// The lines of `texture`, silent; none if it has none.
    pub fn new(texture: &Texture<'_>) -> Option<Self> {
        let lines: Vec<_, MAX_LINES> = texture
            .lines()?
            .iter()
            .take(MAX_LINES)
            .map(|line| PlayedLine::new(&line))
            .collect();
        let silent = lines.iter().map(|_| LineFrame::default()).collect();
        let wanders = texture.lines()?.wanders().take(MAX_WANDERS).enumerate();
        Some(Self {
            lines,
            wanders: wanders
                .map(|(index, wander)| VoiceWander::new(&wander, index))
                .collect(),
            frame: LinesFrame { lines: silent },
        })
    }

    /// The lines of the next block, of `samples` samples, at `motion` on `texture`, the one that they were made for.
    ///
    /// `gain` is that of [`crate::Frame::update_scaled`]; `left` is the number of samples of the block before that are
    /// not played.
    pub fn follow(
        &mut self,
        texture: &Texture<'_>,
        motion: Motion,
        gain: u32,
        passage: Passage,
        samples: u32,
        left: u32,
    ) -> &LinesFrame {
        let point = GridPoint::locate(texture, motion);
        let rate = texture.sample_rate_hz();
        let wanders = self.wanders.iter_mut();
        let passages: Vec<Passage, MAX_WANDERS> = wanders
            .map(|wander| wander.passage(passage, samples, left, rate))
            .collect();
        if let Some(lines) = texture.lines() {
            let both = self.lines.iter_mut().zip(&mut self.frame.lines);
            for ((played, frame), line) in both.zip(lines.iter()) {
                let amplitude = amplitude(&line, &point, gain);
                let passage = *passages.get(played.wander).unwrap_or(&passage);
                *frame = played.frame(*frame, amplitude, passage, samples, left);
            }
        }
        &self.frame
    }
}

/// Amplitude of `line` at `point`, times `gain`, in steps of an output sample.
fn amplitude(line: &Line<'_>, point: &GridPoint, gain: u32) -> u32 {
    let mean = point.mean(|speed, force| line.amplitude(speed, force));
    let steps = (mean * (1u32 << OutputSample::FRACTION_BITS) as f32) as u64;
    let faded = (steps * u64::from(point.fade)) / u64::from(ONE);
    let steps = (faded * u64::from(gain)) / u64::from(ONE);
    steps.min(u64::from(MAX_AMPLITUDE)) as u32
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// The wavelength as the fraction that the float is: mantissa · 2^exponent.
    fn fraction(wavelength_mm: f32) -> (i128, i32) {
        let bits = wavelength_mm.to_bits();
        let mantissa = i128::from(bits & 0x007f_ffff | 0x0080_0000);
        (mantissa, (bits >> 23).cast_signed() - 150)
    }

    proptest! {
        /// Against the turns as a fraction of integers of 128 bits, over 1000 km.
        #[test]
        fn a_phase_is_that_of_the_position_over_a_thousand_kilometres(
            bits in 0.02f32.to_bits()..=1000f32.to_bits(), mm in -1e9f64..1e9,
        ) {
            let wavelength_mm = f32::from_bits(bits);
            let position = Position::from_exact_mm(mm);
            let phase = Turns::of(wavelength_mm).phase(position);
            // Turns in steps of 2⁻³², from steps of 2⁻³² mm: steps / wavelength, by parts because it needs 90 digits.
            let (mantissa, exponent) = fraction(wavelength_mm);
            let scaled = i128::from(position.steps()) << (-exponent).clamp(0, 40);
            let exact = scaled.div_euclid(mantissa);
            let off = phase.wrapping_sub(exact as u32).cast_signed();
            // 3·10⁻¹² of the turns, and a step.
            let turns = (mm / f64::from(wavelength_mm)).abs();
            let bound = 2.0 + turns * 4e-12 * libm::exp2(32.0);
            prop_assert!(f64::from(off).abs() <= bound, "{off}, {bound}, {turns} turns");
        }

        /// Whole turns of a block's way are counted right, and forwards is backwards.
        #[test]
        fn the_turns_of_a_way_are_those_of_its_length(
            bits in 0.02f32.to_bits()..=1000f32.to_bits(), mm in -1e6f64..1e6, way_mm in -256f64..256.0,
        ) {
            let turns = Turns::of(f32::from_bits(bits));
            let [from, to] = [mm, mm + way_mm].map(Position::from_exact_mm);
            let exact = turns.phase(to).wrapping_sub(turns.phase(from));
            let steps = to.since(from);
            prop_assume!(steps.unsigned_abs() <= LONGEST);
            let way = turns.way(steps, exact);
            prop_assert_eq!(way as u32, exact);
            let expected = steps as f64 / f64::from(f32::from_bits(bits));
            prop_assert!((way as f64 - expected).abs() < 3.0 + expected.abs() * 1e-11, "{} {}", way, expected);
            prop_assert_eq!(turns.way(-steps, exact.wrapping_neg()), -way);
        }
    }
}
