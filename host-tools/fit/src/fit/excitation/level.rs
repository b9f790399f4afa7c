//! Local levels of a residual, and the track of them that a library stores.

use model_format::{LEVEL_FRACTION_BITS, ModulationSpec, SAMPLE_RATE_HZ, level_amplitude, limits};

use rayon::prelude::*;

use super::bound::limited;
use super::loudness::Loudest;
use super::power::{hann, least_power, local_rms_at};
use super::trace::Trace;
use crate::dsp::sums::mean_square;

/// Resolution of a level track.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Resolution {
    /// Width of the smoothing Hann window, samples. Its width at half height is half of this.
    pub smoothing: usize,
    /// Samples between two entries.
    pub step: u16,
}

/// Next to a codebook, which holds the faster changes: 100 ms, in steps of 20 ms.
pub(super) const BESIDE_CODEBOOK: Resolution = Resolution {
    smoothing: 500,
    step: 100,
};

/// Next to Gaussian noise: 20 ms, in steps of 5 ms, so that the envelope follows the recording's up to 64 Hz.
pub(super) const BESIDE_NOISE: Resolution = Resolution {
    smoothing: 100,
    step: 25,
};

/// Entries per factor of ten in amplitude: steps of 0.25 dB.
const ENTRIES_PER_DECADE: f64 = 80.0;

/// Highest level of a track, in entries: 20 dB. Higher levels would leave no headroom for a codebook's peaks.
const HIGHEST: f64 = 80.0;

/// Shortest track, s. A player takes pieces of 0.2 to 1 s from it.
const SHORTEST_S: f64 = 1.0;

/// Largest error of a track's mean square. The format allows 2 %.
const LARGEST_ERROR: f64 = 0.01;

/// Returns the level track of `traces`, and the number of trials in it. The traces are joined in their order, each
/// limited to the `loudest` windows and relative to its own RMS.
///
/// If they exceed the format's length, each contributes an equal part from its middle. If these parts would be shorter
/// than a second, fewer trials, evenly distributed, contribute a second each. `None` if all of them together are too
/// short, if their levels are all alike, or if these cannot be stored with a mean square of 1.
pub(super) fn track(traces: &[&Trace], resolution: Resolution, loudest: Loudest) -> Option<(ModulationSpec, usize)> {
    let step = usize::from(resolution.step);
    let shortest = (SHORTEST_S * f64::from(SAMPLE_RATE_HZ)) as usize / step;
    let most = limits::MAX_MODULATION_ENTRIES;
    let amplitudes: Vec<Vec<f64>> = traces
        .par_iter()
        .map(|trace| own_track(trace, resolution, loudest))
        .collect();
    let total: usize = amplitudes.iter().map(Vec::len).sum();
    let parts: Vec<&[f64]> = if total <= most {
        amplitudes.iter().map(Vec::as_slice).collect()
    } else {
        let count = amplitudes.len().min(most / shortest).max(1);
        let share = most / count;
        let middle = |own: &Vec<f64>| {
            let first = own.len().saturating_sub(share) / 2;
            first..own.len().min(first + share)
        };
        let chosen = (0..count).map(|n| &amplitudes[n * amplitudes.len() / count]);
        chosen.map(|own| &own[middle(own)]).collect()
    };
    let used = parts.iter().filter(|part| !part.is_empty()).count();
    let joined: Vec<f64> = parts.into_iter().flatten().copied().collect();
    if joined.len() < shortest.max(limits::MIN_MODULATION_ENTRIES) {
        return None;
    }
    let spec = ModulationSpec {
        step_samples: resolution.step,
        entries: entries(joined)?,
    };
    Some((spec, used))
}

/// Returns the amplitudes of a trial's track, relative to its own RMS, without its flaws.
fn own_track(trace: &Trace, resolution: Resolution, loudest: Loudest) -> Vec<f64> {
    let step = usize::from(resolution.step);
    let residual = limited(trace, trace.residual.as_slice().into(), loudest);
    let (weights, least) = (hann(resolution.smoothing), least_power(&residual));
    let places = (step / 2..residual.len()).step_by(step);
    let clean = places.filter(|&n| trace.is_clean(&(n..n + 1)));
    let level = |n| local_rms_at(&residual, &weights, least, n);
    let track: Vec<f64> = clean.map(level).collect();
    let unit = mean_square(&track).sqrt();
    track.into_iter().map(|level| level / unit).collect()
}

/// Returns the codes of `amplitudes`, scaled so that the mean square of their playback is 1. `None` if rounding
/// prevents that, or if all codes are 0.
fn entries(mut amplitudes: Vec<f64>) -> Option<Vec<i8>> {
    /// Number of scales to either side that are tried for the least error, over 0.5 dB.
    const TRIALS: i32 = 200;
    let highest = 10f64.powf(HIGHEST / ENTRIES_PER_DECADE);
    // Levels above the highest one are clipped, and the others are raised until the mean square is 1 again.
    for _ in 0..20 {
        let unit = played_power(&amplitudes).sqrt();
        if !unit.is_normal() {
            return None;
        }
        for amplitude in &mut amplitudes {
            *amplitude = (*amplitude / unit).min(highest);
        }
    }
    let code = |amplitude: f64, shift: f64| {
        let code = (ENTRIES_PER_DECADE * amplitude.log10() + shift).round();
        code.clamp(f64::from(i8::MIN), HIGHEST) as i8
    };
    let coded = |trial: i32| -> Vec<i8> {
        let shift = 2.0 * f64::from(trial) / f64::from(TRIALS);
        amplitudes.iter().map(|&amplitude| code(amplitude, shift)).collect()
    };
    let error = |codes: &Vec<i8>| {
        let played: Vec<f64> = codes.iter().map(|&code| amplitude(code)).collect();
        (played_power(&played) - 1.0).abs()
    };
    let all = (-TRIALS..=TRIALS).map(coded);
    let judged = all.map(|codes| (error(&codes), codes));
    let (least, codes) = judged.min_by(|a, b| a.0.total_cmp(&b.0))?;
    // A constant track means the same as no track.
    let changes = codes.iter().any(|&code| code != 0);
    (changes && least <= LARGEST_ERROR).then_some(codes)
}

/// Returns the amplitude of an entry.
pub(super) fn amplitude(entry: i8) -> f64 {
    f64::from(level_amplitude(entry)) / f64::from(1u32 << LEVEL_FRACTION_BITS)
}

/// Returns the mean square of amplitudes that are interpolated linearly from each to the next, and from the last to the
/// first.
fn played_power(amplitudes: &[f64]) -> f64 {
    let next = amplitudes.iter().cycle().skip(1);
    let pair = |(a, b): (&f64, &f64)| (a * a + a * b + b * b) / 3.0;
    amplitudes.iter().zip(next).map(pair).sum::<f64>() / amplitudes.len().max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::super::power::local_rms;
    use super::*;

    const ANY: Loudest = Loudest([f64::INFINITY; 3]);
    use proptest::prelude::*;

    fn trace(residual: Vec<f64>) -> Trace {
        Trace {
            residual,
            ..Trace::default()
        }
    }

    /// A tone of 800 Hz whose level changes at 5 Hz, by 1 + 0.8 cos.
    fn beating(samples: usize) -> Vec<f64> {
        let envelope = |n: usize| 1.0 + 0.8 * (n as f64 * std::f64::consts::TAU / 1000.0).cos();
        (0..samples).map(|n| envelope(n) * (n as f64).sin()).collect()
    }

    #[test]
    fn the_local_rms_of_a_steady_signal_is_its_level_up_to_its_ends() {
        for level in local_rms(&[-2.0; 700], 100) {
            assert!((level - 2.0).abs() < 1e-12);
        }
        assert_eq!(local_rms(&[], 100), Vec::<f64>::new());
        assert!(local_rms(&[0.0; 10], 4).iter().all(|&level| level > 0.0));
    }

    #[test]
    fn a_tone_that_beats_has_its_envelope_as_track() {
        let signal = beating(20_000);
        for resolution in [BESIDE_CODEBOOK, BESIDE_NOISE] {
            let (spec, trials) = track(&[&trace(signal.clone())], resolution, ANY).unwrap();
            assert_eq!(trials, 1);
            let step = usize::from(resolution.step);
            assert_eq!(spec.entries.len(), 20_000 / step);
            let level = |n: usize| amplitude(spec.entries[n / step]);
            let dip_db = 20.0 * (level(10_000) / level(10_500)).log10();
            // A window of 100 ms partly fills a dip of 200 ms.
            let expected = if resolution == BESIDE_NOISE { 18.0 } else { 11.0 };
            assert!(dip_db > expected && dip_db < 19.5, "{dip_db}");
        }
    }

    #[test]
    fn trials_without_room_give_equal_parts_of_themselves_or_give_way() {
        let residual = |seconds: usize| beating(5000 * seconds);
        let long = trace(residual(30));
        let (spec, trials) = track(&[&long, &long, &long], BESIDE_CODEBOOK, ANY).unwrap();
        assert_eq!((spec.entries.len(), trials), (4095, 3));
        let many: Vec<Trace> = (0..100).map(|_| trace(residual(2))).collect();
        let (spec, trials) = track(&many.iter().collect::<Vec<_>>(), BESIDE_CODEBOOK, ANY).unwrap();
        assert_eq!((spec.entries.len(), trials), (81 * 50, 81));
        assert!(track(&[&trace(residual(1)[..4000].to_vec())], BESIDE_NOISE, ANY).is_none());
    }

    #[test]
    fn flaws_have_no_entries() {
        let mut one = trace(beating(20_000));
        one.residual[9000..9500].fill(0.0);
        one.flaws.push(8000..10_500);
        let (spec, _) = track(&[&one], BESIDE_NOISE, ANY).unwrap();
        assert_eq!(spec.entries.len(), 700);
        // The dips of the beat are 19 dB below the peaks, and silence is 50 dB below them.
        assert!(spec.entries.iter().all(|&entry| entry > -80));
    }

    proptest! {
        /// Levels of any distribution, even a single burst, give a playback with a mean square of 1, or no track.
        #[test]
        fn a_tracks_played_mean_square_is_one(
            levels in prop::collection::vec(-60.0f64..20.0, 200..400),
            burst_db in 0.0f64..60.0,
        ) {
            let mut amplitudes: Vec<f64> = levels.iter().map(|db| 10f64.powf(db / 20.0)).collect();
            amplitudes[100] *= 10f64.powf(burst_db / 20.0);
            let entries = entries(amplitudes).unwrap();
            let spec = ModulationSpec { step_samples: 25, entries: entries.clone() };
            let played: Vec<f64> = entries.iter().map(|&entry| amplitude(entry)).collect();
            prop_assert!((played_power(&played) - 1.0).abs() <= LARGEST_ERROR);
            prop_assert!(spec.entries.iter().all(|&entry| f64::from(entry) <= HIGHEST));
        }
    }
}
