//! Steps of a linear system by small dense matrices.

use num_complex::Complex;

/// Steps per second: one per code of the stylus's output.
pub const STEP_HZ: f64 = 40_000.0;
/// Time of a step, s.
pub const STEP_S: f64 = 1.0 / STEP_HZ;

/// Number of states of the linear part.
pub const STATES: usize = 6;
/// Number of inputs of the linear part.
pub const INPUTS: usize = 2;
/// States and inputs.
const ALL: usize = STATES + INPUTS;

/// A row per state: the coefficients of its derivative, or of its next value, for states and inputs.
pub type Rows = [[f64; ALL]; STATES];

type Square = [[f64; ALL]; ALL];

fn product(left: &Square, right: &Square) -> Square {
    let mut result = [[0.0; ALL]; ALL];
    for (row, of_left) in result.iter_mut().zip(left) {
        for (factor, of_right) in of_left.iter().zip(right) {
            for (sum, value) in row.iter_mut().zip(of_right) {
                *sum += factor * value;
            }
        }
    }
    result
}

/// Returns the matrix that gives the states after `seconds` from the states before and constant inputs, for the system
/// with `derivatives`.
///
/// It is the exponential of the matrix with the inputs as constant states (Van Loan), computed by scaling, series and
/// squaring.
pub fn exponential(derivatives: &Rows, seconds: f64) -> Rows {
    // The scaled matrix has a norm of at most 1/2, so the first term left out is below 0.5^19 / 19! = 2e-23.
    const TERMS: u32 = 18;
    let mut generator = [[0.0; ALL]; ALL];
    generator[..STATES].copy_from_slice(derivatives);
    let norm = |row: &[f64; ALL]| row.iter().map(|value| value.abs()).sum::<f64>();
    let largest = generator.iter().map(norm).fold(0.0, f64::max) * seconds;
    let halvings = (largest.log2().ceil() + 1.0).max(0.0) as i32;
    let scale = seconds / 2_f64.powi(halvings);
    let mut result = [[0.0; ALL]; ALL];
    (0..ALL).for_each(|at| result[at][at] = 1.0);
    let mut term = result;
    for order in 1..=TERMS {
        term = product(&term, &generator);
        for (row, of_term) in result.iter_mut().zip(&mut term) {
            for (sum, value) in row.iter_mut().zip(of_term) {
                *value *= scale / f64::from(order);
                *sum += *value;
            }
        }
    }
    for _ in 0..halvings {
        result = product(&result, &result);
    }
    // The rows of the inputs, which stay as they are, are left out.
    std::array::from_fn(|row| result[row])
}

/// Returns the states after a step with the matrix `rows`.
pub fn advance(rows: &Rows, states: &[f64; STATES], inputs: [f64; INPUTS]) -> [f64; STATES] {
    rows.map(|row| {
        let (of_states, of_inputs) = row.split_at(STATES);
        let states = of_states.iter().zip(states).map(|(a, b)| a * b);
        let inputs = of_inputs.iter().zip(inputs).map(|(a, b)| a * b);
        states.chain(inputs).sum()
    })
}

/// Returns the phasors of the states after a step with the matrix `rows`, if the first input has the phasor 1. In each
/// step, a phasor is multiplied by `z`.
///
/// The equations are solved by Gaussian elimination with the largest pivot.
pub fn steady_state(rows: &Rows, z: Complex<f64>) -> [Complex<f64>; STATES] {
    let zero = Complex::new(0.0, 0.0);
    let mut left = [[zero; STATES]; STATES];
    let mut right: [Complex<f64>; STATES] = std::array::from_fn(|row| rows[row][STATES].into());
    for (row, of_left) in left.iter_mut().enumerate() {
        for (column, value) in of_left.iter_mut().enumerate() {
            *value = -Complex::from(rows[row][column]);
        }
        of_left[row] += z;
    }
    for at in 0..STATES {
        let size = |row: &usize| left[*row][at].norm_sqr();
        let pivot = (at..STATES)
            .max_by(|one, other| size(one).total_cmp(&size(other)))
            .expect("there is a row");
        left.swap(at, pivot);
        right.swap(at, pivot);
        let (pivot_row, pivot_right) = (left[at], right[at]);
        for row in at + 1..STATES {
            let factor = left[row][at] / pivot_row[at];
            right[row] -= factor * pivot_right;
            for (value, of_pivot) in left[row].iter_mut().zip(pivot_row) {
                *value -= factor * of_pivot;
            }
        }
    }
    for at in (0..STATES).rev() {
        let known: Complex<f64> = (at + 1..STATES).map(|other| left[at][other] * right[other]).sum();
        right[at] = (right[at] - known) / left[at][at];
    }
    // The solution holds before the step.
    right.map(|value| value * z)
}
