//! Part of kind 3: codebooks of the prediction residual. A player plays snippets of them, at their recorded level, in
//! the place of Gaussian noise.
//!
//! The content is a byte with the number K of codebooks; per codebook a varint n, the peak as `f32` in standard
//! deviations, and n bytes of [blocks](super::blocks); then a byte per node, speed-major: 0 for Gaussian noise, k for
//! codebook number k.
//!
//! A codebook's mean square is 1 within 2 %, because the level of a node assumes an excitation of variance 1. Its mean
//! is near 0, because a mean would be a steady force.

#[cfg(feature = "alloc")]
use alloc::vec::Vec;

use crate::error::Problem;
use crate::limits::{
    MAX_CODEBOOK_MEAN, MAX_CODEBOOK_PEAK, MAX_CODEBOOK_POWER, MAX_CODEBOOK_SAMPLES, MAX_CODEBOOKS,
    MAX_EXCITATION_BYTES, MIN_CODEBOOK_POWER, MIN_CODEBOOK_SAMPLES,
};
use crate::wire::Reader;

#[cfg(feature = "alloc")]
use super::PartSpec;
use super::blocks::{BLOCK_BYTES, BLOCK_SAMPLES, Sums, block_share};

/// Kind of this part.
pub(crate) const KIND: u32 = 3;

/// Codebooks of a texture, and the source of each node's excitation.
#[cfg(feature = "alloc")]
#[derive(Clone, Debug, PartialEq)]
pub struct ExcitationSpec {
    /// The codebooks.
    pub codebooks: Vec<CodebookSpec>,
    /// The source of each node's excitation, speed-major: 0 for Gaussian noise, k for codebook number k, from 1.
    pub of_nodes: Vec<u8>,
}

/// A codebook: successive samples of a prediction residual, with a mean square of 1.
#[cfg(feature = "alloc")]
#[derive(Clone, Debug, PartialEq)]
pub struct CodebookSpec {
    /// Value of the largest code in a block of level 0, standard deviations.
    pub peak: f32,
    /// Bytes of blocks; see [`crate::block_share`].
    pub blocks: Vec<u8>,
}

#[cfg(feature = "alloc")]
impl CodebookSpec {
    /// The codebook of these `blocks` whose mean square is 1.
    pub fn of_unit_power(blocks: Vec<u8>) -> Self {
        let mut codebook = Self { peak: 1.0, blocks };
        // The root of a float is in `std` alone, so this is Newton's method, which converges from above.
        let power = f64::from(codebook.mean_square());
        let mut root = power.max(1.0);
        for _ in 0..64 {
            root = f64::midpoint(root, power / root);
        }
        codebook.peak = (1.0 / root) as f32;
        codebook
    }

    /// Mean square of the samples; 0 without samples. A library requires it to be 1 within 2 %.
    pub fn mean_square(&self) -> f32 {
        let mut sums = Sums::default();
        self.blocks.as_chunks().0.iter().for_each(|block| {
            sums.add(block);
        });
        sums.mean_square(self.peak)
    }
}

#[cfg(feature = "alloc")]
impl From<Excitation<'_>> for ExcitationSpec {
    /// Copies the codebooks of a decoded texture. Encoding them gives the same bytes.
    fn from(excitation: Excitation<'_>) -> Self {
        let codebooks = excitation.codebooks().iter().map(|codebook| CodebookSpec {
            peak: codebook.peak,
            blocks: codebook.blocks.to_vec(),
        });
        Self {
            codebooks: codebooks.collect(),
            of_nodes: excitation.of_nodes.to_vec(),
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
}

/// A codebook of a decoded texture.
#[derive(Clone, Copy, Debug)]
pub struct Codebook<'a> {
    peak: f32,
    blocks: &'a [u8],
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
}

impl Codebook<'_> {
    const EMPTY: Self = Self { peak: 0.0, blocks: &[] };

    /// Value of the largest code in a block of level 0, standard deviations.
    pub fn peak(&self) -> f32 {
        self.peak
    }

    /// Number of samples.
    #[inline]
    pub fn samples(&self) -> usize {
        self.blocks.len() / BLOCK_BYTES * BLOCK_SAMPLES
    }

    /// Sample number `at` as a fraction of the peak, in steps of 2⁻³⁰; 0 after the last sample.
    #[inline]
    pub fn share(&self, at: usize) -> i32 {
        let block = self.blocks.as_chunks().0.get(at / BLOCK_SAMPLES);
        block.map_or(0, |block| block_share(block, at % BLOCK_SAMPLES))
    }
}

/// The part's content.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ExcitationPart<'a>(pub &'a [u8]);

impl<'a> ExcitationPart<'a> {
    /// Parses the content for a grid of `forces` forces, and checks everything except the blocks and the nodes'
    /// sources.
    fn read(self, nodes: usize, forces: usize) -> Result<Excitation<'a>, Problem> {
        let most = MAX_EXCITATION_BYTES;
        Problem::count("the length of the excitation in bytes", self.0.len(), [0, most])?;
        let mut reader = Reader(self.0);
        let count = usize::from(reader.byte().ok_or(MALFORMED)?);
        Problem::count("the number of codebooks", count, [1, MAX_CODEBOOKS])?;
        let mut codebooks = [Codebook::EMPTY; MAX_CODEBOOKS];
        for codebook in &mut codebooks[..count] {
            *codebook = codebook_of(&mut reader)?;
        }
        Problem::same("sources of excitation of the nodes", reader.0.len(), nodes)?;
        Ok(Excitation {
            codebooks,
            count,
            of_nodes: reader.0,
            forces,
        })
    }

    /// The view of a part that was found valid.
    pub fn view(self, nodes: usize, forces: usize) -> Option<Excitation<'a>> {
        self.read(nodes, forces).ok()
    }

    /// Checks everything in the part except the blocks and the nodes' sources, in a texture of `nodes` nodes.
    pub fn check(self, nodes: usize) -> Result<(), Problem> {
        self.read(nodes, 1).map(|_| ())
    }
}

const MALFORMED: Problem = Problem::Malformed("its excitation");

/// Reads the codebook at the reader's position, without checking its blocks.
fn codebook_of<'a>(reader: &mut Reader<'a>) -> Result<Codebook<'a>, Problem> {
    let length = reader.varint().ok_or(MALFORMED)? as usize;
    let peak = reader.f32().ok_or(MALFORMED)?;
    // A peak of 0 is refused later, because the mean square of such a codebook is 0.
    Problem::within("the peak of a codebook", peak, [0.0, MAX_CODEBOOK_PEAK])?;
    let (blocks, rest) = reader.0.split_at_checked(length).ok_or(MALFORMED)?;
    reader.0 = rest;
    let codebook = Codebook { peak, blocks };
    if !length.is_multiple_of(BLOCK_BYTES) {
        return Err(Problem::Rule("a codebook is no whole number of blocks"));
    }
    let lengths = [MIN_CODEBOOK_SAMPLES, MAX_CODEBOOK_SAMPLES];
    Problem::count("the number of samples of a codebook", codebook.samples(), lengths)?;
    Ok(codebook)
}

/// The check of the blocks of a part and of its nodes' sources, in steps.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::library) struct ExcitationCheck {
    /// Index of the codebook that is being checked; the number of codebooks while the nodes are being checked.
    codebook: usize,
    /// Number of bytes of this codebook, or of nodes, that were checked.
    at: usize,
    sums: Sums,
    /// One bit per codebook, set if a node uses the codebook.
    used: u8,
}

impl ExcitationCheck {
    /// Checks the next bytes of `excitation`, at most `room` of them. Returns true if none are left.
    ///
    /// # Errors
    /// The first fault found, with the index of the node if the fault is in a node's source.
    pub fn step(&mut self, excitation: &Excitation<'_>, room: usize) -> Result<bool, (Option<usize>, Problem)> {
        let mut taken = 0;
        while let Some(codebook) = excitation.codebooks().get(self.codebook) {
            // A block is checked as a whole, because its level comes last and scales all of its codes.
            let whole = (room - taken) / BLOCK_BYTES * BLOCK_BYTES;
            let end = codebook.blocks.len().min(self.at + whole);
            taken += end - self.at;
            for block in codebook.blocks[self.at..end].as_chunks().0 {
                if !self.sums.add(block) {
                    return Err((None, Problem::Rule("a block of a codebook is louder than its peak")));
                }
            }
            self.at = end;
            if end < codebook.blocks.len() {
                return Ok(false);
            }
            self.end_of_codebook(codebook).map_err(|problem| (None, problem))?;
        }
        let end = excitation.of_nodes.len().min(self.at + room - taken);
        self.nodes(&excitation.of_nodes[self.at..end], excitation.count)
            .map_err(|(index, problem)| (Some(self.at + index), problem))?;
        self.at = end;
        if end < excitation.of_nodes.len() {
            return Ok(false);
        }
        if (0..excitation.count).any(|codebook| self.used >> codebook & 1 == 0) {
            return Err((None, Problem::Needless("a codebook that no node has")));
        }
        Ok(true)
    }

    fn end_of_codebook(&mut self, codebook: &Codebook<'_>) -> Result<(), Problem> {
        let power = self.sums.mean_square(codebook.peak);
        let range = [MIN_CODEBOOK_POWER, MAX_CODEBOOK_POWER];
        Problem::within("the mean square of a codebook", power, range)?;
        let mean = self.sums.mean(codebook.peak).abs();
        Problem::within(
            "the magnitude of the mean of a codebook",
            mean,
            [0.0, MAX_CODEBOOK_MEAN],
        )?;
        (self.codebook, self.at, self.sums) = (self.codebook + 1, 0, Sums::default());
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
        content.extend(postcard::to_allocvec(&(codebook.blocks.len() as u32))?);
        content.extend(codebook.peak.to_le_bytes());
        content.extend(&codebook.blocks);
    }
    content.extend(&spec.of_nodes);
    Ok((KIND, content))
}
