//! Storage of a lattice's θ in the fewest bytes that preserve the spectrum of every node.
//!
//! In all textures, θ of the first 32 stages has 16 bits or more. *Fine* textures have 24 bits there and 16 bits in
//! later stages. *Compact* textures have 24 bits in fewer of the first stages, and one byte per stage after the 32nd,
//! with a range per node. Compact θ takes little more than half of the bytes at order 400.

use model_format::{CodeSpec, NodeSpec, limits};
use rayon::prelude::*;
use stylus_dsp::model::Model;
use stylus_dsp::model_error::ModelError;

use crate::texture::grid::Grid;
use crate::texture::quantise::{COMPACT_FINE_STAGES, compact_codes, stored_reflection, with_codes};

/// Largest errors of a node that compact θ may cause.
///
/// These bounds of the RMS and the third octaves are far below any just noticeable difference (2.2 dB of amplitude,
/// [`stylus_dsp::spectrum::AMPLITUDE_JND_DB`]), and below the scatter between two takes of one surface.
pub(crate) const LARGEST_ERROR: ModelError = ModelError {
    rms_db: 0.1,
    third_octave_db: 0.2,
    line_db: 0.2,
};

/// The form in which a texture's θ is stored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StoredTheta {
    /// 16 bits or more in all stages.
    Fine,
    /// One byte in stages after the 32nd.
    Compact,
}

/// Rounds θ to one byte after the 32nd stage, if this preserves every node's spectrum. `nodes` are those of `grid`,
/// quantised as a lattice with fine θ; `sample_rate_hz` is that of the models.
pub fn store(grid: &Grid, nodes: Vec<NodeSpec>, sample_rate_hz: u32) -> Vec<NodeSpec> {
    if !grid.models.iter().any(is_long) {
        return nodes;
    }
    let compacted: Vec<(CodeSpec, Option<ModelError>)> = (grid.models.par_iter())
        .map(|model| compacted(model, sample_rate_hz))
        .collect();
    // A library has one form of θ per texture, so one node decides for all.
    if !compacted.iter().all(|(_, error)| is_unfelt(*error)) {
        return nodes;
    }
    nodes
        .iter()
        .zip(compacted)
        .map(|(node, (codes, _))| with_codes(node, codes))
        .collect()
}

/// Returns whether an error, if there is one, is within its bounds.
fn is_unfelt(error: Option<ModelError>) -> bool {
    error.is_none_or(|error| error.share_of(LARGEST_ERROR) <= 1.0)
}

/// Returns whether a model is not silent and has stages that compact θ stores in one byte.
fn is_long(model: &Model) -> bool {
    !model.is_silent() && model.reflection.len() > limits::MAX_FINE_STAGES
}

/// Returns the compact codes of a model, and their error. There is no error for a silent model, which is never played,
/// nor for one in which no stage has fewer bits than with fine θ.
fn compacted(model: &Model, sample_rate_hz: u32) -> (CodeSpec, Option<ModelError>) {
    let codes = compact_codes(model);
    let rate_hz = f64::from(sample_rate_hz);
    let rounded = model.reflection.len() > COMPACT_FINE_STAGES;
    let error = (rounded && !model.is_silent())
        .then(|| ModelError::between(&model.reflection, &stored_reflection(&codes), rate_hz));
    (codes, error)
}

/// Returns the length in a library of the coefficients of a node of `order`, bytes, including the fractions and the
/// step of θ. All nodes of a texture have the same number of fractions; `highest_order` is the texture's highest order.
pub fn bytes_per_node(theta: StoredTheta, order: usize, highest_order: usize) -> usize {
    /// A step of a tail.
    const STEP_BYTES: usize = 2;
    let wide = order.min(limits::MAX_FINE_STAGES);
    match theta {
        StoredTheta::Compact => order + wide + highest_order.min(COMPACT_FINE_STAGES) + STEP_BYTES,
        StoredTheta::Fine => 2 * order + highest_order.min(limits::MAX_FINE_STAGES),
    }
}

#[cfg(test)]
mod tests {
    use model_format::{Library, SAMPLE_RATE_HZ, TextureSpec, encode};
    use proptest::prelude::*;

    use super::*;
    use crate::texture::quantise::nodes;

    fn model(reflection: Vec<f64>) -> Model {
        Model::new(reflection, 2.0)
    }

    /// A spectral slope, followed by small coefficients of either sign.
    fn smooth(order: usize) -> Model {
        let k = |stage: usize| match stage {
            0 => -0.9,
            _ => 0.2 * (1.7 * stage as f64).sin() / (1.0 + stage as f64).sqrt(),
        };
        model((0..order).map(k).collect())
    }

    /// A smooth model except for one stage in the tail, whose θ takes most of the range, so that the others get coarse
    /// steps.
    fn steep(order: usize) -> Model {
        let mut model = smooth(order);
        model.reflection[40] = 0.95;
        model
    }

    fn grid(models: Vec<Model>) -> Grid {
        let speeds_mm_s = (1..=models.len()).map(|n| 20.0 * n as f32);
        Grid::new(speeds_mm_s.collect(), vec![0.5], models)
    }

    fn stored(grid: &Grid) -> Vec<NodeSpec> {
        store(grid, nodes("felt", grid).unwrap(), SAMPLE_RATE_HZ)
    }

    /// Returns the errors of `nodes` against the models of `grid`, in their order.
    fn errors<'n>(grid: &'n Grid, nodes: &'n [NodeSpec]) -> impl Iterator<Item = ModelError> + 'n {
        grid.models.iter().zip(nodes).map(|(model, node)| {
            let stored = stored_reflection(&node.codes);
            ModelError::between(&model.reflection, &stored, f64::from(SAMPLE_RATE_HZ))
        })
    }

    fn has_tail(node: &NodeSpec) -> bool {
        !node.codes.tail.codes.is_empty()
    }

    fn spec(grid: &Grid, nodes: Vec<NodeSpec>) -> TextureSpec {
        TextureSpec {
            laws: grid.laws,
            parts: grid.parts.clone(),
            ..TextureSpec::new("felt", &grid.speeds_mm_s, &grid.forces_n, nodes)
        }
    }

    #[test]
    fn models_that_keep_their_spectrum_are_compact() {
        let grid = grid(vec![smooth(20), smooth(33), smooth(400), Model::silent()]);
        let nodes = stored(&grid);
        let tails: Vec<bool> = nodes.iter().map(has_tail).collect();
        assert_eq!(tails, [false, true, true, false]);
        for error in errors(&grid, &nodes).skip(1).take(2) {
            assert!(error.share_of(LARGEST_ERROR) <= 1.0);
        }
        assert!(encode(&[spec(&grid, nodes)]).is_ok());
    }

    #[test]
    fn one_node_that_would_lose_its_spectrum_keeps_the_texture_fine() {
        let grid = grid(vec![smooth(400), steep(400), smooth(100)]);
        assert!(!stored(&grid).iter().any(has_tail));
    }

    #[test]
    fn models_of_32_stages_stay_as_they_are() {
        let grid = grid(vec![smooth(32), smooth(5)]);
        let fine = nodes("felt", &grid).unwrap();
        assert_eq!(stored(&grid), fine);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        /// Whatever form is chosen, the library has the estimated size, and the errors are within the stated bounds.
        #[test]
        fn what_is_chosen_keeps_its_bounds_and_its_size(
            seeds in prop::collection::vec((0usize..=limits::MAX_ORDER, 0.0f64..0.4, any::<u32>()), 1..4),
        ) {
            let models = seeds.iter().map(|&(order, size, seed)| {
                let mut state = seed;
                let k = |_| {
                    state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                    size * (f64::from(state >> 8) / f64::from(1 << 23) - 1.0)
                };
                model((0..order).map(k).collect())
            });
            let grid = grid(models.collect());
            let nodes = stored(&grid);
            let tails = nodes.iter().any(has_tail);
            if tails {
                for error in errors(&grid, &nodes) {
                    prop_assert!(error.share_of(LARGEST_ERROR) <= 1.0);
                }
            }
            let orders: Vec<usize> = nodes.iter().map(|node| node.codes.thetas().count()).collect();
            let highest = orders.iter().copied().max().unwrap_or(0);
            let bytes = orders.iter().map(|&order| {
                bytes_per_node(if tails { StoredTheta::Compact } else { StoredTheta::Fine }, order, highest)
            });
            let reckoned: usize = bytes.sum();
            let library = encode(&[spec(&grid, nodes)]).unwrap();
            let library = Library::decode(&library).unwrap();
            let texture = library.textures().next().unwrap();
            let parts = texture.parts().map(|(_, bytes)| bytes).sum::<usize>();
            let found = texture.coefficient_bytes() + parts;
            // The last fractions of all nodes may be 0 by chance; they are then not stored.
            prop_assert!(found <= reckoned && reckoned <= found + orders.len() * 2, "{} {}", found, reckoned);
        }
    }
}
