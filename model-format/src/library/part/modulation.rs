//! Part of kind 4: a track of the excitation's level. A player joins pieces of it to reproduce the slow changes of the
//! level.
//!
//! The content is the number of samples from one entry to the next, a varint, then a byte per entry: the level in steps
//! of 0.25 dB. Between entries the amplitude is linear, and the last entry is joined to the first. The mean square of
//! this amplitude is 1 within 2 %, because the level of a node assumes an excitation of variance 1.

#[cfg(feature = "alloc")]
use alloc::vec::Vec;

use crate::error::Problem;
use crate::limits::{
    MAX_FED_POWER, MAX_MODULATION_ENTRIES, MAX_MODULATION_STEP_SAMPLES, MIN_FED_POWER, MIN_MODULATION_ENTRIES,
    MIN_MODULATION_STEP_SAMPLES,
};
use crate::wire::Reader;

#[cfg(feature = "alloc")]
use super::PartSpec;
use super::exp;

/// Kind of this part.
pub(crate) const KIND: u32 = 4;

/// Binary digits after the point of [`level_amplitude`].
pub const LEVEL_FRACTION_BITS: u32 = 16;

/// Amplitudes of the entries -128 to 127, in steps of 2⁻¹⁶.
static AMPLITUDES: [u32; 256] = {
    /// Number of steps of an entry per factor of ten in amplitude.
    const PER_DECADE: f64 = 80.0;
    let step = exp(core::f64::consts::LN_10 / PER_DECADE);
    let mut table = [0; 256];
    let (mut up, mut down, mut entry) = (1.0, 1.0, 0);
    while entry <= 128 {
        let unit = (1u32 << LEVEL_FRACTION_BITS) as f64;
        if entry < 128 {
            table[128 + entry] = (up * unit + 0.5) as u32;
        }
        table[128 - entry] = (down * unit + 0.5) as u32;
        up *= step;
        down /= step;
        entry += 1;
    }
    table
};

/// Amplitude of an entry of a level track, 10^(entry / 80), in steps of 2⁻¹⁶.
#[inline]
pub fn level_amplitude(entry: i8) -> u32 {
    AMPLITUDES[usize::from(entry.cast_unsigned() ^ 0x80)]
}

/// Level track of a texture.
///
/// The amplitude is played as straight lines between entries. Its mean square is 1 within 2 %, see
/// [`ModulationSpec::mean_square`]. This mean square is a little less than the mean of the squares at the entries.
#[cfg(feature = "alloc")]
#[derive(Clone, Debug, PartialEq)]
pub struct ModulationSpec {
    /// Samples from one entry to the next.
    pub step_samples: u16,
    /// Levels of the excitation, in steps of 0.25 dB.
    pub entries: Vec<i8>,
}

#[cfg(feature = "alloc")]
impl ModulationSpec {
    /// Mean square of the amplitude as it is played; 0 without entries. A library requires it to be 1 within 2 %.
    pub fn mean_square(&self) -> f32 {
        let next = self.entries.iter().cycle().skip(1);
        let pairs = self.entries.iter().zip(next);
        let sum = pairs.map(|(&from, &to)| squares(level_amplitude(from), level_amplitude(to)));
        mean_square(sum.sum(), self.entries.len())
    }
}

#[cfg(feature = "alloc")]
impl From<Modulation<'_>> for ModulationSpec {
    /// Copies the level track of a decoded texture. Encoding it gives the same bytes.
    fn from(modulation: Modulation<'_>) -> Self {
        let entries = modulation.entries.iter();
        Self {
            step_samples: modulation.step_samples,
            entries: entries.map(|entry| entry.cast_signed()).collect(),
        }
    }
}

/// Level track of a decoded texture.
#[derive(Clone, Copy, Debug)]
pub struct Modulation<'a> {
    step_samples: u16,
    entries: &'a [u8],
}

impl<'a> Modulation<'a> {
    /// Samples from one entry to the next.
    pub fn step_samples(&self) -> u16 {
        self.step_samples
    }

    /// The entries, an `i8` each, in steps of 0.25 dB; see [`level_amplitude`].
    pub fn entries(&self) -> &'a [u8] {
        self.entries
    }
}

/// The part's content.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ModulationPart<'a>(pub &'a [u8]);

impl<'a> ModulationPart<'a> {
    /// Parses the content, and checks everything except the levels of the entries.
    fn read(self) -> Result<Modulation<'a>, Problem> {
        let mut reader = Reader(self.0);
        let step = reader.varint().ok_or(Problem::Malformed("its level track"))?;
        let steps = [MIN_MODULATION_STEP_SAMPLES, MAX_MODULATION_STEP_SAMPLES];
        let steps = steps.map(|step| step as usize);
        Problem::count("the step of the level track in samples", step as usize, steps)?;
        let entries = reader.0;
        let lengths = [MIN_MODULATION_ENTRIES, MAX_MODULATION_ENTRIES];
        Problem::count("the number of entries of the level track", entries.len(), lengths)?;
        Ok(Modulation {
            step_samples: step as u16,
            entries,
        })
    }

    /// The view of a part that was found valid.
    pub fn view(self) -> Option<Modulation<'a>> {
        self.read().ok()
    }

    /// Checks everything in the part except the levels of the entries.
    pub fn check(self) -> Result<(), Problem> {
        self.read().map(|_| ())
    }
}

/// Three times the mean square of the amplitude on the straight line between two entries, in steps of 2⁻³².
#[inline]
fn squares(from: u32, to: u32) -> u64 {
    // Each amplitude is below 2²², so that 4096 such sums together are far below 2⁶⁴.
    let (from, to) = (u64::from(from), u64::from(to));
    from * from + from * to + to * to
}

/// Mean square of `count` entries whose [`squares`] add up to `sum`.
fn mean_square(sum: u64, count: usize) -> f32 {
    const UNIT: f32 = 3.0 * (1u64 << (2 * LEVEL_FRACTION_BITS)) as f32;
    sum as f32 / UNIT / count.max(1) as f32
}

/// The check of a part's entries, in steps.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::library) struct ModulationCheck {
    /// Number of entries that were checked.
    at: usize,
    /// Sum of [`squares`] over these entries.
    sum: u64,
    /// True if any of these entries is not 0.
    changes: bool,
}

impl ModulationCheck {
    /// Checks the next entries of `modulation`, at most `room` of them. Returns true if no entry is left.
    pub fn step(&mut self, modulation: &Modulation<'_>, room: usize) -> Result<bool, Problem> {
        let entries = modulation.entries;
        let end = entries.len().min(self.at + room);
        let mut sum = 0;
        let mut bits = 0;
        if let Some(&first) = entries.get(self.at) {
            let mut from = level_amplitude(first.cast_signed());
            for &entry in &entries[self.at + 1..end] {
                let to = level_amplitude(entry.cast_signed());
                sum += squares(from, to);
                // A bit that is set in any entry shows that the level changes.
                (from, bits) = (to, bits | entry);
            }
            // The entry after the last one of this step. The first entry follows the last one of the track.
            let next = entries.get(end).unwrap_or(&entries[0]);
            sum += squares(from, level_amplitude(next.cast_signed()));
            bits |= first;
        }
        self.sum += sum;
        self.changes |= bits != 0;
        self.at = end;
        if end < entries.len() {
            return Ok(false);
        }
        let power = mean_square(self.sum, entries.len());
        let range = [MIN_FED_POWER, MAX_FED_POWER];
        Problem::within("the mean square of the level track", power, range)?;
        if !self.changes {
            return Err(Problem::Needless("the level track"));
        }
        Ok(true)
    }
}

/// Creates the part for this track.
#[cfg(feature = "alloc")]
pub(crate) fn part(spec: &ModulationSpec) -> postcard::Result<PartSpec> {
    let mut content = postcard::to_allocvec(&u32::from(spec.step_samples))?;
    content.extend(spec.entries.iter().map(|entry| entry.cast_unsigned()));
    Ok((KIND, content))
}
