//! Properties that the test textures need for the comparison of bits to be meaningful.

use kernel_vectors::{
    COST_BUDGETS, DIGESTED, PATH_UPDATES, VECTORS, Vector, digest_library, edges, library, motion, run,
};
use model_format::limits::MAX_ORDER;
use model_format::{Library, OutputSample, Texture};
use stylus_kernel::arithmetic::Portable;
use stylus_kernel::digest::{DIGEST_WORDS, Digest, Stroke, of_plan};
use stylus_kernel::grid::{GridPoint, ONE};
use stylus_kernel::scene::{ContactDetector, Plan};

fn play(library: &[u8], vector: &Vector) -> (Vec<i32>, u32) {
    let mut samples = Vec::new();
    let sink = |OutputSample(sample)| samples.push(sample);
    let saturations = run::<Portable>(library, vector, sink);
    (samples, saturations.expect("the library holds every vector"))
}

#[test]
fn the_library_holds_every_vector_and_nothing_else() {
    let bytes = library();
    let library = Library::decode(&bytes).expect("the library is valid");
    let names: Vec<_> = library.textures().map(|texture| texture.name()).collect();
    let alone = VECTORS.iter().filter(|vector| vector.beside.is_none());
    assert_eq!(names, alone.map(|vector| vector.texture).collect::<Vec<_>>());
}

#[test]
fn every_measured_texture_is_of_the_highest_order() {
    let bytes = library();
    let library = Library::decode(&bytes).expect("the library is valid");
    for measured in COST_BUDGETS {
        let texture = library.texture(measured.texture).expect("it is there");
        assert_eq!(texture.max_order(), MAX_ORDER, "{}", measured.texture);
    }
}

/// Digests of the words of vectors. A library's textures must play the same words in every release.
const GOLDEN: [(u32, &str); 12] = [
    (0xb208_a717, "lattice, one node"),
    (0xd14c_91f3, "lattice"),
    (0x24c7_1535, "lattice of unequal orders"),
    (0xd864_b9b9, "lattice of largest angles"),
    (0x00eb_400a, "fine lattice, mean dB"),
    (0x3ebf_b8e0, "fine lattice of largest angles, mean amplitude"),
    (0xbad4_2b54, "two voices with snippets"),
    (0xddff_948a, "lattice, four lines"),
    (0x6383_47c3, "lattice, snippets and four lines"),
    (0x9e86_e3b1, "compact lattice, mean dB"),
    (0xe083_a5d7, "lattice, four lines that wander"),
    (0x24d5_8a8c, "lattice, snippets"),
];

#[test]
fn the_words_of_lattices_are_those_of_every_release() {
    let library = library();
    for (golden, name) in GOLDEN {
        let vector = VECTORS.iter().find(|vector| vector.texture == name);
        let (samples, saturations) = play(&library, vector.expect("it is there"));
        let mut digest = Digest::default();
        samples.into_iter().map(OutputSample).for_each(|word| digest.add(word));
        assert_eq!(digest.value(), golden, "{name}: {:08x}", digest.value());
        assert_eq!(saturations, 0, "{name}");
    }
}

/// Most samples must differ from zero and from their neighbour, because constant output would agree in any case.
#[test]
fn every_texture_is_heard() {
    let library = library();
    for vector in &VECTORS {
        let (samples, _) = play(&library, vector);
        assert!(
            samples.windows(2).filter(|pair| pair[0] != pair[1]).count() > samples.len() / 2,
            "{}",
            vector.texture
        );
    }
}

/// At full scale a lattice exceeds its output range. Noise alone would reach that only after years.
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
    assert!(some(|point| point.weights.contains(&ONE) && point.fade == ONE));
    assert!(some(|point| point.weights.iter().all(|&weight| weight > 0)));
    let cells = points.chunk_by(|a, b| a.nodes == b.nodes).count();
    assert!(cells > 10, "{cells} changes of cell");
}

fn digest_of(texture: Texture<'_>) -> u32 {
    of_plan::<Portable>(Plan::of_texture(texture)).value()
}

#[test]
fn the_host_plays_the_digest_that_every_platform_must_play() {
    let bytes = digest_library();
    let texture = Library::decode(&bytes).unwrap().texture_at(0).unwrap();
    let digest = digest_of(texture);
    assert_eq!(digest, DIGESTED, "{digest:08x}");
}

#[test]
fn a_part_that_is_left_out_changes_the_digest() {
    let bytes = digest_library();
    let texture = Library::decode(&bytes).unwrap().texture_at(0).unwrap();
    for other in [texture.without_codebooks(), texture.without_lines()] {
        assert_ne!(digest_of(other), DIGESTED);
    }
}

/// The stroke rests, reverses, lifts off, and reaches the inside of cells, the grid's edges and places beyond them.
#[test]
fn the_stroke_reaches_all_of_a_grid() {
    let bytes = digest_library();
    let texture = Library::decode(&bytes).unwrap().texture_at(0).unwrap();
    let mut detector = ContactDetector::new();
    let (mut seen, mut rests, mut lifts, mut backward, mut inner) = (0u32, 0, 0, 0, 0);
    for block in 0..DIGEST_WORDS / 10 {
        let stroke = Stroke::at(block, 5000);
        let interaction = stroke.interaction(&mut detector);
        let point = GridPoint::locate(&texture, interaction.motion);
        for ((speed, force), weight) in point.nodes.into_iter().zip(point.weights) {
            if weight > 0 {
                seen |= 1 << (speed * texture.force_axis().len() + force);
            }
        }
        rests += u32::from(stroke.speed_mm_s == 0.0 && interaction.contact);
        lifts += u32::from(!interaction.contact);
        backward += u32::from(stroke.speed_mm_s < 0.0);
        inner += u32::from(point.weights.iter().all(|&weight| weight > 0) && point.fade == ONE);
    }
    assert_eq!(seen, 0b11_1111, "nodes with a weight: {seen:b}");
    for count in [rests, lifts, backward, inner] {
        assert!(count > 10, "{rests} {lifts} {backward} {inner}");
    }
}

/// The position is the integral of the speed, which is constant within a block.
#[test]
fn a_block_begins_where_the_speed_of_the_one_before_ends() {
    // At a rate that no stylus plays, too, a block is ten samples.
    for (rate, samples) in [(5000, 10.0), (10_000, 20.0), (1000, 10.0), (44_100, 10.0)] {
        for block in 0..1600 {
            let (now, next) = (Stroke::at(block, rate), Stroke::at(block + 1, rate));
            let after = |samples: f64| now.begin_mm + f64::from(now.speed_mm_s) * samples / f64::from(rate);
            assert!((next.begin_mm - after(samples)).abs() < 1e-9, "{rate} Hz, {block}");
            assert!((now.end_mm - after(samples - 1.0)).abs() < 1e-9, "{rate} Hz, {block}");
        }
    }
}
