//! From scattered ARMA models at 1 kHz to AR models at 5 kHz over a rectangle.
//!
//! Up to half their own rate the models' spectrum is kept. Above, where they say nothing, it goes on from its mean
//! level in the last tenth below and falls by [`ROLL_OFF_DB_PER_OCTAVE`]: no power to speak of, and no edge that a
//! model would ring at.

use model_format::{Laws, NodeFlags, Provenance, TextureSpec, limits};
use rayon::prelude::*;
use serde::Serialize;

use super::read::{ArmaModel, Toolkit};
use crate::dsp::line_spectral_frequencies as line_spectrum;
use crate::dsp::linear_prediction::error_share;
use crate::dsp::log_spectrum::{BINS, LogSpectrum, STEP_HZ};
use crate::dsp::model::Model;
use crate::dsp::spectrum::{BAND_COUNT, band_edges_hz};
use crate::support::error::{Error, Result};
use crate::texture::certificate;
use crate::texture::grid::Grid;
use crate::texture::library::texture_spec;
use crate::texture::quantise::StructureChoice;
use model_format::SAMPLE_RATE_HZ;

/// Slope of the spectrum where the models say nothing.
pub const ROLL_OFF_DB_PER_OCTAVE: f64 = 48.0;

/// Worst error of a third octave that the order of a node may leave, dB.
const ECONOMY_DB: f64 = 0.5;

/// Numbers of nodes of the rectangle.
#[derive(Clone, Copy, Debug)]
pub struct Options {
    /// Speeds, evenly from the highest down to a share of it, the lowest above zero.
    pub speeds: usize,
    /// Forces, in the same way.
    pub forces: usize,
}

/// A node, and what the conversion did to it.
#[derive(Clone, Debug, Serialize)]
pub struct ConvertedNode {
    /// Tangential speed, mm/s.
    pub speed_mm_s: f32,
    /// Normal force, N.
    pub force_n: f32,
    /// RMS, m/s².
    pub rms_m_s2: f64,
    /// Order of the model.
    pub order: usize,
    /// Largest error of a third octave within the models' own band, dB; none of silence.
    pub worst_band_db: Option<f64>,
    /// Error of the level within the models' own band, dB; none of silence.
    pub level_db: Option<f64>,
    /// True for a place outside of all triangles, which takes over the nearest place within.
    pub is_extrapolated: bool,
}

/// A texture and what the conversion did.
#[derive(Clone, Debug)]
pub struct Converted {
    /// The texture, ready to be encoded.
    pub spec: TextureSpec,
    /// Its nodes, speed-major.
    pub nodes: Vec<ConvertedNode>,
}

/// Makes the models of `toolkit` a texture named `name`.
///
/// # Errors
/// A rectangle of no nodes or too many, or a level that the library cannot hold.
pub fn convert(name: &str, toolkit: &Toolkit, options: &Options) -> Result<Converted> {
    let (speeds_mm_s, forces_n) = (
        axis("speeds", toolkit.max_speed_mm_s, options.speeds)?,
        axis("forces", toolkit.max_force_n, options.forces)?,
    );
    let scale = (toolkit.max_speed_mm_s, toolkit.max_force_n);
    let places: Vec<(f32, f32)> = speeds_mm_s
        .iter()
        .flat_map(|&speed| forces_n.iter().map(move |&force| (speed, force)))
        .collect();
    let made: Vec<(Model, ConvertedNode)> = places
        .into_par_iter()
        .map(|(speed_mm_s, force_n)| {
            let place = (f64::from(speed_mm_s), f64::from(force_n));
            let (corners, is_extrapolated) = corners(toolkit, place, scale);
            let spectrum = spectrum(toolkit, &corners);
            let mut flags = NodeFlags::NONE;
            if is_extrapolated {
                flags = flags.with(NodeFlags::EXTRAPOLATED);
            }
            let model = match &spectrum {
                Some(spectrum) => Model {
                    flags,
                    ..spectrum.economical_model(ECONOMY_DB)
                },
                None => Model {
                    reflection: Vec::new(),
                    output_power: 0.0,
                    flags: flags.with(NodeFlags::SILENT),
                },
            };
            let errors = spectrum.map(|s| errors(&s, &model, 0.5 * toolkit.sample_rate_hz));
            let node = ConvertedNode {
                speed_mm_s,
                force_n,
                rms_m_s2: model.output_power.sqrt(),
                order: model.reflection.len(),
                worst_band_db: errors.map(|(band, _)| band),
                level_db: errors.map(|(_, level)| level),
                is_extrapolated,
            };
            (model, node)
        })
        .collect();
    let (models, nodes): (Vec<Model>, Vec<ConvertedNode>) = made.into_iter().unzip();
    let grid = Grid {
        speeds_mm_s,
        forces_n,
        models,
        laws: Laws::default(),
    };
    let spec = texture_spec(name, Provenance::Recorded, &grid, StructureChoice::Lattice)?;
    let spec = certificate::certified(spec)?;
    Ok(Converted { spec, nodes })
}

fn axis(what: &str, highest: f64, count: usize) -> Result<Vec<f32>> {
    let sound = highest.is_finite() && highest > 0.0;
    if !sound || !(1..=limits::MAX_AXIS_LEN).contains(&count) {
        return Err(Error::Request(format!(
            "{count} {what} up to {highest} make no grid: there may be 1 to {} of them, up to a maximum above zero",
            limits::MAX_AXIS_LEN
        )));
    }
    let value = |step: usize| (highest * step as f64 / count as f64) as f32;
    Ok((1..=count).map(value).collect())
}

/// Models with their weights, which add up to one.
type Corners = Vec<(usize, f64)>;

/// The corners of the triangle at `place`, with barycentric weights, or of the nearest place on any triangle, and
/// whether it was that. Places are measured by `scale`, so that speeds and forces compare. Without triangles it is the
/// nearest model.
fn corners(toolkit: &Toolkit, place: (f64, f64), scale: (f64, f64)) -> (Corners, bool) {
    let scaled = |(speed, force): (f64, f64)| (speed / scale.0, force / scale.1);
    let at = |index: usize| {
        let model = &toolkit.models[index];
        scaled((model.speed_mm_s, model.force_n))
    };
    let wanted = scaled(place);
    let mut best: Option<(f64, Corners)> = None;
    let mut consider = |distance: f64, corners: Corners| {
        if best.as_ref().is_none_or(|(least, _)| distance < *least) {
            best = Some((distance, corners));
        }
    };
    for triangle in &toolkit.triangles {
        let points = triangle.map(at);
        let weights = barycentric(wanted, points);
        if let Some(weights) = weights.filter(|weights| weights.iter().all(|&w| w >= -1e-9)) {
            let inside = triangle.iter().copied().zip(weights).collect();
            return (inside, false);
        }
        for (from, to) in [(0, 1), (1, 2), (2, 0)] {
            let (distance, share) = nearest_on_edge(wanted, points[from], points[to]);
            consider(
                distance,
                vec![(triangle[from], 1.0 - share), (triangle[to], share)],
            );
        }
    }
    if toolkit.triangles.is_empty() {
        for index in 0..toolkit.models.len() {
            let (x, y) = at(index);
            consider((x - wanted.0).hypot(y - wanted.1), vec![(index, 1.0)]);
        }
    }
    let (distance, corners) = best.expect("there is a model");
    (corners, distance > 1e-9)
}

/// Barycentric coordinates, or none of a triangle without area.
fn barycentric(p: (f64, f64), [a, b, c]: [(f64, f64); 3]) -> Option<[f64; 3]> {
    let area = (b.0 - a.0) * (c.1 - a.1) - (c.0 - a.0) * (b.1 - a.1);
    if area.abs() < 1e-12 {
        return None;
    }
    let second = ((p.0 - a.0) * (c.1 - a.1) - (c.0 - a.0) * (p.1 - a.1)) / area;
    let third = ((b.0 - a.0) * (p.1 - a.1) - (p.0 - a.0) * (b.1 - a.1)) / area;
    Some([1.0 - second - third, second, third])
}

/// Distance of a place from an edge, and how far along the edge the nearest point is.
fn nearest_on_edge(p: (f64, f64), a: (f64, f64), b: (f64, f64)) -> (f64, f64) {
    let (dx, dy) = (b.0 - a.0, b.1 - a.1);
    let square = dx * dx + dy * dy;
    let share = if square > 0.0 {
        (((p.0 - a.0) * dx + (p.1 - a.1) * dy) / square).clamp(0.0, 1.0)
    } else {
        0.0
    };
    (
        (a.0 + share * dx - p.0).hypot(a.1 + share * dy - p.1),
        share,
    )
}

/// The spectrum between `corners` at the stylus's rate; `None` of silence.
///
/// Line spectral frequencies, moving averages and gains are averaged over those that sound, variances over all.
fn spectrum(toolkit: &Toolkit, corners: &Corners) -> Option<LogSpectrum> {
    let sounding: Vec<(&ArmaModel, f64)> = corners
        .iter()
        .map(|&(index, weight)| (&toolkit.models[index], weight))
        .filter(|(model, weight)| model.variance > 0.0 && model.gain > 0.0 && *weight > 0.0)
        .collect();
    let total: f64 = sounding.iter().map(|(_, weight)| weight).sum();
    let variance: f64 = sounding.iter().map(|(m, weight)| m.variance * weight).sum();
    if variance <= 0.0 {
        return None;
    }
    let longest = |of: fn(&ArmaModel) -> usize| sounding.iter().map(|(m, _)| of(m)).max();
    let mut lines = vec![0.0; longest(|m| m.reflection.len())?];
    let mut moving_average = vec![0.0; longest(|m| m.moving_average.len())?];
    let mut gain = 0.0;
    for (model, weight) in &sounding {
        let weight = weight / total;
        let mut reflection = model.reflection.clone();
        reflection.resize(lines.len(), 0.0);
        let own = line_spectrum::frequencies(&reflection);
        for (sum, omega) in lines.iter_mut().zip(own) {
            *sum += weight * omega;
        }
        for (sum, b) in moving_average.iter_mut().zip(&model.moving_average) {
            *sum += weight * b;
        }
        gain += weight * model.gain;
    }
    Some(at_stylus_rate(
        toolkit,
        &lines,
        &moving_average,
        variance * gain * gain,
    ))
}

fn at_stylus_rate(
    toolkit: &Toolkit,
    lines: &[f64],
    moving_average: &[f64],
    excitation: f64,
) -> LogSpectrum {
    let poles = line_spectrum::log_spectrum(lines, BINS);
    let nyquist_hz = 0.5 * toolkit.sample_rate_hz;
    // The same density in (m/s²)²/Hz is a larger one a sample at a higher rate.
    let rates = f64::from(SAMPLE_RATE_HZ) / toolkit.sample_rate_hz;
    let value = |frequency_hz: f64| {
        let share = (frequency_hz / nyquist_hz).min(1.0);
        let omega = std::f64::consts::PI * share;
        let (mut re, mut im) = (1.0, 0.0);
        for (j, b) in moving_average.iter().enumerate() {
            let angle = omega * (j + 1) as f64;
            re += b * angle.cos();
            im -= b * angle.sin();
        }
        // A zero on the circle itself is a floor 200 dB down.
        let zeros = (re * re + im * im).max(1e-20).ln();
        poles.at(share * (BINS - 1) as f64) + zeros + (excitation * rates).ln()
    };
    let last = (nyquist_hz / STEP_HZ).round() as usize;
    let first = (0.9 * nyquist_hz / STEP_HZ) as usize;
    let edge: f64 = (first..=last)
        .map(|bin| value(bin as f64 * STEP_HZ))
        .sum::<f64>()
        / (last - first + 1) as f64;
    let slope = ROLL_OFF_DB_PER_OCTAVE / 10.0 * std::f64::consts::LN_10 / std::f64::consts::LN_2;
    let values = (0..BINS).map(|bin| {
        let frequency_hz = bin as f64 * STEP_HZ;
        if frequency_hz <= nyquist_hz {
            value(frequency_hz)
        } else {
            edge - slope * (frequency_hz / nyquist_hz).ln()
        }
    });
    LogSpectrum::from_values(values.collect())
}

/// Largest error of a third octave below `highest_hz`, and the error of the level, dB.
fn errors(wanted: &LogSpectrum, model: &Model, highest_hz: f64) -> (f64, f64) {
    debug_assert!(error_share(&model.reflection) > 0.0);
    let made = LogSpectrum::of_model(model);
    let bands = wanted.band_errors_db(&made);
    let own = (0..BAND_COUNT).filter(|&band| band_edges_hz(band).1 <= highest_hz);
    let worst = own
        .filter_map(|band| bands[band])
        .fold(0.0, |worst: f64, error| worst.max(error.abs()));
    (worst, 10.0 * (made.power() / wanted.power()).log10())
}

#[cfg(test)]
mod tests {
    use super::super::read::{read, tests::small};
    use super::*;
    use std::path::Path;

    fn toolkit(tri: &str) -> Toolkit {
        read(Path::new("felt.xml"), &small("1 -0.9 0.5", "0.02", tri)).unwrap()
    }

    const GRID: Options = Options {
        speeds: 5,
        forces: 4,
    };

    /// |1 + Σ a e^{-jωi}|² at a frequency, for a rate of 1 kHz.
    fn response(a: [f64; 2], frequency_hz: f64) -> f64 {
        let omega = std::f64::consts::TAU * frequency_hz / 1000.0;
        let re = 1.0 + a[0] * omega.cos() + a[1] * (2.0 * omega).cos();
        let im = a[0] * omega.sin() + a[1] * (2.0 * omega).sin();
        re * re + im * im
    }

    #[test]
    fn at_a_models_own_place_its_density_is_kept_up_to_its_half_rate() {
        let toolkit = toolkit("");
        let spectrum = spectrum(&toolkit, &vec![(2, 1.0)]).unwrap();
        for frequency_hz in [30.0, 100.0, 250.0, 480.0] {
            let wanted = 0.04 / response([-1.2, 0.8], frequency_hz) / 1000.0;
            let density = spectrum.at(frequency_hz / STEP_HZ).exp() / f64::from(SAMPLE_RATE_HZ);
            assert!(
                (density / wanted - 1.0).abs() < 0.02,
                "{frequency_hz}: {density} {wanted}"
            );
        }
        let fall = spectrum.at(1000.0 / STEP_HZ) - spectrum.at(2000.0 / STEP_HZ);
        assert!((10.0 / std::f64::consts::LN_10 * fall - ROLL_OFF_DB_PER_OCTAVE).abs() < 1e-6);
    }

    #[test]
    fn the_errors_of_every_node_are_small_and_told() {
        let converted = convert("felt", &toolkit("1 2 4"), &GRID).unwrap();
        assert_eq!(converted.nodes.len(), 20);
        for node in converted.nodes.iter().filter(|node| node.rms_m_s2 > 0.0) {
            assert!(node.worst_band_db.unwrap() < 0.6, "{node:?}");
            assert!(node.level_db.unwrap().abs() < 0.2, "{node:?}");
        }
        assert!(converted.nodes.iter().any(|node| node.is_extrapolated));
        assert!(converted.nodes.iter().any(|node| !node.is_extrapolated));
        model_format::encode(&[converted.spec]).unwrap();
    }

    #[test]
    fn towards_a_silent_corner_the_level_falls_and_the_timbre_stays() {
        let toolkit = toolkit("");
        let whole = spectrum(&toolkit, &vec![(0, 1.0)]).unwrap();
        let half = spectrum(&toolkit, &vec![(0, 0.5), (3, 0.5)]).unwrap();
        for bin in [100, 400, 900] {
            let fall = whole.values()[bin] - half.values()[bin];
            assert!((fall - 2f64.ln()).abs() < 1e-6);
        }
        assert!(spectrum(&toolkit, &vec![(3, 1.0)]).is_none());
    }

    #[test]
    fn a_moving_average_shapes_the_spectrum() {
        let mut toolkit = toolkit("");
        toolkit.models[0].moving_average = vec![1.0];
        let with = spectrum(&toolkit, &vec![(0, 1.0)]).unwrap();
        toolkit.models[0].moving_average.clear();
        let without = spectrum(&toolkit, &vec![(0, 1.0)]).unwrap();
        let change = |bin: usize| with.values()[bin] - without.values()[bin];
        assert!((change(0) - 4f64.ln()).abs() < 1e-9);
        assert!(
            (change(500) - 2f64.ln()).abs() < 1e-6,
            "at a quarter of the rate |1 + z⁻¹|² = 2"
        );
    }

    #[test]
    fn a_grid_of_nothing_is_refused() {
        for options in [
            Options { speeds: 0, ..GRID },
            Options { forces: 65, ..GRID },
        ] {
            assert!(convert("felt", &toolkit(""), &options).is_err());
        }
    }
}
