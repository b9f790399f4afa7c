//! Properties of the test textures without which the comparison of bits would show little.

use kernel_vectors::{MEASURED, PATH_UPDATES, VECTORS, Vector, edges, library, motion, run};
use model_format::limits::MAX_ORDER;
use model_format::{Library, OutputSample};
use stylus_kernel::arithmetic::Portable;
use stylus_kernel::digest::Digest;
use stylus_kernel::grid::{GridPoint, ONE};

fn play(library: &[u8], vector: &Vector) -> (Vec<i32>, u32) {
    let mut samples = Vec::new();
    let sink = |OutputSample(sample)| samples.push(sample);
    let saturations = run::<Portable>(library, vector, sink);
    (
        samples,
        saturations.expect("the library holds every vector"),
    )
}

#[test]
fn the_library_holds_every_vector_and_nothing_else() {
    let bytes = library();
    let library = Library::decode(&bytes).expect("the library is valid");
    let names: Vec<_> = library.textures().map(|texture| texture.name()).collect();
    let alone = VECTORS.iter().filter(|vector| vector.beside.is_none());
    assert_eq!(
        names,
        alone.map(|vector| vector.texture).collect::<Vec<_>>()
    );
}

#[test]
fn every_measured_texture_is_of_the_highest_order() {
    let bytes = library();
    let library = Library::decode(&bytes).expect("the library is valid");
    for measured in MEASURED {
        let texture = library.texture(measured.texture).expect("it is there");
        assert_eq!(texture.max_order(), MAX_ORDER, "{}", measured.texture);
    }
}

/// Digests of the words of vectors. A library's textures play these words in every release.
const GOLDEN: [(u32, &str); 13] = [
    (0xb208_a717, "lattice, one node"),
    (0xd14c_91f3, "lattice"),
    (0x24c7_1535, "lattice of unequal orders"),
    (0xd864_b9b9, "lattice of largest angles"),
    (0x00eb_400a, "fine lattice, mean dB"),
    (
        0x3ebf_b8e0,
        "fine lattice of largest angles, mean amplitude",
    ),
    (0x20e3_0f61, "lattice, codebooks"),
    (0xb3de_79e7, "lattice, track"),
    (0xa5af_eacd, "lattice, codebooks and track"),
    (0x0465_62bf, "two voices with codebooks and tracks"),
    (0xddff_948a, "lattice, four lines"),
    (0xf5a7_cbb7, "lattice, codebooks, track and four lines"),
    (0x9e86_e3b1, "compact lattice, mean dB"),
];

#[test]
fn the_words_of_lattices_are_those_of_every_release() {
    let library = library();
    for (golden, name) in GOLDEN {
        let vector = VECTORS.iter().find(|vector| vector.texture == name);
        let (samples, saturations) = play(&library, vector.expect("it is there"));
        let mut digest = Digest::default();
        let words = samples.into_iter().map(OutputSample);
        words.for_each(|word| digest.add(word));
        assert_eq!(digest.value(), golden, "{name}: {:08x}", digest.value());
        assert_eq!(saturations, 0, "{name}");
    }
}

/// Most samples must differ from zero and from their neighbour, because constant output would be equal by itself.
#[test]
fn every_texture_is_heard() {
    let library = library();
    for vector in &VECTORS {
        let (samples, _) = play(&library, vector);
        let moving = samples.windows(2).filter(|pair| pair[0] != pair[1]);
        assert!(moving.count() > samples.len() / 2, "{}", vector.texture);
    }
}

/// A lattice at full scale exceeds its output range, which noise alone would reach after years.
#[test]
fn the_edges_reach_both_ends_of_the_lattices_range() {
    let mut words = Vec::new();
    edges::<Portable>(|word| words.push(word));
    assert!(words.contains(&(i32::MAX as u32)) && words.contains(&(i32::MIN as u32)));
}

/// The path must lead below, onto, between and above the nodes, to rest, and from cell to cell.
#[test]
fn the_path_reaches_every_kind_of_place_on_the_grid() {
    let bytes = library();
    let library = Library::decode(&bytes).expect("the library is valid");
    let texture = library.texture("lattice").expect("it is there");
    let points: Vec<_> = (0..PATH_UPDATES)
        .map(|update| GridPoint::locate(&texture, motion(update)))
        .collect();
    let some = |test: fn(&GridPoint) -> bool| points.iter().any(test);
    assert!(some(|point| point.fade == 0));
    assert!(some(|point| (1..ONE).contains(&point.fade)));
    assert!(some(
        |point| point.weights.contains(&ONE) && point.fade == ONE
    ));
    assert!(some(|point| point.weights.iter().all(|&weight| weight > 0)));
    let cells = points.chunk_by(|a, b| a.nodes == b.nodes).count();
    assert!(cells > 10, "{cells} changes of cell");
}
