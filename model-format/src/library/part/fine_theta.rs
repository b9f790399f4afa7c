//! Part of kind 2: 8 more binary digits of θ for the first stages of every node.
//!
//! The part holds n bytes for each node, speed-major, so that any node's are found without reading those before it; n
//! follows from the part's length. Byte i of a node is signed and belongs to stage i: θ = (code · 256 + byte) · π/2²⁴.
//! The code is the nearest of 16 bits, so that the bytes add resolution and nothing else. They are worth their place in
//! the first stages, because that is where a few narrow lines have their large |k|.

use crate::error::Problem;
use crate::limits::MAX_FINE_STAGES;

#[cfg(feature = "alloc")]
use super::PartSpec;

/// Kind of this part.
pub(crate) const KIND: u32 = 2;

/// The part's content.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FineTheta<'a>(pub &'a [u8]);

impl<'a> FineTheta<'a> {
    /// Number of stages that each of `nodes` nodes has a byte for. Never 0 in a part that was found valid.
    pub fn stages(self, nodes: usize) -> usize {
        self.0.len() / nodes.max(1)
    }

    /// The bytes of node `index` of `nodes`, as many as it has stages, of a part that was found valid.
    pub fn of_node(self, index: usize, nodes: usize, order: usize) -> &'a [u8] {
        let stages = self.stages(nodes);
        let begin = index * stages;
        &self.0[begin..begin + stages.min(order)]
    }

    /// Checks the part's length, in a texture of `nodes` nodes.
    pub fn check(self, nodes: usize) -> Result<(), Problem> {
        let (found, stages) = (self.0.len(), self.stages(nodes));
        if !found.is_multiple_of(nodes) || !(1..=MAX_FINE_STAGES).contains(&stages) {
            return Err(Problem::Rule(
                "there must be 1 to 32 fractions of θ for each node",
            ));
        }
        Ok(())
    }

    /// Checks the bytes of node `index` of `nodes`, whose order is `order`. Returns true if the last of them is used.
    pub fn check_node(self, index: usize, nodes: usize, order: usize) -> Result<bool, Problem> {
        let stages = self.stages(nodes);
        let bytes = &self.0[index * stages..][..stages];
        let beyond = bytes.get(order..).unwrap_or_default();
        if let Some(beyond) = beyond.iter().position(|&byte| byte != 0) {
            let stage = order + beyond + 1;
            let what = "a fraction of θ, and is beyond the order";
            return Err(Problem::Stage { stage, what });
        }
        Ok(bytes[stages - 1] != 0)
    }
}

/// The part of a lattice whose nodes have these bytes, if any of them is not 0.
///
/// # Errors
/// Bytes for more than [`MAX_FINE_STAGES`] stages, with the index of the node.
#[cfg(feature = "alloc")]
pub(crate) fn part(nodes: &[&[i8]]) -> Result<Option<PartSpec>, (usize, Problem)> {
    let used = |bytes: &&[i8]| {
        bytes
            .iter()
            .rposition(|&byte| byte != 0)
            .map_or(0, |i| i + 1)
    };
    for (node, bytes) in nodes.iter().enumerate() {
        Problem::count(
            "the number of fractions of θ",
            used(bytes),
            [0, MAX_FINE_STAGES],
        )
        .map_err(|problem| (node, problem))?;
    }
    let stages = nodes.iter().map(used).max().unwrap_or(0);
    let mut content = alloc::vec::Vec::with_capacity(stages * nodes.len());
    for bytes in nodes {
        let bytes = bytes.iter().map(|&byte| byte.cast_unsigned());
        content.extend(bytes.chain(core::iter::repeat(0)).take(stages));
    }
    Ok((stages > 0).then_some((KIND, content)))
}
