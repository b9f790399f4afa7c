//! Part of kind 2: 8 more binary digits of θ for the first stages of every node.
//!
//! The content is n bytes per node, speed-major; n follows from the part's length. It is the same for all nodes, so
//! that a node's bytes can be found without reading those before them. Byte i of a node is signed and belongs to stage
//! i: θ = (code · 256 + byte) · π/2²⁴. The code is θ rounded to 16 bits, so that the bytes only add resolution. They
//! are worth their memory in the first stages, because a few narrow lines cause a large |k| there.

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

    /// The bytes of node `index` of `nodes`, at most as many as its `order`. The part must have been found valid.
    pub fn of_node(self, index: usize, nodes: usize, order: usize) -> &'a [u8] {
        let stages = self.stages(nodes);
        let begin = index * stages;
        &self.0[begin..begin + stages.min(order)]
    }

    /// Checks the part's length, in a texture of `nodes` nodes.
    pub fn check(self, nodes: usize) -> Result<(), Problem> {
        let (found, stages) = (self.0.len(), self.stages(nodes));
        if !found.is_multiple_of(nodes) || !(1..=MAX_FINE_STAGES).contains(&stages) {
            return Err(Problem::Rule("there must be 1 to 32 fractions of θ for each node"));
        }
        Ok(())
    }

    /// Checks the bytes of node `index` of `nodes`, whose order is `order`. Returns true if the last byte is not 0.
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

/// Creates the part for nodes with these bytes; none if all bytes are 0.
///
/// # Errors
/// A node with bytes that are not 0 for more than [`MAX_FINE_STAGES`] stages: its index and the fault.
#[cfg(feature = "alloc")]
pub(crate) fn part(nodes: &[&[i8]]) -> Result<Option<PartSpec>, (usize, Problem)> {
    let used = |bytes: &&[i8]| bytes.iter().rposition(|&byte| byte != 0).map_or(0, |i| i + 1);
    for (node, bytes) in nodes.iter().enumerate() {
        Problem::count("the number of fractions of θ", used(bytes), [0, MAX_FINE_STAGES])
            .map_err(|problem| (node, problem))?;
    }
    // Zeros at the end of all nodes are left out, because a reader refuses them.
    let stages = nodes.iter().map(used).max().unwrap_or(0);
    let mut content = alloc::vec::Vec::with_capacity(stages * nodes.len());
    for bytes in nodes {
        let bytes = bytes.iter().map(|&byte| byte.cast_unsigned());
        content.extend(bytes.chain(core::iter::repeat(0)).take(stages));
    }
    Ok((stages > 0).then_some((KIND, content)))
}
