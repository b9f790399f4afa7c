//! Bytes that were damaged, cut, or never a library. Decoding them gives a typed error or a valid library, by a bounded
//! work: declared counts are checked against the limits before the items are read.

use model_format::limits::{MAX_AXIS_LEN, MAX_LIBRARY_BYTES, MAX_NAME_BYTES, MAX_ORDER, MAX_TEXTURES};
use model_format::{DecodeError, Library, Problem, encode, encode_with_scenes};
use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::Index;

use crate::bytes::{PREFIX_BYTES, RawLibrary, RawNode, RawTexture, repair};
use crate::faults::refused;
use crate::walk::{content, scenes};

#[test]
fn every_single_flipped_bit_is_an_error() {
    let mut bytes = RawLibrary::full().bytes();
    for at in 0..bytes.len() {
        for bit in 0..8 {
            bytes[at] ^= 1 << bit;
            assert!(Library::decode(&bytes).is_err(), "byte {at}, bit {bit}");
            bytes[at] ^= 1 << bit;
        }
    }
    assert!(Library::decode(&bytes).is_ok());
}

/// The length and the checksum in the prefix are right again, so that only the structure of the bytes shows the
/// truncation.
#[test]
fn every_truncation_with_repaired_prefix_is_an_error() {
    let bytes = RawLibrary::full().bytes();
    for length in PREFIX_BYTES..bytes.len() {
        let mut cut = bytes[..length].to_vec();
        repair(&mut cut);
        let error = Library::decode(&cut).expect_err("a truncated library");
        assert!(
            matches!(error.problem, Problem::Malformed(_)),
            "{length} bytes: {error}"
        );
    }
}

/// Checks that `bytes` are refused with an error, or are a valid library.
fn sound_or_refused(bytes: &[u8]) -> Result<(), TestCaseError> {
    match Library::decode(bytes) {
        Ok(library) => {
            let (read, played) = (content(&library), scenes(&library));
            let again = encode_with_scenes(&read, &played).map_err(|error| TestCaseError::fail(error.to_string()))?;
            // A library has only one encoding, so that its content must encode to the same bytes.
            prop_assert_eq!(again.as_slice(), bytes);
        }
        Err(error @ DecodeError { place, problem }) => {
            prop_assert_eq!(error.to_string(), format!("{place}: {problem}"));
        }
    }
    Ok(())
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(4096))]

    #[test]
    fn mutations_behind_a_repaired_checksum_give_a_sound_library_or_an_error(
        changes in vec((any::<Index>(), mutation()), 1..6),
    ) {
        let mut bytes = RawLibrary::full().bytes();
        for (at, mutation) in changes {
            mutation.apply(at, &mut bytes);
        }
        repair(&mut bytes);
        sound_or_refused(&bytes)?;
    }
}

#[derive(Clone, Debug)]
enum Mutation {
    Set(u8),
    Flip(u8),
    Insert(u8),
    Remove,
    /// Makes a varint a byte longer, if one ends here.
    Pad,
    /// Appends a copy of up to so many bytes from here.
    Repeat(usize),
}

impl Mutation {
    fn apply(self, at: Index, bytes: &mut Vec<u8>) {
        // Magic and version stay as they are, so that decoding reaches the body.
        let at = 6 + at.index(bytes.len() - 6);
        match self {
            Self::Set(byte) => bytes[at] = byte,
            Self::Flip(bit) => bytes[at] ^= 1 << bit,
            Self::Insert(byte) => bytes.insert(at, byte),
            Self::Remove if bytes.len() > 32 => drop(bytes.remove(at)),
            Self::Remove => {}
            Self::Pad => {
                bytes[at] |= 0x80;
                bytes.insert(at + 1, 0);
            }
            Self::Repeat(count) => {
                let end = (at + count).min(bytes.len());
                bytes.extend_from_within(at..end);
            }
        }
    }
}

fn mutation() -> impl Strategy<Value = Mutation> {
    prop_oneof![
        3 => any::<u8>().prop_map(Mutation::Set),
        6 => (0u8..8).prop_map(Mutation::Flip),
        1 => any::<u8>().prop_map(Mutation::Insert),
        1 => Just(Mutation::Remove),
        2 => Just(Mutation::Pad),
        1 => (1usize..64).prop_map(Mutation::Repeat),
    ]
}

/// Every byte that can be the last of a varint is replaced by two bytes, so that the varint is longer and has the same
/// value. Where the byte is not part of a varint, the library is damaged in another way.
#[test]
fn a_number_in_more_bytes_than_it_needs_is_refused_wherever_it_stands() {
    let sound = RawLibrary::full().bytes();
    let mut padded = 0;
    for at in PREFIX_BYTES..sound.len() {
        for zeros in 1..4 {
            let mut bytes = sound.clone();
            bytes[at] |= 0x80;
            bytes.insert(at + 1, 0);
            for _ in 1..zeros {
                bytes.insert(at + 1, 0x80);
            }
            repair(&mut bytes);
            let error = Library::decode(&bytes).expect_err("no longer one library's bytes");
            padded += usize::from(matches!(error.problem, Problem::Malformed(_)));
        }
    }
    // The library contains at least this number of counts, lengths and kinds.
    assert!(padded > 100, "{padded}");
}

/// The mutations above would prove nothing if all of them were refused.
#[test]
fn some_mutations_are_other_valid_libraries() {
    let sound = RawLibrary::full().bytes();
    let mut kept = 0;
    for at in PREFIX_BYTES..sound.len() {
        for bit in 0..8 {
            let mut bytes = sound.clone();
            bytes[at] ^= 1 << bit;
            repair(&mut bytes);
            if let Ok(library) = Library::decode(&bytes) {
                assert_ne!(
                    encode_with_scenes(&content(&library), &scenes(&library)).as_ref(),
                    Ok(&sound),
                    "byte {at}, bit {bit}"
                );
                kept += 1;
            }
        }
    }
    assert!(kept > 500, "{kept}");
}

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
