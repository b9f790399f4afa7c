//! Errors of a library against the definition of the file that it was made of: what its bytes play, by the kernel's own
//! response to an impulse, and the spectra of the definition; level and third octaves up to half the file's rate.

use model_format::{MillimetresPerSecond, Newton, OutputSample, SAMPLE_RATE_HZ, Texture};
use rayon::prelude::*;
use realfft::RealFftPlanner;
use serde::Serialize;
use stylus_kernel::arithmetic::Portable;
use stylus_kernel::excitation;
use stylus_kernel::grid::{GridPoint, Motion};
use stylus_kernel::lattice::{LatticeFrame, LatticeState};

use super::between;
use super::toolkit::Toolkit;
use crate::dsp::spectrum::{AMPLITUDE_JND_DB, BAND_COUNT, BAND_LABELS_HZ, band_edges_hz};

/// Error at a place.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PlaceError {
    /// Tangential speed, mm/s.
    pub speed_mm_s: f64,
    /// Normal force, N.
    pub force_n: f64,
    /// Error of the level up to half the file's rate, dB.
    pub level_db: f64,
    /// Errors of the third octaves up to there, by their nominal frequencies, dB.
    pub bands_db: Vec<(&'static str, f64)>,
}

/// Errors at several places together.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Summary {
    /// Number of places.
    pub places: usize,
    /// Median of the level's magnitude of error, dB.
    pub level_median_db: f64,
    /// Magnitude of error that 95 % of the levels keep, dB.
    pub level_95_db: f64,
    /// Largest magnitude of error of a level, dB.
    pub level_worst_db: f64,
    /// Share of all third octaves whose error is not felt (at most 2.2 dB), %.
    pub unfelt_bands_percent: f64,
    /// Largest magnitude of error of a third octave, dB.
    pub band_worst_db: f64,
}

impl PlaceError {
    /// Returns the largest magnitude of error of a third octave, dB.
    pub fn worst_band_db(&self) -> f64 {
        self.bands_db
            .iter()
            .fold(0.0, |worst: f64, (_, error)| worst.max(error.abs()))
    }
}

impl Summary {
    /// Returns the summary of `errors`; nothing if there are none.
    pub fn of(errors: &[PlaceError]) -> Option<Self> {
        let mut levels: Vec<f64> = errors.iter().map(|error| error.level_db.abs()).collect();
        levels.sort_by(f64::total_cmp);
        let rank = |share: f64| levels[(share * (levels.len() - 1) as f64).round() as usize];
        let bands = || errors.iter().flat_map(|error| &error.bands_db);
        let unfelt = bands()
            .filter(|(_, error)| error.abs() <= AMPLITUDE_JND_DB)
            .count();
        (!levels.is_empty()).then(|| Self {
            places: errors.len(),
            level_median_db: rank(0.5),
            level_95_db: rank(0.95),
            level_worst_db: rank(1.0),
            unfelt_bands_percent: 100.0 * unfelt as f64 / bands().count().max(1) as f64,
            band_worst_db: errors
                .iter()
                .map(PlaceError::worst_band_db)
                .fold(0.0, f64::max),
        })
    }
}

/// Compares `texture` with `toolkit` at speeds, mm/s, and forces, N. Places at which the file has no sound give
/// nothing.
pub fn errors(
    toolkit: &Toolkit,
    texture: &Texture<'_>,
    places: &[(f64, f64)],
) -> Vec<Option<PlaceError>> {
    places
        .par_iter()
        .map(|&place| error(toolkit, texture, place))
        .collect()
}

fn error(toolkit: &Toolkit, texture: &Texture<'_>, place: (f64, f64)) -> Option<PlaceError> {
    let played = played_density(texture, place);
    let nyquist_hz = toolkit.nyquist_hz();
    let frequencies_hz: Vec<f64> = (0..played.len())
        .map(|bin| bin as f64)
        .take_while(|&f| f <= nyquist_hz)
        .collect();
    let wanted = between::density(toolkit, place, &frequencies_hz)?;
    let error = |low_hz: f64, high_hz: f64| {
        let ratio =
            power_between(&played, low_hz, high_hz) / power_between(&wanted, low_hz, high_hz);
        10.0 * ratio.log10()
    };
    let bands = (0..BAND_COUNT).filter(|&band| band_edges_hz(band).1 <= nyquist_hz);
    Some(PlaceError {
        speed_mm_s: place.0,
        force_n: place.1,
        level_db: error(0.0, nyquist_hz),
        bands_db: bands
            .map(|band| {
                let (low, high) = band_edges_hz(band);
                (BAND_LABELS_HZ[band], error(low, high))
            })
            .collect(),
    })
}

/// Power between two frequencies of densities 1 Hz apart, each of which stands for half a step to both sides.
fn power_between(density: &[f64], low_hz: f64, high_hz: f64) -> f64 {
    let share = |bin: usize| {
        let at = bin as f64;
        ((at + 0.5).min(high_hz) - (at - 0.5).max(low_hz)).max(0.0)
    };
    density
        .iter()
        .enumerate()
        .map(|(bin, value)| value * share(bin))
        .sum()
}

/// Length of the response, samples: 1 s, so that the densities are 1 Hz apart.
const LENGTH: usize = SAMPLE_RATE_HZ as usize;

/// Height of the impulse in standard deviations of the excitation, as a power of two: half of full scale.
const HEIGHT_BITS: u32 = 2;

/// Returns the density on one side of the spectrum, (m/s²)²/Hz, at 0 Hz, 1 Hz and so on to half the sample rate, of
/// `texture`, a lattice, at a speed, mm/s, and a force, N, both finite.
pub(super) fn played_density(texture: &Texture<'_>, (speed_mm_s, force_n): (f64, f64)) -> Vec<f64> {
    let motion = Motion::new(
        MillimetresPerSecond(speed_mm_s as f32),
        Newton(force_n as f32),
    )
    .expect("speeds and forces of a file are finite");
    let mut frame = LatticeFrame::silent(texture.max_order());
    frame.update::<Portable>(
        texture,
        &GridPoint::locate(texture, motion),
        frame.levels(0),
        1,
    );
    let mut state = LatticeState::new();
    let step = f64::from(1u32 << HEIGHT_BITS) * f64::from(1u32 << OutputSample::FRACTION_BITS);
    let mut response: Vec<f64> = (0..LENGTH)
        .map(|sample| {
            let excitation = if sample == 0 {
                1 << (excitation::FRACTION_BITS + HEIGHT_BITS)
            } else {
                0
            };
            let (output, _) = state.next_sample::<Portable>(&frame, excitation, 0);
            f64::from(output.0) / step
        })
        .collect();
    let transform = RealFftPlanner::new().plan_fft_forward(LENGTH);
    let mut spectrum = transform.make_output_vec();
    transform
        .process(&mut response, &mut spectrum)
        .expect("lengths come from the plan");
    let scale = 2.0 / f64::from(SAMPLE_RATE_HZ);
    spectrum.iter().map(|bin| scale * bin.norm_sqr()).collect()
}
