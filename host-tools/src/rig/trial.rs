//! One trial: a tip on a surface that passes by at one speed under one force.

use std::f64::consts::TAU;

use rand::RngExt;
use rayon::prelude::*;
use realfft::RealFftPlanner;
use realfft::num_complex::Complex;

use super::contact::Contact;
use super::description::{RigDescription, Texture, Tool};
use super::file::RigFile;
use super::measurement;
use super::profile::Profile;
use super::random::StreamKey;
use super::resonance::ToolResponse;
use super::series::UniformSampler;
use super::wander;

/// One texture on the drum with one seed: its profile, and the response per speed that turns the profile into samples.
///
/// Its trials do not depend on the other textures of the rig.
pub struct Strip<'a> {
    description: &'a RigDescription,
    texture: &'a Texture,
    key: StreamKey,
    profile: Profile,
    /// One per speed; empty if nothing is felt: a flat surface, no tool, or no force above zero.
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
    /// RMS about the mean, over the three axes together, m/s².
    pub fn rms_m_s2(&self) -> f64 {
        let power: f64 = self
            .samples_m_s2
            .iter()
            .map(|axis| {
                let count = axis.len() as f64;
                let mean = axis.iter().sum::<f64>() / count;
                axis.iter()
                    .map(|sample| (sample - mean).powi(2))
                    .sum::<f64>()
                    / count
            })
            .sum();
        power.sqrt()
    }
}

/// The response that turns a profile into samples at one speed.
struct Pass {
    /// Share of the drum that passes per sample.
    step_cycles: f64,
    sampler: UniformSampler,
    /// Wavenumber of each term of the profile, and the tool's response at its frequency.
    tool: Vec<TermResponse>,
}

struct TermResponse {
    wavenumber_rad_per_mm: f64,
    response: super::Response,
}

impl<'a> Strip<'a> {
    /// Computes the profile of the texture at position `texture` of [`RigDescription::textures`], and its passes.
    ///
    /// # Panics
    /// If the rig has no such texture.
    pub fn new(rig: &'a RigFile, texture: usize, seed: u64) -> Self {
        let description = rig.description();
        let texture = &description.textures[texture];
        let profile = Profile::new(&description.drum, texture, seed);
        let touches = description
            .recording
            .forces_n
            .iter()
            .any(|force_n| *force_n > 0.0);
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

    /// Profile of the strip.
    pub fn profile(&self) -> &Profile {
        &self.profile
    }

    /// Runs the trial at positions `speed` and `force` of the rig's [`Recording`](super::Recording). The same rig and
    /// seed give the same trial in any order.
    ///
    /// # Panics
    /// If the rig has no such speed or force.
    pub fn trial(&self, speed: usize, force: usize) -> Trial {
        let recording = &self.description.recording;
        let speed_mm_s = recording.speeds_mm_s[speed];
        let force_n = recording.forces_n[force];
        let key = self.key.number(speed_mm_s).number(force_n);
        let felt = self.passes.get(speed).and_then(|pass| {
            let tool = self.description.tool.as_ref()?;
            let contact = Contact::hertz(
                tool.tip_radius_mm,
                self.texture.effective_modulus_mpa,
                force_n,
            )?;
            Some((pass, contact))
        });
        let mut samples_m_s2 = match felt {
            Some((pass, contact)) => {
                let spectra = pass.spectra(&self.profile, self.texture.loss_factor, &contact, key);
                match &self.description.drum.wander {
                    Some(wander) => {
                        let sample_rate_hz = f64::from(recording.sample_rate_hz);
                        let places =
                            wander::places(wander, sample_rate_hz, key, recording.samples());
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
            sampler: UniformSampler::new(
                &mut RealFftPlanner::new(),
                terms,
                recording.samples(),
                step_cycles,
            ),
            tool,
        }
    }

    /// Steady-state acceleration of the tool on each axis at these places, in samples, m/s².
    fn at_places(&self, spectra: &[Vec<Complex<f64>>; 3], places: &[f64]) -> [Vec<f64>; 3] {
        let (first, points) = wander::points(places);
        let point_cycles = self.step_cycles / wander::POINTS_PER_SAMPLE as f64;
        let sampler = UniformSampler::new(
            &mut RealFftPlanner::new(),
            self.tool.len(),
            points,
            point_cycles,
        );
        let start_cycles = first as f64 * point_cycles;
        std::array::from_fn(|axis| {
            let turned: Vec<Complex<f64>> = spectra[axis]
                .iter()
                .enumerate()
                .map(|(n, c)| c * Complex::cis(TAU * (n as f64 * start_cycles).fract()))
                .collect();
            wander::read(&sampler.real_part(&turned), first, places)
        })
    }

    /// Terms of the steady-state acceleration of the tool over the drum on each axis, m/s², from the trial's start.
    fn spectra(
        &self,
        profile: &Profile,
        loss_factor: Option<f64>,
        contact: &Contact,
        key: StreamKey,
    ) -> [Vec<Complex<f64>>; 3] {
        let start_cycles: f64 = key.stream("start").random();
        let mut axes: [Vec<Complex<f64>>; 3] = std::array::from_fn(|_| vec![Complex::default()]);
        for (n, (height_um, term)) in profile
            .coefficients_um()
            .iter()
            .skip(1)
            .zip(&self.tool)
            .enumerate()
        {
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

#[cfg(test)]
mod tests {
    use super::super::tests::{PROTOCOL, ROUGHNESS, STRIP, TOOL, WEAVE, rig};
    use super::*;

    fn passes(parts: &[&str]) -> usize {
        Strip::new(&rig(parts), 0, 1).passes.len()
    }

    #[test]
    fn a_pass_is_built_for_each_speed_only_where_something_is_felt() {
        let untouched = PROTOCOL.replace("[0.0, 0.2, 0.8, 1.4]", "[0.0]");
        assert_eq!(passes(&[PROTOCOL, TOOL, STRIP, WEAVE]), 4);
        assert_eq!(passes(&[PROTOCOL, TOOL, STRIP, ROUGHNESS]), 4);
        assert_eq!(passes(&[PROTOCOL, TOOL, STRIP]), 0, "a flat surface");
        assert_eq!(passes(&[PROTOCOL, STRIP]), 0, "no tool");
        assert_eq!(passes(&[&untouched, TOOL, STRIP, WEAVE]), 0, "no force");
    }
}
