//! Codebooks and level tracks: their laws, and every fault that they may have.

use model_format::limits::{MAX_EXCITATION_BYTES, MAX_MODULATION_ENTRIES};
use model_format::{
    CodebookSpec, DecodeError, ExcitationSpec, LEVEL_FRACTION_BITS, Library, MU_LAW_FRACTION_BITS,
    ModulationSpec, PartKind, Place, Problem, encode, level_amplitude, mu_law,
};
use proptest::prelude::*;

use crate::bytes::{RawLibrary, codebook, track, two_codebooks};
use crate::walk::{content, mean_square, mean_square_as_played};

const TEXTURE: Place = Place::Texture(1);

/// Decodes the sound library with these parts in texture 1, which has six nodes.
fn decoded(parts: Vec<(u32, Vec<u8>)>) -> Result<(), DecodeError> {
    let mut library = RawLibrary::sound();
    library.textures[1].parts = parts;
    Library::decode(&library.bytes()).map(|_| ())
}

/// Checks fault and place, and that the message names the place and says `told`.
fn check(parts: Vec<(u32, Vec<u8>)>, place: Place, problem: Problem, told: &str) {
    let error = decoded(parts).expect_err("a library with a fault");
    assert_eq!((error.place, error.problem), (place, problem));
    let message = error.to_string();
    assert!(message.starts_with(&place.to_string()), "{message}");
    assert!(message.contains(told), "{message}");
}

/// An excitation of these codebooks, with these bytes for the nodes.
fn excitation(codebooks: &[Vec<u8>], of_nodes: &[u8]) -> Vec<(u32, Vec<u8>)> {
    let mut content = vec![codebooks.len() as u8];
    content.extend(codebooks.concat());
    content.extend(of_nodes);
    vec![(3, content)]
}

fn modulation(step: &[u8], entries: &[i8]) -> Vec<(u32, Vec<u8>)> {
    let mut content = step.to_vec();
    content.extend(entries.iter().map(|entry| entry.cast_unsigned()));
    vec![(4, content)]
}

/// A codebook of a mean square of 1.
fn sound() -> Vec<u8> {
    codebook(1.0, &[127; 1000])
}

#[test]
fn codes_follow_the_mu_law_and_levels_a_quarter_of_a_decibel() {
    for code in -127..=127i8 {
        let share = (256f64.powf(f64::from(code.unsigned_abs()) / 127.0) - 1.0) / 255.0;
        let exact = f64::from(code.signum()) * share * 2f64.powi(MU_LAW_FRACTION_BITS as i32);
        assert!((f64::from(mu_law(code)) - exact).abs() <= 0.51, "{code}");
    }
    assert_eq!(mu_law(0), 0);
    assert_eq!(mu_law(127), 1 << MU_LAW_FRACTION_BITS);
    assert_eq!(mu_law(i8::MIN), mu_law(-127));
    for entry in i8::MIN..=i8::MAX {
        let exact = 10f64.powf(f64::from(entry) * 0.25 / 20.0);
        let found = f64::from(level_amplitude(entry)) / 2f64.powi(LEVEL_FRACTION_BITS as i32);
        assert!((found - exact).abs() <= 0.51 / 65_536.0, "{entry}");
    }
}

#[test]
fn a_texture_lists_its_codebooks_and_its_track_with_their_bytes() {
    let bytes = RawLibrary::full().bytes();
    let library = Library::decode(&bytes).expect("a valid library");
    let parts = |index| -> Vec<(PartKind, usize)> {
        let texture = library.texture_at(index).expect("it is there");
        texture.parts().collect()
    };
    let excitation = two_codebooks(6).len();
    assert_eq!(
        parts(1),
        [
            (PartKind::Levels, 2),
            (PartKind::Excitation, excitation),
            (PartKind::Modulation, 21),
        ]
    );
    // Two lines of a wavelength, a phase and six amplitudes.
    let lines = (PartKind::Lines, 1 + 2 * (4 + 2 + 6 * 4));
    assert_eq!(parts(2), [(PartKind::Modulation, 21), lines]);
    let fed: Vec<bool> = library.textures().map(|texture| texture.is_fed()).collect();
    assert_eq!(fed, [false, true, true, false]);
    assert_eq!(parts(3), [(PartKind::FineTheta, 6), (PartKind::Tails, 12)]);
    assert_eq!(PartKind::Tails.to_string(), "tails");
    assert_eq!(PartKind::Excitation.to_string(), "excitation");
    assert_eq!(PartKind::Modulation.to_string(), "modulation");
}

#[test]
fn nodes_have_the_source_that_is_stored_for_them() {
    let bytes = RawLibrary::full().bytes();
    let library = Library::decode(&bytes).expect("a valid library");
    let texture = library.texture("oak").expect("it is there");
    let excitation = texture.excitation().expect("it has codebooks");
    let sources: Vec<usize> = (0..6).map(|n| excitation.of_node(n / 2, n % 2)).collect();
    assert_eq!(sources, [0, 1, 2, 0, 1, 2]);
    let lengths = excitation.codebooks().iter().map(|one| one.codes().len());
    assert_eq!(lengths.collect::<Vec<_>>(), [1000, 1004]);
}

#[test]
fn an_excitation_has_one_to_four_codebooks() {
    for count in [0, 5, 255u8] {
        let parts = vec![(3, [vec![count], sound(), vec![1; 6]].concat())];
        let problem = Problem::CodebookCount(usize::from(count));
        check(parts, TEXTURE, problem, "there must be 1 to 4");
    }
    assert_eq!(
        decoded(excitation(&vec![sound(); 4], &[1, 2, 3, 4, 0, 0])),
        Ok(())
    );
}

#[test]
fn an_excitation_without_bytes_or_cut_anywhere_is_refused() {
    let whole = two_codebooks(6);
    assert_eq!(decoded(vec![(3, whole.clone())]), Ok(()));
    for length in 0..whole.len() {
        let error = decoded(vec![(3, whole[..length].to_vec())]).expect_err("it was cut");
        assert_eq!(error.place, TEXTURE);
        let cut = matches!(
            error.problem,
            Problem::MalformedExcitation | Problem::CodebooksOfNodes { .. }
        );
        assert!(cut, "{length}: {error}");
    }
    let malformed = Problem::MalformedExcitation;
    check(
        vec![(3, Vec::new())],
        TEXTURE,
        malformed,
        "the bytes were damaged",
    );
    // A length beyond the end, up to the largest that the encoding holds, and one that never ends.
    for length in [
        &[0xff, 0x7f][..],
        &[0xff, 0xff, 0xff, 0xff, 0x0f],
        &[0xff; 8],
    ] {
        let content = [&[1][..], length, &1f32.to_le_bytes(), &[127; 1000]].concat();
        assert_eq!(
            decoded(vec![(3, content)]).map_err(|error| error.problem),
            Err(Problem::MalformedExcitation)
        );
    }
}

#[test]
fn an_excitation_takes_at_most_16_kilobytes() {
    // 1 byte of the count, 2 of the length, 4 of the peak, and 6 of the nodes.
    let most = MAX_EXCITATION_BYTES - 13;
    assert_eq!(
        decoded(excitation(&[codebook(1.0, &vec![127; most])], &[1; 6])),
        Ok(())
    );
    let found = MAX_EXCITATION_BYTES + 1;
    check(
        excitation(&[codebook(1.0, &vec![127; most + 1])], &[1; 6]),
        TEXTURE,
        Problem::ExcitationBytes(found),
        "16385 bytes; there may be 16384",
    );
}

#[test]
fn a_codebook_of_few_samples_or_none_is_refused() {
    for length in [0, 1, 999] {
        let codebooks = [sound(), codebook(1.0, &vec![127; length])];
        let problem = Problem::CodebookLength { number: 2, length };
        let told = "there must be at least 1000: fit from a longer recording";
        check(
            excitation(&codebooks, &[1, 2, 1, 2, 0, 0]),
            TEXTURE,
            problem,
            told,
        );
    }
}

#[test]
fn a_peak_is_positive_and_at_most_40_standard_deviations() {
    for peak in [0.0, -0.0, -1.0, 40.0f32.next_up(), f32::INFINITY, f32::NAN] {
        let error = decoded(excitation(&[codebook(peak, &[127; 1000])], &[1; 6]));
        let error = error.expect_err("no peak");
        let Problem::CodebookPeak {
            number: 1,
            peak: told,
        } = error.problem
        else {
            panic!("{error}");
        };
        assert_eq!((told.to_bits(), error.place), (peak.to_bits(), TEXTURE));
        assert!(
            error.to_string().contains("above 0 and at most 40"),
            "{error}"
        );
    }
    let mut codes = [0; 1600];
    codes[77] = -127;
    assert_eq!(
        decoded(excitation(&[codebook(40.0, &codes)], &[1; 6])),
        Ok(())
    );
}

/// Also behind the first step of a decoder, and in the second codebook.
#[test]
fn a_code_that_the_law_lacks_is_told_with_its_place() {
    for (codebook_index, sample) in [(0, 0), (0, 4999), (1, 0), (1, 2999)] {
        let mut codes = [vec![127i8; 5000], vec![-127i8; 3000]];
        codes[codebook_index][sample] = i8::MIN;
        let codebooks = codes.map(|codes| codebook(1.0, &codes));
        let number = codebook_index + 1;
        let problem = Problem::CodebookCode { number, sample };
        let told = format!("sample {sample} of codebook {number} is -128");
        check(
            excitation(&codebooks, &[1, 2, 1, 2, 1, 2]),
            TEXTURE,
            problem,
            &told,
        );
    }
}

#[test]
fn a_codebook_has_a_mean_square_of_one_within_two_per_cent() {
    for (peak, fits) in [
        (0.98f32.sqrt() + 1e-5, true),
        (1.02f32.sqrt() - 1e-5, true),
        (0.98f32.sqrt() - 1e-5, false),
        (1.02f32.sqrt() + 1e-5, false),
        (1e-20, false),
        (40.0, false),
    ] {
        let parts = excitation(&[codebook(peak, &[127; 2500])], &[1; 6]);
        if fits {
            assert_eq!(decoded(parts), Ok(()), "{peak}");
            continue;
        }
        let error = decoded(parts).expect_err("another level");
        let power = mean_square(&CodebookSpec {
            peak,
            codes: vec![127; 2500],
        });
        let Problem::CodebookPower {
            number: 1,
            power: told,
        } = error.problem
        else {
            panic!("{error}");
        };
        assert!(
            (f64::from(told) - power).abs() <= 1e-5 * power,
            "{told}, {power}"
        );
        assert!(
            error.to_string().contains("it must be 0.98 to 1.02"),
            "{error}"
        );
    }
    // Silence is no codebook.
    let error = decoded(excitation(&[codebook(1.0, &[0; 1000])], &[1; 6]));
    let problem = Problem::CodebookPower {
        number: 1,
        power: 0.0,
    };
    assert_eq!(error.map_err(|error| error.problem), Err(problem));
}

#[test]
fn every_node_has_a_source_and_every_codebook_a_node() {
    for nodes in [0, 5, 7] {
        let problem = Problem::CodebooksOfNodes {
            found: nodes,
            nodes: 6,
        };
        let told = format!("{nodes} bytes with the codebooks of nodes where the axes span 6");
        check(
            excitation(&[sound()], &vec![1; nodes]),
            TEXTURE,
            problem,
            &told,
        );
    }
    for (codebook, node) in [(2, 0), (255, 5), (3, 2)] {
        let mut of_nodes = [1u8; 6];
        of_nodes[node] = codebook;
        let place = Place::Node {
            texture: 1,
            speed: node / 2,
            force: node % 2,
        };
        let problem = Problem::UnknownCodebook {
            codebook: codebook.into(),
            count: 1,
        };
        check(
            excitation(&[sound()], &of_nodes),
            place,
            problem,
            "and the texture has 1",
        );
    }
    let two = [sound(), sound()];
    for (of_nodes, unused) in [([0; 6], 1), ([1; 6], 2), ([2; 6], 1)] {
        let problem = Problem::UnusedCodebook(unused);
        check(
            excitation(&two, &of_nodes),
            TEXTURE,
            problem,
            "leave it out",
        );
    }
}

#[test]
fn a_track_has_steps_and_entries_within_bounds() {
    let entries: Vec<i8> = (0..20).map(|n| if n % 2 == 0 { 1 } else { -1 }).collect();
    for (step, bytes) in [(0, &[0][..]), (24, &[24]), (501, &[0xf5, 0x03])] {
        let problem = Problem::ModulationStep(step);
        check(
            modulation(bytes, &entries),
            TEXTURE,
            problem,
            "there must be 25 to 500",
        );
    }
    for length in [0, 19, MAX_MODULATION_ENTRIES + 1] {
        let entries: Vec<i8> = entries.iter().copied().cycle().take(length).collect();
        let problem = Problem::ModulationLength(length);
        check(
            modulation(&[100], &entries),
            TEXTURE,
            problem,
            "there must be 20 to 4096",
        );
    }
    let most: Vec<i8> = entries
        .iter()
        .copied()
        .cycle()
        .take(MAX_MODULATION_ENTRIES)
        .collect();
    assert_eq!(decoded(modulation(&[0xf4, 0x03], &most)), Ok(()));
    assert_eq!(decoded(modulation(&[25], &entries)), Ok(()));
    let malformed = Problem::MalformedModulation;
    check(vec![(4, Vec::new())], TEXTURE, malformed, "does not parse");
    check(
        vec![(4, vec![0xff; 30])],
        TEXTURE,
        malformed,
        "does not parse",
    );
}

#[test]
fn a_track_has_a_mean_square_of_one_and_is_not_flat() {
    check(
        modulation(&[100], &[0; 20]),
        TEXTURE,
        Problem::FlatModulation,
        "leave it out",
    );
    for level in [-128, -1, 1, 127i8] {
        let error = decoded(modulation(&[100], &[level; 4000])).expect_err("another level");
        let Problem::ModulationPower(power) = error.problem else {
            panic!("{error}");
        };
        let exact = 10f64.powf(f64::from(level) * 0.25 / 10.0);
        // A step of the lowest amplitude is a part in 1600.
        assert!(
            (f64::from(power) / exact - 1.0).abs() < 1e-3,
            "{power}, {exact}"
        );
        assert!(error.to_string().contains("shift its entries"), "{error}");
    }
}

/// A reader of a version before these parts refused any kind above 2, as this one refuses those that it does not know.
#[test]
fn a_part_of_an_unknown_kind_is_refused_because_it_would_play_another_texture() {
    for kind in [0, 7, 8, u32::MAX] {
        let parts = vec![(kind, track())];
        check(
            parts,
            TEXTURE,
            Problem::UnknownPart(kind),
            "update the program",
        );
    }
    let both = vec![(4, track()), (3, two_codebooks(6))];
    check(
        both,
        TEXTURE,
        Problem::PartOrder { kind: 3 },
        "after one of a higher kind",
    );
    let twice = vec![(4, track()), (4, track())];
    check(
        twice,
        TEXTURE,
        Problem::PartOrder { kind: 4 },
        "comes twice",
    );
}

/// The encoder reports what the decoder would.
#[test]
fn a_writer_is_told_the_same_faults() {
    type Spoil = fn(&mut ExcitationSpec, &mut ModulationSpec);
    let bytes = RawLibrary::full().bytes();
    let library = Library::decode(&bytes).expect("a valid library");
    let sound = content(&library);
    let cases: [(Spoil, Problem); 5] = [
        (|e, _| e.codebooks.clear(), Problem::CodebookCount(0)),
        (
            |e, _| e.codebooks[1].codes.clear(),
            Problem::CodebookLength {
                number: 2,
                length: 0,
            },
        ),
        (
            |e, _| e.codebooks[0].codes[3] = i8::MIN,
            Problem::CodebookCode {
                number: 1,
                sample: 3,
            },
        ),
        (|_, m| m.entries.clear(), Problem::ModulationLength(0)),
        (|_, m| m.step_samples = 0, Problem::ModulationStep(0)),
    ];
    for (spoil, problem) in cases {
        let mut textures = sound.clone();
        let parts = &mut textures[1].parts;
        let (excitation, modulation) = (parts.excitation.as_mut(), parts.modulation.as_mut());
        spoil(excitation.expect("full"), modulation.expect("full"));
        let error = encode(&textures).expect_err("a fault");
        assert_eq!((error.place, error.problem), (TEXTURE, problem));
    }
}

proptest! {
    #[test]
    fn mean_squares_are_those_of_the_formulas(
        codes in prop::collection::vec(-127..=127i8, 1..3000), peak in 0.01f32..40.0,
        entries in prop::collection::vec(any::<i8>(), 1..300),
    ) {
        let codebook = CodebookSpec { peak, codes };
        let (found, exact) = (f64::from(codebook.mean_square()), mean_square(&codebook));
        prop_assert!((found - exact).abs() <= 1e-5 * exact + 1e-9);
        let track = ModulationSpec { step_samples: 100, entries };
        let (found, exact) = (f64::from(track.mean_square()), mean_square_as_played(&track));
        prop_assert!((found / exact - 1.0).abs() <= 2e-3, "{found} {exact}");
    }
}
