//! Surfaces at a position, and their weights.

use model_format::SAMPLE_RATE_HZ;
use model_format::scene::{Scene, Surface};
use proptest::collection::vec;
use proptest::prelude::*;
use stylus_kernel::grid::ONE;
use stylus_kernel::scene::{Located, Path};

use crate::models::{add_region, name, side_by_side};

/// Regions of any lengths, some of which touch, and a transition.
fn any_path() -> impl Strategy<Value = Path> {
    let length = prop_oneof![4 => 0.1f32..20.0, 1 => Just(0.01)];
    let gap = prop_oneof![2 => Just(0.0), 1 => 0.01f32..5.0];
    let transition = prop_oneof![1 => Just(0.0), 4 => 0.0f32..30.0];
    (vec((gap, length, 0u8..4), 1..20), transition).prop_map(|(stretches, transition_mm)| {
        let surface = Surface::of_texture(0);
        let mut scene = Scene::of_surface(name("path"), SAMPLE_RATE_HZ, surface);
        scene.transition_mm = transition_mm;
        let mut end_mm = 0.0;
        for (gap, length, surface) in stretches {
            let start_mm = end_mm + gap;
            end_mm = start_mm + length;
            add_region(&mut scene, [start_mm, end_mm], surface);
        }
        Path::new(&scene)
    })
}

fn power(located: &[Located]) -> u64 {
    located.iter().map(|at| u64::from(at.weight).pow(2)).sum()
}

proptest! {
    #[test]
    fn no_place_has_more_power_than_one_surface(path in any_path(), places in vec(-5.0f32..420.0, 1..100)) {
        for place in places {
            let located = path.locate(place);
            prop_assert!(power(&located) <= u64::from(ONE).pow(2));
            if let [one, other] = located[..] {
                prop_assert_ne!(one.surface, other.surface);
                prop_assert!(one.weight >= other.weight);
                // Between surfaces the sum of squares is one within rounding.
                prop_assert!(power(&located) >= u64::from(ONE - 3).pow(2));
            }
        }
    }

    /// Weights go through the quarter turn within the transition, or within the shorter neighbour.
    #[test]
    fn weights_change_no_faster_than_the_transition_is_narrow(
        regions in 2usize..6, width in 0.5f32..100.0, place in 0.0f32..600.0, step in 0.0f32..0.05,
    ) {
        let textures = [0, 0, 0, 0, 0, 0];
        let path = Path::new(&side_by_side(&textures[..regions], width));
        let weight = |place: f32, surface: u8| {
            path.locate(place).iter().find(|at| at.surface == surface).map_or(0.0, |at| f64::from(at.weight))
        };
        for surface in 0..regions as u8 {
            let change = (weight(place + step, surface) - weight(place, surface)).abs();
            // The angle changes by π/2 over the width between surfaces, or over half of it at an end without a
            // neighbour.
            let slope = std::f64::consts::PI * f64::from(ONE) / f64::from(width);
            prop_assert!(change <= slope * (f64::from(step) + 1e-4) + 2.0, "{}", change);
        }
    }
}

#[test]
fn beyond_the_regions_and_in_gaps_there_is_nothing() {
    let mut scene = side_by_side(&[0, 1, 0], 4.0);
    scene.regions[2].start_mm = 250.0;
    let path = Path::new(&scene);
    for place in [-1e30, -0.01, 200.0, 225.0, 249.99, 300.0, f32::MAX] {
        assert!(path.locate(place).is_empty(), "{place} mm");
    }
    // At an end without a neighbour a surface fades within itself.
    assert!(path.locate(0.0)[0].weight == 0 && path.locate(2.0)[0].weight == ONE);
    assert!(path.locate(199.99)[0].weight < ONE / 50);
}

#[test]
fn a_transition_of_no_width_is_one_surface_or_the_other() {
    let path = Path::new(&side_by_side(&[0, 1], 0.0));
    for (place, surface) in [(0.0, 0), (99.999, 0), (100.0, 1), (199.9, 1)] {
        let expected = Located { surface, weight: ONE };
        assert_eq!(path.locate(place)[..], [expected], "{place} mm");
    }
}

#[test]
fn in_the_middle_of_a_transition_both_have_half_the_power() {
    let path = Path::new(&side_by_side(&[0, 1], 10.0));
    let located = path.locate(100.0);
    assert_eq!(located.len(), 2);
    for at in located {
        assert!((f64::from(at.weight) / f64::from(ONE) - 0.5f64.sqrt()).abs() < 1e-4);
    }
}

#[test]
fn neighbours_of_one_surface_are_one() {
    let mut scene = side_by_side(&[0, 1], 10.0);
    scene.regions[1].surface = 0;
    let path = Path::new(&scene);
    assert_eq!(path.locate(100.0).len(), 1);
    assert_eq!(path.locate(98.0)[0].weight, ONE);
}
