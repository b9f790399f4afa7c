//! Coefficients as a library stores them, in floating point.

use model_format::{Coefficients, FINE_THETA_STEP_RAD};

/// k(1), k(2) ... of a lattice, exactly as stored. Empty for a direct form.
pub fn reflection(coefficients: Coefficients<'_>) -> Vec<f64> {
    let k = |theta: i32| (f64::from(theta) * FINE_THETA_STEP_RAD).sin();
    coefficients.thetas().map(k).collect()
}

/// h(1), h(2) ... of a direct form, exactly as stored. Empty for a lattice.
pub fn predictor(coefficients: Coefficients<'_>) -> Vec<f64> {
    match coefficients {
        Coefficients::Direct16 { exponent, codes } => {
            let step = 2f64.powi(i32::from(exponent) - 15);
            let code = |&code: &[u8; 2]| f64::from(i16::from_le_bytes(code)) * step;
            codes.iter().map(code).collect()
        }
        Coefficients::Direct32 { exponent, codes } => {
            let step = 2f64.powi(i32::from(exponent) - 31);
            let code = |&code: &[u8; 4]| f64::from(i32::from_le_bytes(code)) * step;
            codes.iter().map(code).collect()
        }
        Coefficients::Lattice { .. } => Vec::new(),
    }
}
