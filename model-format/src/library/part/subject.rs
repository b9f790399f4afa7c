//! The texture that a part belongs to, as far as a part's check needs it.

use crate::error::{DecodeError, Place, Problem};
use crate::wire::{NodeRecord, Structure};

/// Kind and content of a part to be written.
#[cfg(feature = "alloc")]
pub(crate) type PartSpec = (u32, alloc::vec::Vec<u8>);

/// A texture whose header and nodes were found valid.
#[derive(Clone, Copy)]
pub(crate) struct Subject<'a> {
    /// Index of the texture.
    pub index: usize,
    pub structure: Structure,
    /// Number of forces of the grid.
    pub forces: usize,
    /// The records of all nodes, speed-major.
    pub nodes: &'a [u8],
}

impl Subject<'_> {
    /// Number of nodes, at least one.
    pub fn len(&self) -> usize {
        self.nodes.len() / NodeRecord::BYTES
    }

    /// All nodes, speed-major.
    pub fn nodes(&self) -> impl Iterator<Item = NodeRecord> {
        self.nodes.as_chunks().0.iter().map(NodeRecord::read)
    }

    /// Error of the whole texture.
    pub fn error(&self, problem: Problem) -> DecodeError {
        problem.at(Place::Texture(self.index))
    }

    /// Error of node `number`.
    pub fn node_error(&self, number: usize, problem: Problem) -> DecodeError {
        problem.at(Place::Node {
            texture: self.index,
            speed: number / self.forces,
            force: number % self.forces,
        })
    }
}
