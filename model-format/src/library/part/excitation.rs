//! Part of kind 3: codebooks of the prediction residual. A player joins pieces of them to form the excitation.
//!
//! The content is a byte with the number K of codebooks; per codebook a varint n, the peak as `f32` in standard
//! deviations, and n bytes of codes; then a byte per node, speed-major: 0 for Gaussian noise, k for codebook number k.
//!
//! A code c stands for sign(c) · peak · (256^(|c|/127) - 1)/255, the mu-law with mu = 255. A codebook's mean square is
//! 1 within 2 %, because the level of a node assumes an excitation of variance 1. If the texture also has a part of
//! kind 8, the codes are those of [`super::moments`].

#[cfg(feature = "alloc")]
use alloc::vec::Vec;

use crate::error::Problem;
use crate::limits::{
    MAX_CODEBOOK_PEAK, MAX_CODEBOOK_SAMPLES, MAX_CODEBOOKS, MAX_EXCITATION_BYTES, MAX_FED_POWER, MIN_CODEBOOK_SAMPLES,
    MIN_FED_POWER,
};
use crate::wire::Reader;

#[cfg(feature = "alloc")]
use super::PartSpec;
use super::exp;
use super::moments::{BLOCK_BYTES, BLOCK_SAMPLES, MomentsPart, block_share, block_squares};

/// Kind of this part.
pub(crate) const KIND: u32 = 3;

/// Binary digits after the point of [`mu_law`].
pub const MU_LAW_FRACTION_BITS: u32 = 30;

/// Code of the peak.
const MAX_CODE: usize = 127;

/// Magnitudes of the codes 0 to 127 as fractions of the peak, in steps of 2⁻³⁰.
static MU_LAW: [u32; MAX_CODE + 1] = {
    let step = exp(8.0 * core::f64::consts::LN_2 / MAX_CODE as f64);
    let mut table = [0; MAX_CODE + 1];
    let (mut power, mut code) = (1.0, 0);
    while code <= MAX_CODE {
        let share = (power - 1.0) / 255.0;
        table[code] = (share * (1u64 << MU_LAW_FRACTION_BITS) as f64 + 0.5) as u32;
        power *= step;
        code += 1;
    }
    table
};

/// Value of a code by the mu-law as a fraction of the peak, in steps of 2⁻³⁰. The code -128, which no library has,
/// counts as -127.
#[inline]
pub fn mu_law(code: i8) -> i32 {
    let magnitude = MU_LAW[usize::from(code.unsigned_abs()).min(MAX_CODE)] as i32;
    if code < 0 { -magnitude } else { magnitude }
}

/// Codebooks of a texture, and the source of each node's excitation.
#[cfg(feature = "alloc")]
#[derive(Clone, Debug, PartialEq)]
pub struct ExcitationSpec {
    /// The codebooks.
    pub codebooks: Vec<CodebookSpec>,
    /// The source of each node's excitation, speed-major: 0 for Gaussian noise, k for codebook number k, from 1.
    pub of_nodes: Vec<u8>,
    /// Mean length of a moment (recorded snippet), samples. If it is given, the codes are blocks, see
    /// [`crate::block_share`]. If not, the codes follow the mu-law, and pieces of 20 to 80 ms are played.
    pub moment_samples: Option<u16>,
}

/// A codebook: successive samples of a prediction residual, with a mean square of 1.
#[cfg(feature = "alloc")]
#[derive(Clone, Debug, PartialEq)]
pub struct CodebookSpec {
    /// Magnitude of the codes ±127, standard deviations.
    pub peak: f32,
    /// Samples at the texture's rate, coded by the mu-law with mu = 255: sign(c) · peak · (256^(|c| / 127) - 1) / 255.
    /// No code is -128. In a texture with moments, these are the bytes of blocks instead.
    pub codes: Vec<i8>,
}

#[cfg(feature = "alloc")]
impl CodebookSpec {
    /// Mean square of the samples; 0 without samples. A library requires it to be 1 within 2 %.
    pub fn mean_square(&self) -> f32 {
        let sum = self.codes.iter().map(|&code| square(code)).sum();
        mean_square(sum, self.codes.len(), self.peak)
    }

    /// Like [`CodebookSpec::mean_square`], for a codebook in blocks.
    pub fn mean_square_of_blocks(&self) -> f32 {
        let bytes: Vec<u8> = self.codes.iter().map(|code| code.cast_unsigned()).collect();
        let blocks = bytes.as_chunks().0;
        let sum = blocks.iter().filter_map(block_squares).sum();
        mean_square(sum, blocks.len() * BLOCK_SAMPLES, self.peak)
    }
}

#[cfg(feature = "alloc")]
impl From<Excitation<'_>> for ExcitationSpec {
    /// Copies the codebooks of a decoded texture. Encoding them gives the same bytes.
    fn from(excitation: Excitation<'_>) -> Self {
        let signed = |codes: &[u8]| codes.iter().map(|code| code.cast_signed()).collect();
        Self {
            codebooks: excitation
                .codebooks()
                .iter()
                .map(|codebook| CodebookSpec {
                    peak: codebook.peak,
                    codes: signed(codebook.codes),
                })
                .collect(),
            of_nodes: excitation.of_nodes.to_vec(),
            moment_samples: excitation.moment_samples,
        }
    }
}

/// Codebooks of a decoded texture, and the source of each node's excitation.
#[derive(Clone, Copy, Debug)]
pub struct Excitation<'a> {
    codebooks: [Codebook<'a>; MAX_CODEBOOKS],
    count: usize,
    of_nodes: &'a [u8],
    /// Number of forces of the grid.
    forces: usize,
    moment_samples: Option<u16>,
}

/// A codebook of a decoded texture.
#[derive(Clone, Copy, Debug)]
pub struct Codebook<'a> {
    peak: f32,
    codes: &'a [u8],
    is_in_blocks: bool,
}

impl<'a> Excitation<'a> {
    /// The codebooks, at least one.
    pub fn codebooks(&self) -> &[Codebook<'a>] {
        &self.codebooks[..self.count]
    }

    /// The source of the excitation at the indices (`speed`, `force`) of the grid: 0 for Gaussian noise, k for codebook
    /// number k, from 1.
    pub fn of_node(&self, speed: usize, force: usize) -> usize {
        let source = self.of_nodes.get(speed * self.forces + force);
        source.copied().map_or(0, usize::from)
    }

    /// Mean length of a moment (recorded snippet), samples; none if pieces of 20 to 80 ms are played.
    pub fn moment_samples(&self) -> Option<u16> {
        self.moment_samples
    }
}

impl Codebook<'_> {
    const EMPTY: Self = Self {
        peak: 0.0,
        codes: &[],
        is_in_blocks: false,
    };

    /// Magnitude of the codes ±127, standard deviations.
    pub fn peak(&self) -> f32 {
        self.peak
    }

    /// Number of samples.
    #[inline]
    pub fn samples(&self) -> usize {
        if self.is_in_blocks {
            self.codes.len() / BLOCK_BYTES * BLOCK_SAMPLES
        } else {
            self.codes.len()
        }
    }

    /// Sample number `at` as a fraction of the peak, in steps of 2⁻³⁰; 0 after the last sample.
    #[inline]
    pub fn share(&self, at: usize) -> i32 {
        if self.is_in_blocks {
            let block = self.codes.as_chunks().0.get(at / BLOCK_SAMPLES);
            return block.map_or(0, |block| block_share(block, at % BLOCK_SAMPLES));
        }
        let code = self.codes.get(at);
        code.map_or(0, |code| mu_law(code.cast_signed()))
    }
}

/// The part's content.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ExcitationPart<'a>(pub &'a [u8]);

impl<'a> ExcitationPart<'a> {
    /// Parses the content for a grid of `forces` forces, and checks everything except the codes and the nodes' sources.
    fn read(self, nodes: usize, forces: usize, moments: Option<MomentsPart<'_>>) -> Result<Excitation<'a>, Problem> {
        let moment_samples = moments.map(MomentsPart::mean_samples).transpose()?;
        let most = MAX_EXCITATION_BYTES;
        Problem::count("the length of the excitation in bytes", self.0.len(), [0, most])?;
        let mut reader = Reader(self.0);
        let count = usize::from(reader.byte().ok_or(MALFORMED)?);
        Problem::count("the number of codebooks", count, [1, MAX_CODEBOOKS])?;
        let mut codebooks = [Codebook::EMPTY; MAX_CODEBOOKS];
        for codebook in &mut codebooks[..count] {
            *codebook = codebook_of(&mut reader, moments.is_some())?;
        }
        Problem::same("sources of excitation of the nodes", reader.0.len(), nodes)?;
        Ok(Excitation {
            codebooks,
            count,
            of_nodes: reader.0,
            forces,
            moment_samples,
        })
    }

    /// The view of a part that was found valid.
    pub fn view(self, nodes: usize, forces: usize, moments: Option<MomentsPart<'_>>) -> Option<Excitation<'a>> {
        self.read(nodes, forces, moments).ok()
    }

    /// Checks everything in the part except the codes and the nodes' sources, in a texture of `nodes` nodes.
    pub fn check(self, nodes: usize, moments: Option<MomentsPart<'_>>) -> Result<(), Problem> {
        self.read(nodes, 1, moments).map(|_| ())
    }
}

const MALFORMED: Problem = Problem::Malformed("its excitation");

/// Reads the codebook at the reader's position, without checking its codes.
fn codebook_of<'a>(reader: &mut Reader<'a>, is_in_blocks: bool) -> Result<Codebook<'a>, Problem> {
    let length = reader.varint().ok_or(MALFORMED)? as usize;
    let peak = reader.f32().ok_or(MALFORMED)?;
    // A peak of 0 is refused later, because the mean square of such a codebook is 0.
    Problem::within("the peak of a codebook", peak, [0.0, MAX_CODEBOOK_PEAK])?;
    let (codes, rest) = reader.0.split_at_checked(length).ok_or(MALFORMED)?;
    reader.0 = rest;
    let codebook = Codebook {
        peak,
        codes,
        is_in_blocks,
    };
    if is_in_blocks && !length.is_multiple_of(BLOCK_BYTES) {
        return Err(Problem::Rule("a codebook is no whole number of blocks"));
    }
    let (samples, most) = (codebook.samples(), MAX_CODEBOOK_SAMPLES);
    let lengths = [MIN_CODEBOOK_SAMPLES, most];
    Problem::count("the number of samples of a codebook", samples, lengths)?;
    Ok(codebook)
}

/// Square of a code's value as a fraction of the peak, in steps of 2⁻³².
#[inline]
fn square(code: i8) -> u64 {
    let share = u64::from(mu_law(code).unsigned_abs());
    (share * share) >> (2 * MU_LAW_FRACTION_BITS - 32)
}

/// Mean square of `count` samples. `sum` is the sum of the squares of their fractions of `peak`, in steps of 2⁻³².
fn mean_square(sum: u64, count: usize, peak: f32) -> f32 {
    const UNIT: f32 = (1u64 << 32) as f32;
    peak * peak * (sum as f32 / UNIT) / count.max(1) as f32
}

/// The check of the codes of a part and of its nodes' sources, in steps.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::library) struct ExcitationCheck {
    /// Index of the codebook that is being checked; the number of codebooks while the nodes are being checked.
    codebook: usize,
    /// Number of codes of this codebook, or of nodes, that were checked.
    at: usize,
    /// Sum of the squares of these codes, see [`square`].
    sum: u64,
    /// One bit per codebook, set if a node uses the codebook.
    used: u8,
}

impl ExcitationCheck {
    /// Checks the next bytes of `excitation`, at most `room` of them. Returns a number below `room` if and only if none
    /// are left then.
    ///
    /// # Errors
    /// The first fault found, with the index of the node if the fault is in a node's source.
    pub fn step(&mut self, excitation: &Excitation<'_>, room: usize) -> Result<usize, (Option<usize>, Problem)> {
        let mut taken = 0;
        while let Some(codebook) = excitation.codebooks().get(self.codebook) {
            let unit = if codebook.is_in_blocks { BLOCK_BYTES } else { 1 };
            // A block is checked as a whole, because its level comes last and scales all of its codes.
            let whole = (room - taken) / unit * unit;
            let end = codebook.codes.len().min(self.at + whole);
            taken += end - self.at;
            self.codes(&codebook.codes[self.at..end], codebook.is_in_blocks)
                .map_err(|problem| (None, problem))?;
            self.at = end;
            if end < codebook.codes.len() {
                // Whatever was taken: bytes are left.
                return Ok(room);
            }
            self.end_of_codebook(codebook).map_err(|problem| (None, problem))?;
        }
        let end = excitation.of_nodes.len().min(self.at + room - taken);
        taken += end - self.at;
        self.nodes(&excitation.of_nodes[self.at..end], excitation.count)
            .map_err(|(index, problem)| (Some(self.at + index), problem))?;
        self.at = end;
        if taken < room {
            let unused = (0..excitation.count).any(|codebook| self.used >> codebook & 1 == 0);
            if unused {
                return Err((None, Problem::Needless("a codebook that no node has")));
            }
        }
        Ok(taken)
    }

    fn codes(&mut self, codes: &[u8], are_blocks: bool) -> Result<(), Problem> {
        if are_blocks {
            for block in codes.as_chunks().0 {
                let louder = Problem::Rule("a block of a codebook is louder than its peak");
                self.sum += block_squares(block).ok_or(louder)?;
            }
            return Ok(());
        }
        // The lowest code is judged after the loop, which therefore needs no branch per code.
        let mut sum = 0;
        let mut lowest = 0;
        for &code in codes {
            let code = code.cast_signed();
            lowest = lowest.min(code);
            sum += square(code);
        }
        self.sum += sum;
        if lowest == i8::MIN {
            return Err(Problem::Rule("a codebook has the code -128; codes are -127 to 127"));
        }
        Ok(())
    }

    fn end_of_codebook(&mut self, codebook: &Codebook<'_>) -> Result<(), Problem> {
        let power = mean_square(self.sum, codebook.samples(), codebook.peak);
        let range = [MIN_FED_POWER, MAX_FED_POWER];
        Problem::within("the mean square of a codebook", power, range)?;
        (self.codebook, self.at, self.sum) = (self.codebook + 1, 0, 0);
        Ok(())
    }

    fn nodes(&mut self, of_nodes: &[u8], count: usize) -> Result<(), (usize, Problem)> {
        for (index, &source) in of_nodes.iter().enumerate() {
            let source = usize::from(source);
            Problem::count("the number of its codebook", source, [0, count]).map_err(|problem| (index, problem))?;
            // Bit 0 stands for Gaussian noise, and the shift drops it.
            self.used |= ((1u16 << source) >> 1) as u8;
        }
        Ok(())
    }
}

/// Creates the part for these codebooks.
#[cfg(feature = "alloc")]
pub(crate) fn part(spec: &ExcitationSpec) -> postcard::Result<PartSpec> {
    // Numbers beyond a byte become 255, which decoding refuses like them.
    let mut content = alloc::vec![spec.codebooks.len().min(usize::from(u8::MAX)) as u8];
    for codebook in &spec.codebooks {
        content.extend(postcard::to_allocvec(&(codebook.codes.len() as u32))?);
        content.extend(codebook.peak.to_le_bytes());
        content.extend(codebook.codes.iter().map(|code| code.cast_unsigned()));
    }
    content.extend(&spec.of_nodes);
    Ok((KIND, content))
}
