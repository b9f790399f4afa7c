//! Bounded work on any bytes: declared counts are checked against the limits before the items are read.

use model_format::limits::{MAX_AXIS_LEN, MAX_LIBRARY_BYTES, MAX_NAME_BYTES, MAX_ORDER, MAX_TEXTURES};
use model_format::{Library, encode};

use crate::bytes::{RawLibrary, RawNode, RawTexture};
use crate::faults::refused;
use crate::walk::content;

fn tells(library: &RawLibrary, told: &str) {
    let message = refused(&library.bytes());
    assert!(message.contains(told), "{message}");
}

/// The first value is faulty too, but the length is reported first.
#[test]
fn the_length_of_an_axis_is_judged_before_its_values() {
    for length in [MAX_AXIS_LEN + 1, 50_000] {
        let mut library = RawLibrary::sound();
        library.textures[0].force_axis = vec![f32::NAN; length];
        tells(&library, "the number of values");
    }
}

#[test]
fn the_number_of_nodes_is_judged_before_the_nodes() {
    let mut library = RawLibrary::sound();
    let texture = &mut library.textures[0];
    texture.nodes[0].order = u16::MAX;
    texture.nodes = texture.nodes.repeat(1000);
    tells(&library, "nodes: 6000 where 6 is due");
}

#[test]
fn the_size_of_the_whole_is_judged_before_its_checksum() {
    let mut library = RawLibrary::sound();
    library.crc32 = Some(0);
    library.tail = vec![0; MAX_LIBRARY_BYTES];
    tells(&library, "its length in bytes");
}

/// Every limit is reached at once, as far as a slot's size allows. The whole library is read and written again.
#[test]
fn a_library_at_its_limits_is_valid() {
    let mut library = RawLibrary::sound();
    let axis = || (1..=MAX_AXIS_LEN).map(|step| step as f32).collect::<Vec<_>>();
    let mut large = library.textures[0].clone();
    large.name = vec![b'n'; MAX_NAME_BYTES];
    large.sample_rate_hz = 48_000;
    (large.speed_axis, large.force_axis) = (axis(), axis());
    large.coefficients = vec![0xff; 2 * MAX_ORDER * 500];
    large.nodes = (0..MAX_AXIS_LEN * MAX_AXIS_LEN)
        .map(|index| RawNode {
            order: if index < 500 { MAX_ORDER as u16 } else { 0 },
            offset: (index.min(500) * 2 * MAX_ORDER) as u32,
            output_power: 65_536.0,
            prediction_error_power: 65_536.0,
            ..large.nodes[2]
        })
        .collect();
    let small = |index: usize| RawTexture {
        name: index.to_string().into_bytes(),
        speed_axis: vec![1.0],
        force_axis: vec![1.0],
        nodes: vec![library.textures[0].nodes[2]],
        coefficients: library.textures[0].coefficients[..4].to_vec(),
        ..library.textures[0].clone()
    };
    let textures = (1..MAX_TEXTURES).map(small).collect::<Vec<_>>();
    library.textures = textures;
    library.textures.push(large);
    // More nodes with coefficients fill the library up to the full size.
    let missing = MAX_LIBRARY_BYTES - library.bytes().len();
    let last = library.textures.last_mut().expect("one was pushed");
    let more = missing / (2 * MAX_ORDER);
    for (number, node) in last.nodes[500..].iter_mut().enumerate() {
        node.order = if number < more { MAX_ORDER as u16 } else { 0 };
        node.offset = ((500 + number.min(more)) * 2 * MAX_ORDER) as u32;
    }
    last.coefficients = vec![0xff; 2 * MAX_ORDER * (500 + more)];
    let bytes = library.bytes();
    assert!(bytes.len() > MAX_LIBRARY_BYTES - 2 * MAX_ORDER && bytes.len() <= MAX_LIBRARY_BYTES);
    let read = content(&Library::decode(&bytes).expect("nothing is beyond its limit"));
    assert_eq!(read.len(), MAX_TEXTURES);
    assert_eq!(encode(&read).expect("it was read from a library"), bytes);
}
