//! Faults of tails, for each fault there is, as `faults.rs` does it for all others.

use model_format::{CodeSpec, DecodeError, Library, Place, Problem, TailSpec, TextureSpec, encode};

use crate::bytes::{RawLibrary, RawTexture};
use crate::faults::{check, part_fault, refused, spec};

/// The error of decoding a library of which a lattice with tails has this fault.
fn tail_fault(spoil: impl FnOnce(&mut RawTexture)) -> DecodeError {
    let mut library = RawLibrary::sound();
    library.textures = vec![RawTexture::with_tails()];
    assert!(Library::decode(&library.bytes()).is_ok());
    spoil(&mut library.textures[0]);
    refused(&library.bytes())
}

/// Places in [`RawTexture::with_tails`].
const TAILS: Place = Place::Texture(0);

const fn tail_node(speed: usize, force: usize) -> Place {
    Place::Node {
        texture: 0,
        speed,
        force,
    }
}

#[test]
fn every_node_has_one_step_of_a_tail() {
    for found in [0, 1, 10, 11, 13, 14] {
        let error = tail_fault(|texture| texture.parts[1].1.resize(found, 0));
        let problem = Problem::TailSteps { found, nodes: 6 };
        check(error, TAILS, problem, "must have two");
    }
}

#[test]
fn steps_of_tails_without_a_node_of_so_many_stages_are_refused() {
    check(
        part_fault(&[(6, &[0; 12])]),
        TAILS,
        Problem::NoTail,
        "leave the part out",
    );
    // Nor may they hide behind the laws of other parts.
    let parts: [(u32, &[u8]); 2] = [(1, &[1, 1]), (6, &[0; 12])];
    check(part_fault(&parts), TAILS, Problem::NoTail, "more than 32");
}

#[test]
fn a_code_of_a_tail_is_not_below_the_lowest() {
    for (at, stage) in [(0, 33), (3, 36), (4, 37)] {
        let error = tail_fault(|texture| {
            let tail = texture.nodes[4].offset as usize + 64;
            texture.coefficients[tail + at] = 0x80;
        });
        let problem = Problem::TailCode { stage };
        check(error, tail_node(2, 0), problem, "codes are -127 to 127");
    }
}

/// A step of two or more would do with half of itself if all codes were below half their range.
#[test]
fn the_step_of_a_tail_is_the_one_that_its_codes_need() {
    let cases = [
        // The node without a stage beyond the 32nd, and the silent one.
        (0, 1, 0),
        (2, 1, 0),
        // The one whose tail is 0.
        (5, 1, 0),
        (5, 9, 0),
        // Those that are not 0.
        (3, 0, 127),
        (4, 0, 64),
    ];
    for (number, step, largest) in cases {
        let error = tail_fault(|texture| {
            texture.parts[1].1[2 * number..2 * number + 2].copy_from_slice(&u16::to_le_bytes(step));
        });
        let place = tail_node(number / 2, number % 2);
        let problem = Problem::TailStep { step, largest };
        check(error, place, problem, "exactly where all codes are");
    }
    let halved = |step: u16| {
        move |texture: &mut RawTexture| {
            let tail = texture.nodes[4].offset as usize + 64;
            texture.coefficients[tail..tail + 5].copy_from_slice(&[63, 0xff, 0, 32, 0xc1]);
            texture.parts[1].1[8..10].copy_from_slice(&step.to_le_bytes());
        }
    };
    let (step, largest) = (2, 63);
    let problem = Problem::TailStep { step, largest };
    check(
        tail_fault(halved(step)),
        tail_node(2, 0),
        problem,
        "largest code is 63",
    );
    let mut library = RawLibrary::sound();
    library.textures = vec![RawTexture::with_tails()];
    halved(1)(&mut library.textures[0]);
    assert!(Library::decode(&library.bytes()).is_ok());
}

/// A reader that took the bytes of a tail for codes of 16 bits, or the other way round, would find too few or too many.
#[test]
fn coefficients_with_tails_are_as_many_bytes_as_the_nodes_use() {
    let used = 4 * 64 + 1 + 5 + 2;
    for found in [used - 1, used + 1] {
        let error = tail_fault(|texture| texture.coefficients.resize(found, 0));
        let place = if found < used { tail_node(2, 1) } else { TAILS };
        let expected = used;
        let problem = Problem::CoefficientLength { found, expected };
        check(error, place, problem, "where the nodes use");
    }
    // Without its part, the first node of 33 stages takes a byte of the next one.
    let error = tail_fault(|texture| texture.parts.truncate(1));
    let (found, expected) = (129, 130);
    let problem = Problem::Offset { found, expected };
    check(error, tail_node(2, 0), problem, "is due");
}

fn with_tail(before: usize, tail: &[i8], step: u16) -> CodeSpec {
    CodeSpec {
        codes: vec![-1000; before],
        fractions: Vec::new(),
        tail: TailSpec {
            codes: tail.to_vec(),
            step,
        },
    }
}

#[test]
fn the_encoder_refuses_tails_that_the_decoder_would() {
    type Case = (fn(&mut TextureSpec), Problem);
    let place = tail_node(0, 1);
    let cases: [Case; 5] = [
        (
            |spec| spec.nodes[1].codes = with_tail(32, &[100, i8::MIN], 9),
            Problem::TailCode { stage: 34 },
        ),
        (
            |spec| spec.nodes[1].codes = with_tail(32, &[-63], 2),
            Problem::TailStep {
                step: 2,
                largest: 63,
            },
        ),
        (
            |spec| spec.nodes[1].codes = with_tail(31, &[100], 9),
            Problem::TailBegin {
                before: 31,
                after: 1,
            },
        ),
        (
            |spec| {
                spec.nodes[0].codes = with_tail(32, &[100], 9);
                spec.nodes[1].codes = with_tail(33, &[], 0);
            },
            Problem::TailBegin {
                before: 33,
                after: 0,
            },
        ),
        // A step without a tail, where no other node has one.
        (
            |spec| spec.nodes[1].codes = with_tail(32, &[], 1),
            Problem::TailStep {
                step: 1,
                largest: 0,
            },
        ),
    ];
    for (spoil, problem) in cases {
        let mut spec = spec();
        spoil(&mut spec);
        assert_eq!(encode(&[spec]), Err(DecodeError { place, problem }));
    }
}
