//! Codebooks: the laws of their codes, and what a texture returns about them.

use model_format::{
    BLOCK_BYTES, BLOCK_SAMPLES, CodebookSpec, Library, PartKind, SHARE_FRACTION_BITS, block_scale, block_share,
};
use proptest::prelude::*;

use crate::bytes::{RawLibrary, two_codebooks};
use crate::walk::{mean_square, share_of_block};

#[test]
fn levels_are_half_decibels() {
    for level in -128..=0i8 {
        let exact = 10f64.powf(f64::from(level) / 40.0) * 65_536.0;
        let found = f64::from(block_scale(level));
        // The scale is the square of a rounded root.
        assert!(
            (found - exact).abs() <= 1.0 + 1.1 * exact.sqrt() / 256.0,
            "{level}: {found} {exact}"
        );
    }
    assert_eq!((block_scale(0), block_scale(127)), (65_536, 65_536));
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
        let exact = exact * 2f64.powi(SHARE_FRACTION_BITS as i32);
        // The lowest levels have two digits.
        prop_assert!((found - exact).abs() <= 1e-3 * exact.abs() + 17_000.0, "{found} {exact}");
    }

    #[test]
    fn mean_squares_are_those_of_the_formula(
        blocks in prop::collection::vec((prop::array::uniform24(any::<u8>()), -60..=0i8), 1..30), peak in 0.01f32..40.0,
    ) {
        let blocks = blocks.into_iter().flat_map(|(codes, level)| codes.into_iter().chain([level.cast_unsigned()]));
        let codebook = CodebookSpec { peak, blocks: blocks.collect() };
        let (found, exact) = (f64::from(codebook.mean_square()), mean_square(&codebook));
        prop_assert!((found / exact - 1.0).abs() <= 1e-2, "{found} {exact}");
        let unit = CodebookSpec::of_unit_power(codebook.blocks);
        prop_assert!((unit.mean_square() - 1.0).abs() <= 1e-5);
    }
}

#[test]
fn a_texture_lists_its_codebooks_with_their_bytes() {
    let bytes = RawLibrary::full().bytes();
    let library = Library::decode(&bytes).expect("a valid library");
    let parts = |index| -> Vec<(PartKind, usize)> { library.texture_at(index).expect("it is there").parts().collect() };
    let excitation = (PartKind::Excitation, two_codebooks(6).len());
    assert_eq!(parts(1), [(PartKind::Levels, 2), excitation]);
    // Two lines, each with a wavelength, a phase and six amplitudes.
    let lines = (PartKind::Lines, 1 + 2 * (4 + 2 + 6 * 4));
    let wander = (PartKind::Wander, 1 + 2 * 12 + 2);
    assert_eq!(parts(2), [excitation, lines, wander]);
    let fed: Vec<bool> = library.textures().map(|texture| texture.is_fed()).collect();
    assert_eq!(fed, [false, true, true, false]);
    assert_eq!(parts(3), [(PartKind::FineTheta, 6), (PartKind::Tails, 12)]);
    assert_eq!(PartKind::Tails.to_string(), "tails");
    assert_eq!(PartKind::Excitation.to_string(), "excitation");
}
