//! Accuracy at rest: each node is played at its own speed and force and compared with a recording that the fit has not
//! seen, and with the same filter in float64.

use model_format::{MillimetresPerSecond, Newton, SAMPLE_RATE_HZ, Texture};
use serde::Serialize;
use stylus_dsp::spectrum::{self, AMPLITUDE_JND_DB};
use stylus_dsp::sums::mean_square;
use stylus_fit::texture::library::decoded;
use stylus_fit::texture::quantise::reflection;
use stylus_kernel::excitation::{self, Excitation};
use stylus_kernel::{Motion, UPDATE_INTERVAL_SAMPLES};
use stylus_support::{Error, Result};

use super::players::Voice;
use crate::evaluate::WARM_UP_S;
use crate::summary;
use stylus_costs::Structure;
use stylus_hard_cases::{Deviation, FloatLattice};

/// Duration of the comparison with the float64 reference after the warm-up, s.
const REFERENCE_S: f64 = 1.0;

/// One node, played.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Node {
    /// The paper's cost C against the recording that was held out.
    pub cost: Option<f64>,
    /// Mean square of the bands' errors against that recording, dB².
    pub band_square_db: f64,
    /// Number of bands within the JND.
    pub within: usize,
    /// Number of bands that were compared.
    pub bands: usize,
    /// Signal-to-noise ratio, relative to the float64 filter with the stored θ, dB.
    pub snr_db: f64,
    /// Samples at full scale.
    pub saturations: u32,
}

/// Summary of all nodes.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Still {
    /// Nodes played.
    pub nodes: usize,
    /// Nodes that the structure cannot hold.
    pub refused: usize,
    /// Mean of C; not a number if no node could be played.
    pub cost: f64,
    /// RMS of the errors in third-octave bands, dB.
    pub band_error_db: f64,
    /// Fraction of bands within the JND.
    pub bands_within_jnd: f64,
    /// SNR of the noisiest node, dB.
    pub lowest_snr_db: f64,
    /// Mean SNR, dB.
    pub mean_snr_db: f64,
    /// Samples at full scale.
    pub saturations: u32,
}

/// Options of playing nodes.
#[derive(Clone, Copy, Debug)]
pub struct Playing {
    /// Width of C's smoothing, Hz.
    pub smoothing_hz: f64,
    /// Duration of each synthesis, s; it is longer if the recording is longer.
    pub synthesis_s: f64,
    /// Seed of the noise.
    pub seed: u64,
}

/// Plays the only node of the library `bytes` and compares it with `recording`, m/s². Returns `None` if the structure
/// cannot hold the node.
///
/// # Errors
/// Bytes that are no library; those from `encode` always are one.
pub fn play(structure: Structure, bytes: &[u8], recording: &[f64], playing: &Playing) -> Result<Option<Node>> {
    let library = decoded(bytes)?;
    let texture = library.textures().next().expect("one was encoded");
    let rate_hz = f64::from(SAMPLE_RATE_HZ);
    let in_samples = |seconds: f64| (seconds * rate_hz) as usize;
    let warm_up = in_samples(WARM_UP_S);
    let Ok(mut voice) = Voice::new(structure, texture, playing.seed) else {
        return Ok(None);
    };
    let speed = MillimetresPerSecond(texture.speed_axis().value(0));
    let force = Newton(texture.force_axis().value(0));
    let motion = Motion::new(speed, force).map_err(|error| Error::Model(error.to_string()))?;
    // At rest one update is enough, and its ramp of the level ends long before the warm-up does.
    voice.follow(motion, UPDATE_INTERVAL_SAMPLES);
    let length = warm_up + recording.len().max(in_samples(playing.synthesis_s));
    let mut synthesis = Vec::with_capacity(length);
    voice.play(length, &mut synthesis);
    let mut reference = Reference::of(&texture, playing.seed);
    let mut deviation = Deviation::default();
    for (n, &played) in synthesis.iter().enumerate().take(warm_up + in_samples(REFERENCE_S)) {
        // The reference plays the warm-up, too, because its state must have the same past as the filter's.
        let exact = reference.next_m_s2();
        if n >= warm_up {
            deviation.add(exact, played);
        }
    }
    let played = &synthesis[warm_up..];
    let errors: Vec<f64> = spectrum::band_errors_db(recording, played, rate_hz)
        .into_iter()
        .flatten()
        .collect();
    let within = errors.iter().filter(|error| error.abs() <= AMPLITUDE_JND_DB);
    Ok(Some(Node {
        cost: spectrum::spectral_cost(recording, played, rate_hz, playing.smoothing_hz),
        band_square_db: mean_square(&errors),
        within: within.count(),
        bands: errors.len(),
        snr_db: deviation.snr_db(),
        saturations: voice.saturations(),
    }))
}

/// Summarises nodes. `None` stands for a node that the structure cannot hold.
pub fn summarise(nodes: &[Option<Node>]) -> Still {
    let played: Vec<&Node> = nodes.iter().flatten().collect();
    let mean = |values: &mut dyn Iterator<Item = f64>| summary::mean(values).unwrap_or(f64::NAN);
    let bands: usize = played.iter().map(|node| node.bands).sum();
    let within: usize = played.iter().map(|node| node.within).sum();
    let snrs = || played.iter().map(|node| node.snr_db);
    Still {
        nodes: played.len(),
        refused: nodes.len() - played.len(),
        cost: mean(&mut played.iter().filter_map(|node| node.cost)),
        // All nodes count alike, whatever the number of their bands.
        band_error_db: mean(&mut played.iter().map(|node| node.band_square_db)).sqrt(),
        bands_within_jnd: within as f64 / bands.max(1) as f64,
        lowest_snr_db: snrs().reduce(f64::min).unwrap_or(f64::NAN),
        mean_snr_db: mean(&mut snrs()),
        saturations: played.iter().map(|node| node.saturations).sum(),
    }
}

/// A node's filter in float64, with its stored coefficients, and the same noise.
struct Reference {
    filter: FloatLattice,
    /// m/s² for a standard deviation of the excitation.
    gain: f64,
    noise: Excitation,
}

impl Reference {
    fn of(texture: &Texture<'_>, seed: u64) -> Self {
        let node = texture.node(0, 0);
        let reflection = reflection(node.coefficients);
        let mut filter = FloatLattice::new(reflection.len());
        filter.reflect_by(&reflection);
        Self {
            filter,
            gain: f64::from(node.output_power).sqrt(),
            noise: Excitation::new(seed),
        }
    }

    fn next_m_s2(&mut self) -> f64 {
        const DEVIATION: f64 = (1u64 << excitation::FRACTION_BITS) as f64;
        let driven = f64::from(self.noise.next_sample()) / DEVIATION * self.gain;
        self.filter.filter(driven)
    }
}
