//! Fed textures: excitation that comes from codebooks of the residual, or follows a level track, or both.

use std::f64::consts::{FRAC_PI_2, LN_2, LN_10};

use model_format::{
    BLOCK_SAMPLES, CodeSpec, CodebookSpec, ExcitationSpec, ModulationSpec, NodeSpec, OutputSample, PartsSpec, Texture,
    TextureSpec, encode,
};
use proptest::prelude::*;
use stylus_kernel::excitation::Excitation;
use stylus_kernel::feed::{FED_FRACTION_BITS, Feed, Material};
use stylus_kernel::grid::GridPoint;
use stylus_kernel::{MAX_FED_SAMPLES, Synthesis};

use crate::models::{fixture, motion, texture};
use crate::scenes::texture_of;

/// One standard deviation of a fed excitation.
pub const SIGMA: f64 = (1u32 << FED_FRACTION_BITS) as f64;

/// Gaussian numbers of unit variance, from which tests make codebooks and tracks.
pub fn gaussian(seed: u64) -> impl Iterator<Item = f64> {
    let mut source = Excitation::new(seed);
    std::iter::repeat_with(move || f64::from(source.next_sample()) / 2f64.powi(28))
}

/// The codebook of `samples`, scaled to a mean square of 1, by the formula of the format in floating point.
pub fn codebook(samples: &[f64]) -> CodebookSpec {
    let peak = samples.iter().fold(0.0, |peak: f64, x| peak.max(x.abs()));
    let code = |x: &f64| {
        let magnitude = (1.0 + 255.0 * x.abs() / peak).ln() / (8.0 * LN_2) * 127.0;
        x.signum() as i8 * magnitude.round() as i8
    };
    let codes: Vec<i8> = samples.iter().map(code).collect();
    let square: f64 = codes.iter().map(|&code| share(code).powi(2)).sum();
    let peak = (codes.len() as f64 / square).sqrt() as f32;
    CodebookSpec { peak, codes }
}

/// Value of a code as a fraction of the peak, by the formula of the format in floating point.
fn share(code: i8) -> f64 {
    let magnitude = ((8.0 * LN_2 * f64::from(code.unsigned_abs()) / 127.0).exp() - 1.0) / 255.0;
    f64::from(code.signum()) * magnitude
}

/// Samples of a codebook, in standard deviations.
pub fn values(codebook: &CodebookSpec) -> Vec<f64> {
    let peak = f64::from(codebook.peak);
    codebook.codes.iter().map(|&c| peak * share(c)).collect()
}

/// Independent samples with a kurtosis of 27: a Gaussian number times 0.3 plus the square of another.
pub fn impulsive(samples: usize) -> CodebookSpec {
    let pairs: Vec<f64> = gaussian(1).take(2 * samples).collect();
    let samples = pairs.chunks(2).map(|x| x[0] * (0.3 + x[1].powi(2)));
    let samples: Vec<f64> = samples.collect();
    codebook(&samples)
}

/// Nothing but impulses of 32 standard deviations, one in 1024 samples.
pub fn spikes() -> CodebookSpec {
    let samples: Vec<f64> = (0..8192)
        .map(|n| f64::from(u8::from(n % 1024 == 500)) * if n % 2048 < 1024 { 1.0 } else { -1.0 })
        .collect();
    codebook(&samples)
}

/// A level track of `entries` entries, `step_samples` apart, with a spread of `db` and a correlation over some entries.
pub fn track(step_samples: u16, entries: usize, db: f64) -> ModulationSpec {
    let mut level = 0.0;
    let levels: Vec<f64> = gaussian(2)
        .take(entries)
        .map(|x| {
            level = 0.8 * level + 0.6 * x;
            level * db
        })
        .collect();
    let spec = |shift: f64| ModulationSpec {
        step_samples,
        entries: levels.iter().map(|l| (4.0 * (l + shift)).round() as i8).collect(),
    };
    let mean = |shift: f64| f64::from(spec(shift).mean_square());
    let shift = -10.0 * mean(0.0).log10();
    spec(shift - 10.0 * mean(shift).log10())
}

/// Codebook 1 at all `nodes`.
pub fn everywhere(codebook: CodebookSpec, nodes: usize) -> ExcitationSpec {
    ExcitationSpec {
        codebooks: vec![codebook],
        of_nodes: vec![1; nodes],
        moment_samples: None,
    }
}

/// The parts of a texture of four nodes: a codebook, a track, or both.
pub fn all_parts() -> [PartsSpec; 3] {
    let excitation = Some(everywhere(impulsive(4000), 4));
    let modulation = Some(track(100, 200, 4.0));
    let both = PartsSpec {
        excitation,
        modulation,
        lines: None,
    };
    [
        PartsSpec {
            modulation: None,
            ..both.clone()
        },
        PartsSpec {
            excitation: None,
            ..both.clone()
        },
        both,
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

/// A library of a texture whose output is only its excitation of codebooks, with these numbers of its four nodes.
fn bare_of(codebooks: Vec<CodebookSpec>, of_nodes: [u8; 4]) -> Vec<u8> {
    let excitation = ExcitationSpec {
        codebooks,
        of_nodes: of_nodes.to_vec(),
        moment_samples: None,
    };
    encoded(bare(PartsSpec {
        excitation: Some(excitation),
        ..PartsSpec::default()
    }))
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

/// A piece of the excitation of [`steady`]: the sample at which it fades in, and its sign.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Join {
    at: usize,
    negative: bool,
}

/// A codebook of ones, so that signs and joins are visible.
pub fn steady() -> CodebookSpec {
    let codes = vec![127; 1000];
    CodebookSpec { peak: 1.0, codes }
}

/// Samples of a cross-fade at 5 kHz, and range of samples between the beginnings of pieces.
const FADE: usize = 25;
const PIECES: std::ops::RangeInclusive<usize> = 100..=400;

/// Finds the pieces in `signal`, which is the excitation of [`steady`]. Each must be ±1 after a cross-fade of cosine
/// and sine.
fn joins(signal: &[f64]) -> Vec<Join> {
    let mut joins = vec![Join {
        at: 0,
        negative: signal[0] < 0.0,
    }];
    let mut n = 1;
    while n + FADE < signal.len() {
        let before = if joins[joins.len() - 1].negative { -1.0 } else { 1.0 };
        if (signal[n] - before).abs() < 1e-6 {
            n += 1;
            continue;
        }
        let after = signal[n + FADE].signum();
        for (step, &found) in signal[n..n + FADE].iter().enumerate() {
            let angle = (step as f64 + 0.5) / FADE as f64 * FRAC_PI_2;
            let expected = angle.cos() * before + angle.sin() * after;
            assert!((found - expected).abs() < 1e-6, "{found} for {expected} at {step}");
        }
        joins.push(Join {
            at: n,
            negative: after < 0.0,
        });
        n += FADE;
    }
    joins
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

/// Plays 120 s, over which a track's level has a standard deviation of 0.1 dB.
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

#[test]
fn pieces_take_20_to_80_ms_of_either_sign_and_are_joined_by_cosine_and_sine() {
    let bytes = bare_of(vec![steady()], [1; 4]);
    let signal: Vec<f64> = excitation(&texture(&bytes), 5).take(3_000_000).collect();
    let joins = joins(&signal);
    // Neighbours of equal sign are cross-faded too, and show a swell.
    let lengths = joins.windows(2).map(|pair| pair[1].at - pair[0].at);
    let lengths: Vec<usize> = lengths.collect();
    assert!(lengths.iter().all(|length| PIECES.contains(length)));
    assert_eq!(lengths.iter().min(), Some(PIECES.start()));
    assert_eq!(lengths.iter().max(), Some(PIECES.end()));
    let count = lengths.len() as f64;
    // Uniform over 301 lengths, of mean 250 and standard deviation 86.9.
    let average = mean(lengths.iter().map(|&length| length as f64));
    assert!((average - 250.0).abs() < 4.5 * 86.9 / count.sqrt(), "{average}");
    uniform(lengths.iter().map(|length| (length - 100) * 10 / 301), 10);
    // The sign of a piece is independent of the previous one.
    let turned = |pair: &&[Join]| pair[0].negative != pair[1].negative;
    let turns = joins.windows(2).filter(turned).count();
    let negative = joins.iter().filter(|join| join.negative).count();
    for half in [negative, turns].map(|half| half as f64) {
        let off = (half / count - 0.5).abs();
        assert!(off < 4.5 * 0.5 / count.sqrt(), "{half} of {count}");
    }
}

/// A codebook in blocks of ones, or of minus ones, at these levels, scaled to unit power.
pub fn blocks_of_ones(is_negative: bool, levels: impl Iterator<Item = i8>) -> CodebookSpec {
    // Each code of three bits is 3, the highest magnitude, with the minus as its third bit.
    let codes = if is_negative { 0o7777_7777_u32 } else { 0o3333_3333 };
    let [a, b, c, _] = codes.to_le_bytes().map(u8::cast_signed);
    let block = |level| [[a, b, c].repeat(8), vec![level]].concat();
    let codes = levels.flat_map(block).collect();
    let mut codebook = CodebookSpec { peak: 1.0, codes };
    codebook.peak = codebook.mean_square_of_blocks().sqrt().recip();
    codebook
}

/// A library of a texture whose output is only snippets of these codebooks, by their numbers at its four nodes.
pub fn bare_of_snippets(codebooks: Vec<CodebookSpec>, of_nodes: [u8; 4]) -> Vec<u8> {
    encoded(bare(PartsSpec {
        excitation: Some(ExcitationSpec {
            codebooks,
            of_nodes: of_nodes.to_vec(),
            moment_samples: Some(1000),
        }),
        ..PartsSpec::default()
    }))
}

/// The sign of each sample shows its codebook, and the level its block.
#[test]
fn snippets_go_on_where_their_codebook_was_left_and_it_jumps_once_per_pass() {
    const BLOCKS: usize = 60;
    let pass = BLOCKS * BLOCK_SAMPLES;
    let codebooks = [false, true].map(|is_negative| blocks_of_ones(is_negative, (0..BLOCKS as i8).map(|n| -n)));
    let peak = f64::from(codebooks[0].peak);
    let bytes = bare_of_snippets(codebooks.to_vec(), [1, 2, 1, 2]);
    let signal: Vec<f64> = excitation(&texture(&bytes), 7).take(80 * pass).collect();
    // Half of the weight belongs to each codebook; a snippet takes 600 to 2400 samples.
    let changes = signal.windows(2).filter(|pair| pair[0] * pair[1] < 0.0).count();
    let expected = 80 * pass / 1500 / 2;
    assert!(changes.abs_diff(expected) < expected / 4, "{changes} of {expected}");
    for sign in [1.0, -1.0] {
        let own = signal.iter().map(|x| x * sign).filter(|x| *x > 0.0);
        let blocks: Vec<usize> = own.map(|x| (-40.0 * (x / peak).log10()).round() as usize).collect();
        let is_jump = |pair: &[usize]| pair[1] != pair[0] && pair[1] != (pair[0] + 1) % BLOCKS;
        let jumps: Vec<usize> = (1..blocks.len()).filter(|&n| is_jump(&blocks[n - 1..=n])).collect();
        let apart = jumps.windows(2).map(|pair| pair[1] - pair[0]);
        // Two of sixty places are those that would follow anyway.
        assert!(jumps.len().abs_diff(blocks.len() / pass) <= 6, "{}", jumps.len());
        assert!(apart.min().unwrap() >= pass / 2);
        let share = |block: usize| blocks.iter().filter(|&&n| n == block).count() * BLOCKS;
        assert!((0..BLOCKS).all(|block| (0.5..1.5).contains(&(share(block) as f64 / blocks.len() as f64))));
    }
}

/// Checks that `bins` are uniform on 0 to `count` - 1, by a χ² test at a level that is exceeded by chance once in a
/// million.
fn uniform(bins: impl Iterator<Item = usize>, count: usize) {
    let mut counts = vec![0.0; count];
    for bin in bins {
        counts[bin] += 1.0;
    }
    let expected = counts.iter().sum::<f64>() / count as f64;
    let square: f64 = counts.iter().map(|found| (found - expected).powi(2) / expected).sum();
    let degrees = (count - 1) as f64;
    // The cube root of χ² over its degrees of freedom is nearly Gaussian (Wilson and Hilferty, 1931).
    let spread = 2.0 / (9.0 * degrees);
    let z = ((square / degrees).cbrt() - (1.0 - spread)) / spread.sqrt();
    assert!(z < 4.75, "{counts:?}: {z} standard deviations");
}

/// The magnitude of a code shows its place in the codebook: eight samples have each magnitude.
#[test]
fn pieces_begin_anywhere_in_a_codebook_and_go_on_at_its_beginning_after_its_end() {
    let samples: Vec<f64> = (0..1024).map(|n| share((n / 8) as i8)).collect();
    let codebook = codebook(&samples);
    let values = values(&codebook);
    let [bytes, steady] = [codebook, steady()].map(|one| bare_of(vec![one], [1; 4]));
    let count = 3_000_000;
    let signal: Vec<f64> = excitation(&texture(&bytes), 6).take(count).collect();
    // Choices do not depend on the content of a codebook. The codebook of ones is shorter, but the relative places are
    // the same.
    let ones: Vec<f64> = excitation(&texture(&steady), 6).take(count).collect();
    let joins = joins(&ones);
    let mut starts = Vec::new();
    let mut wrapped = 0;
    for pair in joins.windows(2) {
        // The samples of one piece only, after its cross-fade and before the next.
        let alone = &signal[pair[0].at + FADE..pair[1].at];
        let near = |a: f64, b: f64| (a - b).abs() < 1e-5;
        let sign = if pair[0].negative { -1.0 } else { 1.0 };
        let fits = (0..1024).filter(|begin| {
            let places = (0..alone.len()).map(|n| (begin + n) % 1024);
            places.zip(alone).all(|(place, &x)| near(sign * values[place], x))
        });
        let fits: Vec<usize> = fits.collect();
        let [begin] = fits[..] else {
            panic!("{} places fit {} samples", fits.len(), alone.len());
        };
        starts.push((begin + 1024 - FADE) % 1024);
        wrapped += usize::from(begin + alone.len() > 1024);
    }
    assert!(wrapped > starts.len() / 10, "{wrapped}");
    uniform(starts.into_iter().skip(1).map(|start| start / 64), 16);
}

/// Plays 20 minutes. A piece takes at most 400 samples and a piece of a track 5000, so that means over 2 and 10 s are
/// independent.
#[test]
fn an_excitation_has_a_variance_of_one_and_no_mean() {
    for (parts, block) in all_parts().into_iter().zip([10_000, 50_000, 50_000]) {
        let bytes = encoded(bare(parts.clone()));
        let texture = texture(&bytes);
        let signal: Vec<f64> = excitation(&texture, 7).take(6_000_000).collect();
        let squares: Vec<f64> = signal.iter().map(|x| x * x).collect();
        let (power, error) = mean_with_error(&squares, block);
        // The mean squares of the parts as they are stored, which may differ from 1 by 2 %.
        let codebooks = parts.excitation.iter().flat_map(|spec| &spec.codebooks);
        let source: f64 = codebooks.map(|codebook| mean_square(&values(codebook))).product();
        let level = parts
            .modulation
            .as_ref()
            .map_or(1.0, |track| f64::from(track.mean_square()));
        // Joins of a track's pieces go between entries that are not neighbours, which reduces the power by up to 0.5 %.
        assert!((power - source * level).abs() < 4.5 * error + 0.005, "{power} {error}");
        assert!(error < 0.02, "{error}");
        let (mean, error) = mean_with_error(&signal, block);
        assert!(mean.abs() < 4.5 * error, "{mean} {error}");
    }
}

/// Returns the levels of a track as the quotient of the fed excitation and the same noise without the track.
fn levels_of(track: &ModulationSpec, seed: u64, samples: usize) -> Vec<f64> {
    let parts = PartsSpec {
        modulation: Some(track.clone()),
        ..PartsSpec::default()
    };
    let bytes = encoded(bare(parts));
    let noise = gaussian(seed);
    let texture = texture(&bytes);
    let pairs = excitation(&texture, seed).zip(noise).take(samples);
    // Where the noise is near zero its steps are coarse, so those samples have no level.
    pairs
        .map(|(fed, noise)| if noise.abs() > 0.01 { fed / noise } else { f64::NAN })
        .collect()
}

/// Value of an entry of a track by the formula of the format.
fn amplitude(entry: i8) -> f64 {
    (LN_10 * f64::from(entry) / 80.0).exp()
}

#[test]
fn a_level_track_multiplies_the_noise_of_the_same_seed_in_straight_lines_between_its_entries() {
    let track = track(100, 200, 4.0);
    let amplitudes = track.entries.iter().map(|&entry| amplitude(entry));
    let amplitudes: Vec<f64> = amplitudes.collect();
    let levels = levels_of(&track, 11, 500_000);
    // The played entries: within each step, the fitted line gives the level at its beginning and at its end.
    let mut played = Vec::new();
    for step in levels.chunks_exact(100) {
        let known: Vec<(f64, f64)> = step
            .iter()
            .enumerate()
            .filter(|(_, level)| level.is_finite())
            .map(|(n, &level)| (n as f64 / 100.0, level))
            .collect();
        // The least-squares line.
        let (x, y) = (mean(known.iter().map(|p| p.0)), mean(known.iter().map(|p| p.1)));
        let slope = known.iter().map(|p| (p.0 - x) * (p.1 - y)).sum::<f64>()
            / known.iter().map(|p| (p.0 - x).powi(2)).sum::<f64>();
        for &(at, level) in &known {
            assert!((level - (y + slope * (at - x))).abs() < 1e-3 * level.max(0.1));
        }
        played.push((y - slope * x, y + slope * (1.0 - x)));
    }
    for pair in played.windows(2) {
        assert!((pair[0].1 - pair[1].0).abs() < 2e-3, "a step in level");
    }
    // The entries follow each other as in the track, except at the beginnings of pieces.
    let index = |level: f64| -> Vec<usize> {
        (0..amplitudes.len())
            .filter(|&n| (amplitudes[n] - level).abs() < 3e-3)
            .collect()
    };
    let mut lengths = Vec::new();
    let mut at = index(played[0].0);
    let mut length = 1;
    for &(_, level) in &played {
        let next: Vec<usize> = at.iter().map(|n| (n + 1) % amplitudes.len()).collect();
        let here = index(level);
        assert!(!here.is_empty(), "{level} is no entry");
        at = here.iter().copied().filter(|n| next.contains(n)).collect();
        length += 1;
        if at.is_empty() {
            lengths.push(length - 1);
            (at, length) = (here, 1);
        }
    }
    // 0.2 to 1 s in entries of 20 ms. If an entry matches by chance, a join is missed or misplaced.
    let fits = lengths.iter().filter(|length| (10..=50).contains(*length));
    let fits = fits.count();
    assert!(fits * 20 > lengths.len() * 19, "{lengths:?}");
    assert!(lengths.iter().all(|&length| length <= 101));
}

/// Ones at one node, sparse impulses at another, noise at two: the values of a piece show its node.
#[test]
fn the_codebook_of_a_piece_is_drawn_by_the_weights_of_the_nodes() {
    let sparse = CodebookSpec {
        peak: 2.0,
        codes: (0..1000).map(|n| if n % 4 == 0 { 127 } else { 0 }).collect(),
    };
    let bytes = bare_of(vec![steady(), sparse], [1, 2, 0, 0]);
    let texture = texture(&bytes);
    // The grid spans 50 to 100 mm/s and 0.5 to 1 N.
    let (speed, force) = (65.0, 0.625);
    let weights = [0.7 * 0.75, 0.7 * 0.25, 0.3];
    let material = Material::of(&texture);
    let point = GridPoint::locate(&texture, motion(speed, force));
    let mut feed = Feed::new(4);
    let mut samples = [0.0; 3];
    let count = 2_000_000;
    let mut history = [0.0; 8];
    for n in 0..count {
        history[n % 8] = f64::from(feed.next_sample(&material, &point)) / SIGMA;
        let magnitudes = || history.iter().map(|x| x.abs());
        let near = |value: f64| magnitudes().filter(|x| (x - value).abs() < 1e-5).count();
        // Neither a fade nor a piece of noise has eight such values in a row.
        if near(1.0) == 8 {
            samples[0] += 1.0;
        } else if near(0.0) == 6 && near(2.0) == 2 {
            samples[1] += 1.0;
        } else {
            samples[2] += 1.0;
        }
    }
    // A fade and the window take 32 samples of a piece's 250 from the first two. Noise that follows noise has no fade.
    let clear = 1.0 - 32.0 / 250.0;
    let pieces = count as f64 / 250.0;
    for (found, weight) in samples.iter().zip(weights).take(2) {
        let share = found / count as f64 / clear;
        let bound = 4.5 * (weight * (1.0 - weight) * 1.2 / pieces).sqrt();
        assert!((share - weight).abs() < bound, "{share} of {weight} within {bound}");
    }
    // At a single node, at the edge and beyond it, only that node's codebook is heard.
    let beyond = GridPoint::locate(&texture, motion(20.0, 0.1));
    let mut feed = Feed::new(4);
    let alone = (0..100_000).map(|_| f64::from(feed.next_sample(&material, &beyond)) / SIGMA);
    joins(&alone.collect::<Vec<_>>());
}

#[test]
fn noise_beside_codebooks_is_that_of_the_seed_without_them() {
    let bytes = bare_of(vec![steady()], [0, 0, 1, 1]);
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
    fn without_an_update_the_excitation_ends(seed: u64, which in 0usize..3, samples in 1u32..=MAX_FED_SAMPLES as u32) {
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
