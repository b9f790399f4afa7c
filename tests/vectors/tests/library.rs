//! Properties of the test textures without which the comparison of bits would show little.

use kernel_vectors::{MEASURED, PATH_UPDATES, VECTORS, Vector, edges, library, motion, run};
use model_format::limits::MAX_ORDER;
use model_format::{Library, MillimetresPerSecond, Newton, OutputSample};
use stylus_kernel::arithmetic::Portable;
use stylus_kernel::grid::{GridPoint, ONE};
use stylus_kernel::{Motion, Synthesis, UPDATE_INTERVAL_SAMPLES};

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
    let library = Library::decode_uncertified(&bytes).expect("the library is valid");
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
    let library = Library::decode_uncertified(&bytes).expect("the library is valid");
    for measured in MEASURED {
        let texture = library.texture(measured.texture).expect("it is there");
        assert_eq!(texture.max_order(), MAX_ORDER, "{}", measured.texture);
    }
}

#[test]
fn exactly_the_textures_made_unstable_reach_full_scale() {
    let library = library();
    for vector in &VECTORS {
        let (_, saturations) = play(&library, vector);
        let meant = vector.texture.contains("unstable");
        assert_eq!(saturations > 0, meant, "{}: {saturations}", vector.texture);
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

/// Both structures get the same excitation, so that they differ by round-off only, once the beginning has died away,
/// where one ramps the excitation and the other the output.
#[test]
fn a_direct_form_plays_what_the_lattice_of_its_reflection_coefficients_plays() {
    const SETTLING_SAMPLES: usize = 4000;
    let bytes = library();
    let library = Library::decode_uncertified(&bytes).expect("the library is valid");
    let play = |name| {
        let texture = library.texture(name).expect("it is there");
        let mut synthesis = Synthesis::<Portable>::from_rest(texture, 1);
        let motion = Motion::new(MillimetresPerSecond(60.0), Newton(1.0)).expect("it is finite");
        synthesis.follow(motion, UPDATE_INTERVAL_SAMPLES);
        let samples = (0..2 * SETTLING_SAMPLES).map(move |_| f64::from(synthesis.next_sample().0));
        samples.skip(SETTLING_SAMPLES).collect::<Vec<_>>()
    };
    let (lattice, direct) = (play("lattice, one node"), play("direct 32, one node"));
    let power = |samples: &mut dyn Iterator<Item = f64>| samples.map(|x| x * x).sum::<f64>();
    let difference = power(&mut lattice.iter().zip(&direct).map(|(a, b)| a - b));
    let ratio = difference / power(&mut lattice.iter().copied());
    assert!(ratio < 1e-8, "difference {ratio} of the power");
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
    let library = Library::decode_uncertified(&bytes).expect("the library is valid");
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
