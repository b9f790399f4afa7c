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
mod wander;

use heapless::Vec;
use model_format::limits::{MAX_LINES, MAX_WANDERS};
use model_format::{Line, OutputSample, Texture};
use turns::Turns;
use wander::VoiceWander;

use crate::fixed::shift_toward_zero;
use crate::grid::{GridPoint, Motion, ONE};
use crate::level::Ramp;
use crate::position::{Passage, Position};

pub use sine::{SINE_FRACTION_BITS, sine};

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

/// A turn in steps of a phase.
const TURN: i64 = 1 << 32;

/// Advance of the phase per sample at which a line begins to fade: 0.40 of the sample rate.
const FADE_BEGINS: i64 = TURN * 40 / 100;

/// Advance of the phase per sample at and above which a line is silent: 0.44 of the sample rate.
const FADE_ENDS: i64 = TURN * 44 / 100;

/// Longest way in one block that advances a phase, in steps of a position: 256 mm. A longer one is a jump.
const LONGEST: u64 = 256 << Position::FRACTION_BITS;

/// Lines of a voice.
#[derive(Clone, Debug)]
pub struct VoiceLines {
    lines: Vec<PlayedLine, MAX_LINES>,
    wanders: Vec<VoiceWander, MAX_WANDERS>,
    /// The lines of the previous block.
    frame: LinesFrame,
}

/// A line that is played.
#[derive(Clone, Copy, Debug)]
struct PlayedLine {
    /// Turns per mm.
    turns: Turns,
    /// Phase at the origin of positions, in steps of 2⁻³² of a turn.
    phase: u32,
    /// Index of the line's wander; [`MAX_WANDERS`] if the line does not wander.
    wander: usize,
    /// True if the line left the position in the previous block, because it was too fast or the position jumped.
    astray: bool,
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

    /// Returns the line in the next block, in which the tool moves along `passage`: from `before`, of which `left`
    /// samples are not played, to `amplitude`.
    fn frame(&mut self, before: LineFrame, amplitude: u32, passage: Passage, samples: u32, left: u32) -> LineFrame {
        let from = before.amplitude.value(left);
        let end = self.turns.phase(passage.to).wrapping_add(self.phase);
        let advance = self.advance(passage, samples);
        let share = advance.map_or(0, share_of_speed);
        // A line that left the position comes back only from silence, because its phase would jump.
        let lost = share == 0 || (self.astray && from > 0);
        self.astray = lost;
        if lost {
            // The line keeps its frequency while it fades out.
            let end = before.phase(left).wrapping_add(before.step.wrapping_mul(samples));
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

/// Returns the factor of the amplitude of a line whose phase advances by `advance` per sample, in steps of 2⁻¹⁶:
/// [`ONE`] up to 0.40 of the sample rate, and 0 from 0.44 on.
fn share_of_speed(advance: i64) -> u32 {
    let beyond = (FADE_ENDS - advance.abs()).clamp(0, FADE_ENDS - FADE_BEGINS);
    ((beyond << 16) / (FADE_ENDS - FADE_BEGINS)) as u32
}

impl VoiceLines {
    /// The lines of `texture`, silent; none if the texture has no lines.
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

    /// The lines of the next block, of `samples` samples, at `motion`; [`VoiceLines::new`] got the same `texture`.
    ///
    /// `gain` is that of [`crate::Frame::update_scaled`]. `passage` is the tool's path in the block, which the phases
    /// follow. `left` is the number of samples of the previous block that are not played.
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
    // The gain of a surface is bounded by the model's power, not by its lines: 256 m/s² times 64 is above the bound.
    steps.min(u64::from(MAX_AMPLITUDE)) as u32
}
