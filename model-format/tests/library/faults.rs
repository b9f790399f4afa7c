//! Bytes with exactly one fault, for each fault there is: its kind, its place, and the text that a person reads.

use model_format::limits::{MAX_LIBRARY_BYTES, MAX_LINE_AMPLITUDE, MAX_LINES, MAX_OUTPUT_POWER};
use model_format::{
    CodeSpec, DecodeError, FORMAT_VERSION, LevelLaw, Library, LineSpec, LinesSpec, NodeFlags,
    NodeSpec, Place, Problem, TailSpec, TextureSpec, encode,
};

use crate::bytes::{RawLibrary, RawTexture, checksum, lines, repair};

/// Places in [`RawLibrary::sound`]: texture 1 and its first node that is not silent.
const TEXTURE: Place = Place::Texture(1);
const NODE: Place = node(1, 0);

const fn node(speed: usize, force: usize) -> Place {
    Place::Node {
        texture: 1,
        speed,
        force,
    }
}

pub fn refused(bytes: &[u8]) -> DecodeError {
    Library::decode(bytes).expect_err("a library with a fault")
}

/// The error of decoding the sound library after `spoil` has put a fault into it.
pub fn fault(spoil: impl FnOnce(&mut RawLibrary)) -> DecodeError {
    let mut library = RawLibrary::sound();
    assert!(Library::decode(&library.bytes()).is_ok());
    spoil(&mut library);
    refused(&library.bytes())
}

/// The same, with the fault in texture 1.
fn texture_fault(spoil: impl FnOnce(&mut RawTexture)) -> DecodeError {
    fault(|library| spoil(&mut library.textures[1]))
}

/// Checks fault and place, and that the message names the place and contains `told`.
pub fn check(error: DecodeError, place: Place, problem: Problem, told: &str) {
    assert_eq!((error.place, error.problem), (place, problem));
    check_message(error, place, told);
}

fn check_message(error: DecodeError, place: Place, told: &str) {
    let message = error.to_string();
    assert!(message.starts_with(&place.to_string()), "{message}");
    assert!(message.contains(told), "{message}");
}

#[test]
fn places_read_as_a_person_would_point() {
    for (place, text) in [
        (Place::Library, "library"),
        (Place::Texture(3), "texture 3"),
        (Place::SpeedAxis(3), "texture 3, speed axis"),
        (Place::ForceAxis(3), "texture 3, force axis"),
        (node(4, 5), "texture 1, node (speed 4, force 5)"),
    ] {
        assert_eq!(place.to_string(), text);
    }
}

#[test]
fn other_first_bytes_are_not_a_library() {
    let error = fault(|library| library.magic = *b"RIFF");
    check(
        error,
        Place::Library,
        Problem::NotALibrary,
        "not a texture library",
    );
    assert_eq!(refused(b"").problem, Problem::NotALibrary);
}

#[test]
fn a_newer_version_asks_for_a_newer_program_and_an_older_one_for_a_new_fit() {
    for (found, remedy) in [
        (FORMAT_VERSION + 1, "update the program"),
        (u16::MAX, "update the program"),
        (FORMAT_VERSION - 1, "fit it again"),
    ] {
        let error = fault(|library| library.version = found);
        check(error, Place::Library, Problem::Version { found }, remedy);
    }
}

/// The version is reported even if nothing else of a foreign library is understood.
#[test]
fn the_version_is_judged_before_all_else() {
    let error = fault(|library| {
        library.version = FORMAT_VERSION + 1;
        library.reserved = 7;
        library.total_bytes = Some(0);
        library.crc32 = Some(0);
        library.tail = vec![0; 600_000];
    });
    assert!(matches!(error.problem, Problem::Version { .. }));
}

#[test]
fn fewer_or_more_bytes_than_declared_are_told_with_both_lengths() {
    let actual = RawLibrary::sound().bytes().len();
    for declared in [0, actual as u32 - 1, actual as u32 + 1, u32::MAX] {
        let error = fault(|library| library.total_bytes = Some(declared));
        let problem = Problem::Length {
            declared,
            found: actual,
        };
        check(
            error,
            Place::Library,
            problem,
            "truncated, or followed by something else",
        );
    }
}

#[test]
fn less_than_a_prefix_and_a_count_is_too_short() {
    let mut bytes = RawLibrary::sound().bytes();
    bytes.truncate(16);
    repair(&mut bytes);
    check(
        refused(&bytes),
        Place::Library,
        Problem::TooShort { found: 16 },
        "16 bytes are too few",
    );
    check(
        refused(&bytes[..15]),
        Place::Library,
        Problem::TooShort { found: 15 },
        "15 bytes are too few",
    );
}

#[test]
fn more_than_a_slot_holds_is_too_large() {
    let mut library = RawLibrary::sound();
    library.tail = vec![0; MAX_LIBRARY_BYTES - library.bytes().len()];
    assert!(matches!(
        refused(&library.bytes()).problem,
        Problem::LeftOver(_)
    ));
    library.tail.push(0);
    let found = MAX_LIBRARY_BYTES + 1;
    check(
        refused(&library.bytes()),
        Place::Library,
        Problem::TooLarge { found },
        "than the 524032 that a slot holds",
    );
}

#[test]
fn damage_is_told_with_both_checksums() {
    let mut bytes = RawLibrary::sound().bytes();
    let stored = checksum(&bytes);
    *bytes.last_mut().expect("a library") ^= 1;
    let computed = checksum(&bytes);
    let problem = Problem::Checksum { stored, computed };
    check(
        refused(&bytes),
        Place::Library,
        problem,
        "the bytes were damaged",
    );
    check_message(
        refused(&bytes),
        Place::Library,
        &format!("{computed:08x} where {stored:08x}"),
    );
}

#[test]
fn reserved_fields_must_be_zero() {
    let error = fault(|library| library.reserved = 1);
    check(error, Place::Library, Problem::Reserved, "reserved");
}

#[test]
fn headers_that_do_not_parse_are_told_with_their_texture() {
    let spoilt: [fn(&mut RawTexture); 2] = [
        |texture| texture.provenance = 2,
        |texture| texture.name = vec![0xff],
    ];
    for spoil in spoilt {
        check(
            texture_fault(spoil),
            TEXTURE,
            Problem::Malformed,
            "does not parse",
        );
    }
    let error = fault(|library| library.count = Some(4));
    check(
        error,
        Place::Texture(3),
        Problem::Malformed,
        "does not parse",
    );
}

#[test]
fn nothing_may_follow_the_last_record() {
    let error = fault(|library| library.tail = vec![1, 2, 3]);
    check(
        error,
        Place::Library,
        Problem::LeftOver(3),
        "3 bytes are left over",
    );
    // A texture beyond the declared number is read as scenes: the first byte of its length is their number.
    let error = fault(|library| library.count = Some(2));
    assert_eq!(error.place, Place::Library);
    assert!(
        matches!(error.problem, Problem::SceneCount(32..256)),
        "{error}"
    );
    // A texture's string holds the texture and nothing else.
    let error = texture_fault(|texture| texture.tail = vec![0; 5]);
    let problem = Problem::LeftOverOfTexture(5);
    check(
        error,
        TEXTURE,
        problem,
        "5 bytes are left over after its optional parts",
    );
}

/// A player takes these facts from the summary and reads no node for them.
#[test]
fn a_summary_is_that_of_its_nodes() {
    let (order, power) = RawLibrary::sound().textures[1].sound_summary();
    assert_eq!((order, power), (2, 4.0));
    for stored in [0u16, 1, 3, 400, u16::MAX] {
        let error = texture_fault(|texture| texture.summary = Some((stored.into(), power)));
        let problem = Problem::HighestOrder { stored, found: 2 };
        check(error, TEXTURE, problem, "the nodes' is 2");
    }
    for stored in [0.0, -0.0, 4.0f32.next_up(), 4.0f32.next_down(), 65_536.0] {
        let error = texture_fault(|texture| texture.summary = Some((order, stored)));
        let problem = Problem::HighestPower { stored, found: 4.0 };
        check(error, TEXTURE, problem, "the nodes' is 4");
    }
    let error = texture_fault(|texture| texture.summary = Some((1 << 16, power)));
    check(error, TEXTURE, Problem::Malformed, "does not parse");
}

/// A varint that is longer than it needs to be would be a second form of the same library.
#[test]
fn a_padded_varint_is_refused() {
    let bytes = RawLibrary::full().bytes();
    assert!(Library::decode(&bytes).is_ok());
    // The number of textures, the length of the first, and of its name.
    for (at, place) in [(16, None), (17, Some(0)), (19, Some(0))] {
        let mut padded = bytes.clone();
        let last = (at..at + 3).find(|&at| padded[at] < 0x80).expect("it ends");
        padded[last] |= 0x80;
        padded.insert(last + 1, 0);
        if at == 19 {
            // The texture is a byte longer.
            padded[17] += 1;
        }
        repair(&mut padded);
        let error = refused(&padded);
        assert_eq!(
            error.place,
            place.map_or(Place::Library, Place::Texture),
            "{error}"
        );
    }
}

#[test]
fn the_number_of_textures_has_bounds() {
    for count in [0, 257, u32::MAX] {
        let error = fault(|library| library.count = Some(count));
        check(
            error,
            Place::Library,
            Problem::TextureCount(count as usize),
            "there must be 1 to 256",
        );
    }
}

#[test]
fn names_are_neither_empty_nor_long() {
    for length in [0, 49, 300] {
        let error = texture_fault(|texture| texture.name = vec![b'x'; length]);
        check(
            error,
            TEXTURE,
            Problem::NameLength(length),
            "there must be 1 to 48",
        );
    }
    let mut library = RawLibrary::sound();
    library.textures[1].name = vec![b'x'; 48];
    assert!(Library::decode(&library.bytes()).is_ok());
}

#[test]
fn names_have_no_control_characters() {
    for name in ["a\nb", "\0", "tab\t", "\u{7f}", "\u{85}"] {
        let error = texture_fault(|texture| texture.name = name.as_bytes().to_vec());
        check(error, TEXTURE, Problem::NameCharacter, "control character");
    }
}

#[test]
fn names_are_unique() {
    let error = fault(|library| library.textures[2].name = b"oak".to_vec());
    check(
        error,
        Place::Texture(2),
        Problem::NameTaken(1),
        "the same name as texture 1",
    );
}

#[test]
fn sample_rates_have_bounds() {
    for rate in [0, 48_001, u32::MAX] {
        let error = texture_fault(|texture| texture.sample_rate_hz = rate);
        check(
            error,
            TEXTURE,
            Problem::SampleRate(rate),
            "there must be 1 to 48000",
        );
    }
}

/// Checks the error of `values` on each of the two axes.
fn axis_faults(values: &[f32], problem: impl Fn(&DecodeError) -> bool, told: &str) {
    let error = texture_fault(|texture| texture.speed_axis = values.to_vec());
    assert!(problem(&error), "{error}");
    check_message(error, Place::SpeedAxis(1), told);
    let error = texture_fault(|texture| texture.force_axis = values.to_vec());
    assert!(problem(&error), "{error}");
    check_message(error, Place::ForceAxis(1), told);
}

#[test]
fn axes_are_neither_empty_nor_long() {
    axis_faults(
        &[],
        |error| error.problem == Problem::AxisLength(0),
        "there must be 1 to 64",
    );
    let long: Vec<f32> = (0..65u8).map(f32::from).collect();
    axis_faults(
        &long,
        |error| error.problem == Problem::AxisLength(65),
        "there must be 1 to 64",
    );
}

#[test]
fn values_on_axes_are_finite_and_not_negative() {
    for bad in [
        -1.0,
        -0.0,
        -f32::MIN_POSITIVE,
        f32::INFINITY,
        f32::NEG_INFINITY,
        f32::NAN,
    ] {
        let same = |error: &DecodeError| {
            let Problem::AxisValue { index: 1, value } = error.problem else {
                return false;
            };
            value.to_bits() == bad.to_bits()
        };
        axis_faults(&[0.5, bad, 2.0], same, "value 1 is");
        axis_faults(&[0.5, bad, 2.0], same, "finite and not negative");
    }
}

#[test]
fn values_on_axes_ascend() {
    for second in [0.5, 0.25] {
        let same = |error: &DecodeError| error.problem == Problem::AxisOrder { index: 1 };
        axis_faults(
            &[0.5, second, 2.0],
            same,
            "value 1 is not greater than the one before",
        );
    }
}

#[test]
fn byte_strings_hold_whole_records() {
    type Case = (Place, usize, usize, fn(&mut RawTexture));
    let cases: [Case; 4] = [
        (Place::SpeedAxis(1), 13, 4, |texture| {
            texture.ragged.speed_axis = 1;
        }),
        (Place::ForceAxis(1), 11, 4, |texture| {
            texture.ragged.force_axis = 3;
        }),
        (TEXTURE, 111, 16, |texture| texture.ragged.nodes = 15),
        (TEXTURE, 17, 2, |texture| texture.ragged.coefficients = 1),
    ];
    for (place, found, record, spoil) in cases {
        check(
            texture_fault(spoil),
            place,
            Problem::Ragged { found, record },
            "no whole number of records",
        );
    }
}

#[test]
fn there_are_as_many_nodes_as_the_axes_span() {
    for found in [0, 5, 7] {
        let error = texture_fault(|texture| texture.nodes.resize(found, texture.nodes[5]));
        let problem = Problem::NodeCount { found, expected: 6 };
        check(
            error,
            TEXTURE,
            problem,
            &format!("{found} nodes where the axes span 6"),
        );
    }
}

#[test]
fn orders_above_the_limit_are_refused() {
    for order in [401, u16::MAX] {
        let error = texture_fault(|texture| texture.nodes[2].order = order);
        let problem = Problem::Order(usize::from(order));
        check(error, NODE, problem, "the highest is 400");
    }
}

#[test]
fn unknown_flags_are_refused() {
    for flags in [0x10, 0x80, 0xf0, 0x100, 0x8000] {
        let error = texture_fault(|texture| texture.nodes[2].flags = flags);
        check(
            error,
            NODE,
            Problem::Flags(flags),
            &format!("unknown flags {flags:#04x}"),
        );
    }
}

#[test]
fn powers_are_finite_not_negative_and_bounded() {
    let above = MAX_OUTPUT_POWER.next_up();
    for bad in [
        -1.0,
        -0.0,
        f32::INFINITY,
        f32::NEG_INFINITY,
        f32::NAN,
        f32::MAX,
        above,
    ] {
        for name in ["output", "prediction error"] {
            let error = texture_fault(|texture| match name {
                "output" => texture.nodes[2].output_power = bad,
                _ => texture.nodes[2].prediction_error_power = bad,
            });
            let Problem::Power { what, value } = error.problem else {
                panic!("{error}");
            };
            assert_eq!(
                (what, value.to_bits(), error.place),
                (name, bad.to_bits(), NODE)
            );
            check_message(error, NODE, &format!("{name} power is"));
            check_message(error, NODE, "at most 65536");
        }
    }
}

#[test]
fn a_prediction_error_is_not_stronger_than_the_output() {
    let error = texture_fault(|texture| texture.nodes[2].prediction_error_power = 4.0f32.next_up());
    check(error, NODE, Problem::PowerOrder, "above the output's");
}

#[test]
fn the_silent_flag_says_what_the_power_says() {
    let error = texture_fault(|texture| texture.nodes[2].flags = NodeFlags::SILENT.bits().into());
    check(error, NODE, Problem::SilentFlag, "silent flag");
    let error = texture_fault(|texture| {
        texture.nodes[2].output_power = 0.0;
        texture.nodes[2].prediction_error_power = 0.0;
    });
    check(error, NODE, Problem::SilentFlag, "silent flag");
    let error = texture_fault(|texture| texture.nodes[0].flags = NodeFlags::NONE.bits().into());
    check(error, node(0, 0), Problem::SilentFlag, "silent flag");
}

#[test]
fn nodes_at_rest_or_without_contact_are_silent() {
    let error = texture_fault(|texture| {
        texture.nodes[1].flags = NodeFlags::NONE.bits().into();
        texture.nodes[1].output_power = f32::from_bits(1);
    });
    check(
        error,
        node(0, 1),
        Problem::NotSilentAtZero,
        "must be silent",
    );
    let error = texture_fault(|texture| texture.force_axis[0] = 0.0);
    check(error, NODE, Problem::NotSilentAtZero, "must be silent");
}

#[test]
fn coefficients_neither_overlap_nor_leave_gaps() {
    for found in [0, 3, 5, 8, u32::MAX] {
        let error = texture_fault(|texture| texture.nodes[3].offset = found);
        let problem = Problem::Offset { found, expected: 4 };
        check(error, node(1, 1), problem, "where 4 is due");
    }
}

#[test]
fn coefficients_are_as_many_as_the_nodes_use() {
    let error = texture_fault(|texture| texture.coefficients.truncate(14));
    let problem = Problem::CoefficientLength {
        found: 14,
        expected: 16,
    };
    check(error, node(2, 1), problem, "14 bytes of coefficients");
    let error = texture_fault(|texture| texture.coefficients.extend([0; 2]));
    let problem = Problem::CoefficientLength {
        found: 18,
        expected: 16,
    };
    check(error, TEXTURE, problem, "where the nodes use 16");
}

#[test]
fn no_stage_has_a_reflection_coefficient_of_magnitude_one() {
    for (at, speed, force, stage) in [(0, 1, 0, 1), (2, 1, 0, 2), (6, 1, 1, 2)] {
        let error = fault(|library| {
            library.textures[0].coefficients[at..at + 2].copy_from_slice(&i16::MIN.to_le_bytes());
        });
        let place = Place::Node {
            texture: 0,
            speed,
            force,
        };
        let problem = Problem::ReflectionCoefficient { stage };
        check(error, place, problem, &format!("stage {stage}"));
    }
}

pub fn spec() -> TextureSpec {
    let node = NodeSpec {
        prediction_error_power: 0.5,
        ..NodeSpec::new(1.0, CodeSpec::lattice(vec![100]))
    };
    TextureSpec::new("felt", &[50.0], &[0.5, 1.0], vec![node; 2])
}

fn fine(codes: &[i16], fractions: &[i8]) -> CodeSpec {
    CodeSpec {
        codes: codes.to_vec(),
        fractions: fractions.to_vec(),
        tail: TailSpec::default(),
    }
}

/// The encoder does not write what the decoder refuses, and its error has the same text.
#[test]
fn the_encoder_refuses_what_the_decoder_would() {
    type Case = (fn(&mut TextureSpec), Place, Problem);
    let last = Place::Node {
        texture: 0,
        speed: 0,
        force: 1,
    };
    let cases: [Case; 13] = [
        (
            |spec| spec.name.clear(),
            Place::Texture(0),
            Problem::NameLength(0),
        ),
        (
            |spec| spec.sample_rate_hz = 0,
            Place::Texture(0),
            Problem::SampleRate(0),
        ),
        (
            |spec| spec.force_axis_n[1] = 0.5,
            Place::ForceAxis(0),
            Problem::AxisOrder { index: 1 },
        ),
        (
            |spec| spec.speed_axis_mm_s.clear(),
            Place::SpeedAxis(0),
            Problem::AxisLength(0),
        ),
        (
            |spec| drop(spec.nodes.pop()),
            Place::Texture(0),
            Problem::NodeCount {
                found: 1,
                expected: 2,
            },
        ),
        (
            |spec| spec.nodes[1].codes = CodeSpec::lattice(vec![0; 401]),
            last,
            Problem::Order(401),
        ),
        (
            |spec| spec.nodes[1].codes = CodeSpec::lattice(vec![0; 70_000]),
            last,
            Problem::Order(70_000),
        ),
        (
            |spec| spec.nodes[1].codes = CodeSpec::lattice(vec![1, i16::MIN]),
            last,
            Problem::ReflectionCoefficient { stage: 2 },
        ),
        (
            |spec| spec.nodes[1].prediction_error_power = 2.0,
            last,
            Problem::PowerOrder,
        ),
        (
            |spec| spec.nodes[1].codes = fine(&[1; 400], &[1; 33]),
            last,
            Problem::FineStages(33),
        ),
        (
            |spec| spec.nodes[1].codes = fine(&[1; 2], &[1; 3]),
            last,
            Problem::FineBeyondOrder { stage: 3, order: 2 },
        ),
        (
            |spec| spec.nodes[1].codes = fine(&[i16::MIN; 2], &[100; 2]),
            last,
            Problem::ReflectionCoefficient { stage: 1 },
        ),
        (
            |spec| {
                spec.laws.level = LevelLaw::Logarithm;
                spec.nodes[1].flags = NodeFlags::SILENT;
                (
                    spec.nodes[1].output_power,
                    spec.nodes[1].prediction_error_power,
                ) = (0.0, 0.0);
            },
            last,
            Problem::SilentInLogarithm,
        ),
    ];
    assert!(encode(&[spec()]).is_ok());
    for (spoil, place, problem) in cases {
        let mut spec = spec();
        spoil(&mut spec);
        assert_eq!(encode(&[spec]), Err(DecodeError { place, problem }));
    }
    let error = encode(&vec![spec(); 257]).expect_err("too many");
    assert_eq!(
        (error.place, error.problem),
        (Place::Library, Problem::TextureCount(257))
    );
    let error = encode(&[]).expect_err("none");
    assert_eq!(
        (error.place, error.problem),
        (Place::Library, Problem::TextureCount(0))
    );
}

/// The error of decoding a library with one lattice of six nodes, of orders 0, 0, 2, 2, 2, 2, and these parts.
pub fn part_fault(parts: &[(u32, &[u8])]) -> DecodeError {
    fault(|library| {
        let parts = parts
            .iter()
            .map(|(kind, content)| (*kind, content.to_vec()));
        library.textures[0].parts = parts.collect();
    })
}

#[test]
fn a_part_of_an_unknown_kind_is_named_and_asks_for_a_newer_program() {
    for kind in [0, 7, 200, u32::MAX] {
        let told = format!("kind {kind}, which this program does not know");
        let problem = Problem::UnknownPart(kind);
        check(
            part_fault(&[(kind, b"later")]),
            Place::Texture(0),
            problem,
            &told,
        );
        // Behind known ones too.
        let error = part_fault(&[(1, &[1, 1]), (kind, b"")]);
        check(error, Place::Texture(0), problem, "update the program");
    }
}

#[test]
fn parts_ascend_and_none_comes_twice() {
    let (levels, fine): (&[u8], &[u8]) = (&[1, 1], &[0, 0, 1, 1, 1, 1]);
    for (parts, kind) in [
        ([(1, levels), (1, levels)], 1),
        ([(2, fine), (2, fine)], 2),
        ([(2, fine), (1, levels)], 1),
    ] {
        let problem = Problem::PartOrder { kind };
        check(
            part_fault(&parts),
            Place::Texture(0),
            problem,
            "comes twice, or after",
        );
    }
}

/// Their number is not believed: nothing is reserved for it, and a part that is missing ends the search.
#[test]
fn parts_that_do_not_parse_are_told_with_their_texture() {
    for count in [1, 3, u32::MAX] {
        let error = fault(|library| {
            library.textures.truncate(1);
            library.scene_count = None;
            library.textures[0].part_count = Some(count);
        });
        check(
            error,
            Place::Texture(0),
            Problem::MalformedParts,
            "do not parse",
        );
    }
    // A content that is longer than the bytes are.
    let error = fault(|library| {
        library.textures.truncate(1);
        library.textures[0].part_count = Some(1);
        library.scene_count = Some(2);
        library.tail = vec![0xff, 0xff, 0xff, 0xff, 0x0f];
    });
    check(
        error,
        Place::Texture(0),
        Problem::MalformedParts,
        "do not parse",
    );
}

#[test]
fn laws_of_the_level_are_two_known_ones_and_not_those_that_hold_anyway() {
    for (content, problem, told) in [
        (&[][..], Problem::LevelsLength(0), "there must be 2"),
        (&[1], Problem::LevelsLength(1), "1 bytes"),
        (&[1, 1, 0], Problem::LevelsLength(3), "3 bytes"),
        (
            &[3, 0],
            Problem::UnknownLaw {
                what: "level",
                code: 3,
            },
            "level law has the code 3",
        ),
        (
            &[0, 2],
            Problem::UnknownLaw {
                what: "fade",
                code: 2,
            },
            "fade law has the code 2",
        ),
        (&[0, 0], Problem::DefaultLaws, "hold without it"),
    ] {
        check(
            part_fault(&[(1, content)]),
            Place::Texture(0),
            problem,
            told,
        );
    }
}

#[test]
fn levels_in_db_need_nodes_that_are_not_silent() {
    let silent = Place::Node {
        texture: 0,
        speed: 0,
        force: 0,
    };
    let error = part_fault(&[(1, &[2, 0])]);
    check(error, silent, Problem::SilentInLogarithm, "level law");
}

#[test]
fn fractions_of_theta_are_as_many_for_each_node_and_not_too_many() {
    for found in [0, 1, 5, 7, 6 * 33, 6 * 400] {
        let error = part_fault(&[(2, &vec![1; found])]);
        let problem = Problem::FineLength { found, nodes: 6 };
        check(error, Place::Texture(0), problem, "1 to 32 for each");
    }
}

#[test]
fn a_fraction_belongs_to_a_stage_that_is_there() {
    let at = |speed, force| Place::Node {
        texture: 0,
        speed,
        force,
    };
    let error = part_fault(&[(2, &[0, 1, 1, 1, 1, 1])]);
    let problem = Problem::FineBeyondOrder { stage: 1, order: 0 };
    check(error, at(0, 1), problem, "stage 1 of a model of order 0");
    let mut content = [1; 18];
    content[..6].fill(0);
    let error = part_fault(&[(2, &content)]);
    let problem = Problem::FineBeyondOrder { stage: 3, order: 2 };
    check(error, at(1, 0), problem, "stage 3 of a model of order 2");
}

#[test]
fn the_last_fine_stage_is_used_by_some_node() {
    for (content, stage) in [(&[0; 6][..], 1), (&[0, 0, 0, 0, 1, 0, 1, 0, 1, 0, 1, 0], 2)] {
        let error = part_fault(&[(2, content)]);
        let problem = Problem::FineStageUnused { stage };
        check(error, Place::Texture(0), problem, "of the last fine stage");
    }
}

/// A fraction that turns away from π/2 does not make the code of π/2 a valid one, because a reader of codes alone would
/// not see it.
#[test]
fn no_fraction_saves_the_code_of_a_quarter_turn() {
    let error = fault(|library| {
        library.textures[0].parts = vec![(2, vec![0, 0, 100, 100, 100, 100])];
        library.textures[0].coefficients[..2].copy_from_slice(&i16::MIN.to_le_bytes());
    });
    let place = Place::Node {
        texture: 0,
        speed: 1,
        force: 0,
    };
    let problem = Problem::ReflectionCoefficient { stage: 1 };
    check(error, place, problem, "magnitude 1");
}

/// Sound lines of the texture of [`part_fault`], with one fault.
fn lines_fault(spoil: impl FnOnce(&mut Vec<u8>)) -> DecodeError {
    let mut content = lines(&[(0.5, 0), (2.0, 9)], 6);
    let sound = content.clone();
    let whole = fault_free(&[(5, &sound)]);
    assert!(Library::decode(&whole).is_ok());
    spoil(&mut content);
    part_fault(&[(5, &content)])
}

/// The bytes of the library of [`part_fault`] with parts that are right.
fn fault_free(parts: &[(u32, &[u8])]) -> Vec<u8> {
    let mut library = RawLibrary::sound();
    let parts = parts
        .iter()
        .map(|(kind, content)| (*kind, content.to_vec()));
    library.textures[0].parts = parts.collect();
    library.bytes()
}

/// Bytes of one line of [`lines_fault`].
const LINE_BYTES: usize = 6 + 6 * 4;

#[test]
fn lines_are_as_many_as_their_count_says_and_neither_none_nor_too_many() {
    let texture = Place::Texture(0);
    for count in [0, MAX_LINES + 1, 255] {
        let error = lines_fault(|content| content[0] = count as u8);
        check(
            error,
            texture,
            Problem::LineCount(count),
            "there must be 1 to 8",
        );
    }
    check(
        part_fault(&[(5, b"")]),
        texture,
        Problem::LineCount(0),
        "has no such part",
    );
    let whole = 1 + 2 * LINE_BYTES;
    for (found, count) in [
        (whole, 1),
        (whole, 3),
        (whole - 1, 2),
        (whole + 1, 2),
        (1, 2),
        (2, 8),
    ] {
        let error = lines_fault(|content| {
            content.resize(found, 0);
            content[0] = count as u8;
        });
        let expected = 1 + count * LINE_BYTES;
        let problem = Problem::LinesLength { found, expected };
        check(
            error,
            texture,
            problem,
            "where their number and the nodes take",
        );
    }
}

#[test]
fn wavelengths_are_in_their_range_and_none_comes_twice() {
    let set = |value: f32| {
        lines_fault(|content| content[1 + LINE_BYTES..][..4].copy_from_slice(&value.to_le_bytes()))
    };
    for value in [
        0.0,
        -2.0,
        0.0199,
        1000.1,
        f32::INFINITY,
        f32::NAN,
        f32::MIN_POSITIVE,
    ] {
        let error = set(value);
        assert!(
            matches!(error.problem, Problem::Wavelength { line: 1, value: found }
                if found.to_bits() == value.to_bits())
        );
        check_message(error, Place::Texture(0), "must be 0.02 to 1000 mm");
    }
    let problem = Problem::WavelengthTaken { line: 1, other: 0 };
    check(
        set(0.5),
        Place::Texture(0),
        problem,
        "make one line of both",
    );
}

#[test]
fn amplitudes_of_lines_are_finite_bounded_and_zero_at_rest() {
    let set = |node: usize, value: f32| {
        lines_fault(|content| {
            content[1 + LINE_BYTES + 6 + 4 * node..][..4].copy_from_slice(&value.to_le_bytes());
        })
    };
    let at = |node: usize| Place::Node {
        texture: 0,
        speed: node / 2,
        force: node % 2,
    };
    for value in [
        -1.0,
        -0.0,
        f32::NAN,
        f32::INFINITY,
        MAX_LINE_AMPLITUDE.next_up(),
    ] {
        for node in [0, 3, 5] {
            let error = set(node, value);
            assert!(
                matches!(error.problem, Problem::LineAmplitude { line: 1, value: found }
                    if found.to_bits() == value.to_bits())
            );
            check_message(error, at(node), "not negative and at most 256");
        }
    }
    for node in [0, 1] {
        check(
            set(node, 0.5),
            at(node),
            Problem::LineAtZero(1),
            "speed 0 or force 0",
        );
    }
    let silent = lines_fault(|content| content[1 + LINE_BYTES + 6..].fill(0));
    check(
        silent,
        Place::Texture(0),
        Problem::SilentLine(1),
        "leave it out",
    );
}

/// The last amplitude of the largest grid is checked too, however many steps that takes.
#[test]
fn every_amplitude_of_the_largest_grid_is_checked() {
    let values = |unit: f32| {
        (1..=64)
            .map(|index| unit * index as f32)
            .collect::<Vec<_>>()
    };
    let mut wide = spec();
    let node = NodeSpec {
        codes: CodeSpec::lattice(vec![]),
        ..wide.nodes[1].clone()
    };
    (wide.speed_axis_mm_s, wide.force_axis_n) = (values(5.0), values(0.1));
    wide.nodes = vec![node; 64 * 64];
    let line = |at: usize| LineSpec {
        wavelength_mm: 1.0 + at as f32,
        phase: 0,
        amplitudes: vec![1.0; 64 * 64],
    };
    wide.parts.lines = Some(LinesSpec {
        lines: (0..MAX_LINES).map(line).collect(),
    });
    let bytes = encode(std::slice::from_ref(&wide)).expect("it is valid");
    assert!(bytes.len() < MAX_LIBRARY_BYTES);
    for (line, node) in [(0, 0), (3, 2049), (7, 64 * 64 - 1)] {
        let mut spoilt = wide.clone();
        spoilt.parts.lines.as_mut().expect("it has lines").lines[line].amplitudes[node] = 300.0;
        let error = encode(&[spoilt]).expect_err("a line is too loud");
        let place = Place::Node {
            texture: 0,
            speed: node / 64,
            force: node % 64,
        };
        assert_eq!(
            error,
            DecodeError {
                place,
                problem: Problem::LineAmplitude { line, value: 300.0 }
            }
        );
    }
}

#[test]
fn the_encoder_refuses_lines_of_other_nodes() {
    let mut wrong = spec();
    let amplitudes = vec![0.0; wrong.nodes.len() + 1];
    let expected = wrong.nodes.len();
    let line = LineSpec {
        wavelength_mm: 1.0,
        phase: 0,
        amplitudes,
    };
    wrong.parts.lines = Some(LinesSpec {
        lines: vec![line.clone()],
    });
    let error = encode(std::slice::from_ref(&wrong)).expect_err("an amplitude too many");
    let problem = Problem::LineNodes {
        line: 0,
        found: expected + 1,
        expected,
    };
    check(error, Place::Texture(0), problem, "one for each");
    wrong.parts.lines = Some(LinesSpec {
        lines: vec![line; MAX_LINES + 1],
    });
    let error = encode(&[wrong]).expect_err("a line too many");
    check(
        error,
        Place::Texture(0),
        Problem::LineCount(MAX_LINES + 1),
        "there must be 1 to 8",
    );
}
