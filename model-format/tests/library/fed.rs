//! Codebooks and level tracks: the laws of their codes, and what a texture returns about them.

use model_format::{
    BLOCK_BYTES, BLOCK_SAMPLES, CodebookSpec, LEVEL_FRACTION_BITS, Library, MU_LAW_FRACTION_BITS, ModulationSpec,
    PartKind, block_share, level_amplitude, mu_law,
};
use proptest::prelude::*;

use crate::bytes::{RawLibrary, two_codebooks};
use crate::walk::{mean_square, mean_square_as_played, share_of_block};

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

proptest! {
    #[test]
    fn samples_of_blocks_follow_their_formula(
        codes in prop::array::uniform24(any::<u8>()), level in -128..=0i8, index in 0..BLOCK_SAMPLES,
    ) {
        let mut block = [0; BLOCK_BYTES];
        block[..24].copy_from_slice(&codes);
        block[24] = level.cast_unsigned();
        let (found, exact) = (f64::from(block_share(&block, index)), share_of_block(&block, index));
        let exact = exact * 2f64.powi(MU_LAW_FRACTION_BITS as i32);
        // The lowest levels have two digits.
        prop_assert!((found - exact).abs() <= 1e-3 * exact.abs() + 17_000.0, "{found} {exact}");
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
    // Two lines, each with a wavelength, a phase and six amplitudes.
    let lines = (PartKind::Lines, 1 + 2 * (4 + 2 + 6 * 4));
    let wander = (PartKind::Wander, 1 + 2 * 12 + 2);
    assert_eq!(parts(2), [(PartKind::Modulation, 21), lines, wander]);
    let fed: Vec<bool> = library.textures().map(|texture| texture.is_fed()).collect();
    assert_eq!(fed, [false, true, true, false, true]);
    assert_eq!(parts(3), [(PartKind::FineTheta, 6), (PartKind::Tails, 12)]);
    // A count, a length of two bytes, a peak, 16 blocks and six sources.
    let blocks = (PartKind::Excitation, 1 + 2 + 4 + 16 * 25 + 6);
    assert_eq!(parts(4), [blocks, (PartKind::Moments, 2)]);
    assert_eq!(PartKind::Tails.to_string(), "tails");
    assert_eq!(PartKind::Excitation.to_string(), "excitation");
    assert_eq!(PartKind::Modulation.to_string(), "modulation");
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
