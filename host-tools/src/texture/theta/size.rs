//! Sizes of coefficients in a library.

use model_format::{Structure, limits};

use super::choice::StoredTheta;
use crate::texture::quantise::COMPACT_FINE_STAGES;

/// Length of the coefficients of a node of `order` in a library, bytes, with the fractions and the step of its θ. A
/// lattice's fractions are as many for each node of a texture, whose highest order is `highest_order`.
pub fn bytes_per_node(
    structure: Structure,
    theta: StoredTheta,
    order: usize,
    highest_order: usize,
) -> usize {
    /// A step of a tail.
    const STEP_BYTES: usize = 2;
    let wide = order.min(limits::MAX_FINE_STAGES);
    match (structure, theta) {
        (Structure::NormalisedLattice, StoredTheta::Compact) => {
            order + wide + highest_order.min(COMPACT_FINE_STAGES) + STEP_BYTES
        }
        (Structure::NormalisedLattice, StoredTheta::Fine) => {
            2 * order + highest_order.min(limits::MAX_FINE_STAGES)
        }
        _ => order * structure.coefficient_bytes(),
    }
}
