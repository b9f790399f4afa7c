//! Faults of optional parts, each reported with its place.

use model_format::Library;
use model_format::limits::{MAX_CODEBOOK_SAMPLES, MAX_CODEBOOKS, MAX_LINE_AMPLITUDE, MAX_LINES};

use crate::bytes::{RawLibrary, RawTexture, blocks, codebook, lines, two_codebooks};
use crate::faults::{BAD, of_texture, tells};

fn owned(parts: &[(u32, &[u8])]) -> Vec<(u32, Vec<u8>)> {
    parts.iter().map(|part| (part.0, part.1.to_vec())).collect()
}

/// Checks that the sound library is refused so with these optional parts of texture 1.
fn of_parts(parts: &[(u32, &[u8])], begin: &str) {
    of_texture(|texture| texture.parts = owned(parts), begin);
}

/// Checks that the library is valid with these parts of texture 1.
fn holds(parts: &[(u32, &[u8])]) {
    let mut library = RawLibrary::sound();
    library.textures[1].parts = owned(parts);
    let decoded = Library::decode(&library.bytes()).map(drop);
    assert_eq!(decoded, Ok(()));
}

#[test]
fn parts_are_known_ascend_and_say_something() {
    // Kinds 4 and 8 belonged to earlier versions.
    for kind in [0, 4, 8, 50, 200, u32::MAX] {
        let told = format!(": an optional part of {kind:#x}, which this program does not know");
        of_parts(&[(kind, b"later")], &told);
        // The same after a part of a known kind.
        of_parts(&[(1, &[1, 1]), (kind, b"")], &told);
    }
    let (levels, fine): (&[u8], &[u8]) = (&[1, 1], &[0, 0, 1, 1, 1, 1]);
    holds(&[(1, levels), (2, fine)]);
    for (one, other) in [(1, 1), (2, 2), (2, 1)] {
        let parts = [one, other].map(|kind| (kind, [levels, fine][kind as usize - 1]));
        of_parts(&parts, ": a part comes twice, or after");
    }
    let two = two_codebooks(6);
    let levels = "the part with the laws of the level";
    let fractions = "there must be 1 to 32 fractions of θ for each node";
    let last = "the last stage of fractions of θ says nothing";
    for (kind, content, told) in [
        (1, &[][..], levels),
        (1, &[1], levels),
        (1, &[1, 1, 0], levels),
        (1, &[3, 0], "a law of the level of 0x3, which"),
        (1, &[0, 2], "a law of the fade of 0x2, which"),
        (1, &[0, 0], levels),
        (2, &[], fractions),
        (2, &[1; 5], fractions),
        (2, &[1; 6 * 33], fractions),
        (2, &[0; 6], last),
        (2, &[0, 0, 0, 0, 1, 0, 1, 0, 1, 0, 1, 0], last),
        (3, &two[..two.len() - 1], "sources of excitation"),
        (6, &[0; 12], "the part with the steps of tails"),
        (6, &[0; 11], "bytes of steps of tails: 11"),
    ] {
        of_parts(&[(kind, content)], &format!(": {told}"));
    }
    let beyond = "a fraction of θ, and is beyond the order";
    let told = format!(", node (speed 0, force 1): stage 1 has {beyond}");
    of_parts(&[(2, &[0, 1, 1, 1, 1, 1])], &told);
    let mut content = [1; 18];
    content[..6].fill(0);
    let told = format!(", node (speed 1, force 0): stage 3 has {beyond}");
    of_parts(&[(2, &content)], &told);
}

/// The declared number of parts is not trusted: no memory is reserved for it, and reading ends at the first missing
/// part.
#[test]
fn parts_that_do_not_parse_are_told_with_their_texture() {
    let told = "texture 0: an optional part does not parse";
    let alone = |count, library: &mut RawLibrary| {
        library.textures.truncate(1);
        library.textures[0].part_count = Some(count);
    };
    for count in [1, 3, u32::MAX] {
        tells(
            |library| {
                alone(count, library);
                library.scene_count = None;
            },
            told,
        );
    }
    // A content whose declared length exceeds the remaining bytes.
    tells(
        |library| {
            alone(1, library);
            library.scene_count = Some(2);
            library.tail = vec![0xff, 0xff, 0xff, 0xff, 0x0f];
        },
        told,
    );
}

/// Content of an excitation of these codebooks, with these bytes for the nodes.
fn excitation(codebooks: &[Vec<u8>], of_nodes: &[u8]) -> Vec<u8> {
    [&[codebooks.len() as u8], &codebooks.concat()[..], of_nodes].concat()
}

/// Content of an excitation of one codebook, which all nodes use.
fn one(peak: f32, blocks: &[u8]) -> Vec<u8> {
    excitation(&[codebook(peak, blocks)], &[1; 6])
}

#[test]
fn codebooks_have_whole_blocks_below_their_peak_a_mean_square_of_one_and_hardly_a_mean() {
    let steady = |count: usize| blocks(vec![0; count]);
    let sound = || codebook(1.0, &steady(16));
    let most = MAX_CODEBOOK_SAMPLES / 64;
    // One block of 600 at the peak.
    let sparse = blocks([vec![-128; 599], vec![0]].concat());
    // In `count` blocks of 50, one sample of 64 without its minus.
    let leaning = |count: usize| {
        let mut blocks = steady(50);
        blocks.chunks_mut(25).take(count).for_each(|block| block[0] = 0xdb);
        blocks
    };
    for valid in [
        excitation(&vec![sound(); MAX_CODEBOOKS], &[1, 2, 3, 4, 0, 0]),
        one(1.0, &steady(most - 1)),
        one(24.49, &sparse),
        one(0.98f32.sqrt() + 1e-5, &steady(40)),
        one(1.02f32.sqrt() - 1e-5, &steady(40)),
        one(1.0, &leaning(20)),
    ] {
        holds(&[(3, &valid)]);
    }
    let square = "the mean square of a codebook is";
    let mean = "the magnitude of the mean of a codebook is";
    let short = "the number of samples of a codebook is";
    let whole = "a codebook is no whole number of blocks";
    let louder = "a block of a codebook is louder than its peak";
    let count = "the number of codebooks is";
    let unused = "a codebook that no node has";
    let two = |last: Vec<u8>| excitation(&[sound(), last], &[1, 2, 1, 2, 0, 0]);
    // Also after the bytes of a decoder's first step, and in the second codebook.
    let with_louder = |at: usize| {
        let mut levels = vec![0; 200];
        levels[at] = 1;
        blocks(levels)
    };
    let mut cut = steady(400);
    cut.pop();
    for (content, told) in [
        (excitation(&[], &[0; 6]), count),
        (excitation(&vec![sound(); 5], &[1; 6]), count),
        (one(1.0, &steady(most + 1)), "the length of the exc"),
        (two(codebook(1.0, &[])), short),
        (two(codebook(1.0, &steady(15))), short),
        (one(1.0, &cut), whole),
        (one(1.0, &with_louder(0)), louder),
        (one(1.0, &with_louder(199)), louder),
        (two(codebook(1.0, &with_louder(199))), louder),
        (one(0.0, &steady(40)), square),
        (one(1.0, &blocks([-128; 17])), square),
        (one(0.98f32.sqrt() - 1e-5, &steady(40)), square),
        (one(1.02f32.sqrt() + 1e-5, &steady(40)), square),
        (one(1e-20, &steady(40)), square),
        (one(40.0, &steady(40)), square),
        (one(1.0, &leaning(50)), mean),
        (one(1.0, &[[0xff; 24].as_slice(), &[0]].concat().repeat(40)), mean),
        (excitation(&[sound()], &[]), "sources of excitation"),
        (excitation(&[sound()], &[1; 7]), "sources of excitation"),
        (excitation(&[sound(), sound()], &[0; 6]), unused),
        (excitation(&[sound(), sound()], &[1; 6]), unused),
        (excitation(&[sound(), sound()], &[2; 6]), unused),
    ] {
        of_parts(&[(3, &content)], &format!(": {told}"));
    }
}

#[test]
fn a_codebook_has_a_peak_in_bounds_and_a_node_a_codebook_that_is_there() {
    for bad in [-0.0, -1.0, 40.0f32.next_up(), f32::INFINITY, f32::NAN] {
        of_parts(&[(3, &one(bad, &blocks([0; 16])))], ": the peak of a codebook is");
    }
    for (source, node) in [(2, 0), (255, 5), (3, 2)] {
        let mut of_nodes = [1u8; 6];
        of_nodes[node] = source;
        let place = format!(", node (speed {}, force {})", node / 2, node % 2);
        let told = format!("{place}: the number of its codebook is {source}; it must be 0 to 1");
        of_parts(
            &[(3, &excitation(&[codebook(1.0, &blocks([0; 16]))], &of_nodes))],
            &told,
        );
    }
}

#[test]
fn an_excitation_that_is_cut_anywhere_is_refused() {
    let whole = two_codebooks(6);
    holds(&[(3, &whole)]);
    for length in 0..whole.len() {
        of_parts(&[(3, &whole[..length])], ": ");
    }
    // Lengths beyond the end of the bytes, up to the largest that a varint can encode, and a varint that does not end.
    for length in [&[0xf4, 0x03][..], &[0xff, 0xff, 0xff, 0xff, 0x0f], &[0xff; 8]] {
        let content = [&[1][..], length, &1f32.to_le_bytes(), &blocks([0; 16])].concat();
        of_parts(&[(3, &content)], ": ");
    }
}

/// Length of one line of [`of_lines`], bytes.
const LINE_BYTES: usize = 6 + 6 * 4;

/// Checks that valid lines of texture 1 are refused after `spoil` has put a fault into them.
fn of_lines(spoil: impl FnOnce(&mut Vec<u8>), begin: &str) {
    let mut content = lines(&[(0.5, 0), (2.0, 9)], 6);
    holds(&[(5, &content)]);
    spoil(&mut content);
    of_parts(&[(5, &content)], begin);
}

#[test]
fn lines_are_as_many_as_their_count_says_and_their_wavelengths_in_range_and_unique() {
    for count in [0, MAX_LINES + 1, 255] {
        let told = format!(": the number of lines is {count}; it must be 1 to 8");
        of_lines(|content| content[0] = count as u8, &told);
    }
    of_parts(&[(5, b"")], ": the number of lines is 0");
    let whole = 1 + 2 * LINE_BYTES;
    for (found, count) in [(whole, 1), (whole, 3), (whole - 1, 2), (whole + 1, 2), (1, 2), (2, 8)] {
        of_lines(
            |content| {
                content.resize(found, 0);
                content[0] = count as u8;
            },
            &format!(": bytes of lines: {found} where {}", 1 + count * LINE_BYTES),
        );
    }
    let second = 1 + LINE_BYTES;
    for value in [0.0, -2.0, 0.0199, 1000.1, f32::INFINITY, f32::NAN, f32::MIN_POSITIVE] {
        of_lines(
            |content| content[second..][..4].copy_from_slice(&f32::to_le_bytes(value)),
            ": a line's wavelength in mm is",
        );
    }
    of_lines(
        |content| content[second..][..4].copy_from_slice(&0.5f32.to_le_bytes()),
        ": the same wavelength as number 0",
    );
}

#[test]
fn amplitudes_of_lines_are_finite_bounded_and_zero_at_rest() {
    let set = |node: usize, value: f32, told: &str| {
        let begin = 1 + LINE_BYTES + 6 + 4 * node;
        of_lines(
            |content| content[begin..][..4].copy_from_slice(&value.to_le_bytes()),
            &format!(", node (speed {}, force {}): {told}", node / 2, node % 2),
        );
    };
    for value in BAD.into_iter().chain([MAX_LINE_AMPLITUDE.next_up()]) {
        for node in [0, 3, 5] {
            set(node, value, "the amplitude of a line in m/s² is");
        }
    }
    for node in [0, 1] {
        set(
            node,
            0.5,
            "a line must have an amplitude of 0 at speed 0 and at force 0",
        );
    }
    let told = ": a line of amplitude 0 says nothing";
    of_lines(|content| content[1 + LINE_BYTES + 6..].fill(0), told);
}

/// Two wanders of three lines, each time with one fault.
#[test]
fn wanders_are_bounded_used_and_of_lines_that_there_are() {
    fn of_wander(spoil: impl FnOnce(&mut Vec<u8>), begin: &str) {
        let three = lines(&[(0.5, 0), (2.0, 9), (3.0, 0)], 6);
        let mut content = vec![2];
        let values = [0.1f32, 2.0, 0.0, 0.0, 1.0, 80.0];
        content.extend(values.into_iter().flat_map(f32::to_le_bytes));
        content.extend([2, 0, 1]);
        holds(&[(5, &three), (7, &content)]);
        spoil(&mut content);
        of_parts(&[(5, &three), (7, &content)], begin);
    }
    let set = |at: usize, value: f32, told: &str| {
        of_wander(
            |content| content[1 + 4 * at..][..4].copy_from_slice(&value.to_le_bytes()),
            &format!(": {told}"),
        );
    };
    for value in [f32::NAN, -1.0, 0.0, 0.049, 1001.0] {
        set(1, value, "a correlation length in mm is");
    }
    for value in [f32::INFINITY, -0.1, 0.51] {
        set(0, value, "the RMS of a wander in mm is");
    }
    set(5, 10_001.0, "a clock's speed in mm/s is");
    set(5, 0.0, "a wander says nothing");
    of_wander(|content| content[0] = 5, ": the number of wanders is 5");
    of_wander(|content| content[0] = 0, ": the number of wanders is 0");
    of_wander(|content| content.push(0), ": bytes of wanders: 29 where 28");
    of_wander(|content| content[25] = 3, ": the number of a line's wander is 3");
    of_wander(|content| content[25] = 1, ": a wander that no line has says nothing");
    let alone: &[u8] = &[1, 0, 0, 0, 63, 0, 0, 0, 64, 0, 0, 0, 0];
    of_parts(&[(7, alone)], ": a wander that no line has says nothing");
}

#[test]
fn tails_have_one_step_per_node_which_is_the_one_that_their_codes_need() {
    fn of_tails(spoil: impl FnOnce(&mut RawTexture), begin: &str) {
        tells(
            |library| {
                library.textures = vec![RawTexture::with_tails()];
                spoil(&mut library.textures[0]);
            },
            begin,
        );
    }
    for found in [0, 1, 10, 11, 13, 14] {
        let told = format!("texture 0: bytes of steps of tails: {found} where 12 is due");
        of_tails(|texture| texture.parts[1].1.resize(found, 0), &told);
    }
    for (at, stage) in [(0, 33), (3, 36), (4, 37)] {
        let lowest = |texture: &mut RawTexture| {
            let tail = texture.nodes[4].offset as usize + 64;
            texture.coefficients[tail + at] = 0x80;
        };
        let told = format!("texture 0, node (speed 2, force 0): stage {stage} has the code -128");
        of_tails(lowest, &told);
    }
    // The step must be 0 in a silent node (0), in a node of 32 stages (2) and in a node whose tail is all 0 (5). It
    // must not be 0 in nodes with other tails (3 and 4).
    for (number, step) in [(0, 1), (2, 1), (5, 1), (5, 9), (3, 0), (4, 0)] {
        let stepped = |texture: &mut RawTexture| {
            texture.parts[1].1[2 * number..][..2].copy_from_slice(&u16::to_le_bytes(step));
        };
        let (speed, force) = (number / 2, number % 2);
        of_tails(
            stepped,
            &format!("texture 0, node (speed {speed}, force {force}): the step"),
        );
    }
    // If all codes are below half their range, half the step would suffice. A step of 2 is then refused, and a step of
    // 1 is valid.
    let halved = |texture: &mut RawTexture, step: u16| {
        let tail = texture.nodes[4].offset as usize + 64;
        texture.coefficients[tail..tail + 5].copy_from_slice(&[63, 0xff, 0, 32, 0xc1]);
        texture.parts[1].1[8..10].copy_from_slice(&step.to_le_bytes());
    };
    let told = "texture 0, node (speed 2, force 0): the step";
    of_tails(|texture| halved(texture, 2), told);
    let mut library = RawLibrary::sound();
    library.textures = vec![RawTexture::with_tails()];
    halved(&mut library.textures[0], 1);
    assert!(Library::decode(&library.bytes()).is_ok());
    // A reader that confused the bytes of a tail with codes of 16 bits would find too few or too many bytes.
    let used = 4 * 64 + 1 + 5 + 2;
    let told = "texture 0, node (speed 2, force 1): the coefficients end within";
    of_tails(|texture| texture.coefficients.resize(used - 1, 0), told);
    let more = used + 1;
    let told = format!("texture 0: bytes of coefficients: {more} where {used}");
    of_tails(|texture| texture.coefficients.resize(more, 0), &told);
    let told = "texture 0, node (speed 2, force 0): the begin of its coefficients: 129 where 130";
    of_tails(|texture| texture.parts.truncate(1), told);
}
