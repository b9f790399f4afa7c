//! Band-limited conversion of the sample rate.

use rubato::audioadapter_buffers::direct::SequentialSliceOfVecs;
use rubato::{Fft, FixedSync, Resampler, WindowFunction};

/// Approximate length of a block of the resampler's transform, in samples of the lower rate. Its transition band is
/// then a few per cent of the lower Nyquist frequency.
const BLOCK: usize = 2048;

/// Converts `channels` from `from_hz` to `to_hz`, and removes everything above half the lower rate.
///
/// Both rates are above zero; channels have equal length. Time is kept: sample n of the result is at n / `to_hz`.
///
/// # Errors
/// The resampler's message, for rates that it cannot convert.
pub fn resample(channels: &[Vec<f64>], from_hz: u32, to_hz: u32) -> Result<Vec<Vec<f64>>, String> {
    let frames = channels.first().map_or(0, Vec::len);
    if frames == 0 || from_hz == to_hz {
        return Ok(channels.to_vec());
    }
    let (from, to) = (from_hz as usize, to_hz as usize);
    let step = from / gcd(from, to);
    // An even number of steps makes the resampler's delay of half a block a whole number of samples.
    let steps = 2 * (BLOCK * from.max(to) / to).div_ceil(2 * step);
    let mut resampler = Fft::<f64>::new_custom(
        from,
        to,
        steps * step,
        1,
        channels.len(),
        WindowFunction::BlackmanHarris2,
        FixedSync::Both,
    )
    .map_err(|failure| failure.to_string())?;
    let input = SequentialSliceOfVecs::new(channels, channels.len(), frames)
        .map_err(|failure| failure.to_string())?;
    let output = resampler
        .process_all(&input, frames, None)
        .map_err(|failure| failure.to_string())?
        .take_data();
    let count = channels.len();
    Ok((0..count)
        .map(|channel| {
            output
                .iter()
                .skip(channel)
                .step_by(count)
                .copied()
                .collect()
        })
        .collect())
}

fn gcd(a: usize, b: usize) -> usize {
    if b == 0 { a } else { gcd(b, a % b) }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sine(frequency_hz: f64, rate_hz: u32, seconds: f64) -> Vec<f64> {
        let step = core::f64::consts::TAU * frequency_hz / f64::from(rate_hz);
        (0..(seconds * f64::from(rate_hz)) as usize)
            .map(|n| (step * n as f64).sin())
            .collect()
    }

    fn rms(signal: &[f64]) -> f64 {
        (signal.iter().map(|x| x * x).sum::<f64>() / signal.len() as f64).sqrt()
    }

    #[test]
    fn a_tone_in_the_band_keeps_time_and_amplitude() {
        for from_hz in [2800, 8000, 44_100, 48_000] {
            let signal = sine(400.0, from_hz, 2.0);
            let there = resample(&[signal], from_hz, 5000).unwrap().remove(0);
            assert_eq!(there.len(), 10_000, "from {from_hz} Hz");
            let expected = sine(400.0, 5000, 2.0);
            let middle = 1000..9000;
            let error: Vec<f64> = middle.map(|n| there[n] - expected[n]).collect();
            assert!(rms(&error) < 1e-3, "from {from_hz} Hz: {}", rms(&error));
        }
    }

    #[test]
    fn a_tone_above_the_new_band_is_gone_and_does_not_fold() {
        let signal = sine(3000.0, 44_100, 2.0);
        let there = resample(&[signal], 44_100, 5000).unwrap().remove(0);
        assert!(rms(&there[1000..9000]) < 1e-4);
    }

    #[test]
    fn channels_stay_apart() {
        let channels = [sine(100.0, 10_000, 1.0), vec![0.0; 10_000]];
        let there = resample(&channels, 10_000, 5000).unwrap();
        assert!(rms(&there[0]) > 0.7 && rms(&there[1]) < 1e-12);
    }
}
