//! Check of the amplitudes of lines that are locked to place.

use crate::error::{DecodeError, Place, Problem};
use crate::library::part::lines::{AMPLITUDE_BYTES, Lines};
use crate::library::texture::Texture;
use crate::limits::{MAX_LINE_AMPLITUDE, STEP_BYTES};

/// The check of all amplitudes of a texture whose header was found valid, in steps.
#[derive(Clone, Debug)]
pub(in crate::library) struct LinesCheck<'a> {
    texture: Texture<'a>,
    index: usize,
    lines: Lines<'a>,
    /// Index of the line that is checked.
    line: usize,
    /// The next node of that line.
    speed: usize,
    force: usize,
    /// True if a node of that line was found above 0.
    sounds: bool,
}

impl<'a> LinesCheck<'a> {
    /// The check of texture number `index`; none if it has no lines.
    pub fn new(texture: Texture<'a>, index: usize) -> Option<Self> {
        Some(Self {
            texture,
            index,
            lines: texture.lines()?,
            line: 0,
            speed: 0,
            force: 0,
            sounds: false,
        })
    }

    /// The texture, and its index.
    pub const fn texture(&self) -> (Texture<'a>, usize) {
        (self.texture, self.index)
    }

    /// Checks some amplitudes; returns true after the last one.
    pub fn step(&mut self) -> Result<bool, DecodeError> {
        let (speeds, forces) = (self.texture.speed_axis(), self.texture.force_axis());
        let mut left = STEP_BYTES / AMPLITUDE_BYTES;
        while self.line < self.lines.len() {
            let line = self.lines.line(self.line);
            while self.speed < speeds.len() {
                let rests = speeds.value(self.speed) <= 0.0;
                while self.force < forces.len() {
                    if left == 0 {
                        return Ok(false);
                    }
                    left -= 1;
                    let value = line.amplitude(self.speed, self.force);
                    // As integers, the bits of a negative number, of -0.0, of an infinity and of a NaN are all larger.
                    if value.to_bits() > MAX_LINE_AMPLITUDE.to_bits() {
                        let line = self.line;
                        return Err(self.at_node(Problem::LineAmplitude { line, value }));
                    }
                    if value > 0.0 {
                        self.sounds = true;
                        // Only the first force can be 0, because the axis ascends.
                        if rests || (self.force == 0 && forces.value(0) <= 0.0) {
                            return Err(self.at_node(Problem::LineAtZero(self.line)));
                        }
                    }
                    self.force += 1;
                }
                (self.speed, self.force) = (self.speed + 1, 0);
            }
            if !core::mem::take(&mut self.sounds) {
                return Err(Problem::SilentLine(self.line).at(Place::Texture(self.index)));
            }
            (self.line, self.speed) = (self.line + 1, 0);
        }
        Ok(true)
    }

    fn at_node(&self, problem: Problem) -> DecodeError {
        problem.at(Place::Node {
            texture: self.index,
            speed: self.speed,
            force: self.force,
        })
    }
}
