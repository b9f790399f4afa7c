//! Spectra between the models of a file, interpolated in the way of the file's authors.

use std::f64::consts::PI;

use model_format::NodeFlags;
use stylus_dsp::fourier::Complex;
use stylus_dsp::line_spectral_frequencies as line_spectrum;
use stylus_dsp::linear_prediction::error_share;
use stylus_dsp::log_spectrum::{BINS, LogSpectrum};
use stylus_dsp::model::Model;
use stylus_dsp::spectrum::band_edges_hz;
use stylus_dsp::wide;

use super::toolkit::{ArmaModel, Timbre, Toolkit};

/// Slope of the spectrum above the band of the models.
pub const ROLL_OFF_DB_PER_OCTAVE: f64 = 48.0;

/// Models with their weights, which add up to one.
type Corners = Vec<(usize, f64)>;

/// The interpolated model at a position between models.
pub(super) struct Between {
    /// Spectrum for unit excitation at the stylus's rate; `None` if none of the surrounding models has a shape, or if
    /// their mean gain is 0.
    pub shape: Option<LogSpectrum>,
    /// Variance of the excitation, (m/s²)².
    pub variance: f64,
    /// True for a position outside of all triangles. It gets the values of the nearest position within one.
    pub is_extrapolated: bool,
}

/// Returns the model at a speed, mm/s, and a force, N: the means of variance, gain and line spectral frequencies over
/// the corners of the triangle, with barycentric weights. Corners without a shape count only for the variance.
pub(super) fn at(toolkit: &Toolkit, place: (f64, f64)) -> Between {
    let (corners, is_extrapolated) = corners(toolkit, place);
    let models: Vec<(&ArmaModel, f64)> = corners
        .iter()
        .map(|&(index, weight)| (&toolkit.models[index], weight))
        .collect();
    Between {
        shape: shape(toolkit, &models),
        variance: models.iter().map(|(model, weight)| model.variance * weight).sum(),
        is_extrapolated,
    }
}

/// Returns the one-sided density, (m/s²)²/Hz, that the file defines at a speed, mm/s, and a force, N, at these
/// frequencies, which are at most half the file's rate. Returns `None` outside of all triangles and where the file is
/// silent. Speeds and forces above the highest are treated as the highest.
pub(super) fn density(toolkit: &Toolkit, place: (f64, f64), frequencies_hz: &[f64]) -> Option<Vec<f64>> {
    let highest = (toolkit.max_speed_mm_s, toolkit.max_force_n);
    let place = (place.0.min(highest.0), place.1.min(highest.1));
    let between = at(toolkit, place);
    // The weights' rounding leaves a tiny variance at the edges of silence.
    let is_silent = between.variance <= 1e-15;
    let shape = between.shape.filter(|_| !between.is_extrapolated && !is_silent)?;
    let scale = 2.0 / toolkit.play_rate_hz() * between.variance;
    let frequencies = frequencies_hz.iter();
    Some(
        frequencies
            .map(|hz| scale * shape.at(hz / toolkit.step_hz()).exp())
            .collect(),
    )
}

/// Returns the corners of the triangle at `place` with barycentric weights, and false. Outside of all triangles,
/// returns those of the nearest position on any triangle, and true. Distances are relative to the highest speed and
/// force. If there are no triangles, the nearest model is returned.
fn corners(toolkit: &Toolkit, place: (f64, f64)) -> (Corners, bool) {
    let scale = (toolkit.max_speed_mm_s, toolkit.max_force_n);
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
        // Rounding may make the weights on an edge slightly negative.
        let weights = barycentric(wanted, points);
        if let Some(weights) = weights.filter(|weights| weights.iter().all(|&w| w >= -1e-9)) {
            let inside = triangle.iter().copied().zip(weights.map(|w| w.max(0.0))).collect();
            return (inside, false);
        }
        for (from, to) in [(0, 1), (1, 2), (2, 0)] {
            let (distance, share) = nearest_on_edge(wanted, points[from], points[to]);
            consider(distance, vec![(triangle[from], 1.0 - share), (triangle[to], share)]);
        }
    }
    if toolkit.triangles.is_empty() {
        for index in 0..toolkit.models.len() {
            let (x, y) = at(index);
            consider((x - wanted.0).hypot(y - wanted.1), vec![(index, 1.0)]);
        }
    }
    let (distance, corners) = best.expect("there is a model");
    // Axes are stored in 32 bits; the rounding may move the highest speed just beyond the triangles.
    (corners, distance > 1e-6)
}

/// Returns the barycentric coordinates of `p`; `None` if the triangle has no area.
fn barycentric(p: (f64, f64), [a, b, c]: [(f64, f64); 3]) -> Option<[f64; 3]> {
    let area = (b.0 - a.0) * (c.1 - a.1) - (c.0 - a.0) * (b.1 - a.1);
    if area.abs() < 1e-12 {
        return None;
    }
    let second = ((p.0 - a.0) * (c.1 - a.1) - (c.0 - a.0) * (p.1 - a.1)) / area;
    let third = ((b.0 - a.0) * (p.1 - a.1) - (p.0 - a.0) * (b.1 - a.1)) / area;
    Some([1.0 - second - third, second, third])
}

/// Returns the distance of a position from an edge, and how far along the edge the nearest point is.
fn nearest_on_edge(p: (f64, f64), a: (f64, f64), b: (f64, f64)) -> (f64, f64) {
    let (dx, dy) = (b.0 - a.0, b.1 - a.1);
    let square = dx * dx + dy * dy;
    // Two models at one position make an edge without length.
    let share = if square > 0.0 {
        (((p.0 - a.0) * dx + (p.1 - a.1) * dy) / square).clamp(0.0, 1.0)
    } else {
        0.0
    };
    ((a.0 + share * dx - p.0).hypot(a.1 + share * dy - p.1), share)
}

fn shape(toolkit: &Toolkit, models: &[(&ArmaModel, f64)]) -> Option<LogSpectrum> {
    let shaped: Vec<(&Timbre, f64)> = models
        .iter()
        .filter(|(_, weight)| *weight > 0.0)
        .filter_map(|(model, weight)| Some((model.timbre.as_ref()?, *weight)))
        .collect();
    // Corners without a shape leave their weights to the others.
    let total: f64 = shaped.iter().map(|(_, weight)| weight).sum();
    let mean = |of: fn(&Timbre) -> &[f64]| {
        let mut lines = vec![0.0; of(shaped.first()?.0).len()];
        for (timbre, weight) in &shaped {
            for (sum, omega) in lines.iter_mut().zip(of(timbre)) {
                *sum += weight / total * omega;
            }
        }
        Some(lines)
    };
    let (poles, zeros) = (mean(|t| t.poles.as_slice())?, mean(|t| t.zeros.as_slice())?);
    let gain = shaped.iter().map(|(timbre, weight)| timbre.gain * weight).sum::<f64>() / total;
    Some(at_play_rate(toolkit, &poles, &zeros, gain)).filter(|_| gain > 0.0)
}

/// Returns the spectrum, at the played rate, of the file's ARMA filter driven by noise of unit variance at the file's
/// rate. The density per sample grows with the ratio of the rates. Above half the file's rate the spectrum rolls off by
/// [`ROLL_OFF_DB_PER_OCTAVE`].
fn at_play_rate(toolkit: &Toolkit, poles: &[f64], zeros: &[f64], gain: f64) -> LogSpectrum {
    // A zero on the unit circle is limited to a floor of -200 dB.
    const FLOOR: f64 = 1e-20;
    let (rate_hz, step_hz) = (toolkit.sample_rate_hz, toolkit.step_hz());
    // The result's bins, or, if half the file's rate is none of them, at most half of their spacing.
    let own = 0.5 * rate_hz / step_hz;
    let own_bins = if own.fract() == 0.0 { own } else { 2.0 * own.ceil() } as usize + 1;
    let (poles, zeros) = (
        line_spectrum::log_spectrum(poles, own_bins),
        line_spectrum::log_spectrum(zeros, own_bins),
    );
    let nyquist_hz = 0.5 * rate_hz;
    let level = (gain * gain * toolkit.play_rate_hz() / rate_hz).ln();
    let value = |frequency_hz: f64| {
        let bin = (frequency_hz / nyquist_hz).min(1.0) * (own_bins - 1) as f64;
        poles.at(bin) + (-zeros.at(bin)).max(FLOOR.ln()) + level
    };
    let last = (nyquist_hz / step_hz).round() as usize;
    let first = (0.9 * nyquist_hz / step_hz) as usize;
    let edge = (first..=last).map(|bin| value(bin as f64 * step_hz)).sum::<f64>() / (last - first + 1) as f64;
    let slope = ROLL_OFF_DB_PER_OCTAVE / 10.0 * std::f64::consts::LN_10 / std::f64::consts::LN_2;
    let values = (0..BINS).map(|bin| {
        let frequency_hz = bin as f64 * step_hz;
        if frequency_hz <= nyquist_hz {
            value(frequency_hz)
        } else {
            edge - slope * (frequency_hz / nyquist_hz).ln()
        }
    });
    LogSpectrum::from_values(values.collect())
}

/// Largest error of a third octave that the chosen order of a node may leave, dB.
pub const ORDER_TOLERANCE_DB: f64 = 0.4;

/// Orders that are tried. The last one is used if none is within the tolerance.
const ORDERS: [usize; 17] = [6, 8, 10, 12, 14, 16, 18, 20, 23, 26, 30, 35, 42, 50, 65, 80, 100];

/// Returns the model at a speed, mm/s, and a force, N.
///
/// The model has exactly the power of the spectrum up to half the lower of the file's rate and the played one. A silent
/// node keeps its shape, because shapes are interpolated towards it.
pub(super) fn model(toolkit: &Toolkit, place: (f64, f64)) -> Model {
    let Between {
        shape,
        variance,
        is_extrapolated,
    } = at(toolkit, place);
    let mut flags = NodeFlags::NONE;
    if is_extrapolated {
        flags = flags.with(NodeFlags::EXTRAPOLATED);
    }
    let Some(shape) = shape else {
        return Model {
            flags: flags.with(NodeFlags::SILENT),
            ..Model::silent()
        };
    };
    let model = economical(&shape, toolkit);
    let output_power = model.output_power * variance;
    // What is zero in the library's 32 bits is silent there.
    if output_power as f32 <= 0.0 {
        flags = flags.with(NodeFlags::SILENT);
    }
    Model {
        output_power,
        flags,
        ..model
    }
}

fn economical(shape: &LogSpectrum, toolkit: &Toolkit) -> Model {
    let last_bin = (toolkit.highest_hz() / toolkit.step_hz()).round() as usize;
    let wanted: Vec<f64> = shape.values()[..=last_bin].iter().map(|value| value.exp()).collect();
    // Lower orders need no fit of their own: their models are the first stages of this lattice.
    let full = shape.model(ORDERS[ORDERS.len() - 1]);
    // The polynomials of the stages so far at each frequency.
    let begin = |bin: usize| {
        (
            Complex::cis(-PI * bin as f64 / (BINS - 1) as f64),
            1.0.into(),
            1.0.into(),
        )
    };
    let mut bins: Vec<_> = (0..=last_bin).map(begin).collect();
    let (mut order, mut made) = (0, Vec::<f64>::new());
    for next in ORDERS.map(|next| next.min(full.reflection.len())) {
        let stages = &full.reflection[order..next];
        wide(
            #[inline(always)]
            || {
                for k in stages {
                    for (turn, a, b) in &mut bins {
                        (*a, *b) = stage((*a, *b), *turn, *k);
                    }
                }
            },
        );
        order = next;
        let error_power = full.output_power * error_share(&full.reflection[..order]);
        let density = |(_, a, _): &(_, Complex<f64>, _)| error_power / a.norm_sqr().max(f64::MIN_POSITIVE);
        made = bins.iter().map(density).collect();
        let is_near = toolkit.bands().all(|band| {
            let (low_hz, high_hz) = band_edges_hz(band);
            let (low, high) = (low_hz / toolkit.step_hz(), high_hz / toolkit.step_hz());
            let ratio = power_between(&made, low, high) / power_between(&wanted, low, high);
            let error_db = 10.0 * ratio.log10();
            error_db.abs() <= ORDER_TOLERANCE_DB || !error_db.is_finite()
        });
        if is_near {
            break;
        }
    }
    Model {
        output_power: full.output_power * power_below(&wanted) / power_below(&made),
        reflection: full.reflection[..order].to_vec(),
        ..full
    }
}

/// Returns A and its backward polynomial, which is e^(-jωm) times the conjugate of A, of one order more.
/// The reflection coefficient is k, and `turn` is e^(-jω).
#[inline(always)]
pub(super) fn stage((a, b): (Complex<f64>, Complex<f64>), turn: Complex<f64>, k: f64) -> (Complex<f64>, Complex<f64>) {
    let delayed = b * turn;
    (a + delayed * k, delayed + a * k)
}

/// Returns the sum of the `density` between two fractional bins.
fn power_between(density: &[f64], low: f64, high: f64) -> f64 {
    let share = |bin: usize| (bin as f64 + 0.5).min(high) - (bin as f64 - 0.5).max(low);
    let bins = low.round() as usize..=(high.round() as usize).min(density.len() - 1);
    bins.map(|bin| density[bin] * share(bin).max(0.0)).sum()
}

/// Returns the sum of the `density`, which is proportional to power.
fn power_below(density: &[f64]) -> f64 {
    let last = density.len() - 1;
    density[1..last].iter().sum::<f64>() + 0.5 * (density[0] + density[last])
}

#[cfg(test)]
mod tests {
    use super::super::fixture;
    use super::super::read::read;
    use super::*;
    use model_format::{PlayRate, SAMPLE_RATE_HZ};
    use std::path::Path;
    use stylus_dsp::log_spectrum::STEP_HZ;
    use test_helpers::near;

    fn toolkit() -> Toolkit {
        read(Path::new("felt.xml"), &fixture::whole()).unwrap()
    }

    /// The densities in closed form check the reading of the file and the interpolation too.
    #[test]
    fn densities_are_those_in_closed_form_at_models_and_between_them_and_fall_above() {
        let toolkit = toolkit();
        let frequencies_hz = [0.0, 40.0, 133.0, 250.0, 499.0];
        for models in [
            vec![(4, 1.0)],
            vec![(3, 1.0)],
            vec![(1, 0.2), (3, 0.3), (5, 0.5)],
            vec![(0, 0.6), (4, 0.4)],
        ] {
            let sum = |of: fn((f64, f64, f64)) -> f64| -> f64 {
                let weighed = models.iter().map(|&(i, w)| w * of(fixture::PLACES[i]));
                weighed.sum()
            };
            let place = (sum(|p| p.0), sum(|p| p.1));
            let found = density(&toolkit, place, &frequencies_hz).unwrap();
            for (got, hz) in found.iter().zip(frequencies_hz) {
                let wanted = fixture::density(&models, hz);
                near(got / wanted, 1.0, 1e-3);
            }
        }
        let shape = at(&toolkit, (60.0, 0.5)).shape.unwrap();
        let fall = shape.at(1000.0 / STEP_HZ) - shape.at(2000.0 / STEP_HZ);
        assert!((10.0 / std::f64::consts::LN_10 * fall - ROLL_OFF_DB_PER_OCTAVE).abs() < 1e-6);
    }

    /// Models of the fixture at ten times its rate, with all frequencies ten times as high: Penn's models of 10 kHz
    /// have no zeros.
    #[test]
    fn models_of_10_khz_have_their_spectrum_up_to_half_the_rate_that_is_played() {
        let text = fixture::whole().replace("<SampleRate>1000", "<SampleRate>10000");
        let mut toolkit = read(Path::new("felt.xml"), &text).unwrap();
        for play_rate in PlayRate::ALL {
            toolkit.play_rate = play_rate;
            keeps_its_spectrum(&toolkit);
        }
    }

    fn keeps_its_spectrum(toolkit: &Toolkit) {
        let highest_hz = toolkit.play_rate.hz() / 2;
        assert!((toolkit.highest_hz() - f64::from(highest_hz)).abs() < 1e-9);
        let frequencies_hz = [0.0, 400.0, 1_330.0, f64::from(highest_hz) - 10.0];
        let found = density(toolkit, (60.0, 0.5), &frequencies_hz).unwrap();
        for (got, hz) in found.iter().zip(frequencies_hz) {
            let wanted = 0.1 * fixture::density(&[(4, 1.0)], 0.1 * hz);
            assert!((got / wanted - 1.0).abs() < 1e-3, "{hz}: {got} {wanted}");
        }
        let without_zeros = ArmaModel {
            timbre: toolkit.models[4].timbre.clone().map(|timbre| Timbre {
                zeros: Vec::new(),
                ..timbre
            }),
            ..toolkit.models[4].clone()
        };
        assert!(shape(toolkit, &[(&without_zeros, 1.0)]).is_some());
        let model = model(toolkit, (60.0, 0.5));
        let kept: f64 = (0..highest_hz)
            .map(|hz| 0.1 * fixture::density(&[(4, 1.0)], 0.1 * (f64::from(hz) + 0.5)))
            .sum();
        assert!(
            (model.output_power / kept - 1.0).abs() < 0.02,
            "{} {kept}",
            model.output_power
        );
    }

    #[test]
    fn silence_has_no_density_and_the_highest_speed_counts_above_it() {
        let toolkit = toolkit();
        assert!(density(&toolkit, (0.0, 1.0), &[100.0]).is_none());
        assert!(density(&toolkit, (50.0, 0.0), &[100.0]).is_none());
        assert_eq!(
            density(&toolkit, (900.0, 9.0), &[100.0]),
            density(&toolkit, (200.0, 2.0), &[100.0])
        );
    }

    #[test]
    fn towards_a_silent_corner_the_variance_falls_and_the_shape_is_the_mean_of_both() {
        let toolkit = toolkit();
        // Halfway to a silent corner with the same shape, and to one with another shape.
        let half = at(&toolkit, (30.0, 0.25));
        assert!((half.variance - 0.002).abs() < 1e-12);
        let (here, there) = (at(&toolkit, (60.0, 0.5)).shape.unwrap(), half.shape.unwrap());
        assert!((here.values()[300] - there.values()[300]).abs() < 1e-9);
        let other = at(&toolkit, (130.0, 0.25));
        let wanted = fixture::density(&[(1, 0.5), (4, 0.5)], 150.0);
        let density = 2.0 * other.variance * other.shape.unwrap().at(150.0 / STEP_HZ).exp() / f64::from(SAMPLE_RATE_HZ);
        assert!((density / wanted - 1.0).abs() < 1e-3, "{density} {wanted}");
        assert!(at(&toolkit, (0.0, 1.0)).variance.abs() < 1e-15);
    }

    #[test]
    fn a_silent_model_without_a_shape_counts_for_the_variance_alone() {
        let mut toolkit = toolkit();
        toolkit.models[1].timbre = None;
        let half = at(&toolkit, (130.0, 0.25));
        assert!((half.variance - 0.002).abs() < 1e-12);
        let whole = at(&toolkit, (60.0, 0.5)).shape.unwrap();
        assert!((half.shape.unwrap().values()[300] - whole.values()[300]).abs() < 1e-9);
    }
}
