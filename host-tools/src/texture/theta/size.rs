//! Sizes of coefficients in a library.

use model_format::limits;

use super::choice::StoredTheta;
use crate::texture::quantise::COMPACT_FINE_STAGES;

/// Length of the coefficients of a node of `order` in a library, bytes, with the fractions and the step of its θ. There
/// are as many fractions for each node of a texture, whose highest order is `highest_order`.
pub fn bytes_per_node(theta: StoredTheta, order: usize, highest_order: usize) -> usize {
    /// A step of a tail.
    const STEP_BYTES: usize = 2;
    let wide = order.min(limits::MAX_FINE_STAGES);
    match theta {
        StoredTheta::Compact => order + wide + highest_order.min(COMPACT_FINE_STAGES) + STEP_BYTES,
        StoredTheta::Fine => 2 * order + highest_order.min(limits::MAX_FINE_STAGES),
    }
}
