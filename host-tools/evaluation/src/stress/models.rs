//! Hard models as a library stores them.

use model_format::Texture;
use stylus_dsp::fourier::{self, Complex};
use stylus_dsp::linear_prediction::{error_share, step_up};
use stylus_dsp::model::Model;
use stylus_fit::texture::grid::Grid;
use stylus_fit::texture::library::library_of;
use stylus_fit::texture::quantise::reflection;
use stylus_hard_cases::{FORCES_N, NamedModel, SPEEDS_MM_S};
use stylus_support::Result;

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
    nodes.iter().zip(texture.nodes()).map(node).fold(0.0, f64::max)
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
        let mut largest = mine.iter().zip(&its).map(|(a, b)| difference(a, b)).fold(0.0, f64::max);
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
        fourier::forward(&mut terms)
            .iter()
            .map(|a| self.share / a.norm_sqr())
            .collect()
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
