//! A codebook: material from a residual, whitened if several nodes share it, clipped at its highest peaks, and coded in
//! blocks.

use model_format::{BLOCK_BYTES, BLOCK_MAGNITUDES, BLOCK_SAMPLES, CodebookSpec, SAMPLE_RATE_HZ, block_scale, limits};
use stylus_dsp::fourier::{self, Complex};
use stylus_dsp::sums::{mean_square, sum_of};
use stylus_dsp::wide;

/// Range of lengths over which the spectrum of a material is whitened, samples: 20 to 80 ms, the resolution of third
/// octaves. A finer one would smear events.
const PIECE_SAMPLES: std::ops::RangeInclusive<usize> = 100..=400;

/// Highest peak before coding, standard deviations. Compensation for the power lost in coding raises it to at most 40.
const HIGHEST_PEAK: f64 = 36.0;

/// Passes of whitening, of clipping, and of whitening what is decoded. Three of whitening leave less than 0.1 dB of any
/// third octave.
const PASSES: usize = 3;

/// Least power density that whitening raises to the mean, relative to the mean: -30 dB.
const LEAST_POWER: f64 = 1e-3;

/// Weights of the last errors of the codes in what is coded next, the latest first. They move the noise of the codes
/// above the band that a hand feels: from 15 to 21 dB below the signal at 20 to 1000 Hz. The model's filter has the
/// same gain for both, so that no texture needs weights of its own.
const SHAPING: [f64; 12] = [
    -1.0455, 0.2231, 0.3626, -0.0382, -0.2284, -0.0524, 0.1432, 0.0980, -0.0689, -0.1095, 0.0052, 0.0938,
];

/// Band that a hand feels, Hz.
const FELT_HZ: [f64; 2] = [20.0, 1000.0];

/// A codebook, and the losses by its coding.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Coded {
    /// The codebook, with a mean square of 1.
    pub spec: CodebookSpec,
    /// Number of samples that were clipped.
    pub cut: usize,
    /// Ratio of its power to that of the error of the codes, at 20 to 1000 Hz, dB.
    pub snr_db: f64,
}

/// Codes `material`, clipped at [`HIGHEST_PEAK`]. Last samples that do not fill a block are dropped. `None` if the
/// material has no power.
///
/// Material of one node keeps its spectrum, and so what the node's predictor left of the recording's: its own filter
/// makes the recording of it again. The filters of several nodes left different things, so their material is whitened.
pub(super) fn coded(material: &[f64], is_of_one_node: bool) -> Option<Coded> {
    let whole = material.len() / BLOCK_SAMPLES * BLOCK_SAMPLES;
    let (samples, cut) = prepared(&material[..whole], is_of_one_node)?;
    let (bytes, decoded) = coded_blocks(&samples);
    with_unit_power(bytes, &samples, &decoded, cut)
}

/// Returns the bytes of whole blocks of `samples`, and what they decode to.
fn coded_blocks(samples: &[f64]) -> (Vec<u8>, Vec<f64>) {
    let peak = peak_of(samples);
    let mut made_good = [0.0; SHAPING.len()];
    let (mut bytes, mut decoded) = (Vec::new(), Vec::new());
    for block in samples.as_chunks().0 {
        bytes.extend(coded_block(block, peak, &mut made_good, &mut decoded));
    }
    (bytes, decoded)
}

/// A level of a block: the largest magnitude of its codes, and the bounds between their magnitudes.
struct Scale {
    level: i8,
    magnitudes: [f64; BLOCK_MAGNITUDES.len()],
}

impl Scale {
    /// Returns the scale of `level` in a codebook with this `peak`.
    fn of(level: i8, peak: f64) -> Self {
        let scale = peak * f64::from(block_scale(level)) / 65_536.0;
        let magnitudes = BLOCK_MAGNITUDES.map(|m| scale * f64::from(m) / 16_384.0);
        Self { level, magnitudes }
    }

    /// Returns the code that decodes nearest to `x`, and what it decodes to.
    fn code(&self, x: f64) -> (usize, f64) {
        let nearer = |k: &usize| 2.0 * x.abs() > self.magnitudes[*k] + self.magnitudes[*k + 1];
        let number = (0..self.magnitudes.len() - 1).take_while(nearer).count();
        (
            number | if x < 0.0 { 4 } else { 0 },
            self.magnitudes[number].copysign(x),
        )
    }

    /// Returns the sum of the squared errors of the codes of `samples`.
    fn error(&self, samples: &[f64]) -> f64 {
        let distance = |x: f64| self.magnitudes.map(|magnitude| (x.abs() - magnitude).abs());
        wide(
            #[inline(always)]
            || {
                sum_of(samples, |x| {
                    distance(x).into_iter().fold(f64::INFINITY, f64::min).powi(2)
                })
            },
        )
    }
}

/// Returns the bytes of a block of samples, for a codebook with this `peak`, and appends what they decode to. The
/// block's level is the one with the least error. What errors of the last blocks add to its first samples is in
/// `made_good`, which goes on to the next block.
fn coded_block(
    samples: &[f64; BLOCK_SAMPLES],
    peak: f64,
    made_good: &mut [f64; SHAPING.len()],
    decoded: &mut Vec<f64>,
) -> [u8; BLOCK_BYTES] {
    /// Levels that are tried below and above the block's own peak: 6 dB and 1 dB, in steps of 0.5 dB.
    const TRIED: std::ops::RangeInclusive<i32> = -12..=2;
    // A silent block gives -∞, which the cast and the clamp turn into the lowest level.
    let own = (40.0 * (peak_of(samples) / peak).log10()).round() as i32;
    let tried = TRIED.map(|step| own.saturating_add(step).clamp(i8::MIN.into(), 0) as i8);
    let best = tried
        .map(|level| Scale::of(level, peak))
        .min_by(|a, b| a.error(samples).total_cmp(&b.error(samples)));
    let scale = best.expect("some levels are tried");
    let most = scale.magnitudes[scale.magnitudes.len() - 1];
    let mut bytes = [0; BLOCK_BYTES];
    for (index, &x) in samples.iter().enumerate() {
        // Errors of a louder block before are beyond what this block's codes can make good.
        let wanted = x + made_good[0].clamp(-most, most);
        let (code, value) = scale.code(wanted);
        // Of the sum for a sample, only the product with the error just before it has to wait for that error.
        made_good.rotate_left(1);
        made_good[SHAPING.len() - 1] = 0.0;
        for (sum, weight) in made_good.iter_mut().zip(SHAPING) {
            *sum += weight * (value - wanted);
        }
        decoded.push(value);
        let bits = (code << (3 * index % 8)) as u16;
        let [low, high] = bits.to_le_bytes();
        bytes[3 * index / 8] |= low;
        bytes[3 * index / 8 + 1] |= high;
    }
    bytes[BLOCK_BYTES - 1] = scale.level.cast_unsigned();
    bytes
}

fn peak_of(samples: &[f64]) -> f64 {
    samples.iter().fold(0.0, |peak: f64, x| peak.max(x.abs()))
}

/// Returns the codebook of these blocks, scaled to a mean square of 1. The blocks decode to `decoded` instead of
/// `samples`.
fn with_unit_power(blocks: Vec<u8>, samples: &[f64], decoded: &[f64], cut: usize) -> Option<Coded> {
    let errors: Vec<f64> = decoded.iter().zip(samples).map(|(a, b)| a - b).collect();
    let power = mean_square(decoded);
    let mean = decoded.iter().sum::<f64>() / decoded.len() as f64;
    let peak = (peak_of(samples) / power.sqrt()) as f32;
    let is_valid = power.is_normal() && peak.is_finite() && peak <= limits::MAX_CODEBOOK_PEAK;
    let has_no_mean = mean.abs() < 0.99 * f64::from(limits::MAX_CODEBOOK_MEAN) * power.sqrt();
    (is_valid && has_no_mean).then(|| Coded {
        spec: CodebookSpec { peak, blocks },
        cut,
        snr_db: 10.0 * (felt_power(decoded) / felt_power(&errors)).log10(),
    })
}

/// Returns the power of `samples` in the band that a hand feels, without scaling.
fn felt_power(samples: &[f64]) -> f64 {
    let bin_hz = f64::from(SAMPLE_RATE_HZ) / samples.len() as f64;
    fourier::forward(&mut samples.to_vec())
        .into_iter()
        .enumerate()
        .filter(|(bin, _)| (FELT_HZ[0]..FELT_HZ[1]).contains(&(*bin as f64 * bin_hz)))
        .map(|(_, value)| value.norm_sqr())
        .sum()
}

/// Returns `material`, whitened unless it `is_of_one_node`, clipped at [`HIGHEST_PEAK`], with a mean square of 1; and
/// the number of samples that were clipped. `None` if it has no power.
fn prepared(material: &[f64], is_of_one_node: bool) -> Option<(Vec<f64>, usize)> {
    let mut samples = material.to_vec();
    let wanted = if is_of_one_node {
        smoothed(material)?
    } else {
        let white = vec![1.0; material.len()];
        for _ in 0..PASSES {
            samples = filtered(&samples, &samples, &white)?;
        }
        white
    };
    let mut prepared = clipped(samples)?;
    // The noise of the codes is mostly above the felt band, which would lose 0.3 dB to it.
    for _ in 0..PASSES {
        let (_, decoded) = coded_blocks(&prepared.0);
        prepared = clipped(filtered(&prepared.0, &decoded, &wanted)?)?;
    }
    Some(prepared)
}

/// Returns `samples` clipped at [`HIGHEST_PEAK`], with a mean square of 1; and the number of samples that
/// were clipped. `None` if they have no power.
fn clipped(mut samples: Vec<f64>) -> Option<(Vec<f64>, usize)> {
    // Clipping removes power; scaling compensates for it and raises other peaks, which are clipped in the next pass.
    let mut is_cut = vec![false; samples.len()];
    for _ in 0..PASSES {
        scale_to_one(&mut samples)?;
        for (sample, is_cut) in samples.iter_mut().zip(&mut is_cut) {
            *is_cut |= sample.abs() > HIGHEST_PEAK;
            *sample = sample.clamp(-HIGHEST_PEAK, HIGHEST_PEAK);
        }
    }
    scale_to_one(&mut samples)?;
    Some((samples, is_cut.iter().filter(|&&cut| cut).count()))
}

/// Scales `samples` to a mean of 0 and a mean square of 1. `None` if they have no power.
fn scale_to_one(samples: &mut [f64]) -> Option<()> {
    let mean = samples.iter().sum::<f64>() / samples.len().max(1) as f64;
    samples.iter_mut().for_each(|x| *x -= mean);
    let power = mean_square(samples);
    if !power.is_normal() {
        return None;
    }
    let scale = 1.0 / power.sqrt();
    samples.iter_mut().for_each(|x| *x *= scale);
    Some(())
}

/// Returns the expected fraction of sample pairs at distance `lag` that lie in one piece: the mean of L - lag over the
/// mean of L, where L is the length of a piece. It smooths the spectrum.
fn share_in_one_piece(lag: usize) -> f64 {
    let left: usize = PIECE_SAMPLES.map(|length| length.saturating_sub(lag)).sum();
    let all: usize = PIECE_SAMPLES.sum();
    left as f64 / all as f64
}

/// Returns `samples`, treated as circular, filtered so that the spectrum of `played`, smoothed over pieces of
/// [`PIECE_SAMPLES`], would have the shape of `wanted`.
///
/// The filter has linear phase, and its gain is the square root of the ratio of these spectra. `None` if there is no
/// power.
fn filtered(samples: &[f64], played: &[f64], wanted: &[f64]) -> Option<Vec<f64>> {
    if !mean_square(samples).is_normal() {
        return None;
    }
    let smoothed = smoothed(played)?;
    let mut spectrum = fourier::forward(&mut samples.to_vec());
    for (bin, (wanted, smoothed)) in spectrum.iter_mut().zip(wanted.iter().zip(smoothed)) {
        *bin /= (smoothed / wanted).sqrt();
    }
    Some(inverse(spectrum, samples.len()))
}

/// Returns the power of `played`, treated as circular, at each frequency, smoothed over pieces of [`PIECE_SAMPLES`]; at
/// least [`LEAST_POWER`] of the mean. `None` if there is no power.
fn smoothed(played: &[f64]) -> Option<Vec<f64>> {
    let count = played.len();
    if !mean_square(played).is_normal() {
        return None;
    }
    let power = fourier::forward(&mut played.to_vec());
    let power = power.iter().map(|bin| Complex::new(bin.norm_sqr() / count as f64, 0.0));
    let mut lags = inverse(power.collect(), count);
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
    let smoothed = fourier::forward(&mut lags).into_iter().map(|bin| bin.re.max(least));
    Some(smoothed.collect())
}

/// Returns the `count` real samples whose spectrum this is.
fn inverse(mut spectrum: Vec<Complex<f64>>, count: usize) -> Vec<f64> {
    let samples = fourier::inverse(&mut spectrum, count);
    samples.iter().map(|x| x / count as f64).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand::{RngExt, SeedableRng};
    use test_helpers::{near, noise};

    fn decoded(spec: &CodebookSpec) -> Vec<f64> {
        let blocks = spec.blocks.as_chunks::<BLOCK_BYTES>().0;
        let share = |block, index| f64::from(model_format::block_share(block, index));
        let samples = blocks
            .iter()
            .flat_map(|block| (0..BLOCK_SAMPLES).map(move |index| share(block, index)));
        let unit = f64::from(1u32 << model_format::SHARE_FRACTION_BITS);
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
        let coded = coded(&material, false).unwrap();
        assert_eq!(coded.spec.blocks.len(), 10_000 / 64 * 25);
        assert!(coded.cut == 0, "{}", coded.cut);
        let samples = decoded(&coded.spec);
        near(mean_square(&samples), 1.0, 1e-3);
        let level = |from: usize| {
            let bursts = samples
                .chunks_exact(1000)
                .map(|period| mean_square(&period[from..from + 150]));
            10.0 * (bursts.sum::<f64>() / 9.0).log10()
        };
        let step_db = level(25) - level(500);
        near(step_db, 20.0, 1.0);
    }

    /// The noise of the codes, as what is decoded has it; 14.9 dB without its shape.
    #[test]
    fn noise_of_the_codes_is_18_db_below_the_signal_in_the_felt_band() {
        let material: Vec<f64> = noise(6, 25_600).iter().map(|x| x * (0.4 + x.abs())).collect();
        let coded = coded(&material, false).unwrap();
        let (samples, _) = prepared(&material, false).unwrap();
        let decoded = decoded(&coded.spec);
        let errors: Vec<f64> = decoded.iter().zip(&samples).map(|(a, b)| a - b).collect();
        let snr_db = 10.0 * (felt_power(&samples) / felt_power(&errors)).log10();
        println!("{snr_db:.1} dB, said to be {:.1} dB", coded.snr_db);
        assert!(snr_db > 18.0, "{snr_db}");
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
            let piece: Vec<f64> = (start..start + length).map(|n| samples[n % count]).collect();
            for (lag, sum) in lags.iter_mut().enumerate().take(length) {
                *sum += piece[lag..].iter().zip(&piece).map(|(a, b)| a * b).sum::<f64>();
            }
            played += length;
        }
        move |hz| {
            let angle = std::f64::consts::TAU * hz / 5000.0;
            let sum: f64 = lags
                .iter()
                .enumerate()
                .skip(1)
                .map(|(lag, r)| 2.0 * r * (angle * lag as f64).cos())
                .sum();
            (lags[0] + sum) / f64::from(played as u32)
        }
    }

    /// Centre, Hz, of each third octave from 30 Hz on, and its level in the playback of `samples`, dB of white noise.
    fn bands_db(samples: &[f64]) -> Vec<(f64, f64)> {
        let density = played(samples, 1);
        let of_band = |band| {
            let centre_hz = 30.0 * 2f64.powf(f64::from(band) / 3.0);
            let at = |n| density(centre_hz * 2f64.powf((f64::from(n) - 9.5) / 60.0));
            (centre_hz, 10.0 * ((0..20).map(at).sum::<f64>() / 20.0).log10())
        };
        (0..19).map(of_band).collect()
    }

    /// For coloured, heavy-tailed material of even and odd length, long enough that the noise of the codes scatters by
    /// less than 0.1 dB.
    #[test]
    fn what_is_played_of_a_codebook_is_white_or_as_its_node_left_it_and_of_unit_power() {
        for (seed, count) in [(1, 10_000), (2, 12_001)] {
            let mut last = 0.0;
            let material: Vec<f64> = noise(seed, count)
                .iter()
                .map(|x| {
                    last = 0.6 * last + x.powi(3);
                    last
                })
                .collect();
            let coded = coded(&material, false).unwrap();
            let samples = decoded(&coded.spec);
            near(mean_square(&samples), 1.0, 1e-3);
            assert_eq!(coded.cut, 0);
            for (centre_hz, level_db) in bands_db(&samples) {
                assert!(level_db.abs() < 0.3, "{centre_hz} Hz: {level_db} dB");
            }
            // Of one node it plays what it is, up to 1000 Hz. Above, the noise of the codes is not made good in full.
            let kept = decoded(&super::coded(&material, true).unwrap().spec);
            let power = mean_square(&material);
            let own: Vec<f64> = material.iter().map(|x| x / power.sqrt()).collect();
            for ((_, kept_db), (_, own_db)) in bands_db(&kept).into_iter().zip(bands_db(&own)).take(16) {
                near(kept_db, own_db, 0.3);
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
        let density = played(&decoded(&coded(&material, false).unwrap().spec), 5);
        let loudest = (0..2500).map(|hz| density(f64::from(hz))).fold(0.0, f64::max);
        assert!(loudest < 2.0, "{loudest}");
    }

    #[test]
    fn high_peaks_are_cut_and_counted_and_the_power_stays_one() {
        let mut material = noise(3, 20_000);
        for n in (0..20_000).step_by(5000) {
            material[n] = 400.0;
        }
        let coded = coded(&material, false).unwrap();
        near(mean_square(&decoded(&coded.spec)), 1.0, 1e-3);
        assert!(f64::from(coded.spec.peak) <= 1.15 * HIGHEST_PEAK, "{}", coded.spec.peak);
        assert!(coded.cut > 0);
    }

    #[test]
    fn material_without_power_has_no_codebook_and_an_impulse_has_one() {
        assert_eq!(coded(&[], false), None);
        assert_eq!(coded(&vec![0.0; 5000], true), None);
        assert_eq!(coded(&vec![f64::NAN; 5000], true), None);
        let mut impulse = vec![0.0; 5000];
        impulse[700] = 1e-3;
        if let Some(coded) = coded(&impulse, false) {
            near(mean_square(&decoded(&coded.spec)), 1.0, 1e-3);
            assert!(coded.spec.peak <= 40.0);
        }
        let alternating: Vec<f64> = (0..5000).map(|n| if n % 2 == 0 { 3.0 } else { -3.0 }).collect();
        let coded = coded(&alternating, false).unwrap();
        near(mean_square(&decoded(&coded.spec)), 1.0, 1e-3);
    }
}
