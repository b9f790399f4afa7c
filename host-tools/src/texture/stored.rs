//! Coefficients as a library stores them, in floating point.

use model_format::Coefficients;

/// h(1), h(2) ... of a direct form, exactly as stored.
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
        Coefficients::Lattice(_) => Vec::new(),
    }
}
