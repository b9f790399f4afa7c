//! The library that the suite uploads: a lattice texture of each order whose cycles are measured, and scenes with each
//! effect.

use kernel_vectors::scenes::{equalised, of_surface, side_by_side, sticky, tapped};
use kernel_vectors::{COUNTED_ORDERS, counted_texture};
use model_format::encode_with_scenes;
use model_format::link::{Selection, TextureName};
use model_format::scene::{Scene, Surface};

/// Indices of the textures with lattices of orders 100 and 50. A transition between these two stays within a scene's
/// budget.
const LATTICE: u8 = 3;
const SECOND: u8 = 2;

/// Textures and scenes that are played and measured, and the library that holds them.
#[derive(Clone, Debug)]
pub struct Played {
    /// The library's bytes.
    pub bytes: Vec<u8>,
    /// All textures and scenes of the library, each with a description for the table of cycles.
    pub selections: Vec<(String, Selection)>,
}

/// Returns the suite's library.
pub fn played() -> Played {
    let textures = COUNTED_ORDERS.map(|order| counted_texture(order, &format!("lattice, order {order}")));
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

/// Selects the texture of the highest order, whose filter is the most expensive.
pub fn dearest() -> Selection {
    let order = COUNTED_ORDERS[COUNTED_ORDERS.len() - 1];
    texture(&format!("lattice, order {order}"))
}

/// Selects a texture that is cheap to compute, so that an emulator is fast.
pub fn cheap() -> Selection {
    texture("lattice, order 10")
}

fn texture(name: &str) -> Selection {
    Selection::Texture(TextureName::try_from(name).expect("short"))
}

/// Returns the scenes, on a lattice of order 100: one without effects, and one or two for each effect.
fn scenes() -> Vec<Scene> {
    let plain = || Surface::of_texture(LATTICE);
    let surfaces = [plain(), Surface::of_texture(SECOND)];
    vec![
        of_surface("lattice, order 100", plain()),
        of_surface("tap", tapped(plain())),
        of_surface("stick-slip", sticky(plain())),
        equalised(of_surface("one section", plain()), 1),
        equalised(of_surface("eight sections", plain()), 8),
        // Wide enough that no stroke of a run leaves the regions.
        side_by_side("transition", surfaces, [-1e5, 0.0, 1e5], 100.0),
    ]
}
