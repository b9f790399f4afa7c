//! The digest of the fixture on this computer, and what makes it worth comparing.

use kernel_vectors::{DIGESTED, digest_library};
use model_format::{Library, OutputSample, Texture};
use stylus_kernel::arithmetic::Portable;
use stylus_kernel::digest::{DIGEST_WORDS, Digest, Stroke, of_plan};
use stylus_kernel::grid::{GridPoint, ONE};
use stylus_kernel::scene::{ContactDetector, Plan};

fn digest_of(texture: Texture<'_>) -> u32 {
    of_plan::<Portable>(Plan::of_texture(texture)).value()
}

#[test]
fn the_host_plays_the_digest_that_every_platform_must_play() {
    let bytes = digest_library();
    let texture = Library::decode(&bytes).unwrap().texture_at(0).unwrap();
    let digest = digest_of(texture);
    assert_eq!(digest, DIGESTED, "{digest:08x}");
}

#[test]
fn a_part_that_is_left_out_changes_the_digest() {
    let bytes = digest_library();
    let texture = Library::decode(&bytes).unwrap().texture_at(0).unwrap();
    let others = [
        texture.without_codebooks(),
        texture.without_track(),
        texture.without_lines(),
    ];
    for other in others {
        assert_ne!(digest_of(other), DIGESTED);
    }
}

#[test]
fn one_bit_of_one_word_changes_a_digest() {
    let digest = |words: [i32; 4]| {
        let mut digest = Digest::default();
        words
            .into_iter()
            .for_each(|word| digest.add(OutputSample(word)));
        digest.value()
    };
    let whole = digest([3, -4, 5, 0]);
    for place in 0..4 {
        for bit in 0..32 {
            let mut words = [3, -4, 5, 0];
            words[place] ^= 1 << bit;
            assert_ne!(digest(words), whole, "word {place}, bit {bit}");
        }
    }
}

/// The stroke rests, reverses, lifts off, and comes to nodes' cells, to edges and beyond them.
#[test]
fn the_stroke_reaches_all_of_a_grid() {
    let bytes = digest_library();
    let texture = Library::decode(&bytes).unwrap().texture_at(0).unwrap();
    let mut detector = ContactDetector::new();
    let (mut seen, mut rests, mut lifts, mut backward, mut inner) = (0u32, 0, 0, 0, 0);
    for block in 0..DIGEST_WORDS / 10 {
        let stroke = Stroke::at(block, 5000);
        let interaction = stroke.interaction(&mut detector);
        let point = GridPoint::locate(&texture, interaction.motion);
        for ((speed, force), weight) in point.nodes.into_iter().zip(point.weights) {
            if weight > 0 {
                seen |= 1 << (speed * texture.force_axis().len() + force);
            }
        }
        rests += u32::from(stroke.speed_mm_s == 0.0 && interaction.contact);
        lifts += u32::from(!interaction.contact);
        backward += u32::from(stroke.speed_mm_s < 0.0);
        inner += u32::from(point.weights.iter().all(|&weight| weight > 0) && point.fade == ONE);
    }
    assert_eq!(seen, 0b11_1111, "nodes with a weight: {seen:b}");
    for count in [rests, lifts, backward, inner] {
        assert!(count > 10, "{rests} {lifts} {backward} {inner}");
    }
}

/// The position is the integral of the speed, which is constant in a block.
#[test]
fn a_block_begins_where_the_speed_of_the_one_before_ends() {
    for block in 0..1600 {
        let (now, next) = (Stroke::at(block, 5000), Stroke::at(block + 1, 5000));
        let expected = now.begin_mm + f64::from(now.speed_mm_s) * 0.002;
        assert!((next.begin_mm - expected).abs() < 1e-9, "{block}");
        let last = now.begin_mm + f64::from(now.speed_mm_s) * 0.0018;
        assert!((now.end_mm - last).abs() < 1e-9, "{block}");
    }
}
