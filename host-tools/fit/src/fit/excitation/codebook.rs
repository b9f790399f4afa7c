//! A codebook: material from a residual, whitened for the way it is played, clipped at its highest peaks, and coded by
//! the mu-law, or in blocks if it keeps the recording's level.

use model_format::{
    BLOCK_BYTES, BLOCK_MAGNITUDES, BLOCK_SAMPLES, CodebookSpec, MU_LAW_FRACTION_BITS, block_scale, limits, mu_law,
};

use crate::dsp::fourier::{self, Complex};
use crate::dsp::sums::mean_square;

/// Range of the lengths of the pieces that a player takes from a codebook, samples: 20 to 80 ms. Recorded snippets are
/// longer, but whitened with the same resolution, which is that of third octaves; a finer one would smear events.
const PIECE_SAMPLES: std::ops::RangeInclusive<usize> = 100..=400;

/// Passes of whitening, and of clipping. Three of whitening leave less than 0.1 dB of any third octave.
const PASSES: usize = 3;

/// Least power density that whitening raises to the mean, relative to the mean: -30 dB.
const LEAST_POWER: f64 = 1e-3;

/// Code of the peak.
const HIGHEST_CODE: i8 = 127;

/// A codebook, and the losses by its coding.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Coded {
    /// The codebook, with a mean square of 1.
    pub spec: CodebookSpec,
    /// Number of samples that were clipped.
    pub cut: usize,
    /// Ratio of its power to that of the error of the codes, dB.
    pub snr_db: f64,
}

/// Codes `material` by the mu-law, clipped at `highest` standard deviations. `None` if it has no power.
pub(super) fn coded(material: &[f64], highest: f64) -> Option<Coded> {
    let (samples, cut) = prepared(material, highest)?;
    let peak = peak_of(&samples);
    let bounds: Vec<f64> = (0..HIGHEST_CODE)
        .map(|code| peak * (share(code) + share(code + 1)) / 2.0)
        .collect();
    let code = |x: &f64| {
        let code = bounds.partition_point(|&bound| bound < x.abs()) as i8;
        if *x < 0.0 { -code } else { code }
    };
    let codes: Vec<i8> = samples.iter().map(code).collect();
    let decoded: Vec<f64> = codes.iter().map(|&code| peak * share(code)).collect();
    with_unit_power(codes, peak, &samples, &decoded, cut)
}

/// Codes `material` in blocks, clipped at `highest` standard deviations. Last samples that do not fill a block are
/// dropped. `None` if the material has no power.
pub(super) fn coded_in_blocks(material: &[f64], highest: f64) -> Option<Coded> {
    let whole = material.len() / BLOCK_SAMPLES * BLOCK_SAMPLES;
    let (samples, cut) = prepared(&material[..whole], highest)?;
    let peak = peak_of(&samples);
    let blocks = samples.as_chunks::<BLOCK_SAMPLES>().0;
    let coded: Vec<_> = blocks.iter().map(|block| coded_block(block, peak)).collect();
    let codes: Vec<i8> = coded.iter().flat_map(|(bytes, _)| bytes.map(u8::cast_signed)).collect();
    let decoded: Vec<f64> = coded.iter().flat_map(|(_, samples)| *samples).collect();
    with_unit_power(codes, peak, &samples, &decoded, cut)
}

/// Returns the bytes of a block of samples, for a codebook with this `peak`, and the samples that they decode to. The
/// block's level is the one with the least error.
fn coded_block(samples: &[f64; BLOCK_SAMPLES], peak: f64) -> ([u8; BLOCK_BYTES], [f64; BLOCK_SAMPLES]) {
    /// Levels that are tried below and above the block's own peak: 6 dB and 1 dB, in steps of 0.5 dB.
    const TRIED: std::ops::RangeInclusive<i32> = -12..=2;
    // A silent block gives -∞, which the cast and the clamp turn into the lowest level.
    let own = (40.0 * (peak_of(samples) / peak).log10()).round() as i32;
    let tried = TRIED.map(|step| own.saturating_add(step).clamp(i8::MIN.into(), 0) as i8);
    let coded = tried.map(|level| {
        let scale = peak * f64::from(block_scale(level)) / 65_536.0;
        let magnitudes = BLOCK_MAGNITUDES.map(|m| scale * f64::from(m) / 16_384.0);
        let number = |x: f64| {
            let nearer = |k: &usize| 2.0 * x.abs() > magnitudes[*k] + magnitudes[*k + 1];
            (0..magnitudes.len() - 1).take_while(nearer).count()
        };
        let codes = samples.map(|x| number(x) | if x < 0.0 { 4 } else { 0 });
        let decoded = codes.map(|code| {
            let magnitude = magnitudes[code & 3];
            if code & 4 == 0 { magnitude } else { -magnitude }
        });
        let error: f64 = samples.iter().zip(&decoded).map(|(a, b)| (a - b).powi(2)).sum();
        (error, level, codes, decoded)
    });
    let best = coded.min_by(|a, b| a.0.total_cmp(&b.0));
    let (_, level, codes, decoded) = best.expect("some levels are tried");
    let mut bytes = [0; BLOCK_BYTES];
    for (index, code) in codes.into_iter().enumerate() {
        let bits = (code << (3 * index % 8)) as u16;
        let [low, high] = bits.to_le_bytes();
        bytes[3 * index / 8] |= low;
        bytes[3 * index / 8 + 1] |= high;
    }
    bytes[BLOCK_BYTES - 1] = level.cast_unsigned();
    (bytes, decoded)
}

fn peak_of(samples: &[f64]) -> f64 {
    samples.iter().fold(0.0, |peak: f64, x| peak.max(x.abs()))
}

/// Returns the codebook with these codes and this peak, scaled to a mean square of 1. The codes decode to `decoded`
/// instead of `samples`.
fn with_unit_power(codes: Vec<i8>, peak: f64, samples: &[f64], decoded: &[f64], cut: usize) -> Option<Coded> {
    let errors: Vec<f64> = decoded.iter().zip(samples).map(|(a, b)| a - b).collect();
    let power = mean_square(decoded);
    let peak = (peak / power.sqrt()) as f32;
    (power.is_normal() && peak.is_finite() && peak <= limits::MAX_CODEBOOK_PEAK).then(|| Coded {
        spec: CodebookSpec { peak, codes },
        cut,
        snr_db: 10.0 * (power / mean_square(&errors)).log10(),
    })
}

/// Returns `material` whitened, clipped at `highest` standard deviations, with a mean square of 1; and the number of
/// samples that were clipped. `None` if it has no power.
fn prepared(material: &[f64], highest: f64) -> Option<(Vec<f64>, usize)> {
    // Lower than the format's peak, because the last scaling, which compensates for the clipped power, raises the peak.
    let highest = highest.min(0.99 * f64::from(limits::MAX_CODEBOOK_PEAK));
    let mut samples = material.to_vec();
    for _ in 0..PASSES {
        samples = whitened(&samples)?;
    }
    // Clipping removes power; scaling compensates for it and raises other peaks, which are clipped in the next pass.
    let mut is_cut = vec![false; samples.len()];
    for _ in 0..PASSES {
        scale_to_one(&mut samples)?;
        for (sample, is_cut) in samples.iter_mut().zip(&mut is_cut) {
            *is_cut |= sample.abs() > highest;
            *sample = sample.clamp(-highest, highest);
        }
    }
    scale_to_one(&mut samples)?;
    Some((samples, is_cut.iter().filter(|&&cut| cut).count()))
}

/// Returns the value of a mu-law code, relative to the peak.
fn share(code: i8) -> f64 {
    f64::from(mu_law(code)) / f64::from(1u32 << MU_LAW_FRACTION_BITS)
}

/// Scales `samples` to a mean square of 1. `None` if they have no power.
fn scale_to_one(samples: &mut [f64]) -> Option<()> {
    let power = mean_square(samples);
    if !power.is_normal() {
        return None;
    }
    let scale = 1.0 / power.sqrt();
    samples.iter_mut().for_each(|x| *x *= scale);
    Some(())
}

/// Returns the expected fraction of sample pairs at distance `lag` that lie in one piece: the mean of L - lag over the
/// mean of L, where L is the length of a piece.
fn share_in_one_piece(lag: usize) -> f64 {
    let left: usize = PIECE_SAMPLES.map(|length| length.saturating_sub(lag)).sum();
    let all: usize = PIECE_SAMPLES.sum();
    left as f64 / all as f64
}

/// Returns `samples`, treated as circular, filtered so that the expected spectrum of their playback is flatter.
///
/// Pieces begin at random positions with equal probability and have independent signs, so the autocorrelation of the
/// playback is that of the circular samples times [`share_in_one_piece`]. The filter has linear phase, and its gain is
/// the inverse square root of the resulting spectrum, whose resolution is that of the longest piece. `None` if there is
/// no power.
fn whitened(samples: &[f64]) -> Option<Vec<f64>> {
    let count = samples.len();
    if count == 0 || !mean_square(samples).is_normal() {
        return None;
    }
    let back = |mut spectrum: Vec<Complex<f64>>| -> Vec<f64> {
        let signal = fourier::inverse(&mut spectrum, count);
        signal.iter().map(|x| x / count as f64).collect()
    };
    let spectrum = fourier::forward(&mut samples.to_vec());
    let power = spectrum
        .iter()
        .map(|bin| Complex::new(bin.norm_sqr() / count as f64, 0.0));
    let mut lags = back(power.collect());
    let reach = (*PIECE_SAMPLES.end()).min(count / 2);
    for lag in 0..=count / 2 {
        // No two samples of one piece are further apart than the longest piece.
        let share = if lag <= reach { share_in_one_piece(lag) } else { 0.0 };
        lags[lag] *= share;
        // Lag 0, and the middle one of an even number, are their own mirror images.
        if lag > 0 && count - lag > lag {
            lags[count - lag] *= share;
        }
    }
    let least = LEAST_POWER * lags[0];
    let played = fourier::forward(&mut lags);
    let filtered = spectrum
        .iter()
        .zip(&played)
        .map(|(bin, played)| bin / played.re.max(least).sqrt());
    Some(back(filtered.collect()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use test_helpers::noise;

    fn decoded(spec: &CodebookSpec) -> Vec<f64> {
        let value = |&code: &i8| f64::from(spec.peak) * share(code);
        spec.codes.iter().map(value).collect()
    }

    fn decoded_blocks(spec: &CodebookSpec) -> Vec<f64> {
        let bytes: Vec<u8> = spec.codes.iter().map(|code| code.cast_unsigned()).collect();
        let blocks = bytes.as_chunks::<BLOCK_BYTES>().0;
        let share = |block, index| f64::from(model_format::block_share(block, index));
        let samples = blocks
            .iter()
            .flat_map(|block| (0..BLOCK_SAMPLES).map(move |index| share(block, index)));
        let unit = f64::from(1u32 << MU_LAW_FRACTION_BITS);
        samples.map(|x| f64::from(spec.peak) * x / unit).collect()
    }

    /// Bursts of 40 ms that are 20 dB louder than the signal between them, and silence.
    #[test]
    fn blocks_keep_the_level_of_bursts_and_come_near_each_sample() {
        let material: Vec<f64> = noise(4, 10_000)
            .iter()
            .enumerate()
            .map(|(n, x)| match n % 1000 {
                0..200 => 10.0 * x,
                200..900 => *x,
                _ => 0.0,
            })
            .collect();
        let coded = coded_in_blocks(&material, 36.0).unwrap();
        assert_eq!(coded.spec.codes.len(), 10_000 / 64 * 25);
        assert!(coded.cut == 0 && coded.snr_db > 12.5, "{}", coded.snr_db);
        let samples = decoded_blocks(&coded.spec);
        assert!((mean_square(&samples) - 1.0).abs() < 1e-3);
        let level = |from: usize| {
            let bursts = samples.chunks_exact(1000);
            let bursts = bursts.map(|period| mean_square(&period[from..from + 150]));
            10.0 * (bursts.sum::<f64>() / 9.0).log10()
        };
        let step_db = level(25) - level(500);
        assert!((step_db - 20.0).abs() < 1.0, "{step_db}");
        assert_eq!(coded_in_blocks(&[0.0; 2000], 36.0), None);
    }

    /// Returns the power density of the playback of `samples` at any frequency in Hz, relative to that of white noise
    /// of unit power. It is computed independently of the filter, from pieces with random starts and signs.
    fn played(samples: &[f64], seed: u64) -> impl Fn(f64) -> f64 + use<> {
        let count = samples.len();
        let mut random = rand_pcg::Pcg64::seed_from_u64(seed);
        let mut lags = vec![0.0; 401];
        let (pieces, mut played) = (20_000, 0);
        for _ in 0..pieces {
            let (start, length) = (random.random_range(0..count), random.random_range(PIECE_SAMPLES));
            let piece = (start..start + length).map(|n| samples[n % count]);
            let piece: Vec<f64> = piece.collect();
            for (lag, sum) in lags.iter_mut().enumerate().take(length) {
                *sum += piece[lag..].iter().zip(&piece).map(|(a, b)| a * b).sum::<f64>();
            }
            played += length;
        }
        move |hz| {
            let angle = std::f64::consts::TAU * hz / 5000.0;
            let cosines = lags.iter().enumerate().skip(1);
            let sum = cosines.map(|(lag, r)| 2.0 * r * (angle * lag as f64).cos());
            let sum: f64 = sum.sum();
            (lags[0] + sum) / f64::from(played as u32)
        }
    }

    /// For coloured, heavy-tailed material of even and odd length.
    #[test]
    fn what_is_played_of_a_codebook_is_white_and_of_unit_power() {
        for (seed, count) in [(1, 10_000), (2, 4001)] {
            let mut last = 0.0;
            let material: Vec<f64> = noise(seed, count)
                .iter()
                .map(|x| {
                    last = 0.6 * last + x.powi(3);
                    last
                })
                .collect();
            let coded = coded(&material, 38.0).unwrap();
            let samples = decoded(&coded.spec);
            assert!((mean_square(&samples) - 1.0).abs() < 1e-6);
            assert!(coded.cut == 0 && coded.snr_db > 30.0, "{coded:?}", coded = coded.snr_db);
            let density = played(&samples, seed);
            for band in 0..19 {
                let centre = 30.0 * 2f64.powf(f64::from(band) / 3.0);
                let mean = (0..20)
                    .map(|n| density(centre * 2f64.powf((f64::from(n) - 9.5) / 60.0)))
                    .sum::<f64>()
                    / 20.0;
                let level_db = 10.0 * mean.log10();
                assert!(level_db.abs() < 0.3, "{centre} Hz: {level_db} dB");
            }
        }
    }

    /// A tone in the residual would resonate with the model's own pole at its frequency.
    #[test]
    fn a_tone_in_the_material_is_no_louder_than_white_noise_at_its_frequency() {
        let mut material = noise(5, 8000);
        for (n, x) in material.iter_mut().enumerate() {
            *x += 30.0 * (std::f64::consts::TAU * 440.0 / 5000.0 * n as f64).sin();
        }
        let density = played(&decoded(&coded(&material, 38.0).unwrap().spec), 5);
        let loudest = (0..2500).map(|hz| density(f64::from(hz)));
        let loudest = loudest.fold(0.0, f64::max);
        println!("{loudest:.2} of white noise");
        assert!(loudest < 2.0, "{loudest}");
    }

    #[test]
    fn peaks_are_cut_where_asked_and_counted_and_the_power_stays_one() {
        let mut material = noise(3, 6000);
        for n in (0..6000).step_by(600) {
            material[n] = 60.0;
        }
        for highest in [5.0, 12.0, 100.0] {
            let coded = coded(&material, highest).unwrap();
            let power = mean_square(&decoded(&coded.spec));
            assert!((power - 1.0).abs() < 1e-6);
            assert!(f64::from(coded.spec.peak) <= 1.1 * highest.min(40.0));
            assert_eq!(coded.cut > 0, highest < 20.0, "{highest}: {}", coded.cut);
        }
    }

    #[test]
    fn material_without_power_has_no_codebook_and_an_impulse_has_one() {
        assert_eq!(coded(&[], 30.0), None);
        assert_eq!(coded(&vec![0.0; 5000], 30.0), None);
        assert_eq!(coded(&vec![f64::NAN; 5000], 30.0), None);
        let mut impulse = vec![0.0; 5000];
        impulse[700] = 1e-3;
        if let Some(coded) = coded(&impulse, 30.0) {
            assert!((mean_square(&decoded(&coded.spec)) - 1.0).abs() < 1e-3);
            assert!(coded.spec.peak <= 40.0);
        }
        let alternating = (0..5000).map(|n| if n % 2 == 0 { 3.0 } else { -3.0 });
        let alternating: Vec<f64> = alternating.collect();
        let coded = coded(&alternating, 30.0).unwrap();
        assert!((mean_square(&decoded(&coded.spec)) - 1.0).abs() < 1e-3);
    }
}
