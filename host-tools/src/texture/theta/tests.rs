//! Tests of the choice, on models that allow one byte per further stage and on models that do not.

use model_format::{
    Laws, Library, NodeFlags, NodeSpec, PartsSpec, SAMPLE_RATE_HZ, TextureSpec, encode, limits,
};
use proptest::prelude::*;

use super::*;
use crate::dsp::model::Model;
use crate::dsp::model_error::ModelError;
use crate::texture::grid::Grid;
use crate::texture::quantise::{nodes, stored_reflection};

fn model(reflection: Vec<f64>) -> Model {
    Model {
        reflection,
        output_power: 2.0,
        flags: NodeFlags::NONE,
    }
}

/// A slope, and small coefficients of either sign behind it.
fn smooth(order: usize) -> Model {
    let k = |stage: usize| match stage {
        0 => -0.9,
        _ => 0.2 * (1.7 * stage as f64).sin() / (1.0 + stage as f64).sqrt(),
    };
    model((0..order).map(k).collect())
}

/// The same with a stage in the tail whose θ takes most of the range, so that the others are left with coarse steps.
fn steep(order: usize) -> Model {
    let mut model = smooth(order);
    model.reflection[40] = 0.95;
    model
}

fn grid(models: Vec<Model>) -> Grid {
    Grid {
        speeds_mm_s: (1..=models.len()).map(|n| 20.0 * n as f32).collect(),
        forces_n: vec![0.5],
        models,
        laws: Laws::default(),
        parts: PartsSpec::default(),
    }
}

fn stored(grid: &Grid, choice: ThetaChoice) -> (Vec<NodeSpec>, ThetaReport) {
    let fine = nodes("felt", grid).unwrap();
    store("felt", grid, fine, choice, SAMPLE_RATE_HZ)
}

/// Errors of `nodes` against the models of `grid`, in their order.
fn errors<'n>(grid: &'n Grid, nodes: &'n [NodeSpec]) -> impl Iterator<Item = ModelError> + 'n {
    let both = grid.models.iter().zip(nodes);
    both.map(|(model, node)| {
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
    let (nodes, report) = stored(&grid, ThetaChoice::Auto);
    assert_eq!(report.stored, StoredTheta::Compact, "{report:?}");
    assert_eq!(report.long_nodes, 2);
    assert_eq!(report.forbidden_by, None);
    let tails: Vec<bool> = nodes.iter().map(has_tail).collect();
    assert_eq!(tails, [false, true, true, false]);
    // The node of 20 stages is as fine as it was, and was not judged.
    let largest = errors(&grid, &nodes).skip(1).take(2);
    let largest = largest.reduce(ModelError::max).unwrap();
    assert_eq!(report.largest_error, Some(largest));
    assert!(largest.share_of(LARGEST_ERROR) <= 1.0);
    assert!(encode(&[spec(&grid, nodes)]).is_ok());
}

#[test]
fn one_node_that_would_lose_its_spectrum_keeps_the_texture_fine_and_is_named() {
    let grid = grid(vec![smooth(400), steep(400), smooth(100)]);
    let (nodes, report) = stored(&grid, ThetaChoice::Auto);
    assert!(!nodes.iter().any(has_tail));
    assert_eq!(report.stored, StoredTheta::Fine);
    let forbidding = report.forbidden_by.expect("the steep one");
    assert_eq!((forbidding.speed_mm_s, forbidding.force_n), (40.0, 0.5));
    assert!(forbidding.error.share_of(LARGEST_ERROR) > 1.0);
    let said = summary(&[report]).join("\n");
    assert!(
        said.contains("felt: θ in 16 bits") && said.contains("at 40 mm/s, 0.5 N"),
        "{said}"
    );
}

#[test]
fn what_is_asked_for_is_stored() {
    let grid = grid(vec![smooth(400), steep(400)]);
    let (nodes, report) = stored(&grid, ThetaChoice::Compact);
    assert!(nodes.iter().all(has_tail));
    assert_eq!(report.stored, StoredTheta::Compact);
    let forbidding = report.forbidden_by.expect("the steep one");
    assert_eq!((forbidding.speed_mm_s, forbidding.force_n), (40.0, 0.5));
    let (nodes, report) = stored(&grid, ThetaChoice::Fine);
    assert!(!nodes.iter().any(has_tail));
    assert_eq!(report.largest_error, None);
}

#[test]
fn models_of_32_stages_stay_as_they_are() {
    let grid = grid(vec![smooth(32), smooth(5)]);
    let fine = nodes("felt", &grid).unwrap();
    for choice in [ThetaChoice::Auto, ThetaChoice::Compact] {
        let (nodes, report) = store("felt", &grid, fine.clone(), choice, SAMPLE_RATE_HZ);
        assert_eq!(nodes, fine);
        assert_eq!((report.stored, report.long_nodes), (StoredTheta::Fine, 0));
    }
}

#[test]
fn a_summary_names_textures_that_are_alike_together() {
    let of = |name: &str, models, choice| {
        let grid = grid(models);
        let fine = nodes(name, &grid).unwrap();
        store(name, &grid, fine, choice, SAMPLE_RATE_HZ).1
    };
    let auto = ThetaChoice::Auto;
    let said = summary(&[
        of("a", vec![smooth(100)], auto),
        of("b", vec![smooth(3)], auto),
        of("c", vec![smooth(100)], ThetaChoice::Fine),
        of("d", vec![smooth(60)], auto),
        of("e", vec![steep(60)], ThetaChoice::Compact),
    ]);
    let begins = [
        "b: no node has",
        "c: θ in 16 bits",
        "a, d: θ in 8 bits",
        "e: θ in 8 bits after stage 32, as asked",
    ];
    assert_eq!(said.len(), begins.len(), "{said:?}");
    for (line, begin) in said.iter().zip(begins) {
        assert!(line.starts_with(begin), "{line}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Whatever is chosen makes a library of the size that is reckoned with, within the bounds that are stated.
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
        let (nodes, report) = stored(&grid, ThetaChoice::Auto);
        let tails = nodes.iter().any(has_tail);
        prop_assert_eq!(tails, report.stored == StoredTheta::Compact);
        if tails {
            for error in errors(&grid, &nodes) {
                prop_assert!(error.share_of(LARGEST_ERROR) <= 1.0);
            }
        }
        if report.long_nodes > 0 {
            let models: Vec<&Model> = grid.models.iter().collect();
            prop_assert_eq!(all_allow_compact(&models), tails);
        }
        let orders: Vec<usize> = nodes.iter().map(|node| node.codes.thetas().count()).collect();
        let highest = orders.iter().copied().max().unwrap_or(0);
        let bytes = orders.iter().map(|&order| {
            bytes_per_node(report.stored, order, highest)
        });
        let reckoned: usize = bytes.sum();
        let library = encode(&[spec(&grid, nodes)]).unwrap();
        let library = Library::decode(&library).unwrap();
        let texture = library.textures().next().unwrap();
        let parts = texture.parts().map(|(_, bytes)| bytes).sum::<usize>();
        let found = texture.coefficient_bytes() + parts;
        // The last fractions of all nodes may be 0 by chance, and are not stored then.
        prop_assert!(found <= reckoned && reckoned <= found + orders.len() * 2, "{} {}", found, reckoned);
    }
}
