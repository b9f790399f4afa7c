//! Effects of measuring, added to the tool's acceleration.

use std::f64::consts::TAU;

use rand::{RngExt, SeedableRng};
use rand_distr::StandardNormal;
use rand_pcg::Pcg64;
use stylus_dsp::fourier::Complex;
use stylus_support::fnv::Fnv;

use super::{Hum, Measurement, Noise, Tremor};

/// Number of sines that make up a tremor; enough that their sum is nearly Gaussian.
const TREMOR_SINES: usize = 24;

/// Adds the effects that `measurement` names to `samples` (axis by axis, m/s²), in the order tremor, hum, offset,
/// noise, clipping. Returns the number of clipped samples.
pub(super) fn apply(
    measurement: &Measurement,
    sample_rate_hz: f64,
    key: StreamKey,
    samples: &mut [Vec<f64>; 3],
) -> u64 {
    if let Some(tremor) = &measurement.tremor {
        let movement = tremor_movement(tremor, sample_rate_hz, key, samples[0].len());
        add_along(samples, &movement, tremor.rms_m_s2);
    }
    if let Some(hum) = &measurement.hum {
        let sine = hum_sine(hum, sample_rate_hz, key, samples[0].len());
        add_along(samples, &sine, hum.amplitude_m_s2);
    }
    if let Some(offset) = &measurement.offset {
        for (axis, value) in samples.iter_mut().zip(offset.value_m_s2) {
            for sample in axis {
                *sample += value;
            }
        }
    }
    if let Some(noise) = &measurement.noise {
        add_noise(noise, key, samples);
    }
    let mut clipped = 0;
    if let Some(clipping) = &measurement.clipping {
        let range = clipping.range_m_s2();
        for sample in samples.iter_mut().flatten() {
            if sample.abs() > range {
                *sample = range.copysign(*sample);
                clipped += 1;
            }
        }
    }
    clipped
}

fn add_along(samples: &mut [Vec<f64>; 3], movement: &[f64], direction: [f64; 3]) {
    for (axis, scale) in samples.iter_mut().zip(direction) {
        for (sample, value) in axis.iter_mut().zip(movement) {
            *sample += scale * value;
        }
    }
}

/// Returns a Gaussian movement of expected RMS 1 whose power is spread evenly over the band: a sum of sines of random
/// frequencies.
fn tremor_movement(tremor: &Tremor, sample_rate_hz: f64, key: StreamKey, samples: usize) -> Vec<f64> {
    let mut random = key.stream("tremor");
    let mut movement = vec![0.0; samples];
    let scale = (TREMOR_SINES as f64).sqrt().recip();
    for _ in 0..TREMOR_SINES {
        let position: f64 = random.random();
        let frequency_hz = tremor.lowest_hz + position * (tremor.highest_hz - tremor.lowest_hz);
        let (cosine, sine): (f64, f64) = (random.sample(StandardNormal), random.sample(StandardNormal));
        // A rotating phasor costs one multiplication per sample, and its error after 10⁴ samples is 1e-12.
        let mut phasor = Complex::new(cosine, sine) * scale;
        let step = Complex::cis(TAU * frequency_hz / sample_rate_hz);
        for value in &mut movement {
            *value += phasor.re;
            phasor *= step;
        }
    }
    movement
}

fn hum_sine(hum: &Hum, sample_rate_hz: f64, key: StreamKey, samples: usize) -> Vec<f64> {
    let start_cycles: f64 = key.stream("hum").random();
    (0..samples)
        .map(|i| {
            // Without whole turns, the angle keeps its digits in a long trial.
            let cycles = start_cycles + hum.frequency_hz * i as f64 / sample_rate_hz;
            (TAU * cycles.fract()).sin()
        })
        .collect()
}

fn add_noise(noise: &Noise, key: StreamKey, samples: &mut [Vec<f64>; 3]) {
    for (index, (axis, rms)) in samples.iter_mut().zip(noise.rms_m_s2).enumerate() {
        let mut random = key.index(index).stream("noise");
        for sample in axis {
            let value: f64 = random.sample(StandardNormal);
            *sample += rms * value;
        }
    }
}

/// The key of a random stream: the hash of what it is used for.
#[derive(Debug, Clone, Copy)]
pub(super) struct StreamKey(Fnv);

impl StreamKey {
    pub(super) fn new(seed: u64) -> Self {
        Self(Fnv::default().then(&seed.to_le_bytes()))
    }

    /// Adds a text. It is terminated by the byte 0xFF, which UTF-8 never contains.
    pub(super) fn text(self, text: &str) -> Self {
        Self(self.0.then(text.as_bytes()).then(&[0xFF]))
    }

    pub(super) fn number(self, value: f64) -> Self {
        Self(self.0.then(&value.to_le_bytes()))
    }

    pub(super) fn index(self, index: usize) -> Self {
        Self(self.0.then(&(index as u64).to_le_bytes()))
    }

    /// Returns the stream of `effect`.
    pub(super) fn stream(self, effect: &str) -> Pcg64 {
        Pcg64::seed_from_u64(self.text(effect).0.value())
    }
}
