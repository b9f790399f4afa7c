//! Models that are hard on a filter's arithmetic, and grids of them.

use std::f64::consts::{PI, TAU};

use model_format::{SAMPLE_RATE_HZ, Texture, limits};

use crate::dsp::fourier::{self, Complex};
use crate::dsp::linear_prediction::{Prediction, error_share, step_up};
use crate::dsp::model::Model;
use crate::support::error::Result;
use crate::texture::grid::Grid;
use crate::texture::library::library_of;
use crate::texture::quantise::reflection;

const RATE_HZ: f64 = SAMPLE_RATE_HZ as f64;

/// A model by its reflection coefficients, with a name.
#[derive(Clone, Debug)]
pub struct NamedModel {
    /// Name in tables.
    pub name: String,
    /// Reflection coefficients, the first stage first.
    pub reflection: Vec<f64>,
    /// Largest magnitude of the model's poles, or a bound of it.
    pub pole_radius: f64,
}

/// The six models of order 400 of `tests/fixtures`, made from the formulas that are given there.
pub fn fixtures() -> Vec<NamedModel> {
    let damped = |first_hz: f64, second_hz: f64| {
        let line = |radius: f64, hz: f64, lag: usize| {
            radius.powi(lag as i32) * (TAU * hz * lag as f64 / RATE_HZ).cos()
        };
        let lag = |lag| line(0.995, first_hz, lag) + 0.5 * line(0.99, second_hz, lag);
        let mut lags: Vec<f64> = (0..=limits::MAX_ORDER).map(lag).collect();
        lags[0] += 1e-4;
        lags
    };
    [
        ("H1a", damped(60.0, 180.0)),
        ("H1b", damped(240.0, 720.0)),
        ("H2a", low_pass(100.0, 8, 1e-6)),
        ("H2b", low_pass(800.0, 8, 1e-6)),
        ("H3", low_pass(200.0, 8, 1e-8)),
        ("H4", low_pass(200.0, 16, 1e-10)),
    ]
    .into_iter()
    .map(|(name, lags)| NamedModel {
        name: name.to_owned(),
        reflection: Prediction::levinson_durbin(&lags, limits::MAX_ORDER).reflection,
        // The larger radius of H1's two lines. The poles of the other models are below it.
        pole_radius: 0.995,
    })
    .collect()
}

/// Autocorrelation of noise with the spectrum 1 / (1 + (f/cut-off)^`order`) over a floor, on a grid of 32 768
/// frequencies.
fn low_pass(cut_off_hz: f64, order: i32, floor: f64) -> Vec<f64> {
    const POINTS: usize = 32_768;
    let power = |bin: usize| {
        let frequency_hz = bin as f64 * RATE_HZ / POINTS as f64;
        1.0 / (1.0 + (frequency_hz / cut_off_hz).powi(order)) + floor
    };
    let power: Vec<f64> = (0..=POINTS / 2).map(power).collect();
    let mut lags = fourier::of_power(&power, POINTS);
    lags.truncate(limits::MAX_ORDER + 1);
    let total = lags[0];
    lags.iter().map(|lag| lag / total).collect()
}

/// A model of one pair of poles of this radius.
pub fn resonance(radius: f64, frequency_hz: f64) -> NamedModel {
    // The step-down recursion of the polynomial 1 - 2r cos ω z⁻¹ + r² z⁻².
    let k2 = radius * radius;
    let k1 = -2.0 * radius * (TAU * frequency_hz / RATE_HZ).cos() / (1.0 + k2);
    NamedModel {
        name: format!("r {radius}, {frequency_hz} Hz"),
        reflection: vec![k1, k2],
        pole_radius: radius,
    }
}

/// Resonances of low and high frequency, from a damped one to a pole radius of 0.99999.
pub fn resonances() -> Vec<NamedModel> {
    let radii = [0.99, 0.999, 0.9999, 0.999_99];
    radii
        .into_iter()
        .flat_map(|radius| [resonance(radius, 100.0), resonance(radius, 1230.0)])
        .collect()
}

/// A model of this order whose reflection coefficients fall as 1/m, with changing signs.
pub fn falling(order: usize) -> NamedModel {
    let k = |stage: usize| 0.9 * (PI * stage as f64 * 0.7).cos() / stage as f64;
    NamedModel {
        name: format!("order {order}"),
        reflection: (1..=order).map(k).collect(),
        pole_radius: 0.995,
    }
}

/// Speeds of a grid of two by two nodes, mm/s.
pub const SPEEDS_MM_S: [f32; 2] = [100.0, 200.0];
/// Forces of a grid of two by two nodes, N.
pub const FORCES_N: [f32; 2] = [0.5, 1.0];

/// A library of one texture: of one node, or of four, speed-major, with their output powers, (m/s²)².
///
/// # Errors
/// A model that a library cannot hold, in the words of `fit`.
pub fn library(nodes: &[(&NamedModel, f64)]) -> Result<Vec<u8>> {
    let side = if nodes.len() == 1 { 1 } else { 2 };
    let model = |(model, power): &(&NamedModel, f64)| Model::new(model.reflection.clone(), *power);
    let grid = Grid::new(
        SPEEDS_MM_S[..side].to_vec(),
        FORCES_N[..side].to_vec(),
        nodes.iter().map(model).collect(),
    );
    library_of("hard", &grid)
}

/// Number of steps from 0 to half the sample rate at which spectra are compared, in addition to the frequencies near a
/// model's strongest line.
const POINTS: usize = 32_768;

/// Returns the largest difference of power at any frequency, dB, between the models `nodes` and the nodes of `texture`
/// that store them.
pub(super) fn largest_difference_db(nodes: &[(&NamedModel, f64)], texture: &Texture<'_>) -> f64 {
    let node = |((model, _), node): (&(&NamedModel, f64), model_format::Node<'_>)| {
        let fitted = Shape::new(step_up(&model.reflection), error_share(&model.reflection));
        let reflection = reflection(node.coefficients);
        let stored = Shape::new(step_up(&reflection), error_share(&reflection));
        fitted.largest_difference_db(&stored)
    };
    nodes
        .iter()
        .zip(texture.nodes())
        .map(node)
        .fold(0.0, f64::max)
}

/// A power spectrum: share / |A|².
struct Shape {
    a: Vec<f64>,
    share: f64,
}

impl Shape {
    fn new(a: Vec<f64>, share: f64) -> Self {
        Self { a, share }
    }

    fn largest_difference_db(&self, other: &Self) -> f64 {
        let (mine, its) = (self.on_the_grid(), other.on_the_grid());
        let difference = |a: &f64, b: &f64| (10.0 * (a / b).log10()).abs();
        let on_the_grid = mine.iter().zip(&its).map(|(a, b)| difference(a, b));
        let mut largest = on_the_grid.fold(0.0, f64::max);
        // A line may be narrower than the grid's steps.
        for powers in [&mine, &its] {
            let peak = (0..powers.len()).max_by(|&a, &b| powers[a].total_cmp(&powers[b]));
            let peak = std::f64::consts::PI * peak.unwrap_or(0) as f64 / POINTS as f64;
            let step = std::f64::consts::PI / POINTS as f64;
            // Steps of 9.6e-8 rad, a hundredth of the half width of a line at pole radius 0.99999.
            for n in -2000..=2000 {
                let frequency = peak + step * f64::from(n) / 1000.0;
                largest = largest.max(difference(&self.at(frequency), &other.at(frequency)));
            }
        }
        largest
    }

    fn on_the_grid(&self) -> Vec<f64> {
        let mut terms = vec![1.0];
        terms.extend(&self.a);
        terms.resize(2 * POINTS, 0.0);
        let spectrum = fourier::forward(&mut terms);
        spectrum.iter().map(|a| self.share / a.norm_sqr()).collect()
    }

    fn at(&self, frequency: f64) -> f64 {
        let step = Complex::from_polar(1.0, -frequency);
        // Horner's scheme from the last coefficient on.
        let tail = self
            .a
            .iter()
            .rev()
            .fold(Complex::new(0.0, 0.0), |sum, a| (sum + a) * step);
        self.share / (tail + 1.0).norm_sqr()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_shapes_do_not_differ_and_a_shifted_line_is_seen() {
        let line = |frequency: f64| {
            let radius = 0.9999;
            let a = vec![-2.0 * radius * f64::cos(frequency), radius * radius];
            Shape::new(a, 1.0)
        };
        assert!(line(0.5).largest_difference_db(&line(0.5)) < 1e-9);
        // The lines are apart by their half width at half power. They differ by 3 dB at one line's peak, and by up to
        // 4.2 dB on the flank; see `spectrum_limit_db`.
        let difference = line(0.5).largest_difference_db(&line(0.5001));
        assert!((3.0..9.0).contains(&difference), "{difference}");
    }
}
