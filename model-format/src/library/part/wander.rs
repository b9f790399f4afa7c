//! Part of kind 7: the irregular displacement of lines, called wander.
//!
//! A weave's threads are not evenly spaced. Therefore a line is evaluated at x + d(x) in place of the position x, where
//! d is a random function. A *wander* states the RMS and the correlation length of d. Lines of one weave share a
//! wander, so that the weave's harmonics stay locked in phase.
//!
//! The content is a byte with the number of wanders; then per wander its RMS, mm, its correlation length, mm, and its
//! clock's speed, mm/s, all as `f32`; then a byte per line: the number of the line's wander, from 1, or 0 if the line
//! does not wander.
//!
//! If the clock's speed is 0, x is the tool's position. Otherwise x advances at the clock's speed, so that the lines
//! keep their frequency at any speed of the hand, like a resonance or a motor.

use serde::{Deserialize, Serialize};

use crate::error::Problem;
use crate::limits::{MAX_CLOCK_MM_S, MAX_CORRELATION_MM, MAX_WANDER_SLOPE, MAX_WANDERS, MIN_CORRELATION_MM};

/// Kind of this part.
pub(crate) const KIND: u32 = 7;

/// Bytes of a wander.
const BYTES: usize = 12;

/// Irregular displacement of lines.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Wander {
    /// RMS of the displacement d(x), mm.
    pub rms_mm: f32,
    /// Correlation length ℓ, mm: the correlation of d(x) and d(x + Δ) is exp(-Δ² / 2ℓ²).
    pub correlation_mm: f32,
    /// Speed at which a clock advances the position in place of the tool, mm/s; 0 if the tool's position counts.
    pub clock_mm_s: f32,
}

impl Wander {
    fn check(&self) -> Result<(), Problem> {
        let range = [MIN_CORRELATION_MM, MAX_CORRELATION_MM];
        Problem::within("a correlation length in mm", self.correlation_mm, range)?;
        let range = [0.0, MAX_WANDER_SLOPE * self.correlation_mm];
        Problem::within("the RMS of a wander in mm", self.rms_mm, range)?;
        Problem::within("a clock's speed in mm/s", self.clock_mm_s, [0.0, MAX_CLOCK_MM_S])?;
        if self.rms_mm == 0.0 && self.clock_mm_s == 0.0 {
            return Err(Problem::Needless("a wander"));
        }
        Ok(())
    }

    fn read(bytes: &[u8; BYTES]) -> Self {
        let value = |at: usize| {
            let [a, b, c, d] = [0, 1, 2, 3].map(|byte| bytes[at + byte]);
            f32::from_le_bytes([a, b, c, d])
        };
        Self {
            rms_mm: value(0),
            correlation_mm: value(4),
            clock_mm_s: value(8),
        }
    }
}

/// The part's content.
#[derive(Clone, Copy, Debug)]
pub(crate) struct WanderPart<'a>(pub &'a [u8]);

/// The wanders of a texture's lines; by default none.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Wanders<'a> {
    wanders: &'a [[u8; BYTES]],
    of_lines: &'a [u8],
}

impl<'a> WanderPart<'a> {
    /// The wanders of a part that was found valid.
    pub fn wanders(self) -> Wanders<'a> {
        let Some((&count, rest)) = self.0.split_first() else {
            return Wanders::default();
        };
        let (wanders, of_lines) = rest.split_at(rest.len().min(usize::from(count) * BYTES));
        Wanders {
            wanders: wanders.as_chunks().0,
            of_lines,
        }
    }

    /// Checks the part, in a texture of `lines` lines.
    pub fn check(self, lines: usize) -> Result<(), Problem> {
        let count = usize::from(self.0.first().copied().unwrap_or(0));
        Problem::count("the number of wanders", count, [1, MAX_WANDERS])?;
        Problem::same("bytes of wanders", self.0.len(), 1 + count * BYTES + lines)?;
        let wanders = self.wanders();
        wanders.iter().try_for_each(|wander| wander.check())?;
        for &number in wanders.of_lines {
            Problem::count("the number of a line's wander", number.into(), [0, count])?;
        }
        // A wander without a line would change nothing, and a texture has only one encoding.
        let is_used = |number: usize| wanders.of_lines.contains(&(number as u8));
        if !(1..=count).all(is_used) {
            return Err(Problem::Needless("a wander that no line has"));
        }
        Ok(())
    }
}

impl<'a> Wanders<'a> {
    pub fn iter(self) -> impl Iterator<Item = Wander> + use<'a> {
        self.wanders.iter().map(Wander::read)
    }

    /// Index of the wander of line `index`, if it has one.
    pub fn of_line(self, index: usize) -> Option<u8> {
        self.of_lines.get(index)?.checked_sub(1)
    }
}

/// Returns the part's content for these wanders; none if there are no wanders. `of_lines` holds for each line the
/// number of its wander, from 1, or 0.
#[cfg(feature = "alloc")]
pub(super) fn content(wanders: &[Wander], of_lines: &[u8]) -> Option<alloc::vec::Vec<u8>> {
    if wanders.is_empty() {
        return None;
    }
    // Numbers beyond a byte become 255, which decoding refuses like them.
    let mut content = alloc::vec![wanders.len().min(usize::from(u8::MAX)) as u8];
    for wander in wanders {
        for value in [wander.rms_mm, wander.correlation_mm, wander.clock_mm_s] {
            content.extend(value.to_le_bytes());
        }
    }
    content.extend(of_lines);
    Some(content)
}
