//! Coefficients as a library stores them, in floating point.

use model_format::{Coefficients, FINE_THETA_STEP_RAD, LevelLaw, Texture};
use stylus_kernel::grid::{GridPoint, ONE};

/// k(1), k(2) ..., exactly as stored.
pub fn reflection(coefficients: Coefficients<'_>) -> Vec<f64> {
    let k = |theta: i32| (f64::from(theta) * FINE_THETA_STEP_RAD).sin();
    coefficients.thetas().map(k).collect()
}

/// RMS of a lattice's output at `point`, m/s², by the texture's laws between nodes and below the grid, in float64.
pub fn rms_m_s2(texture: &Texture<'_>, point: &GridPoint) -> f64 {
    let power = |speed, force| f64::from(texture.node(speed, force).output_power);
    let mean = |of: fn(f64) -> f64| -> f64 {
        let nodes = point.nodes.iter().zip(&point.weights);
        let used = nodes.filter(|&(_, &weight)| weight > 0);
        let term = |(&(speed, force), &weight)| f64::from(weight) * of(power(speed, force));
        used.map(term).sum::<f64>() / f64::from(ONE)
    };
    let rms = match texture.level_law() {
        LevelLaw::Power => mean(|power| power).sqrt(),
        LevelLaw::Amplitude => mean(f64::sqrt),
        LevelLaw::Logarithm => mean(|power| 0.5 * power.ln()).exp(),
    };
    rms * f64::from(point.fade) / f64::from(ONE)
}
