//! One trial: a tip on a surface that passes at one speed under one force.

use std::f64::consts::{PI, TAU};

use rand::RngExt;
use rand_distr::StandardNormal;
use rayon::prelude::*;
use stylus_dsp::fourier::Complex;

use super::contact::{Contact, Response, ToolResponse};
use super::file::RigFile;
use super::measurement::{self, StreamKey};
use super::profile::Profile;
use super::series::UniformSampler;
use super::{RigDescription, Texture, Tool, Wander};

/// One texture on the drum with one seed: its profile, and for each speed the response that turns the profile into
/// samples.
///
/// Trials of a strip do not depend on the other textures of the rig.
pub struct Strip<'a> {
    description: &'a RigDescription,
    texture: &'a Texture,
    key: StreamKey,
    profile: Profile,
    /// Responses, one per speed. The list is empty if there is no vibration: the surface is flat, there is no tool, or
    /// no force is above zero.
    passes: Vec<Pass>,
}

/// The recording of one trial.
#[derive(Debug, Clone, PartialEq)]
pub struct Trial {
    /// Surface speed, mm/s.
    pub speed_mm_s: f64,
    /// Normal force, N.
    pub force_n: f64,
    /// Acceleration on x (along the motion), y (across) and z (normal), m/s²; each [`Recording::samples`] long.
    ///
    /// [`Recording::samples`]: super::Recording::samples
    pub samples_m_s2: [Vec<f64>; 3],
    /// Number of samples that the sensor's range cut off.
    pub clipped: u64,
}

impl Trial {
    /// Returns the RMS about the mean, over the three axes together, m/s².
    pub fn rms_m_s2(&self) -> f64 {
        let power: f64 = self
            .samples_m_s2
            .iter()
            .map(|axis| {
                let count = axis.len() as f64;
                let mean = axis.iter().sum::<f64>() / count;
                axis.iter().map(|sample| (sample - mean).powi(2)).sum::<f64>() / count
            })
            .sum();
        power.sqrt()
    }
}

/// The response that turns a profile into samples at one speed.
struct Pass {
    /// Fraction of the drum's circumference that passes per sample.
    step_cycles: f64,
    sampler: UniformSampler,
    /// Wavenumber of each term of the profile, and the tool's response at its frequency.
    tool: Vec<TermResponse>,
}

struct TermResponse {
    wavenumber_rad_per_mm: f64,
    response: Response,
}

impl<'a> Strip<'a> {
    /// Computes the profile of the texture at index `texture` of [`RigDescription::textures`], and its responses.
    /// Panics if the rig has no such texture.
    pub fn new(rig: &'a RigFile, texture: usize, seed: u64) -> Self {
        let description = rig.description();
        let texture = &description.textures[texture];
        let profile = Profile::new(&description.drum, texture, seed);
        let touches = description.recording.forces_n.iter().any(|force_n| *force_n > 0.0);
        let passes = match &description.tool {
            Some(tool) if touches && !profile.is_flat() => description
                .recording
                .speeds_mm_s
                .par_iter()
                .map(|speed_mm_s| Pass::new(description, tool, *speed_mm_s, &profile))
                .collect(),
            _ => Vec::new(),
        };
        Self {
            description,
            texture,
            key: StreamKey::new(seed).text(&texture.name),
            profile,
            passes,
        }
    }

    /// Runs the trial with the speed and force at the indices `speed` and `force` of the rig's
    /// [`Recording`](super::Recording). The same rig and seed give the same trial in any order.
    /// Panics if the rig has no such speed or force.
    pub fn trial(&self, speed: usize, force: usize) -> Trial {
        let recording = &self.description.recording;
        let speed_mm_s = recording.speeds_mm_s[speed];
        let force_n = recording.forces_n[force];
        let key = self.key.number(speed_mm_s).number(force_n);
        let felt = self.passes.get(speed).and_then(|pass| {
            let tool = self.description.tool.as_ref()?;
            let contact = Contact::hertz(tool.tip_radius_mm, self.texture.effective_modulus_mpa, force_n)?;
            Some((pass, contact))
        });
        // Without contact, only the effects of measuring remain.
        let mut samples_m_s2 = match felt {
            Some((pass, contact)) => {
                let spectra = pass.spectra(&self.profile, self.texture.loss_factor, &contact, key);
                match &self.description.drum.wander {
                    Some(wander) => {
                        let sample_rate_hz = f64::from(recording.sample_rate_hz);
                        let places = places(wander, sample_rate_hz, key, recording.samples());
                        pass.at_places(&spectra, &places)
                    }
                    None => spectra.map(|coefficients| pass.sampler.real_part(&coefficients)),
                }
            }
            None => std::array::from_fn(|_| vec![0.0; recording.samples()]),
        };
        let clipped = measurement::apply(
            &self.description.measurement,
            f64::from(recording.sample_rate_hz),
            key,
            &mut samples_m_s2,
        );
        Trial {
            speed_mm_s,
            force_n,
            samples_m_s2,
            clipped,
        }
    }
}

impl Pass {
    fn new(description: &RigDescription, tool: &Tool, speed_mm_s: f64, profile: &Profile) -> Self {
        let recording = &description.recording;
        let circumference_mm = description.drum.circumference_mm;
        let sample_rate_hz = f64::from(recording.sample_rate_hz);
        let step_cycles = speed_mm_s / (sample_rate_hz * circumference_mm);
        // Strictly below half the sample rate, because samples at that frequency depend on the phase.
        let below_nyquist = ((0.5 / step_cycles).ceil() as usize).saturating_sub(1);
        let terms = (profile.coefficients_um().len() - 1).min(below_nyquist);
        let tool = ToolResponse::new(&tool.modes);
        let tool = (1..=terms)
            .map(|n| TermResponse {
                wavenumber_rad_per_mm: TAU * n as f64 / circumference_mm,
                response: tool.at(n as f64 * speed_mm_s / circumference_mm),
            })
            .collect();
        Self {
            step_cycles,
            sampler: UniformSampler::new(terms, recording.samples(), step_cycles),
            tool,
        }
    }

    /// Returns the steady-state acceleration of the tool on each axis at these positions, m/s². Positions are in
    /// samples at the nominal speed.
    fn at_places(&self, spectra: &[Vec<Complex<f64>>; 3], places: &[f64]) -> [Vec<f64>; 3] {
        let (first, points) = points(places);
        let point_cycles = self.step_cycles / POINTS_PER_SAMPLE as f64;
        let sampler = UniformSampler::new(self.tool.len(), points, point_cycles);
        let start_cycles = first as f64 * point_cycles;
        std::array::from_fn(|axis| {
            // The sampler begins at 0, so the series is turned to begin at the first point.
            let turned: Vec<Complex<f64>> = spectra[axis]
                .iter()
                .enumerate()
                .map(|(n, c)| c * Complex::cis(TAU * (n as f64 * start_cycles).fract()))
                .collect();
            read(&sampler.real_part(&turned), first, places)
        })
    }

    /// Returns the terms of the steady-state acceleration of the tool over the drum on each axis, m/s², starting at the
    /// trial's start.
    fn spectra(
        &self,
        profile: &Profile,
        loss_factor: Option<f64>,
        contact: &Contact,
        key: StreamKey,
    ) -> [Vec<Complex<f64>>; 3] {
        let start_cycles: f64 = key.stream("start").random();
        // Term 0 is not used.
        let mut axes: [Vec<Complex<f64>>; 3] = std::array::from_fn(|_| vec![Complex::default()]);
        for (n, (height_um, term)) in profile.coefficients_um().iter().skip(1).zip(&self.tool).enumerate() {
            let turn = Complex::cis(TAU * ((n + 1) as f64 * start_cycles).fract());
            let force_n = height_um
                * turn
                * contact.patch_response(term.wavenumber_rad_per_mm)
                * term.response.force_per_height(contact, loss_factor);
            for (axis, response) in axes.iter_mut().zip(term.response.acceleration_per_force) {
                axis.push(force_n * response);
            }
        }
        axes
    }
}

/// Number of sines that make up a wander.
const SINES: usize = 48;

/// Number of points of the vibration per sample.
const POINTS_PER_SAMPLE: usize = 4;

/// Number of points on each side of a position from which its value is interpolated.
const REACH: usize = 16;

/// Returns the position at each sample, in samples at the nominal speed.
fn places(wander: &Wander, sample_rate_hz: f64, key: StreamKey, samples: usize) -> Vec<f64> {
    let mut random = key.stream("wander");
    let mut speed = vec![1.0; samples];
    let scale = wander.rms / (SINES as f64).sqrt();
    for _ in 0..SINES {
        // A process with a Gaussian correlation over time has a Gaussian spectrum.
        let position: f64 = random.sample(StandardNormal);
        let frequency_hz = position / (TAU * wander.correlation_s);
        let (cosine, sine): (f64, f64) = (random.sample(StandardNormal), random.sample(StandardNormal));
        for (n, speed) in speed.iter_mut().enumerate() {
            let angle = TAU * (frequency_hz * n as f64 / sample_rate_hz).fract();
            *speed += scale * (cosine * angle.cos() + sine * angle.sin());
        }
    }
    let mut place = 0.0;
    speed
        .into_iter()
        .map(|speed| {
            let here = place;
            place += speed;
            here
        })
        .collect()
}

/// Returns the index of the first point that is needed for `places`, and the number of points.
fn points(places: &[f64]) -> (i64, usize) {
    let (low, high) = places
        .iter()
        .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), &x| {
            (low.min(x), high.max(x))
        });
    let (reach, per_sample) = (REACH as i64, POINTS_PER_SAMPLE as f64);
    let first = (low * per_sample).floor() as i64 - reach;
    let last = (high * per_sample).ceil() as i64 + reach;
    (first, (last - first + 1) as usize)
}

/// Returns the values at `places` of a function that is known at points from `first` on.
fn read(values: &[f64], first: i64, places: &[f64]) -> Vec<f64> {
    places
        .iter()
        .map(|place| {
            let at = place * POINTS_PER_SAMPLE as f64 - first as f64;
            let before = at.floor() as usize;
            (before + 1 - REACH..=before + REACH)
                .map(|point| values[point] * windowed_sinc(at - point as f64))
                .sum()
        })
        .collect()
}

/// Sinc function with a Hann window over [`REACH`] points on each side.
fn windowed_sinc(x: f64) -> f64 {
    let window = 0.5 + 0.5 * (PI * x / REACH as f64).cos();
    if x.abs() < 1e-9 {
        return window;
    }
    window * (PI * x).sin() / (PI * x)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use test_helpers::near;

    const WANDER: Wander = Wander {
        rms: 0.01,
        correlation_s: 0.2,
    };

    proptest! {
        #[test]
        fn a_sine_over_place_is_read_where_the_tip_is(cycles_per_sample in 0.001..0.45_f64, seed in 0u64..1000) {
            let places = places(&WANDER, 5000.0, StreamKey::new(seed), 2000);
            let (first, count) = points(&places);
            let sine = |place: f64| (TAU * cycles_per_sample * place).sin();
            let values: Vec<f64> = (0..count)
                .map(|point| sine((first + point as i64) as f64 / POINTS_PER_SAMPLE as f64))
                .collect();
            for (value, place) in read(&values, first, &places).iter().zip(&places) {
                prop_assert!((value - sine(*place)).abs() < 1e-3);
            }
        }
    }

    #[test]
    fn the_speed_wanders_by_as_much_as_is_named() {
        let samples = 400_000;
        let places = places(&WANDER, 5000.0, StreamKey::new(3), samples);
        let deviations = places.windows(2).map(|pair| (pair[1] - pair[0] - 1.0).powi(2));
        let rms = (deviations.sum::<f64>() / (samples - 1) as f64).sqrt();
        near(rms / WANDER.rms, 1.0, 0.3);
    }
}
