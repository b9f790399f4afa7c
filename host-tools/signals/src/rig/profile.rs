//! Profile of a strip on the drum: its height along the track.

use std::f64::consts::TAU;

use rand::RngExt;
use rand_distr::StandardNormal;
use stylus_dsp::fourier::{self, Complex};

use super::measurement::StreamKey;
use super::{Drum, Jitter, Roughness, Texture, Weave};

/// A profile along the track, as the terms of a Fourier series over the drum's circumference.
#[derive(Debug, Clone, PartialEq)]
pub struct Profile {
    /// `coefficients[n]` is cₙ of h(x) = Re Σ cₙ e^{2πi n x / L}, µm. The list is empty for a flat profile.
    coefficients: Vec<Complex<f64>>,
}

impl Profile {
    /// Computes the profile of `texture` on `drum`. The same seed and texture give the same profile on any rig with
    /// this drum.
    pub fn new(drum: &Drum, texture: &Texture, seed: u64) -> Self {
        let circumference_mm = drum.circumference_mm;
        let key = StreamKey::new(seed).text(&texture.name);
        let mut coefficients = Vec::new();
        for (index, weave) in texture.weaves.iter().enumerate() {
            // Each weave has random streams of its own.
            let terms = weave_terms(weave, circumference_mm, key.index(index));
            add(&mut coefficients, &terms);
        }
        if let Some(roughness) = &texture.roughness {
            let terms = roughness_terms(roughness, circumference_mm, key);
            add(&mut coefficients, &terms);
        }
        Self { coefficients }
    }

    /// Returns true if the profile has no parts, so that its height is zero everywhere.
    pub fn is_flat(&self) -> bool {
        self.coefficients.is_empty()
    }

    /// Terms of the series, µm. The n-th term has n periods on the drum; the 0-th is zero.
    pub fn coefficients_um(&self) -> &[Complex<f64>] {
        &self.coefficients
    }
}

/// Returns the number of periods of a wavelength on the drum: the nearest whole number, at least one.
pub(super) fn periods(circumference_mm: f64, wavelength_mm: f64) -> f64 {
    (circumference_mm / wavelength_mm).round().max(1.0)
}

/// Returns the index of the highest term of a weave, including the sidebands of its jitter.
pub(super) fn highest_weave_term(weave: &Weave, circumference_mm: f64) -> f64 {
    let harmonics = (weave.harmonics.len() + 1) as f64;
    let line = harmonics * periods(circumference_mm, weave.wavelength_mm);
    match &weave.jitter {
        // The width of a sideband is twice Carson's bandwidth of a phase modulation, which is (1 + peak phase) times
        // its highest frequency.
        Some(jitter) => {
            let peak_rad = 4.0 * harmonics * jitter.rms_rad;
            (line + 2.0 * (1.0 + peak_rad) * jitter_terms(jitter, circumference_mm)).ceil()
        }
        None => line,
    }
}

/// Returns the index of the highest term of a roughness.
pub(super) fn highest_roughness_term(roughness: &Roughness, circumference_mm: f64) -> f64 {
    (circumference_mm / roughness.shortest_mm).floor()
}

/// Returns the number of terms of a jitter's phase. Its power spectrum is exp(-q²ℓ²/2), with q = 2πn / circumference
/// and the correlation length ℓ. It is cut off at qℓ = 5, where it is 4e-6 of its maximum.
fn jitter_terms(jitter: &Jitter, circumference_mm: f64) -> f64 {
    (5.0 * circumference_mm / (TAU * jitter.correlation_mm)).ceil()
}

fn add(total: &mut Vec<Complex<f64>>, terms: &[Complex<f64>]) {
    if total.len() < terms.len() {
        total.resize(terms.len(), Complex::default());
    }
    for (sum, term) in total.iter_mut().zip(terms) {
        *sum += term;
    }
}

fn weave_terms(weave: &Weave, circumference_mm: f64, key: StreamKey) -> Vec<Complex<f64>> {
    let periods = periods(circumference_mm, weave.wavelength_mm);
    let phase_rad = TAU * key.stream("weave position").random::<f64>();
    let amplitudes_um: Vec<f64> = std::iter::once(1.0)
        .chain(weave.harmonics.iter().copied())
        .map(|fraction| weave.amplitude_um * fraction)
        .collect();
    let highest = highest_weave_term(weave, circumference_mm) as usize;
    let mut terms = vec![Complex::default(); highest + 1];
    let Some(jitter) = &weave.jitter else {
        for (index, amplitude_um) in amplitudes_um.iter().enumerate() {
            let harmonic = (index + 1) as f64;
            terms[(harmonic * periods) as usize] = Complex::from_polar(*amplitude_um, harmonic * phase_rad);
        }
        return terms;
    };
    // The phase varies along the drum, so the profile is computed over position and then transformed. The grid is twice
    // as fine as the highest sideband requires.
    let length = (4 * (highest + 1)).next_power_of_two();
    let mut phase_spectrum = vec![Complex::default(); length / 2 + 1];
    let wander = jitter_spectrum(jitter, circumference_mm, key);
    phase_spectrum[..wander.len()].copy_from_slice(&wander);
    let mut profile = fourier::inverse(&mut phase_spectrum, length);
    for (i, value) in profile.iter_mut().enumerate() {
        let line_rad = TAU * (periods * i as f64 / length as f64).fract();
        let angle = line_rad + phase_rad + *value;
        *value = amplitudes_um
            .iter()
            .enumerate()
            .map(|(index, amplitude_um)| amplitude_um * ((index + 1) as f64 * angle).cos())
            .sum();
    }
    // The mean is left out, because a constant height causes no vibration.
    let spectrum = fourier::forward(&mut profile);
    for (term, bin) in terms.iter_mut().zip(&spectrum).skip(1) {
        *term = bin * (2.0 / length as f64);
    }
    terms
}

/// Returns the spectrum of the jitter's phase, scaled for an inverse transform without a factor.
fn jitter_spectrum(jitter: &Jitter, circumference_mm: f64, key: StreamKey) -> Vec<Complex<f64>> {
    let terms = jitter_terms(jitter, circumference_mm) as usize;
    gaussian_terms(terms, jitter.rms_rad, key, "weave jitter", |n| {
        let q_l = TAU * n * jitter.correlation_mm / circumference_mm;
        (-0.5 * q_l * q_l).exp()
    })
    .into_iter()
    // The bin and its mirror image each have half of the term's amplitude.
    .map(|term| term * 0.5)
    .collect()
}

fn roughness_terms(roughness: &Roughness, circumference_mm: f64, key: StreamKey) -> Vec<Complex<f64>> {
    let highest = highest_roughness_term(roughness, circumference_mm) as usize;
    let roll_off = circumference_mm / roughness.roll_off_mm;
    gaussian_terms(highest, roughness.rms_um, key, "roughness", |n| {
        (n / roll_off).max(1.0).powf(-1.0 - 2.0 * roughness.hurst)
    })
}

/// Returns the terms 0 to `highest` of a Gaussian field of expected RMS `rms`, whose power is proportional to
/// `power(n)`.
fn gaussian_terms(
    highest: usize,
    rms: f64,
    key: StreamKey,
    effect: &str,
    power: impl Fn(f64) -> f64,
) -> Vec<Complex<f64>> {
    let powers: Vec<f64> = (1..=highest).map(|n| power(n as f64)).collect();
    let total: f64 = powers.iter().sum();
    let mut random = key.stream(effect);
    std::iter::once(Complex::default())
        .chain(powers.iter().map(|power| {
            let scale = rms * (power / total).sqrt();
            let (cosine, sine): (f64, f64) = (random.sample(StandardNormal), random.sample(StandardNormal));
            Complex::new(scale * cosine, -scale * sine)
        }))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use test_helpers::near;

    const DRUM: Drum = Drum {
        circumference_mm: 300.0,
        wander: None,
    };

    fn texture(weaves: Vec<Weave>, roughness: Option<Roughness>) -> Texture {
        Texture {
            name: "strip".into(),
            effective_modulus_mpa: 500.0,
            loss_factor: None,
            weaves,
            roughness,
        }
    }

    fn weave(jitter: Option<Jitter>) -> Weave {
        Weave {
            wavelength_mm: 0.75,
            amplitude_um: 4.0,
            harmonics: vec![0.5, -0.25],
            jitter,
        }
    }

    const ROUGH: Roughness = Roughness {
        rms_um: 2.0,
        hurst: 0.7,
        roll_off_mm: 2.0,
        shortest_mm: 0.02,
    };

    #[test]
    fn nothing_named_is_nothing_there() {
        let profile = Profile::new(&DRUM, &texture(vec![], None), 1);
        assert!(profile.is_flat());
    }

    #[test]
    fn an_exact_weave_has_its_lines_and_no_others() {
        for (n, term) in Profile::new(&DRUM, &texture(vec![weave(None)], None), 1)
            .coefficients_um()
            .iter()
            .enumerate()
        {
            let expected = match n {
                400 => 4.0,
                800 => 2.0,
                1200 => 1.0,
                _ => 0.0,
            };
            assert!((term.norm() - expected).abs() < 1e-12, "term {n}");
        }
    }

    #[test]
    fn a_wandering_phase_has_the_stated_rms_and_correlation() {
        let jitter = Jitter {
            rms_rad: 0.4,
            correlation_mm: 2.0,
        };
        let key = StreamKey::new(5).text("strip");
        let (mut variance, mut covariance) = (0.0, 0.0);
        let profiles = 60;
        for index in 0..profiles {
            for (n, bin) in jitter_spectrum(&jitter, 300.0, key.index(index)).iter().enumerate() {
                let power = 2.0 * bin.norm_sqr();
                variance += power;
                covariance += power * (TAU * n as f64 * jitter.correlation_mm / 300.0).cos();
            }
        }
        near(variance / f64::from(profiles as u32) / 0.16, 1.0, 0.05);
        near(covariance / variance, (-0.5_f64).exp(), 0.05);
    }

    #[test]
    fn roughness_has_the_stated_rms_and_slope() {
        let profile = Profile::new(&DRUM, &texture(vec![], Some(ROUGH)), 3);
        let terms = profile.coefficients_um();
        let power: f64 = terms.iter().map(Complex::norm_sqr).sum();
        near((0.5 * power).sqrt() / ROUGH.rms_um, 1.0, 0.15);
        assert_eq!(terms.len(), 15_001);
        let mean_power = |from: usize| terms[from..2 * from].iter().map(Complex::norm_sqr).sum::<f64>() / from as f64;
        // Between two octaves that are three octaves apart, the power changes by the factor 8^{-(1+2H)}.
        let slope = (mean_power(6400) / mean_power(800)).log(8.0);
        assert!((slope + 2.4).abs() < 0.1, "{slope}");
        let plateau = mean_power(64) / (terms[5..64].iter().map(Complex::norm_sqr).sum::<f64>() / 59.0);
        near(plateau, 1.0, 0.6);
    }

    #[test]
    fn a_part_more_leaves_the_others_as_they_were() {
        let both = Profile::new(&DRUM, &texture(vec![weave(None)], Some(ROUGH)), 3);
        let rough = Profile::new(&DRUM, &texture(vec![], Some(ROUGH)), 3);
        let woven = Profile::new(&DRUM, &texture(vec![weave(None)], None), 3);
        for (n, term) in both.coefficients_um().iter().enumerate() {
            let sum = woven.coefficients_um().get(n).copied().unwrap_or_default() + rough.coefficients_um()[n];
            assert_eq!(*term, sum);
        }
        let other = Profile::new(&DRUM, &texture(vec![], Some(ROUGH)), 4);
        assert_ne!(other, rough);
    }
}
