//! The library that the suite uploads: one texture per filter and order whose cycles are measured, and one scene per
//! effect.

use kernel_vectors::{COUNTED_ORDERS, counted_texture};
use model_format::link::{Selection, TextureName};
use model_format::scene::{Biquad, Region, Scene, SceneName, StickSlip, Surface, Tap};
use model_format::{SAMPLE_RATE_HZ, encode_with_scenes};

/// Indices among the textures of the lattices of orders 100 and 50. A transition of both keeps within a scene's budget.
const LATTICE: u8 = 3;
const SECOND: u8 = 2;

/// Textures and scenes that are played and measured, with the library that holds them.
#[derive(Clone, Debug)]
pub struct Played {
    /// The library's bytes.
    pub bytes: Vec<u8>,
    /// All of its textures and scenes, with a description of each for the table of cycles.
    pub selections: Vec<(String, Selection)>,
}

/// The suite's library.
pub fn played() -> Played {
    let textures =
        COUNTED_ORDERS.map(|order| counted_texture(order, &format!("lattice, order {order}")));
    let scenes = scenes();
    let bytes = encode_with_scenes(&textures, &scenes).expect("within the limits");
    let textures = textures.iter().map(|texture| {
        let name = TextureName::try_from(texture.name.as_str()).expect("short");
        (texture.name.clone(), Selection::Texture(name))
    });
    let scenes = scenes.iter().map(|scene| {
        let what = format!("scene: {}", scene.name);
        (what, Selection::Scene(scene.name.clone()))
    });
    let selections = textures.chain(scenes).collect();
    Played { bytes, selections }
}

/// The texture of the highest order, the dearest filter.
pub fn dearest() -> Selection {
    let order = COUNTED_ORDERS[COUNTED_ORDERS.len() - 1];
    texture(&format!("lattice, order {order}"))
}

/// A texture that is cheap, so that an emulator is fast.
pub fn cheap() -> Selection {
    texture("lattice, order 10")
}

fn texture(name: &str) -> Selection {
    Selection::Texture(TextureName::try_from(name).expect("short"))
}

/// One scene per stage of a scene, on a lattice of order 100.
fn scenes() -> Vec<Scene> {
    let scene = |name: &str, surface| {
        let name = SceneName::try_from(name).expect("short");
        Scene::of_surface(name, SAMPLE_RATE_HZ, surface)
    };
    let plain = || Surface::of_texture(LATTICE);
    let mut tapped = plain();
    tapped.tap = Some(Tap {
        frequency_hz: 300.0,
        decay_s: 1.0,
        gain_m_s2_per_n_s: 0.05,
        limit_m_s2: 20.0,
    });
    let mut sticky = plain();
    sticky.stick_slip = Some(StickSlip {
        period_mm: 1.5,
        duty: 0.6,
        depth: 0.9,
        below_mm_s: 1_000.0,
        above_n: 0.05,
    });
    let equalised = |name, sections| {
        let mut scene = scene(name, plain());
        for section in 0..sections {
            let pole = 0.3 + 0.05 * f64::from(section);
            let biquad = Biquad::from_f64([0.8, -0.2, 0.1], [-pole, 0.2]).expect("within range");
            scene.equaliser.push(biquad).expect("there is room");
        }
        scene
    };
    let mut transition = scene("transition", plain());
    let second = Surface::of_texture(SECOND);
    transition.surfaces.push(second).expect("there is room");
    for (surface, [start_mm, end_mm]) in [[-1e5, 0.0], [0.0, 1e5]].into_iter().enumerate() {
        let region = Region {
            start_mm,
            end_mm,
            surface: surface as u8,
        };
        transition.regions.push(region).expect("there is room");
    }
    transition.transition_mm = 100.0;
    vec![
        scene("lattice, order 100", plain()),
        scene("tap", tapped),
        scene("stick-slip", sticky),
        equalised("one section", 1),
        equalised("eight sections", 8),
        transition,
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use model_format::Library;

    #[test]
    fn the_library_fits_a_slot_and_holds_all_that_is_played() {
        let played = played();
        let library = Library::decode(&played.bytes).expect("it is valid");
        let fast = [dearest(), cheap()];
        let known: Vec<_> = played.selections.iter().map(|(_, one)| one).collect();
        assert!(fast.iter().all(|one| known.contains(&one)));
        for selection in known {
            match selection {
                Selection::Texture(name) => assert!(library.texture(name).is_some(), "{name}"),
                Selection::Scene(name) => assert!(library.scene(name).is_some(), "{name}"),
            }
        }
        let names: Vec<_> = library.textures().map(|texture| texture.name()).collect();
        assert_eq!(names[usize::from(LATTICE)], "lattice, order 100");
        assert_eq!(names[usize::from(SECOND)], "lattice, order 50");
    }
}
