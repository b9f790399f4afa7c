//! Fed textures: excitation that comes from codebooks of recorded snippets.

use model_format::{
    BLOCK_BYTES, BLOCK_MAGNITUDES, BLOCK_SAMPLES, CodeSpec, CodebookSpec, ExcitationSpec, NodeSpec, OutputSample,
    PartsSpec, Texture, TextureSpec, block_share, encode,
};
use proptest::prelude::*;
use stylus_kernel::excitation::Excitation;
use stylus_kernel::feed::{FED_FRACTION_BITS, Feed, Material};
use stylus_kernel::grid::GridPoint;
use stylus_kernel::{MAX_FED_SAMPLES, Synthesis};

use crate::models::{fixture, motion, texture, texture_of};

/// One standard deviation of a fed excitation.
pub const SIGMA: f64 = (1u32 << FED_FRACTION_BITS) as f64;

/// Gaussian numbers of unit variance, from which tests make codebooks.
pub fn gaussian(seed: u64) -> impl Iterator<Item = f64> {
    let mut source = Excitation::new(seed);
    std::iter::repeat_with(move || f64::from(source.next_sample()) / 2f64.powi(28))
}

/// The codebook of `samples`, each with the nearest magnitude in a block at the level of its peak, scaled to a mean
/// square of 1. Zeros have either sign in turn.
pub fn codebook(samples: &[f64]) -> CodebookSpec {
    let peak_of = |samples: &[f64]| samples.iter().fold(0.0, |peak: f64, x| peak.max(x.abs()));
    let peak = peak_of(samples);
    let mut blocks = Vec::new();
    for block in samples.chunks_exact(BLOCK_SAMPLES) {
        let level = (40.0 * (peak_of(block) / peak).log10()).ceil().max(-128.0);
        let unit = peak * 10f64.powf(level / 40.0) / 16_384.0;
        let code = |(n, x): (usize, &f64)| {
            let off = |k: &usize| (x.abs() / unit - f64::from(BLOCK_MAGNITUDES[*k])).abs();
            let nearest = (0..4).min_by(|a, b| off(a).total_cmp(&off(b))).unwrap();
            let is_negative = *x < 0.0 || (*x == 0.0 && n % 2 == 0);
            nearest + if is_negative { 4 } else { 0 }
        };
        let codes: Vec<usize> = block.iter().enumerate().map(code).collect();
        for eight in codes.chunks_exact(8) {
            let bits = eight.iter().rev().fold(0, |bits, code| bits << 3 | *code as u32);
            blocks.extend_from_slice(&bits.to_le_bytes()[..3]);
        }
        blocks.push((level as i8).cast_unsigned());
    }
    CodebookSpec::of_unit_power(blocks)
}

/// Samples of a codebook, in standard deviations.
pub fn values(codebook: &CodebookSpec) -> Vec<f64> {
    codebook
        .blocks
        .as_chunks::<BLOCK_BYTES>()
        .0
        .iter()
        .flat_map(|block| (0..BLOCK_SAMPLES).map(|n| block_share(block, n)))
        .map(|share| f64::from(codebook.peak) * f64::from(share) / 2f64.powi(30))
        .collect()
}

/// Independent samples with a kurtosis of 27: a Gaussian number times 0.3 plus the square of another. The second half
/// is the first half negated, so that there is no mean.
pub fn impulsive(samples: usize) -> CodebookSpec {
    let pairs: Vec<f64> = gaussian(1).take(samples).collect();
    let half: Vec<f64> = pairs.chunks(2).map(|x| x[0] * (0.3 + x[1].powi(2))).collect();
    let negated = half.iter().map(|x| -x);
    codebook(&half.iter().copied().chain(negated).collect::<Vec<_>>())
}

/// Impulses of 37 standard deviations, one in 1792 samples, and little else.
pub fn spikes() -> CodebookSpec {
    let samples: Vec<f64> = (0..10_752)
        .map(|n| f64::from(u8::from(n % 1792 == 500)) * if n % 3584 < 1792 { 1.0 } else { -1.0 })
        .collect();
    codebook(&samples)
}

/// A codebook of ones of either sign in turn, in blocks of these levels.
pub fn alternating(levels: impl IntoIterator<Item = i8>) -> CodebookSpec {
    let mut blocks = Vec::new();
    for level in levels {
        // Codes of three bits: 3, the highest magnitude, and 7, its negative.
        blocks.extend([0xfb, 0xbe, 0xef].repeat(8));
        blocks.push(level.cast_unsigned());
    }
    CodebookSpec::of_unit_power(blocks)
}

/// Codebooks with these numbers at the nodes; 0 is Gaussian noise.
pub fn of(codebooks: Vec<CodebookSpec>, of_nodes: [u8; 4]) -> PartsSpec {
    PartsSpec {
        excitation: Some(ExcitationSpec {
            codebooks,
            of_nodes: of_nodes.to_vec(),
        }),
        ..PartsSpec::default()
    }
}

/// The parts of textures of four nodes: a codebook at all of them, and one beside noise.
pub fn all_parts() -> [PartsSpec; 2] {
    [
        of(vec![impulsive(4096)], [1; 4]),
        of(vec![impulsive(3072)], [1, 0, 0, 1]),
    ]
}

fn fed(spec: TextureSpec, parts: PartsSpec) -> TextureSpec {
    TextureSpec { parts, ..spec }
}

/// A model of order 400 at four nodes, fed by `parts`.
pub fn fed_h3(parts: PartsSpec) -> TextureSpec {
    fed(texture_of("fed", &fixture("H3").node(4.0)), parts)
}

/// A texture that puts out its excitation at an RMS of 1 m/s².
pub fn bare(parts: PartsSpec) -> TextureSpec {
    let node = NodeSpec::new(1.0, CodeSpec::lattice(Vec::new()));
    fed(texture_of("bare", &node), parts)
}

/// A library of a texture whose output is only its excitation of these codebooks.
pub fn bare_of(codebooks: Vec<CodebookSpec>, of_nodes: [u8; 4]) -> Vec<u8> {
    encoded(bare(of(codebooks, of_nodes)))
}

pub fn encoded(spec: TextureSpec) -> Vec<u8> {
    encode(&[spec]).expect("a valid library")
}

/// Excitation of a fed texture, in standard deviations.
pub fn excitation(texture: &Texture<'_>, seed: u64) -> impl Iterator<Item = f64> {
    let material = Material::of(texture);
    let point = GridPoint::locate(texture, motion(75.0, 0.75));
    let mut feed = Feed::new(seed);
    std::iter::repeat_with(move || f64::from(feed.next_sample(&material, &point)) / SIGMA)
}

fn mean(values: impl IntoIterator<Item = f64>) -> f64 {
    let (sum, count) = values
        .into_iter()
        .fold((0.0, 0.0), |(sum, count), x| (sum + x, count + 1.0));
    sum / count
}

pub fn mean_square(samples: &[f64]) -> f64 {
    mean(samples.iter().map(|x| x * x))
}

/// Returns the mean and its standard deviation, from means over blocks that are long enough to be independent.
fn mean_with_error(values: &[f64], block: usize) -> (f64, f64) {
    let means: Vec<f64> = values
        .chunks_exact(block)
        .map(|one| mean(one.iter().copied()))
        .collect();
    let all = mean(means.iter().copied());
    let variance = mean(means.iter().map(|x| (x - all).powi(2)));
    (all, (variance / (means.len() - 1) as f64).sqrt())
}

pub fn decibels(power: f64) -> f64 {
    10.0 * power.log10()
}

/// Samples of a synthesis of `texture`, m/s².
fn played(texture: Texture<'_>, seed: u64, blocks: u32) -> (Vec<f64>, u32) {
    let mut synthesis: Synthesis<'_> = Synthesis::new(texture, seed);
    let mut samples = Vec::new();
    for _ in 0..blocks {
        synthesis.follow(motion(75.0, 0.75), 10);
        let block = (0..10).map(|_| synthesis.next_sample().metres_per_second_squared().0);
        samples.extend(block.map(f64::from));
    }
    (samples, synthesis.saturations())
}

#[test]
fn a_fed_texture_has_the_level_of_its_node() {
    let plain = encoded(fed_h3(PartsSpec::default()));
    let (samples, _) = played(texture(&plain), 3, 60_000);
    let plain = mean_square(&samples[5000..]);
    for parts in all_parts() {
        let bytes = encoded(fed_h3(parts));
        let (samples, saturations) = played(texture(&bytes), 3, 60_000);
        let level_db = decibels(mean_square(&samples[5000..]) / plain);
        assert!(level_db.abs() < 0.6, "{level_db} dB");
        assert_eq!(saturations, 0);
    }
}

/// The magnitude of each sample shows its block, and that it is none of the noise of the other nodes.
#[test]
fn snippets_go_on_where_their_codebook_was_left() {
    const BLOCKS: usize = 30;
    const PASSES: usize = 160;
    let pass = BLOCKS * BLOCK_SAMPLES;
    let codebook = alternating((0..BLOCKS as i8).map(|n| -n));
    let peak = f64::from(codebook.peak);
    let bytes = bare_of(vec![codebook], [1, 0, 1, 0]);
    let block_of = |x: f64| {
        let level = -40.0 * (x.abs() / peak).log10();
        let is_near = (level - level.round()).abs() < 1e-3 && (0.0..BLOCKS as f64).contains(&level.round());
        is_near.then_some(level.round() as usize)
    };
    let texture = texture(&bytes);
    let blocks: Vec<Option<usize>> = excitation(&texture, 7).take(PASSES * pass).map(block_of).collect();
    // A sample of noise has such a magnitude once in a while, but not ten in a row.
    let is_own: Vec<bool> = blocks.windows(10).map(|ten| ten.iter().all(Option::is_some)).collect();
    let changes = is_own.windows(2).filter(|pair| pair[0] != pair[1]).count();
    // Half of the weight belongs to the codebook; a snippet takes 600 to 2400 samples.
    let expected = PASSES * pass / 1500 / 2;
    assert!(changes.abs_diff(expected) < expected / 4, "{changes} of {expected}");
    let mut own = Vec::new();
    for (n, block) in blocks.iter().enumerate() {
        // Each sample that is in ten of the codebook's in a row.
        if is_own[n.saturating_sub(9).min(is_own.len() - 1)..=n.min(is_own.len() - 1)]
            .iter()
            .any(|own| *own)
        {
            own.extend(*block);
        }
    }
    let is_jump = |pair: &[usize]| pair[1] != pair[0] && pair[1] != (pair[0] + 1) % BLOCKS;
    let jumps: Vec<usize> = (1..own.len()).filter(|&n| is_jump(&own[n - 1..=n])).collect();
    let apart = jumps.windows(2).map(|pair| pair[1] - pair[0]);
    // Of a pass's eight joints, one leads to the part that follows anyway.
    let expected = own.len() * 7 / pass;
    let count = jumps.len();
    assert!(count.abs_diff(expected) <= expected / 20, "{count} of {expected}");
    assert!(apart.min().unwrap() + 20 >= pass / 8);
    let share = |block: usize| own.iter().filter(|&&n| n == block).count() * BLOCKS;
    assert!((0..BLOCKS).all(|block| (0.5..1.5).contains(&(share(block) as f64 / own.len() as f64))));
}

#[test]
fn each_pass_plays_every_sample_once_in_an_order_of_its_own() {
    let codebook = impulsive(4096);
    let sorted = |pass: &[f64]| {
        let mut pass = pass.to_vec();
        pass.sort_by(f64::total_cmp);
        pass
    };
    let all = sorted(&values(&codebook));
    let bytes = bare_of(vec![codebook], [1; 4]);
    let signal: Vec<f64> = excitation(&texture(&bytes), 7).take(50 * all.len()).collect();
    let passes: Vec<&[f64]> = signal.chunks(all.len()).collect();
    for (n, pass) in passes.iter().enumerate() {
        let off = sorted(pass)
            .iter()
            .zip(&all)
            .map(|(a, b)| (a - b).abs())
            .fold(0.0, f64::max);
        assert!(off < 1e-6, "pass {n}: {off}");
        // Independent orders share an eighth of their places in the mean.
        for other in &passes[..n] {
            let same = other.iter().zip(*pass).filter(|(a, b)| a == b).count();
            assert!(same < all.len() * 3 / 4, "pass {n}: {same}");
        }
    }
}

/// Plays 20 minutes, in blocks of several passes of a codebook, which are independent.
#[test]
fn an_excitation_has_a_variance_of_one_and_no_mean() {
    for parts in all_parts() {
        let codebook = values(&parts.excitation.as_ref().unwrap().codebooks[0]);
        assert!((mean_square(&codebook) - 1.0).abs() < 1e-3);
        let bytes = encoded(bare(parts));
        let signal: Vec<f64> = excitation(&texture(&bytes), 7).take(6_000_000).collect();
        let squares: Vec<f64> = signal.iter().map(|x| x * x).collect();
        let (power, error) = mean_with_error(&squares, 20_000);
        assert!((power - 1.0).abs() < 4.5 * error && error < 0.01, "{power} {error}");
        let (mean, error) = mean_with_error(&signal, 20_000);
        assert!(mean.abs() < 4.5 * error && error < 0.01, "{mean} {error}");
    }
}

/// Ones at one node, ones of two levels at another, noise at two: the magnitude of a sample shows its node.
#[test]
fn the_codebook_of_a_snippet_is_drawn_by_the_weights_of_the_nodes() {
    let two_levels = alternating((0..20).map(|n| -40 * (n % 2)));
    let magnitudes = [
        vec![1.0],
        values(&two_levels)[..=BLOCK_SAMPLES].iter().map(|x| x.abs()).collect(),
    ];
    let bytes = bare_of(vec![alternating([0; 16]), two_levels], [1, 2, 0, 0]);
    let texture = texture(&bytes);
    // The grid spans 50 to 100 mm/s and 0.5 to 1 N.
    let (speed, force) = (65.0, 0.625);
    let weights = [0.7 * 0.75, 0.7 * 0.25];
    let material = Material::of(&texture);
    let point = GridPoint::locate(&texture, motion(speed, force));
    let mut feed = Feed::new(4);
    let mut samples = [0.0; 2];
    let count = 6_000_000;
    for _ in 0..count {
        let sample = (f64::from(feed.next_sample(&material, &point)) / SIGMA).abs();
        for (found, own) in samples.iter_mut().zip(&magnitudes) {
            *found += f64::from(u8::from(own.iter().any(|x| (x - sample).abs() < 1e-6)));
        }
    }
    for (found, weight) in samples.iter().zip(weights) {
        let share = found / f64::from(count);
        let bound = 4.5 * (weight * (1.0 - weight) * 1.2 * 1500.0 / f64::from(count)).sqrt();
        assert!((share - weight).abs() < bound, "{share} of {weight} within {bound}");
    }
    // At a single node, at the edge and beyond it, only that node's codebook is heard.
    let beyond = GridPoint::locate(&texture, motion(20.0, 0.1));
    let mut feed = Feed::new(4);
    let mut alone = (0..100_000).map(|_| f64::from(feed.next_sample(&material, &beyond)) / SIGMA);
    assert!(alone.all(|x| (x.abs() - 1.0).abs() < 1e-6));
}

#[test]
fn noise_beside_codebooks_is_that_of_the_seed_without_them() {
    let bytes = bare_of(vec![alternating([0; 16])], [0, 0, 1, 1]);
    let texture = texture(&bytes);
    let (material, slow) = (Material::of(&texture), GridPoint::locate(&texture, motion(50.0, 0.7)));
    let mut feed = Feed::new(21);
    for noise in gaussian(21).take(20_000) {
        let sample = f64::from(feed.next_sample(&material, &slow)) / SIGMA;
        assert!((sample - noise).abs() <= 0.51 / SIGMA, "{sample} for {noise}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// After a late update the filter has no more excitation, so that its energy falls; without a filter there is
    /// silence.
    #[test]
    fn without_an_update_the_excitation_ends(seed: u64, which in 0usize..2, samples in 1u32..=MAX_FED_SAMPLES as u32) {
        let bytes = encoded(bare(all_parts()[which].clone()));
        let mut synthesis: Synthesis<'_> = Synthesis::new(texture(&bytes), seed);
        synthesis.follow(motion(75.0, 0.75), samples);
        for _ in 0..samples {
            synthesis.next_sample();
        }
        let mut on_time = synthesis.clone();
        prop_assert!((0..500).all(|_| synthesis.next_sample() == OutputSample::SILENCE));
        // It continues as if nothing had been missed.
        for one in [&mut synthesis, &mut on_time] {
            one.follow(motion(75.0, 0.75), 10);
        }
        for _ in 0..10 {
            prop_assert_eq!(synthesis.next_sample(), on_time.next_sample());
        }
    }
}
