//! Quantisation of a floating-point model to the codes that a library stores.

use model_format::{
    CodeSpec, Coefficients, FINE_THETA_STEP_RAD, LevelLaw, NodeFlags, NodeSpec, THETA_FRACTION_BITS, Texture, limits,
};
use stylus_dsp::linear_prediction::error_share;
use stylus_dsp::model::Model;
use stylus_kernel::grid::{GridPoint, ONE};
use stylus_support::in_order::in_order;
use stylus_support::{Error, Result};

use crate::texture::grid::Grid;

/// Returns all nodes of `grid` as codes.
pub fn nodes(name: &str, grid: &Grid) -> Result<Vec<NodeSpec>> {
    let nodes: Vec<_> = grid.nodes().collect();
    in_order(&nodes, |(speed_mm_s, force_n, model)| {
        node(model).map_err(|problem| {
            let place = format!("texture '{name}' at {speed_mm_s} mm/s, {force_n} N");
            Error::Model(format!("{place}: {problem}"))
        })
    })
}

/// Returns whether `model` is louder than a library can hold.
pub(crate) fn is_too_loud(model: &Model) -> bool {
    model.output_power as f32 > limits::MAX_OUTPUT_POWER
}

fn node(model: &Model) -> std::result::Result<NodeSpec, String> {
    let mut output_power = model.output_power as f32;
    if is_too_loud(model) {
        return Err(format!(
            "an RMS of {:.1} m/s² is above the {} that a model can have; check scale_m_s2",
            model.output_power.sqrt(),
            limits::MAX_OUTPUT_POWER.sqrt()
        ));
    }
    let mut flags = model.flags;
    if output_power <= 0.0 {
        output_power = 0.0;
        flags = flags.with(NodeFlags::SILENT);
    }
    let (codes, reflection) = lattice(model);
    // Computed from the coefficients as they are stored, so that the level is right to the last code.
    let prediction_error_power = (f64::from(output_power) * error_share(&reflection)) as f32;
    Ok(NodeSpec {
        output_power,
        // The format refuses a residual above the output, as rounding to 32 bits might make it.
        prediction_error_power: prediction_error_power.min(output_power),
        flags,
        codes,
    })
}

/// Returns θ with 24 bits in the first stages and 16 bits in the others, and the reflection coefficients that these
/// codes represent.
fn lattice(model: &Model) -> (CodeSpec, Vec<f64>) {
    const CODE: f64 = (1 << THETA_FRACTION_BITS) as f64;
    let thetas: Vec<i32> = model
        .reflection
        .iter()
        .enumerate()
        .map(|(stage, k)| {
            let theta = k.asin() / FINE_THETA_STEP_RAD;
            if stage < limits::MAX_FINE_STAGES {
                theta.round() as i32
            } else {
                // Rounded only once. The clamp excludes the very last code, which would mean |k| = 1.
                let code = (theta / CODE).round();
                (code.clamp(-f64::from(i16::MAX), f64::from(i16::MAX)) * CODE) as i32
            }
        })
        .collect();
    let codes = CodeSpec::fine_lattice(&thetas);
    let reflection = stored_reflection(&codes);
    (codes, reflection)
}

/// Number of first stages of a compact lattice that have 24 bits. With this value 120 nodes of order 400 take less than
/// 56 KiB.
pub const COMPACT_FINE_STAGES: usize = 24;

/// Returns the compact codes of `model`: 24 bits in the first [`COMPACT_FINE_STAGES`] stages, 16 bits in the next ones
/// up to [`limits::MAX_FINE_STAGES`], then 8 bits.
pub(crate) fn compact_codes(model: &Model) -> CodeSpec {
    let theta = |k: &f64| (k.asin() / FINE_THETA_STEP_RAD).round() as i32;
    let thetas: Vec<i32> = model.reflection.iter().map(theta).collect();
    CodeSpec::compact_lattice(&thetas, COMPACT_FINE_STAGES)
}

/// Returns `node` with other lattice codes and the prediction-error power that belongs to them.
pub(crate) fn with_codes(node: &NodeSpec, codes: CodeSpec) -> NodeSpec {
    let share = error_share(&stored_reflection(&codes));
    NodeSpec {
        prediction_error_power: (f64::from(node.output_power) * share) as f32,
        codes,
        ..*node
    }
}

/// Returns the reflection coefficients that `codes` represent.
pub(crate) fn stored_reflection(codes: &CodeSpec) -> Vec<f64> {
    let k = |theta: i32| (f64::from(theta) * FINE_THETA_STEP_RAD).sin();
    codes.thetas().map(k).collect()
}

/// Returns `nodes` with 16 bits of θ in every stage, for a texture that must save the 32 bytes per node.
pub fn coarse(nodes: Vec<NodeSpec>) -> Vec<NodeSpec> {
    let coarse = |node: NodeSpec| {
        let mut codes = node.codes.clone();
        // The codes are already rounded to the nearest 16-bit value.
        codes.fractions.clear();
        with_codes(&node, codes)
    };
    nodes.into_iter().map(coarse).collect()
}

/// Returns k(1), k(2) ..., exactly as stored.
pub fn reflection(coefficients: Coefficients<'_>) -> Vec<f64> {
    let k = |theta: i32| (f64::from(theta) * FINE_THETA_STEP_RAD).sin();
    coefficients.thetas().map(k).collect()
}

/// Returns the RMS of a lattice's output at `point`, m/s², in float64. It follows the texture's laws of the level
/// between nodes and below the grid.
pub fn rms_m_s2(texture: &Texture<'_>, point: &GridPoint) -> f64 {
    let power = |speed, force| f64::from(texture.node(speed, force).output_power);
    let mean = |of: fn(f64) -> f64| -> f64 {
        let used = point
            .nodes
            .iter()
            .zip(&point.weights)
            .filter(|&(_, &weight)| weight > 0);
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

#[cfg(test)]
mod tests {
    use model_format::THETA_STEP_RAD;
    use proptest::prelude::*;

    use super::*;
    use crate::texture::theta::LARGEST_ERROR;
    use stylus_dsp::linear_prediction::{Prediction, step_up};
    use stylus_dsp::model_error::ModelError;

    fn model(reflection: Vec<f64>) -> Model {
        Model::new(reflection, 2.0)
    }

    proptest! {
        #[test]
        fn every_stable_model_has_a_lattice_within_half_a_step(
            k in prop::collection::vec(-0.999_999_999f64..0.999_999_999, 0..400),
        ) {
            let (spec, back) = lattice(&model(k.clone()));
            prop_assert!(spec.codes.iter().all(|&code| code != i16::MIN));
            for (stage, (a, b)) in k.iter().zip(back).enumerate() {
                let step = if stage < limits::MAX_FINE_STAGES { FINE_THETA_STEP_RAD } else { THETA_STEP_RAD };
                // The last code of θ is half a coarse step from π/2.
                let end = std::f64::consts::FRAC_PI_2 - 0.51 * THETA_STEP_RAD;
                let error = (a.asin().clamp(-end, end) - b.asin().clamp(-end, end)).abs();
                prop_assert!(error <= 0.51 * step, "stage {}: {}", stage + 1, error / step);
            }
            let node = node(&model(k.clone())).unwrap();
            let coarse = coarse(vec![node]).remove(0);
            for (a, b) in k.iter().zip(stored_reflection(&coarse.codes)) {
                prop_assert!((a.asin() - b.asin()).abs() <= 0.51 * THETA_STEP_RAD);
            }
        }
    }

    /// Returns the power density at a frequency of the model with these predictor coefficients, per unit of power.
    fn density(a: &[f64], share: f64, hz: f64) -> f64 {
        let angle = std::f64::consts::TAU * hz / f64::from(model_format::SAMPLE_RATE_HZ);
        let mut sum = (1.0, 0.0);
        for (lag, a) in (1..).zip(a) {
            let (sin, cos) = (angle * f64::from(lag)).sin_cos();
            sum = (sum.0 + a * cos, sum.1 - a * sin);
        }
        share / (sum.0 * sum.0 + sum.1 * sum.1)
    }

    /// Returns a model's density at its peak near a line, and the peak's frequency, Hz. The search narrows down step by
    /// step, because the peak is far narrower than any fixed grid.
    fn peak(reflection: &[f64], line_hz: f64) -> (f64, f64) {
        let (a, share) = (step_up(reflection), error_share(reflection));
        let (mut best, mut step_hz) = ((0.0, line_hz), 0.05);
        for _ in 0..6 {
            let middle_hz = best.1;
            let densities = (-60..=60)
                .map(|step| middle_hz + step_hz * f64::from(step))
                .map(|hz| (density(&a, share, hz), hz));
            best = densities.max_by(|a, b| a.0.total_cmp(&b.0)).unwrap();
            step_hz /= 20.0;
        }
        best
    }

    /// Largest errors of a stored lattice against its model, over all lines.
    #[derive(Clone, Copy, Debug, Default)]
    struct LineErrors {
        /// Error of the peak's height, wherever the peak is.
        peak_db: f64,
        /// Error of the density at the frequency of the model's peak.
        in_place_db: f64,
        /// Error of the peak's frequency.
        shift_hz: f64,
    }

    impl LineErrors {
        fn max(self, other: Self) -> Self {
            Self {
                peak_db: self.peak_db.max(other.peak_db),
                in_place_db: self.in_place_db.max(other.in_place_db),
                shift_hz: self.shift_hz.max(other.shift_hz),
            }
        }
    }

    /// Returns the errors of lines with the fractions of θ, and without them.
    fn line_errors(reflection: Vec<f64>, lines_hz: &[f64]) -> [LineErrors; 2] {
        let model = model(reflection);
        let fine = node(&model).unwrap();
        let coarse = coarse(vec![fine.clone()]).remove(0);
        [fine, coarse].map(|node| {
            let stored = stored_reflection(&node.codes);
            let (a, share) = (step_up(&stored), error_share(&stored));
            let decibels = |ratio: f64| (10.0 * ratio.log10()).abs();
            let error = |&line_hz: &f64| {
                let (exact, played) = (peak(&model.reflection, line_hz), peak(&stored, line_hz));
                LineErrors {
                    peak_db: decibels(played.0 / exact.0),
                    in_place_db: decibels(density(&a, share, exact.1) / exact.0),
                    shift_hz: (played.1 - exact.1).abs(),
                }
            };
            lines_hz.iter().map(error).fold(LineErrors::default(), LineErrors::max)
        })
    }

    /// Lines of radius 0.99999, which decay in 20 s, over a floor. 16 bits preserve a peak's height but not its
    /// frequency.
    #[test]
    fn first_stages_with_24_bits_keep_narrow_lines_in_their_place() {
        let mut worst = [LineErrors::default(); 2];
        for order in [20, 100] {
            for lines_hz in [
                &[60.0, 180.0][..],
                &[200.0, 200.5],
                &[100.0, 130.0],
                &[60.0, 170.0, 270.0, 380.0, 480.0, 590.0, 690.0, 800.0],
            ] {
                let reflection = lines_over_a_floor(0.999_99, lines_hz, order);
                let errors = line_errors(reflection, lines_hz);
                worst = [worst[0].max(errors[0]), worst[1].max(errors[1])];
            }
        }
        let [fine, coarse] = worst;
        assert!(fine.in_place_db < 0.1, "{fine:?}");
        assert!(fine.peak_db < 0.01, "{fine:?}");
        assert!(fine.shift_hz < 0.002, "{fine:?}");
        // Otherwise the cases would prove nothing.
        assert!(coarse.in_place_db > 3.0, "{coarse:?}");
        assert!(coarse.shift_hz > 0.01, "{coarse:?}");
    }

    #[test]
    fn compact_theta_moves_no_line_beyond_its_bound() {
        let mut without_fractions_db = 0.0_f64;
        for radius in [0.9, 0.99, 0.999, 0.9999, 0.999_99] {
            for lines_hz in [
                &[60.0, 180.0][..],
                &[200.0, 230.0],
                &[100.0, 130.0, 480.0],
                &[60.0, 170.0, 270.0, 380.0],
            ] {
                let reflection = lines_over_a_floor(radius, lines_hz, 100);
                let codes = compact_codes(&model(reflection.clone()));
                let stored = stored_reflection(&codes);
                let error = ModelError::between(&reflection, &stored, 5000.0);
                assert!(error.share_of(LARGEST_ERROR) <= 1.0, "{radius}: {error:?}");
                let (a, share) = (step_up(&stored), error_share(&stored));
                for &line_hz in lines_hz {
                    let exact = peak(&reflection, line_hz);
                    let ratio = density(&a, share, exact.1) / exact.0;
                    let in_place_db = (10.0 * ratio.log10()).abs();
                    let bound_db = 1.01 * LARGEST_ERROR.line_db;
                    assert!(in_place_db <= bound_db, "{radius}, {line_hz} Hz: {in_place_db} dB");
                }
                let thetas: Vec<i32> = codes.thetas().collect();
                let coarse = stored_reflection(&CodeSpec::compact_lattice(&thetas, 0));
                let error = ModelError::between(&reflection, &coarse, 5000.0);
                without_fractions_db = without_fractions_db.max(error.line_db);
            }
        }
        // Otherwise the cases would prove nothing.
        assert!(without_fractions_db > 1.0, "{without_fractions_db} dB");
    }

    /// Returns the reflection coefficients of lines that decay by `radius` per sample, over a floor.
    fn lines_over_a_floor(radius: f64, lines_hz: &[f64], order: usize) -> Vec<f64> {
        let lag = |lag: usize| {
            let angle = std::f64::consts::TAU * lag as f64 / f64::from(model_format::SAMPLE_RATE_HZ);
            let mean = lines_hz.iter().map(|hz| (angle * hz).cos()).sum::<f64>() / lines_hz.len() as f64;
            radius.powi(lag as i32) * mean + if lag == 0 { 1e-6 } else { 0.0 }
        };
        let lags: Vec<f64> = (0..=order).map(lag).collect();
        Prediction::levinson_durbin(&lags, order).reflection
    }
}
