//! Prediction residuals, by the predictor that a library stores.

use model_format::{CodeSpec, FINE_THETA_STEP_RAD};

use crate::dsp::linear_prediction::step_up;

/// a(1), a(2) ... of A(z), exactly as the codes have them.
pub(super) fn predictor(codes: &CodeSpec) -> Vec<f64> {
    let k = |theta: i32| (f64::from(theta) * FINE_THETA_STEP_RAD).sin();
    step_up(&codes.thetas().map(k).collect::<Vec<_>>())
}

/// Residual of `signal`, from the first sample that all of the predictor's samples stand before. Empty for a signal
/// that is not longer than the predictor.
pub(super) fn residual(signal: &[f64], predictor: &[f64]) -> Vec<f64> {
    let order = predictor.len();
    // The window's oldest sample comes first, and a(M) belongs to it.
    let newest_last: Vec<f64> = predictor.iter().rev().copied().collect();
    let error = |window: &[f64]| -> f64 {
        let (before, now) = (&window[..order], window[order]);
        now + before
            .iter()
            .zip(&newest_last)
            .map(|(x, a)| x * a)
            .sum::<f64>()
    };
    signal.windows(order + 1).map(error).collect()
}

/// Mean square of a signal; 0 of an empty one.
pub(super) fn mean_square(signal: &[f64]) -> f64 {
    signal.iter().map(|x| x * x).sum::<f64>() / signal.len().max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::texture::grid::Grid;
    use crate::texture::quantise::nodes;

    /// The residual of what the model's filter makes of an excitation is that excitation.
    #[test]
    fn the_residual_of_a_synthesis_is_its_excitation() {
        let model = crate::dsp::model::Model {
            reflection: vec![-0.7, 0.5, -0.3],
            output_power: 1.0,
            flags: model_format::NodeFlags::NONE,
        };
        let grid = Grid {
            speeds_mm_s: vec![100.0],
            forces_n: vec![1.0],
            models: vec![model],
            laws: model_format::Laws::default(),
            parts: model_format::PartsSpec::default(),
        };
        let node = nodes("test", &grid).unwrap().remove(0);
        let a = predictor(&node.codes);
        let excitation: Vec<f64> = (0..200u32).map(|n| f64::from(n * n % 31) - 15.0).collect();
        let mut signal: Vec<f64> = Vec::new();
        for (n, e) in excitation.iter().enumerate() {
            let past = a.iter().enumerate().filter(|(i, _)| *i < n);
            let predicted: f64 = past.map(|(i, a)| -a * signal[n - 1 - i]).sum();
            signal.push(e + predicted);
        }
        let found = residual(&signal, &a);
        assert_eq!(found.len(), 197);
        for (found, e) in found.iter().zip(&excitation[3..]) {
            assert!((found - e).abs() < 1e-9);
        }
        assert_eq!(residual(&[1.0, 2.0], &[0.5, 0.5]), Vec::<f64>::new());
        assert_eq!(residual(&[1.0, 2.0], &[]), [1.0, 2.0]);
    }
}
