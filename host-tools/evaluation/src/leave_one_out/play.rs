//! A model played by the device's kernel, and compared with a recording.

use model_format::{MillimetresPerSecond, Newton};
use serde::Serialize;
use stylus_dsp::model::Model;
use stylus_dsp::spectrum::{self, BAND_COUNT};
use stylus_fit::texture::grid::Grid;
use stylus_fit::texture::library::{decoded, library_of};
use stylus_signals::playing::motion::MotionPath;
use stylus_signals::playing::render::render;
use stylus_support::Result;

use super::Options;

use crate::evaluate::WARM_UP_S;
use crate::perception::ScoringRange;
use model_format::SAMPLE_RATE_HZ;

/// Speed and force of the only node of a library for a test. Any values in contact and in motion serve.
const PLACE: (f32, f32) = (100.0, 1.0);

/// The comparison of a synthesis with a recording.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Judged {
    /// The paper's cost C, equation (6).
    pub cost: f64,
    /// Level of the synthesis relative to the recording in each third-octave band from 20 to 1000 Hz, dB.
    pub band_errors_db: [Option<f64>; BAND_COUNT],
    /// Log-spectral distance from 30 to 1000 Hz in sliding third octaves, dB.
    pub log_spectral_distance_db: Option<f64>,
}

impl Judged {
    /// Returns the score of silence, which lacks everything of the recording.
    pub fn silence() -> Self {
        Self {
            cost: 1.0,
            band_errors_db: [None; BAND_COUNT],
            log_spectral_distance_db: None,
        }
    }
}

/// Plays `seconds` of `model` with the device's kernel, m/s², after a warm-up. Returns `None` if it is too loud.
pub fn synthesis(model: &Model, seconds: f64, seed: u64) -> Result<Option<Vec<f64>>> {
    const NAME: &str = "removed node";
    let grid = Grid::new(vec![PLACE.0], vec![PLACE.1], vec![model.clone()]);
    let Ok(bytes) = library_of(NAME, &grid) else {
        return Ok(None);
    };
    let library = decoded(&bytes)?;
    let texture = library.textures().next().expect("one was encoded");
    let motion = MotionPath::constant(MillimetresPerSecond(PLACE.0), Newton(PLACE.1))?;
    let mut samples = render(texture, &motion, seconds + WARM_UP_S, seed)?.accelerations_m_s2();
    Ok(Some(
        samples.split_off((WARM_UP_S * f64::from(SAMPLE_RATE_HZ)) as usize),
    ))
}

/// Compares a synthesis with a recording, both in m/s² at the models' rate, at the frequencies of `range`. `None` if
/// there is nothing to compare.
pub(super) fn judge(recorded: &[f64], synthesised: &[f64], range: &ScoringRange, options: &Options) -> Option<Judged> {
    let rate_hz = f64::from(SAMPLE_RATE_HZ);
    // Both spectra have segments of one length, so that the window's leakage is the same in both.
    let of_blocks = |signal: &[f64]| spectrum::PowerSpectrum::of_blocks(&[signal], range.segment, rate_hz);
    let (a, b) = (of_blocks(recorded), of_blocks(synthesised));
    let (low_hz, high_hz) = range.distance_hz();
    Some(Judged {
        cost: spectrum::cost_of_blocks(
            &[recorded],
            &[synthesised],
            rate_hz,
            options.judging.smoothing_hz,
            range.cost_hz,
        )?,
        band_errors_db: spectrum::band_errors_within_db(&a, &b, range.band_edges_hz()),
        log_spectral_distance_db: spectrum::distance_of_spectra_db(&a, &b, low_hz, high_hz),
    })
}
