//! Part of kind 5: lines that are tied to position.
//!
//! The content is a byte with the number of lines, then the lines. Each line is its wavelength, mm, as `f32`; its phase
//! at position 0, in steps of 2⁻¹⁶ of a turn, as `u16`; and per node, speed-major, its amplitude, m/s², as `f32`. All
//! lines take the same number of bytes, so that any amplitude can be found without reading those before it.

#[cfg(feature = "alloc")]
use super::wander;
use super::wander::{Wander, WanderPart, Wanders};
use crate::error::Problem;
use crate::limits::{MAX_LINES, MAX_WAVELENGTH_MM, MIN_WAVELENGTH_MM};

/// Kind of this part.
pub(crate) const KIND: u32 = 5;

/// Bytes of a line before its amplitudes: wavelength and phase.
const HEAD_BYTES: usize = 6;

/// Bytes of an amplitude.
pub(in crate::library) const AMPLITUDE_BYTES: usize = 4;

/// The part's content.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LinesPart<'a>(pub &'a [u8]);

/// Lines of a texture, which are tied to position.
#[derive(Clone, Copy, Debug)]
pub struct Lines<'a> {
    /// The lines' bytes, one line after the other.
    bytes: &'a [u8],
    nodes: usize,
    forces: usize,
    wanders: Wanders<'a>,
}

/// A line. Its value at position x is amplitude · sin(2π (x / wavelength + phase)), where x includes the displacement
/// by the line's wander.
#[derive(Clone, Copy, Debug)]
pub struct Line<'a> {
    bytes: &'a [u8],
    forces: usize,
    wander: Option<u8>,
}

impl<'a> LinesPart<'a> {
    /// Number of lines, as the part states it.
    pub fn count(self) -> usize {
        usize::from(self.0.first().copied().unwrap_or(0))
    }

    /// The lines of a part that was found valid, in a texture of `nodes` nodes and `forces` forces, with its wanders.
    pub fn lines(self, nodes: usize, forces: usize, wander: Option<WanderPart<'a>>) -> Lines<'a> {
        Lines {
            bytes: self.0.get(1..).unwrap_or_default(),
            nodes,
            forces,
            wanders: wander.map(WanderPart::wanders).unwrap_or_default(),
        }
    }

    /// Checks everything except the amplitudes, in a texture of `nodes` nodes.
    pub fn check(self, nodes: usize) -> Result<(), Problem> {
        let count = self.count();
        Problem::count("the number of lines", count, [1, MAX_LINES])?;
        let expected = 1 + count * (HEAD_BYTES + nodes * AMPLITUDE_BYTES);
        Problem::same("bytes of lines", self.0.len(), expected)?;
        // The number of forces matters only for amplitudes, which are not read here.
        let lines = self.lines(nodes, 1, None);
        for line in 0..count {
            let value = lines.line(line).wavelength_mm();
            let range = [MIN_WAVELENGTH_MM, MAX_WAVELENGTH_MM];
            Problem::within("a line's wavelength in mm", value, range)?;
            let same = |&other: &usize| lines.line(other).wavelength_mm().to_bits() == value.to_bits();
            if let Some(other) = (0..line).find(same) {
                let what = "wavelength";
                return Err(Problem::Taken { what, other });
            }
        }
        Ok(())
    }
}

impl<'a> Lines<'a> {
    fn line_bytes(self) -> usize {
        HEAD_BYTES + self.nodes * AMPLITUDE_BYTES
    }

    /// Number of lines, 1 to [`MAX_LINES`].
    #[expect(clippy::len_without_is_empty, reason = "a texture without lines has no such part")]
    pub fn len(self) -> usize {
        self.bytes.len() / self.line_bytes()
    }

    /// Line `index`, which must be below [`Lines::len`].
    pub fn line(self, index: usize) -> Line<'a> {
        let length = self.line_bytes();
        Line {
            bytes: &self.bytes[index * length..][..length],
            forces: self.forces,
            wander: self.wanders.of_line(index),
        }
    }

    /// The wanders that lines share.
    pub fn wanders(self) -> impl Iterator<Item = Wander> + use<'a> {
        self.wanders.iter()
    }

    /// All lines.
    pub fn iter(self) -> impl Iterator<Item = Line<'a>> {
        (0..self.len()).map(move |index| self.line(index))
    }
}

impl Line<'_> {
    /// Wavelength, mm.
    pub fn wavelength_mm(&self) -> f32 {
        f32::from_le_bytes(self.bytes.first_chunk().copied().unwrap_or_default())
    }

    /// Phase at position 0, in steps of 2⁻¹⁶ of a turn.
    pub fn phase(&self) -> u16 {
        u16::from_le_bytes([self.bytes[4], self.bytes[5]])
    }

    /// Index of the line's wander among [`Lines::wanders`], if it has one.
    pub fn wander(&self) -> Option<usize> {
        self.wander.map(usize::from)
    }

    /// Amplitude at the node of the indices (`speed`, `force`), each below the length of its axis, m/s²: the peak of
    /// the sine.
    pub fn amplitude(&self, speed: usize, force: usize) -> f32 {
        self.of_node(speed * self.forces + force)
    }

    /// Amplitudes of all nodes, m/s², speed-major.
    pub fn amplitudes(&self) -> impl Iterator<Item = f32> {
        let amplitudes = self.bytes[HEAD_BYTES..].as_chunks().0;
        amplitudes.iter().copied().map(f32::from_le_bytes)
    }

    fn of_node(&self, index: usize) -> f32 {
        f32::from_le_bytes(self.bytes[HEAD_BYTES..].as_chunks().0[index])
    }
}

/// Lines of a texture to be written: sines of the position on the surface.
#[cfg(feature = "alloc")]
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LinesSpec {
    /// The lines.
    pub lines: alloc::vec::Vec<LineSpec>,
    /// The wanders that lines share.
    pub wanders: alloc::vec::Vec<Wander>,
}

/// A line to be written. Its value at position x is amplitude · sin(2π (x / wavelength + phase)).
#[cfg(feature = "alloc")]
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LineSpec {
    /// Wavelength, mm.
    pub wavelength_mm: f32,
    /// Phase at position 0, in steps of 2⁻¹⁶ of a turn.
    pub phase: u16,
    /// Amplitude at each node, m/s², speed-major: the peak of the sine.
    pub amplitudes: alloc::vec::Vec<f32>,
    /// Index of the line's wander in [`LinesSpec::wanders`], if it has one.
    pub wander: Option<u8>,
}

#[cfg(feature = "alloc")]
impl LinesSpec {
    /// Creates the lines to be written. Of `wanders`, only those that a line refers to are kept, and the lines' indices
    /// are adapted.
    pub fn with_wanders(mut lines: alloc::vec::Vec<LineSpec>, wanders: &[Wander]) -> Self {
        let mut kept = alloc::vec::Vec::new();
        for (index, wander) in wanders.iter().enumerate() {
            let of_lines = lines.iter_mut().filter_map(|line| line.wander.as_mut());
            let mut of_lines = of_lines.filter(|own| usize::from(**own) == index).peekable();
            if of_lines.peek().is_some() {
                of_lines.for_each(|own| *own = kept.len() as u8);
                kept.push(*wander);
            }
        }
        Self { lines, wanders: kept }
    }
}

#[cfg(feature = "alloc")]
impl From<alloc::vec::Vec<LineSpec>> for LinesSpec {
    /// Lines without wanders.
    fn from(lines: alloc::vec::Vec<LineSpec>) -> Self {
        Self {
            lines,
            wanders: alloc::vec::Vec::new(),
        }
    }
}

#[cfg(feature = "alloc")]
impl From<Lines<'_>> for LinesSpec {
    /// Copies the lines of a decoded texture. Encoding them gives the same bytes.
    fn from(lines: Lines<'_>) -> Self {
        let spec = |line: Line<'_>| LineSpec {
            wavelength_mm: line.wavelength_mm(),
            phase: line.phase(),
            amplitudes: line.amplitudes().collect(),
            wander: line.wander,
        };
        Self {
            lines: lines.iter().map(spec).collect(),
            wanders: lines.wanders().collect(),
        }
    }
}

/// Returns the part's content for these lines, in a texture of `nodes` nodes.
///
/// # Errors
/// No line, more lines than [`MAX_LINES`], or a line with more or fewer amplitudes than nodes.
#[cfg(feature = "alloc")]
pub(crate) fn content(lines: &LinesSpec, nodes: usize) -> Result<alloc::vec::Vec<u8>, Problem> {
    Problem::count("the number of lines", lines.lines.len(), [1, MAX_LINES])?;
    let mut content = alloc::vec![lines.lines.len() as u8];
    for line in &lines.lines {
        Problem::same("amplitudes of a line", line.amplitudes.len(), nodes)?;
        content.extend(line.wavelength_mm.to_le_bytes());
        content.extend(line.phase.to_le_bytes());
        content.extend(line.amplitudes.iter().flat_map(|value| value.to_le_bytes()));
    }
    Ok(content)
}

/// Returns the content of the part of kind 7 for the wanders of these lines, if there are any.
#[cfg(feature = "alloc")]
pub(crate) fn wander_content(lines: &LinesSpec) -> Option<alloc::vec::Vec<u8>> {
    // An index of 255 stays 255, which decoding refuses, because a texture has at most four wanders.
    let number = |line: &LineSpec| line.wander.map_or(0, |index| index.saturating_add(1));
    let of_lines: alloc::vec::Vec<u8> = lines.lines.iter().map(number).collect();
    wander::content(&lines.wanders, &of_lines)
}
