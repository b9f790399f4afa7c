//! Band-limited conversion of the sample rate.

use core::f64::consts::TAU;
use std::cell::RefCell;
use std::rc::Rc;

use stylus_dsp::fourier::{self, Complex};

/// Approximate length of a block, in samples of the lower rate. The transition band is then a few per cent of the lower
/// Nyquist frequency.
const BLOCK: usize = 2048;

/// Converts `channels` from `from_hz` to `to_hz`, and removes everything above half the lower rate.
///
/// Both rates must be above zero, and channels must have equal lengths. The work is done in blocks, each of at most two
/// seconds or of a few thousand samples of the lower rate, whose spectra are truncated or extended. There is no delay:
/// sample n of the result is at n / `to_hz`.
///
/// Beyond its ends a channel goes on as its point reflection, because zeros there would be a step whose ringing would
/// extend into the recording. The mean is subtracted before the conversion and added again afterwards, so that a large
/// offset costs no digits.
pub fn resample(channels: &[Vec<f64>], from_hz: u32, to_hz: u32) -> Vec<Vec<f64>> {
    let frames = channels.first().map_or(0, Vec::len);
    if frames == 0 || from_hz == to_hz {
        return channels.to_vec();
    }
    let blocks = blocks(from_hz as usize, to_hz as usize);
    let [block_in, block_out] = blocks;
    let mut input = vec![0.0; 2 * block_in];
    let response = response(blocks);
    let resampled = channels.iter().map(|channel| {
        let mean = mean(channel);
        // In 64 bits, because a page counts in 32: 20 s at 44.1 kHz would be too many.
        let samples = (frames as u64 * u64::from(to_hz)).div_ceil(u64::from(from_hz));
        let mut output = vec![mean; samples as usize];
        for (block, samples) in extended(channel, block_in / 2).chunks(block_in).enumerate() {
            input.fill(0.0);
            for (centred, sample) in input.iter_mut().zip(samples) {
                *centred = sample - mean;
            }
            let bins = fourier::forward(&mut input).into_iter().zip(&*response);
            // The bin at half the output's rate stays zero, because the filter has removed it.
            let kept = bins.take(block_out).map(|(bin, response)| bin * response);
            let mut kept: Vec<Complex<f64>> = kept.collect();
            kept.resize(block_out + 1, Complex::default());
            let wave = fourier::inverse(&mut kept, 2 * block_out);
            // The filter is as long as a block, so each result overlaps the next. Its delay and the extension are half
            // a block each, so the first begins a block before the output.
            let begin = block * block_out;
            let places = output.iter_mut().skip(begin.saturating_sub(block_out));
            for (sum, value) in places.zip(&wave[block_out.saturating_sub(begin)..]) {
                *sum += value;
            }
        }
        output
    });
    resampled.collect()
}

/// Returns the lengths of a block at both rates.
fn blocks(from: usize, to: usize) -> [usize; 2] {
    let [step_in, step_out] = [from, to].map(|rate| rate / gcd(from, to));
    // A quick length is even, so that the filter's delay of half a block is a whole number of samples.
    let steps = fourier::quick_length((BLOCK * from.max(to) / to).div_ceil(step_in));
    [steps * step_in, steps * step_out]
}

/// A filter's blocks and response.
type Response = ([usize; 2], Rc<[Complex<f64>]>);

thread_local! {
    /// The last response, because a set's recordings usually have one rate.
    static RESPONSE: RefCell<Response> = RefCell::new(([0; 2], Rc::new([])));
}

/// Returns the bins of [`low_pass`], followed by as many zeros.
fn response([block_in, block_out]: [usize; 2]) -> Rc<[Complex<f64>]> {
    RESPONSE.with_borrow_mut(|(blocks, kept)| {
        if *blocks != [block_in, block_out] {
            let mut padded = low_pass(block_in, block_out);
            padded.resize(2 * block_in, 0.0);
            (*blocks, *kept) = ([block_in, block_out], fourier::forward(&mut padded).into());
        }
        Rc::clone(kept)
    })
}

/// Returns the impulse response of a low-pass filter of `block_in` samples, around its middle: a sinc function
/// multiplied by a squared Blackman-Harris window. It is divided by the length of the transform, which does not scale
/// its results.
///
/// The edge is 6.8 bins of a block (13.6 of the transform) below the Nyquist frequency of the lower rate. Above that
/// Nyquist frequency the response is below -140 dB.
fn low_pass(block_in: usize, block_out: usize) -> Vec<f64> {
    let lower = block_in.min(block_out) as f64;
    let cutoff = (lower - 13.6) / block_in as f64;
    let mut response: Vec<f64> = (0..block_in)
        .map(|n| {
            let angle = TAU * n as f64 / block_in as f64;
            // The coefficients of the 4-term window of 92 dB (Harris, Proc. IEEE 66, 1978, 51, table 1).
            let window =
                0.35875 - 0.48829 * angle.cos() + 0.14128 * (2.0 * angle).cos() - 0.01168 * (3.0 * angle).cos();
            let phase = TAU / 2.0 * cutoff * (n as f64 - (block_in / 2) as f64);
            let sinc = if phase == 0.0 { 1.0 } else { phase.sin() / phase };
            window * window * sinc
        })
        .collect();
    let scale = 1.0 / (response.iter().sum::<f64>() * 2.0 * block_in as f64);
    for value in &mut response {
        *value *= scale;
    }
    response
}

/// Returns `channel` with `reach` samples more on each side: its point reflections about its first and last sample, and
/// beyond the length of a short channel the last values of these.
fn extended(channel: &[f64], reach: usize) -> Vec<f64> {
    let last = channel.len() - 1;
    let before = (1..=reach).rev().map(|n| 2.0 * channel[0] - channel[n.min(last)]);
    let after = (1..=reach).map(|n| 2.0 * channel[last] - channel[last - n.min(last)]);
    before.chain(channel.iter().copied()).chain(after).collect()
}

/// Mean of at least one value. The first value is subtracted before summing, so that a large offset costs no digits.
fn mean(values: &[f64]) -> f64 {
    let first = values[0];
    first + values.iter().map(|x| x - first).sum::<f64>() / values.len() as f64
}

fn gcd(a: usize, b: usize) -> usize {
    if b == 0 { a } else { gcd(b, a % b) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use stylus_dsp::sums::rms;
    use test_helpers::largest_factor;

    fn sine(frequency_hz: f64, rate_hz: u32, seconds: f64) -> Vec<f64> {
        let step = core::f64::consts::TAU * frequency_hz / f64::from(rate_hz);
        (0..(seconds * f64::from(rate_hz)) as usize)
            .map(|n| (step * n as f64).sin())
            .collect()
    }

    #[test]
    fn a_tone_in_the_band_keeps_time_and_amplitude() {
        for from_hz in [2800, 8000, 44_100, 48_000] {
            let signal = sine(400.0, from_hz, 2.0);
            let there = resample(&[signal], from_hz, 5000).remove(0);
            assert_eq!(there.len(), 10_000, "from {from_hz} Hz");
            let expected = sine(400.0, 5000, 2.0);
            let middle = 1000..9000;
            let error: Vec<f64> = middle.map(|n| there[n] - expected[n]).collect();
            assert!(rms(&error) < 1e-3, "from {from_hz} Hz: {}", rms(&error));
        }
    }

    #[test]
    fn blocks_have_no_factor_above_that_of_their_rates() {
        for from in (50..200_000).step_by(50) {
            let most = largest_factor(from).max(5);
            assert!(
                blocks(from, 5000).iter().all(|&block| largest_factor(block) <= most),
                "{from} Hz"
            );
        }
    }

    #[test]
    fn the_ends_of_a_vibration_do_not_ring() {
        for from_hz in [1000, 2800, 8000, 44_100] {
            // A sine that ends near its crest, where a step to zero rings most.
            let signal = sine(100.0, from_hz, 0.9925);
            let there = resample(&[signal], from_hz, 5000).remove(0);
            let expected = sine(100.0, 5000, 1.0);
            let error = |range: core::ops::Range<usize>| {
                let error: Vec<f64> = range.map(|n| there[n] - expected[n]).collect();
                rms(&error)
            };
            let end = there.len();
            let errors = (error(0..100), error(end - 100..end));
            assert!(errors.0 < 1e-3 && errors.1 < 0.02, "from {from_hz} Hz: {errors:?}");
        }
    }

    #[test]
    fn a_tone_above_the_new_band_is_gone_and_does_not_fold() {
        let signal = sine(3000.0, 44_100, 2.0);
        let there = resample(&[signal], 44_100, 5000).remove(0);
        assert!(rms(&there[1000..9000]) < 1e-4);
    }

    /// Reference: the vibration without the offset, resampled alone. The offset must not change it anywhere, and the
    /// mean must stay the same.
    #[test]
    fn an_offset_of_gravity_leaks_into_no_weak_vibration_at_any_rate() {
        for from_hz in [1000, 2800, 8000, 44_100, 48_000, 96_000] {
            let weak: Vec<f64> = sine(200.0, from_hz, 2.0).iter().map(|x| 0.06 * x).collect();
            let lifted: Vec<f64> = weak.iter().map(|x| x + 9.81).collect();
            let alone = resample(&[weak], from_hz, 5000).remove(0);
            let there = resample(&[lifted], from_hz, 5000).remove(0);
            assert!((mean(&there) - mean(&alone) - 9.81).abs() < 1e-9, "from {from_hz} Hz");
            let error = there.iter().zip(&alone).map(|(a, b)| a - 9.81 - b);
            let error: Vec<f64> = error.collect();
            assert!(rms(&error) < 1e-9, "from {from_hz} Hz: {}", rms(&error));
            // The level must also be that of the vibration, over the whole length including the ends.
            let expected: Vec<f64> = sine(200.0, 5000, 2.0).iter().map(|x| 0.06 * x).collect();
            let error = there.iter().zip(&expected).map(|(a, b)| a - 9.81 - b);
            let error: Vec<f64> = error.collect();
            assert!(rms(&error) < 0.06 * 0.1, "from {from_hz} Hz: {}", rms(&error));
        }
    }

    #[test]
    fn channels_stay_apart() {
        let channels = [sine(100.0, 10_000, 1.0), vec![0.0; 10_000]];
        let there = resample(&channels, 10_000, 5000);
        assert!(rms(&there[0]) > 0.7 && rms(&there[1]) < 1e-12);
    }
}
