//! Bytes that were damaged, cut, or never a library. Decoding them gives a typed error or a valid library.

use model_format::{DecodeError, Library, Problem, encode_with_scenes};
use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::Index;

use crate::bytes::{PREFIX_BYTES, RawLibrary, repair};
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
