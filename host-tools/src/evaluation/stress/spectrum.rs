//! The spectrum of a model as it was fitted and as it is stored.

use model_format::Texture;
use realfft::num_complex::Complex;

use super::models::NamedModel;
use crate::dsp::linear_prediction::{error_share, step_up};
use crate::dsp::with_planner;
use crate::texture::stored::reflection;

/// Frequencies from 0 to half the rate that are looked at, beside those near a model's strongest line.
const POINTS: usize = 32_768;

/// The largest difference of power at any frequency, dB, over all nodes of `texture`, which was made of `nodes`.
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
            for n in -2000..=2000 {
                let frequency = peak + step * f64::from(n) / 1000.0;
                largest = largest.max(difference(&self.at(frequency), &other.at(frequency)));
            }
        }
        largest
    }

    fn on_the_grid(&self) -> Vec<f64> {
        let forward = with_planner(|planner| planner.plan_fft_forward(2 * POINTS));
        let mut terms = vec![1.0];
        terms.extend(&self.a);
        terms.resize(2 * POINTS, 0.0);
        let mut spectrum = forward.make_output_vec();
        forward
            .process(&mut terms, &mut spectrum)
            .expect("lengths come from the plan");
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
        // Off by the half width at half power: 3 dB at the one line's top, 7 dB on the way down the other side.
        let difference = line(0.5).largest_difference_db(&line(0.5001));
        assert!((3.0..9.0).contains(&difference), "{difference}");
    }
}
