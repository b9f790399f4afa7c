//! Faults of a library's bytes, mostly one at a time, in prefix, headers, axes and nodes, and what the encoder refuses.
//! The message names the fault's place, and the numbers if there are any.

use model_format::limits::{MAX_LIBRARY_BYTES, MAX_LINES, MAX_OUTPUT_POWER};
use model_format::{CodeSpec, FORMAT_VERSION, Library, LineSpec, LinesSpec, NodeSpec, TailSpec, TextureSpec, encode};

use crate::bytes::{RawLibrary, RawTexture, checksum, repair};

pub fn refused(bytes: &[u8]) -> String {
    let error = Library::decode(bytes).expect_err("a library with a fault");
    assert_eq!(error.to_string(), format!("{}: {}", error.place, error.problem));
    error.to_string()
}

/// Checks that [`RawLibrary::sound`] is refused after `spoil` has put a fault into it. The message begins with `begin`.
pub fn tells(spoil: impl FnOnce(&mut RawLibrary), begin: &str) {
    let mut library = RawLibrary::sound();
    spoil(&mut library);
    let message = refused(&library.bytes());
    assert!(message.starts_with(begin), "'{message}' is not '{begin}'");
}

/// Checks that a library with a fault in texture 1 is refused; the message names the texture, then `told`.
pub fn of_texture(spoil: impl FnOnce(&mut RawTexture), told: &str) {
    tells(|library| spoil(&mut library.textures[1]), &format!("texture 1{told}"));
}

/// Numbers that are invalid as a value on an axis, as a power and as an amplitude.
pub const BAD: [f32; 5] = [-1.0, -0.0, f32::INFINITY, f32::NEG_INFINITY, f32::NAN];

/// Indices of the first node of texture 1 that is not silent.
const AT: [usize; 2] = [1, 0];

/// Checks that a library with a fault in this node (speed, force) of texture 1 is refused; the message names the node,
/// then `told`.
fn of_node([speed, force]: [usize; 2], spoil: impl FnOnce(&mut RawTexture), told: &str) {
    of_texture(spoil, &format!(", node (speed {speed}, force {force}): {told}"));
}

#[test]
fn a_newer_version_asks_for_a_newer_program_and_an_older_one_for_a_new_fit_before_all_else() {
    for (found, remedy) in [
        (FORMAT_VERSION + 1, "update the program"),
        (u16::MAX, "update the program"),
        (FORMAT_VERSION - 1, "fit it again"),
    ] {
        let mut library = RawLibrary::sound();
        (library.version, library.reserved) = (found, 7);
        (library.total_bytes, library.crc32) = (Some(0), Some(0));
        library.tail = vec![0; 600_000];
        let message = refused(&library.bytes());
        assert!(message.contains(&format!("version {found}")), "{message}");
        assert!(message.contains(remedy), "{message}");
    }
}

#[test]
fn fewer_or_more_bytes_than_declared_are_told_with_both_lengths() {
    let actual = RawLibrary::sound().bytes().len();
    for declared in [0, actual as u32 - 1, actual as u32 + 1, u32::MAX] {
        tells(
            |library| library.total_bytes = Some(declared),
            &format!("library: {actual} bytes where the library declares {declared}: truncated"),
        );
    }
    let mut bytes = RawLibrary::sound().bytes();
    bytes.truncate(16);
    repair(&mut bytes);
    assert_eq!(refused(&bytes), "library: the number of textures does not parse");
    assert_eq!(refused(&bytes[..15]), "library: its prefix does not parse");
    assert!(refused(b"").contains("not a texture library"));
}

#[test]
fn a_library_takes_at_most_what_a_slot_holds() {
    let room = MAX_LIBRARY_BYTES - RawLibrary::sound().bytes().len();
    tells(
        |library| library.tail = vec![0; room],
        &format!("library: {room} bytes are left over"),
    );
    tells(
        |library| library.tail = vec![0; room + 1],
        "library: its length in bytes is 524033; it must be 0 to 524032",
    );
}

#[test]
fn damage_is_told_with_both_checksums() {
    let mut bytes = RawLibrary::sound().bytes();
    let stored = checksum(&bytes);
    *bytes.last_mut().expect("a library") ^= 1;
    let computed = checksum(&bytes);
    let told = format!("library: checksum {computed:08x} where {stored:08x} is stored");
    assert!(refused(&bytes).starts_with(&told));
}

/// The summary is checked because the player reads the highest order and power from it, without reading the nodes.
#[test]
fn headers_and_counts_are_checked() {
    tells(|l| l.magic = *b"RIFF", "library: not a texture library");
    tells(|l| l.reserved = 1, "library: a reserved field");
    tells(|l| l.count = Some(0), "library: the number of textures is");
    tells(|l| l.count = Some(257), "library: the number of textures i");
    tells(|l| l.count = Some(u32::MAX), "library: the number of textu");
    tells(|l| l.count = Some(4), "texture 3: its header does not pars");
    // A texture beyond the declared number is read as scenes. The first byte of its length is then read as their
    // number.
    tells(|l| l.count = Some(2), "library: the number of scenes is");
    tells(|l| l.tail = vec![1, 2, 3], "library: 3 bytes are left over");
    of_texture(|t| t.tail = vec![0; 5], ": 5 bytes are left over");
    of_texture(|t| t.provenance = 3, ": its header does not parse");
    of_texture(|t| t.name = vec![0xff], ": its header does not parse");
    of_texture(|t| t.name.clear(), ": the length of the name in bytes is 0");
    of_texture(|t| t.name = vec![b'x'; 49], ": the length of the name in b");
    tells(|l| l.textures[2].name = b"oak".to_vec(), "texture 2: the s");
    of_texture(|t| t.sample_rate_hz = 0, ": the sample rate in Hz is 0");
    of_texture(|t| t.sample_rate_hz = 48_001, ": the sample rate in Hz is");
    of_texture(|t| t.summary = Some((1, 4.0)), ": the highest order: 1 whe");
    of_texture(|t| t.summary = Some((400, 4.0)), ": the highest order: 400");
    of_texture(|t| t.summary = Some((1 << 16, 4.0)), ": its header does no");
    of_texture(|t| t.summary = Some((2, -0.0)), ": the highest output powe");
    of_texture(|t| t.summary = Some((2, 4.0f32.next_up())), ": the highest output");
    of_texture(|t| t.nodes.truncate(5), ": nodes: 5 where 6 is due");
    of_texture(|t| t.nodes.clear(), ": nodes: 0 where 6 is due");
    of_texture(|t| t.speed_axis.clear(), ", speed axis: the number of valu");
    of_texture(|t| t.force_axis.clear(), ", force axis: the number of valu");
    of_texture(|t| t.ragged.speed_axis = 1, ", speed axis: a string holds");
    of_texture(|t| t.ragged.force_axis = 3, ", force axis: a string holds");
    of_texture(|t| t.ragged.nodes = 15, ": a string holds no whole number");
    of_texture(|t| t.ragged.coefficients = 1, ": a string holds no whole n");
    for name in ["a\nb", "\0", "tab\t", "\u{7f}", "\u{85}"] {
        of_texture(|t| t.name = name.as_bytes().to_vec(), ": a name with a con");
    }
    let mut library = RawLibrary::sound();
    library.textures[1].name = vec![b'x'; 48];
    assert!(Library::decode(&library.bytes()).is_ok());
}

#[test]
fn values_on_axes_are_few_finite_not_negative_and_ascend() {
    let long: Vec<f32> = (0..65u8).map(f32::from).collect();
    let mut cases = vec![
        (long, "the number of values is 65; it must be 1 to 64"),
        (vec![0.5, 0.5, 2.0], "the values do not ascend"),
        (vec![0.5, 0.25, 2.0], "the values do not ascend"),
    ];
    for bad in BAD {
        cases.push((vec![0.5, bad, 2.0], "a value is "));
    }
    for (values, told) in cases {
        of_texture(|t| t.speed_axis = values.clone(), &format!(", speed axis: {told}"));
        of_texture(|t| t.force_axis = values, &format!(", force axis: {told}"));
    }
}

#[test]
fn nodes_are_checked() {
    of_node(AT, |t| t.nodes[2].order = 401, "the order is 401; it must");
    of_node(AT, |t| t.nodes[2].order = u16::MAX, "the order is 65535");
    of_node(AT, |t| t.nodes[2].flags = 0x10, "flags of 0x10, which this");
    of_node(AT, |t| t.nodes[2].flags = 0x80, "flags of 0x80");
    of_node(AT, |t| t.nodes[2].flags = 0x8000, "flags of 0x8000");
    let told = "the prediction error's power is a";
    of_node(AT, |t| t.nodes[2].prediction_error_power = 4.0f32.next_up(), told);
    of_node(AT, |t| t.nodes[2].flags = 1, "the silent flag");
    of_node(
        AT,
        |t| (t.nodes[2].output_power, t.nodes[2].prediction_error_power) = (0.0, 0.0),
        "the silent flag",
    );
    of_node([0, 0], |t| t.nodes[0].flags = 0, "the silent flag");
    of_node(
        [0, 1],
        |t| (t.nodes[1].flags, t.nodes[1].output_power) = (0, f32::from_bits(1)),
        "a node at speed 0 o",
    );
    of_node(AT, |t| t.force_axis[0] = 0.0, "a node at speed 0 or force");
    of_node([1, 1], |t| t.nodes[3].offset = 0, "the begin of its coeffi");
    of_node([1, 1], |t| t.nodes[3].offset = 3, "the begin of its coeffi");
    of_node([1, 1], |t| t.nodes[3].offset = 8, "the begin of its coeffi");
    of_node([1, 1], |t| t.nodes[3].offset = u32::MAX, "the begin of its");
    of_node([2, 1], |t| t.coefficients.truncate(14), "the coefficients");
    for (node, at, told) in [(AT, 0, "stage 1"), (AT, 2, "stage 2"), ([1, 1], 6, "stage 2")] {
        let reflects = |t: &mut RawTexture| t.coefficients[at..at + 2].copy_from_slice(&[0, 0x80]);
        of_node(node, reflects, &format!("{told} has a reflection"));
    }
    // A code of -2¹⁵ is refused even if its fraction moves θ away from -π/2, because a reader that ignores fractions
    // would not see this.
    of_node(
        AT,
        |t| {
            t.parts = vec![(2, vec![0, 0, 100, 100, 100, 100])];
            t.coefficients[..2].copy_from_slice(&i16::MIN.to_le_bytes());
        },
        "stage 1 has a reflection",
    );
    of_node(
        [0, 0],
        |t| t.parts = vec![(1, vec![2, 0])],
        "a silent node has no level in dB",
    );
    of_texture(|t| t.coefficients.extend([0; 2]), ": bytes of coefficients");
}

#[test]
fn powers_of_nodes_are_finite_not_negative_and_bounded() {
    for bad in BAD.into_iter().chain([MAX_OUTPUT_POWER.next_up()]) {
        let place = ", node (speed 1, force 0): the";
        of_texture(|t| t.nodes[2].output_power = bad, &format!("{place} output power in"));
        let told = format!("{place} power of the prediction error in");
        of_texture(|t| t.nodes[2].prediction_error_power = bad, &told);
    }
}

fn spec() -> TextureSpec {
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

/// Lines with `amplitudes` amplitudes each.
fn flat_lines(count: usize, amplitudes: usize) -> LinesSpec {
    let line = |at: usize| LineSpec {
        wavelength_mm: 1.0 + at as f32,
        phase: 0,
        amplitudes: vec![1.0; amplitudes],
        ..LineSpec::default()
    };
    let lines: Vec<_> = (0..count).map(line).collect();
    LinesSpec::from(lines)
}

fn encodes_not(spoil: impl FnOnce(&mut TextureSpec), told: &str) {
    let mut spec = spec();
    spoil(&mut spec);
    let message = encode(&[spec]).expect_err("a fault").to_string();
    let begin = format!("texture 0{told}");
    assert!(message.starts_with(&begin), "'{message}' is not '{begin}'");
}

/// Checks that the encoder refuses `codes` in the last node; the message names the node, then `told`.
fn of_codes(codes: CodeSpec, told: &str) {
    encodes_not(
        |spec| spec.nodes[1].codes = codes,
        &format!(", node (speed 0, force 1): {told}"),
    );
}

/// The encoder decodes what it has written. It refuses by itself what a `TextureSpec` can express but bytes cannot.
#[test]
fn the_encoder_refuses_what_the_decoder_would() {
    assert!(encode(&[spec()]).is_ok());
    encodes_not(|spec| spec.name.clear(), ": the length of the name");
    encodes_not(|spec| spec.speed_axis_mm_s.clear(), ", speed axis: the num");
    encodes_not(|spec| drop(spec.nodes.pop()), ": nodes: 1 where 2 is due");
    of_codes(CodeSpec::lattice(vec![0; 401]), "the order is 401");
    of_codes(CodeSpec::lattice(vec![0; 70_000]), "the order is 70000");
    of_codes(CodeSpec::lattice(vec![1, i16::MIN]), "stage 2 has a refl");
    of_codes(fine(&[1; 400], &[1; 33]), "the number of fractions of θ is");
    of_codes(fine(&[1; 2], &[1; 3]), "stage 3 has a fraction of θ, and");
    of_codes(with_tail(32, &[100, i8::MIN], 9), "stage 34 has the code");
    of_codes(with_tail(32, &[-63], 2), "the step of a tail");
    of_codes(with_tail(31, &[100], 9), "a tail begins after stage 32");
    encodes_not(
        |spec| {
            spec.nodes[0].codes = with_tail(32, &[100], 9);
            spec.nodes[1].codes = with_tail(33, &[], 0);
        },
        ", node (speed 0, force 1): a tail begins after stage 32",
    );
    // A step without a tail, in a texture in which no node has a tail.
    of_codes(with_tail(32, &[], 1), "the step of a tail");
    encodes_not(
        |spec| spec.parts.lines = Some(flat_lines(1, 3)),
        ": amplitudes of a line: 3 where 2",
    );
    encodes_not(
        |spec| spec.parts.lines = Some(flat_lines(MAX_LINES + 1, 2)),
        ": the number of lines is 9",
    );
    for count in [0, 257] {
        let error = encode(&vec![spec(); count]).expect_err("too few or many").to_string();
        assert!(error.starts_with("library: the number of textures is"), "{error}");
    }
}

/// The last amplitude of the largest grid is checked too, however many steps that takes.
#[test]
fn every_amplitude_of_the_largest_grid_is_checked() {
    let values = |unit: f32| (1..=64).map(|index| unit * index as f32).collect::<Vec<_>>();
    let mut wide = spec();
    let node = NodeSpec::new(1.0, CodeSpec::lattice(vec![]));
    (wide.speed_axis_mm_s, wide.force_axis_n) = (values(5.0), values(0.1));
    wide.nodes = vec![node; 64 * 64];
    wide.parts.lines = Some(flat_lines(MAX_LINES, 64 * 64));
    let bytes = encode(std::slice::from_ref(&wide)).expect("it is valid");
    assert!(bytes.len() < MAX_LIBRARY_BYTES);
    for (line, node) in [(0, 0), (3, 2049), (7, 64 * 64 - 1)] {
        let mut spoilt = wide.clone();
        spoilt.parts.lines.as_mut().expect("it has lines").lines[line].amplitudes[node] = 300.0;
        let error = encode(&[spoilt]).expect_err("a line is too loud").to_string();
        let place = format!("texture 0, node (speed {}, force {})", node / 64, node % 64);
        let told = format!("{place}: the amplitude of a line in m/s² is 300; it must be 0 to 256");
        assert_eq!(error, told);
    }
}
