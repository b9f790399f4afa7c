//! Accuracy in motion: how much is lost when coefficients follow the hand only at intervals.
//!
//! A hand rubs to and fro over the grid. The output of a structure is compared with that of a normalised lattice in
//! float64, which is driven by the same noise. The reference has the same nodes and the same order, and its θ and power
//! are interpolated again at every sample. Both signals are cut into frames of [`FRAME_S`] that overlap by half, and
//! their levels in third-octave bands are compared frame by frame. Because the noise is the same, differences come only
//! from coefficients and arithmetic: late updates, a structure's own interpolation, and its word lengths. (Frames this
//! short resolve third octaves from 50 Hz on; lower bands share power.)

use std::f64::consts::TAU;

use model_format::{FINE_THETA_STEP_RAD, MillimetresPerSecond, Newton, SAMPLE_RATE_HZ, Texture};
use serde::Serialize;
use stylus_dsp::spectrum::{AMPLITUDE_JND_DB, BAND_COUNT, band_powers};
use stylus_fit::texture::quantise::rms_m_s2;
use stylus_kernel::Motion;
use stylus_kernel::excitation::{self, Excitation};
use stylus_kernel::grid::{GridPoint, ONE};

use super::players::{NotHeld, Voice};
use stylus_costs::Structure;
use stylus_hard_cases::FloatLattice;

/// Strokes to and fro per second, and presses of the hand per second.
const STROKES_HZ: f64 = 2.0;
const PRESSES_HZ: f64 = 1.3;

/// Length of a frame, s.
pub const FRAME_S: f64 = 0.1;

/// Duration of the rubbing, s.
const SECONDS: f64 = 4.0;

/// Level below the frame's strongest band at which a band can no longer be felt, dB.
const HIDDEN_DB: f64 = 50.0;

/// A hand that rubs over the whole of a texture's grid.
#[derive(Clone, Copy, Debug)]
pub struct Rub {
    speed_mm_s: (f64, f64),
    force_n: (f64, f64),
}

impl Rub {
    /// Creates a rub over the whole grid of `texture`, except its nodes at rest and without contact.
    pub fn over(texture: &Texture<'_>) -> Self {
        let span = |axis: model_format::Axis<'_>| {
            let positive: Vec<f64> = (0..axis.len())
                .map(|index| f64::from(axis.value(index)))
                .filter(|&value| value > 0.0)
                .collect();
            let low = positive.first().copied().unwrap_or(0.0);
            let high = positive.last().copied().unwrap_or(0.0);
            (f64::midpoint(low, high), (high - low) / 2.0)
        };
        Self {
            speed_mm_s: span(texture.speed_axis()),
            force_n: span(texture.force_axis()),
        }
    }

    /// The motion at a sample.
    pub fn at(&self, sample: usize) -> Motion {
        let time_s = sample as f64 / f64::from(SAMPLE_RATE_HZ);
        let (speed, stroke) = self.speed_mm_s;
        let (force, press) = self.force_n;
        // Frequencies without a common period within the rub make the hand cover the grid, and not one line on it.
        let speed = speed + stroke * (TAU * STROKES_HZ * time_s).sin();
        let force = force + press * (TAU * PRESSES_HZ * time_s + 1.0).sin();
        Motion::new(MillimetresPerSecond(speed as f32), Newton(force as f32)).expect("a grid's values are finite")
    }

    /// Number of samples of the whole rub.
    pub fn samples() -> usize {
        (SECONDS * f64::from(SAMPLE_RATE_HZ)) as usize
    }
}

/// Levels by frame and band, (m/s²)².
pub type Frames = Vec<[f64; BAND_COUNT]>;

/// The outcome of rubbing one texture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize)]
pub struct Moving {
    /// Sum of the squared errors, dB².
    squares: f64,
    /// Number of bands that were compared, over all frames.
    bands: usize,
    /// Number of these bands within the JND.
    within: usize,
    /// Updates of the coefficients.
    updates: usize,
    /// Number of these updates that loaded the nodes of another cell.
    new_cells: usize,
    /// Samples played.
    samples: usize,
    /// Samples at full scale.
    pub saturations: u32,
}

impl Moving {
    /// Returns the sum of both outcomes.
    #[must_use]
    pub fn and(self, other: Self) -> Self {
        Self {
            squares: self.squares + other.squares,
            bands: self.bands + other.bands,
            within: self.within + other.within,
            updates: self.updates + other.updates,
            new_cells: self.new_cells + other.new_cells,
            samples: self.samples + other.samples,
            saturations: self.saturations + other.saturations,
        }
    }

    /// RMS of the errors in third-octave bands, frame by frame, dB.
    pub fn band_error_db(&self) -> f64 {
        (self.squares / self.bands as f64).sqrt()
    }

    /// Fraction of bands within the JND.
    pub fn bands_within_jnd(&self) -> f64 {
        self.within as f64 / self.bands as f64
    }

    /// Returns the number of updates per sample that stay in their cell, and of those that load the nodes of another
    /// cell.
    pub(crate) fn updates_per_sample(&self) -> (f64, f64) {
        let samples = self.samples as f64;
        let same = self.updates - self.new_cells;
        (same as f64 / samples, self.new_cells as f64 / samples)
    }
}

/// Returns the levels of the float64 reference for `texture`, which is a normalised lattice, during its rub.
pub fn reference(texture: &Texture<'_>, seed: u64) -> Frames {
    const DEVIATION: f64 = (1u64 << excitation::FRACTION_BITS) as f64;
    let stages = texture.max_order();
    let rub = Rub::over(texture);
    let mut noise = Excitation::new(seed);
    let mut lattice = FloatLattice::new(stages);
    let mut thetas = vec![0.0; stages];
    let signal: Vec<f64> = (0..Rub::samples())
        .map(|sample| {
            let point = GridPoint::locate(texture, rub.at(sample));
            thetas.fill(0.0);
            for (&(speed, force), &weight) in point.nodes.iter().zip(&point.weights) {
                let stored = texture.node(speed, force).coefficients.thetas();
                let step = f64::from(weight) / f64::from(ONE) * FINE_THETA_STEP_RAD;
                for (theta, stored) in thetas.iter_mut().zip(stored) {
                    *theta += f64::from(stored) * step;
                }
            }
            lattice.turn_by(&thetas);
            let driven = f64::from(noise.next_sample()) / DEVIATION;
            // A normalised lattice passes on the noise's power of one, so the level is a gain behind it.
            lattice.filter(driven) * rms_m_s2(texture, &point)
        })
        .collect();
    frames(&signal)
}

/// Plays `texture` with `structure` during its rub, with an update every `interval` samples, and compares the output
/// with `reference`.
pub fn play(
    structure: Structure,
    texture: Texture<'_>,
    reference: &Frames,
    interval: usize,
    seed: u64,
) -> Result<Moving, NotHeld> {
    let rub = Rub::over(&texture);
    let mut voice = Voice::new(structure, texture, seed)?;
    let mut moving = Moving {
        samples: Rub::samples(),
        ..Moving::default()
    };
    let mut nodes = None;
    let mut signal = Vec::with_capacity(Rub::samples());
    while signal.len() < Rub::samples() {
        let motion = rub.at(signal.len());
        voice.follow(motion, interval as u32);
        // An update to other nodes takes longer, and the table of costs has both kinds.
        let at = GridPoint::locate(&texture, motion).nodes;
        moving.updates += 1;
        moving.new_cells += usize::from(nodes != Some(at));
        nodes = Some(at);
        voice.play(interval.min(Rub::samples() - signal.len()), &mut signal);
    }
    moving.saturations = voice.saturations();
    for (played, exact) in frames(&signal).iter().zip(reference) {
        let strongest = exact.iter().copied().fold(0.0, f64::max);
        for (played, exact) in played.iter().zip(exact) {
            if *exact > strongest * 10f64.powf(-HIDDEN_DB / 10.0) {
                // A band that fell silent counts as too low by `HIDDEN_DB`, not by an infinite amount.
                let ratio = (played / exact).max(10f64.powf(-HIDDEN_DB / 10.0));
                let error = 10.0 * ratio.log10();
                moving.squares += error * error;
                moving.bands += 1;
                moving.within += usize::from(error.abs() <= AMPLITUDE_JND_DB);
            }
        }
    }
    Ok(moving)
}

/// Levels of `signal` in bands, frame by frame; the first frames, in which filters start, are left out.
fn frames(signal: &[f64]) -> Frames {
    let rate_hz = f64::from(SAMPLE_RATE_HZ);
    let length = (FRAME_S * rate_hz) as usize;
    (length..=signal.len() - length)
        .step_by(length / 2)
        .map(|begin| band_powers(&signal[begin..begin + length], rate_hz))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stress::models::library;
    use model_format::Library;
    use stylus_hard_cases::resonance;

    /// Four resonances, each at another frequency, so that the spectrum moves with the hand.
    fn moving_lines() -> Vec<u8> {
        let lines = [80.0, 120.0, 160.0, 240.0].map(|frequency_hz| resonance(0.98, frequency_hz));
        let nodes: Vec<_> = lines.iter().map(|line| (line, 4.0)).collect();
        library(&nodes).unwrap()
    }

    #[test]
    fn updates_at_every_sample_are_float64s_own_and_rarer_ones_are_farther_from_it() {
        let bytes = moving_lines();
        let library = Library::decode(&bytes).unwrap();
        let texture = library.textures().next().unwrap();
        let exact = reference(&texture, 3);
        let error = |interval| {
            let lattice = Structure::NormalisedLattice32;
            play(lattice, texture, &exact, interval, 3).unwrap().band_error_db()
        };
        let errors = [1, 10, 50, 250].map(error);
        // The level lags by one sample, because a ramp ends one sample late.
        assert!(errors[0] < 0.02, "{errors:?}");
        assert!(errors.is_sorted(), "{errors:?}");
        assert!(errors[3] > 10.0 * errors[0], "{errors:?}");
    }

    #[test]
    fn a_rub_stays_on_the_grid_and_reaches_its_ends() {
        let bytes = moving_lines();
        let library = Library::decode(&bytes).unwrap();
        let texture = library.textures().next().unwrap();
        let rub = Rub::over(&texture);
        let mut most = [0u32; 4];
        for sample in 0..Rub::samples() {
            let point = GridPoint::locate(&texture, rub.at(sample));
            assert_eq!(point.fade, ONE);
            for (most, weight) in most.iter_mut().zip(point.weights) {
                *most = weight.max(*most);
            }
        }
        assert!(most.iter().all(|&weight| weight > ONE / 2), "{most:?}");
    }
}
