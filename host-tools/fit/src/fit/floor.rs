//! The rig's own noise: motor and sensor without a surface. It is measured in trials in motion at 0 N, or in recordings
//! that the user names.
//!
//! The noise is reduced to one axis in the same way as each recording, because motor and texture vibrate in different
//! directions. Between speeds its level in dB is linear in the logarithm of the speed; beyond the outermost speeds the
//! nearest one counts. Only noise that was recorded at a recording's own speed has its tones at the right frequencies.

use std::path::Path;

use stylus_dsp::fourier::quick_length;
use stylus_dsp::reduction::View;
use stylus_dsp::spectrum::{PowerSpectrum, band_edges_hz, longest_segment, without_noise};
use stylus_signals::recording::{RecordingSet, Trial};
use stylus_support::in_order::in_order;
use stylus_support::number::counted;
use stylus_support::{Error, Result};

use super::options::Options;
use super::trial::{FloorShares, read_axes};

/// Divisor for the length of the segments of both spectra: about a tenth of the shorter recording, so that each
/// spectrum is a mean over about twenty segments.
const SEGMENT_SHARE: usize = 10;

/// Shortest recording of the noise that is used, s.
const LEAST_S: f64 = 0.5;

/// A recording of the noise.
pub(super) struct NoiseTake {
    /// Tangential speed, mm/s.
    pub speed_mm_s: f64,
    /// Axes of the recording about their means, m/s².
    pub axes: Vec<Vec<f64>>,
}

/// The noise of a rig.
pub(super) struct Floor {
    /// Recordings of the noise, in the order of their speeds.
    takes: Vec<NoiseTake>,
    rate_hz: f64,
}

impl Floor {
    /// Returns the noise in `takes`; `None` if there are none, or all are too short.
    pub fn of(mut takes: Vec<NoiseTake>, rate_hz: u32) -> Option<Self> {
        let rate_hz = f64::from(rate_hz);
        takes.retain(|take| take.samples() as f64 >= LEAST_S * rate_hz);
        takes.sort_by(|a, b| a.speed_mm_s.total_cmp(&b.speed_mm_s));
        (!takes.is_empty()).then_some(Self { takes, rate_hz })
    }

    /// Returns the noise's fraction of the power of `samples`, a recording at a speed that was reduced to one axis by
    /// `view`. Subtracts the noise from the samples if `is_taken_off`.
    pub fn apply(&self, samples: &mut Vec<f64>, speed_mm_s: f64, view: &View, is_taken_off: bool) -> FloorShares {
        let shortest = self.takes.iter().map(NoiseTake::samples).min().unwrap_or(0);
        let segment = quick_length(shortest.min(samples.len()) / SEGMENT_SHARE).min(longest_segment(self.rate_hz));
        let whole = PowerSpectrum::of_blocks(&[samples], segment, self.rate_hz);
        let noise = self.at(speed_mm_s, view, segment);
        if is_taken_off {
            *samples = without_noise(samples, &whole, &noise, self.rate_hz);
        }
        // Of the recording as it was, even if the noise was subtracted.
        shares(&noise, &whole)
    }

    /// Returns the noise at a speed, reduced to one axis by `view`.
    fn at(&self, speed_mm_s: f64, view: &View, segment: usize) -> PowerSpectrum {
        let slower = self.takes.partition_point(|take| take.speed_mm_s < speed_mm_s);
        let last = self.takes.len() - 1;
        let [below, above] = [slower.saturating_sub(1), slower.min(last)];
        let [low, high] = [below, above].map(|index| self.takes[index].speed_mm_s);
        let share = if low < speed_mm_s && speed_mm_s < high && low > 0.0 {
            (speed_mm_s / low).ln() / (high / low).ln()
        } else {
            // At a speed of the noise, beyond all its speeds, or above a noise at rest, whose speed has no logarithm.
            1.0
        };
        let upper = self.spectrum(high, view, segment);
        if share < 1.0 {
            return self.spectrum(low, view, segment).towards(&upper, share);
        }
        upper
    }

    /// Returns the mean over all takes of the noise at one of its speeds.
    fn spectrum(&self, speed_mm_s: f64, view: &View, segment: usize) -> PowerSpectrum {
        let at_speed = self
            .takes
            .iter()
            .filter(|take| take.speed_mm_s.total_cmp(&speed_mm_s).is_eq());
        // Each take was reduced in the same way when it was read, so the reduction does not fail.
        let reduced: Vec<Vec<f64>> = at_speed.filter_map(|take| view.reduce(&take.axes).ok()).collect();
        let blocks: Vec<&[f64]> = reduced.iter().map(Vec::as_slice).collect();
        PowerSpectrum::of_blocks(&blocks, segment, self.rate_hz)
    }
}

impl NoiseTake {
    /// Returns the noise in `trial`, whose `axes` are given. The recordings of the `texture` have this number of
    /// `channels`.
    pub fn of(trial: &Trial, axes: Vec<Vec<f64>>, texture: &str, channels: Option<usize>) -> Result<Self> {
        if let Some(channels) = channels.filter(|&channels| channels != axes.len()) {
            let problem = format!(
                "has {}, and the recordings of '{texture}' have {channels}: record the rig's noise by the same sensor, \
                 or leave it out",
                counted(axes.len(), "channel"),
            );
            return Err(Error::file(&trial.file, problem));
        }
        Ok(Self {
            speed_mm_s: trial.speed_mm_s,
            axes,
        })
    }

    fn samples(&self) -> usize {
        self.axes.first().map_or(0, Vec::len)
    }
}

/// Returns the fraction of `noise` in the power of `whole`, for each band.
fn shares(noise: &PowerSpectrum, whole: &PowerSpectrum) -> FloorShares {
    std::array::from_fn(|band| {
        let (low_hz, high_hz) = band_edges_hz(band);
        let [noise, whole] = [noise, whole].map(|spectrum| spectrum.power_between(low_hz, high_hz));
        if whole > 0.0 {
            (noise / whole).min(1.0) as f32
        } else {
            0.0
        }
    })
}

/// Reads the rig's noise from the recordings at `path`. They must be of the same sensor as the texture, with the same
/// number of `channels`. A missing scale or sample rate is taken from the texture's trial `like`.
pub(super) fn named(path: &Path, like: &Trial, channels: Option<usize>, options: &Options) -> Result<Vec<NoiseTake>> {
    let mut set = RecordingSet::open(&[path.to_owned()])?;
    for trial in &mut set.trials {
        trial.scale_m_s2 = trial.scale_m_s2.or(like.scale_m_s2);
        trial.sample_rate_hz = trial.sample_rate_hz.or(like.sample_rate_hz);
    }
    in_order(&set.trials, |trial| {
        let axes = read_axes(trial, options)?;
        NoiseTake::of(trial, axes, &like.texture, channels)
    })
}

/// Mean fraction of the rig's noise in the recordings at one speed.
#[derive(Clone, Debug, PartialEq)]
pub struct FloorAtSpeed {
    /// Tangential speed, mm/s.
    pub speed_mm_s: f64,
    /// Fraction for each third octave.
    pub shares: FloorShares,
}

/// Returns the fractions at each speed, from the speeds, mm/s, and fractions of the recordings of a texture.
pub fn by_speed<'a>(recordings: impl IntoIterator<Item = (f64, &'a FloorShares)>) -> Vec<FloorAtSpeed> {
    let mut all: Vec<(f64, &FloorShares)> = recordings.into_iter().collect();
    all.sort_by(|a, b| a.0.total_cmp(&b.0));
    let at_speed = all.chunk_by(|a, b| a.0.total_cmp(&b.0).is_eq());
    let mean = |own: &[(f64, &FloorShares)]| FloorAtSpeed {
        speed_mm_s: own[0].0,
        shares: std::array::from_fn(|band| own.iter().map(|(_, shares)| shares[band]).sum::<f32>() / own.len() as f32),
    };
    at_speed.map(mean).collect()
}

/// Returns the error of a texture whose noise should be subtracted but is not known.
pub(super) fn unknown(texture: &str) -> Error {
    Error::Model(format!(
        "texture '{texture}' has no trial in motion at 0 N of half a second, so that its rig's noise is not known: \
         record one at each speed, or give --floor-recording, or leave out --floor subtract"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::fit;
    use model_format::SAMPLE_RATE_HZ;
    use proptest::prelude::*;
    use stylus_dsp::reduction::Reduction;
    use stylus_support::float_wav::float_wav;
    use test_helpers::{holds, near, noise};

    const SEGMENT: usize = 500;

    /// Makes a rig's noise with these RMS values, m/s², at speeds in mm/s.
    fn floor(levels: &[(f64, f64)]) -> Floor {
        let take = |&(speed_mm_s, rms): &(f64, f64)| NoiseTake {
            speed_mm_s,
            axes: vec![noise(1, 20_000).iter().map(|x| rms * x).collect()],
        };
        Floor {
            takes: levels.iter().map(take).collect(),
            rate_hz: 5000.0,
        }
    }

    fn rms(floor: &Floor, speed_mm_s: f64) -> f64 {
        let view = View::of(&[vec![1.0, -1.0]], Reduction::Pca);
        floor.at(speed_mm_s, &view, SEGMENT).power_between(0.0, 2500.0).sqrt()
    }

    #[test]
    fn between_two_speeds_the_level_is_linear_in_the_logarithm_of_the_speed_and_beyond_the_nearest() {
        let rig = floor(&[(50.0, 0.1), (200.0, 0.4)]);
        let unit = rms(&floor(&[(50.0, 1.0)]), 50.0);
        for (speed, expected) in [(10.0, 0.1), (50.0, 0.1), (100.0, 0.2), (200.0, 0.4), (900.0, 0.4)] {
            near(rms(&rig, speed) / unit, expected, 1e-9);
        }
    }

    #[test]
    fn noise_of_fewer_channels_than_the_texture_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let trial = |channels: usize, force_n: f64| {
            let file = folder.path().join(format!("{channels}.wav"));
            let wav = float_wav(channels, SAMPLE_RATE_HZ, noise(1, 12_000)).unwrap();
            std::fs::write(&file, wav).unwrap();
            Trial::of(file, "felt", 80.0, force_n)
        };
        let set = RecordingSet {
            trials: vec![trial(1, 0.0), trial(2, 1.0)],
            is_listed: true,
        };
        let failure = fit(&set, &Options::default(), |_| ()).unwrap_err();
        let problem = "has 1 channel, and the recordings of 'felt' have 2: record the rig's noise by the same sensor";
        holds(&failure, &["1.wav", problem]);
    }

    #[test]
    fn recordings_of_one_speed_count_by_the_mean_of_their_power() {
        let unit = rms(&floor(&[(50.0, 1.0)]), 50.0);
        near(
            rms(&floor(&[(50.0, 0.6), (50.0, 0.8)]), 50.0) / unit,
            0.5f64.sqrt(),
            1e-9,
        );
    }

    proptest! {
        #[test]
        fn the_noise_at_any_speed_is_between_that_of_its_neighbours(
            speeds in prop::collection::vec(0.0..1000.0f64, 1..6), speed in 0.0..1200.0f64,
        ) {
            let mut levels: Vec<(f64, f64)> = speeds.iter().map(|&speed| (speed, 0.01 + speed)).collect();
            levels.sort_by(|a, b| a.0.total_cmp(&b.0));
            let found = rms(&floor(&levels), speed);
            let unit = rms(&floor(&[(50.0, 1.0)]), 50.0);
            let known = |&(_, level): &(f64, f64)| level * unit;
            let below = levels.iter().rev().find(|own| own.0 <= speed).unwrap_or(&levels[0]);
            let above = levels.iter().find(|own| own.0 >= speed).unwrap_or(&levels[levels.len() - 1]);
            prop_assert!(found >= known(below) * (1.0 - 1e-9) && found <= known(above) * (1.0 + 1e-9));
        }
    }
}
