//! Line spectral frequencies: the angles at which P(z) = A(z) + z⁻⁽ⁿ⁺¹⁾A(1/z) and Q(z) = A(z) - z⁻⁽ⁿ⁺¹⁾A(1/z) are zero
//! (Itakura, J. Acoust. Soc. Am. 57, 1975, S35), by a method that finds all of them at any order.
//!
//! On the unit circle z⁻⁽ⁿ⁺¹⁾A(1/z)/A(z) has magnitude one and phase -φ, with φ(ω) = (n + 1)ω + 2 arg A(ω), which rises
//! from 0 to (n + 1)π. Frequency i is the ω at which φ = iπ. The argument of A needs no unwrapping, because each step
//! of the order recursion turns it by less than a right angle.

use std::f64::consts::PI;

use crate::dsp::log_spectrum::LogSpectrum;

/// Number of steps of the coarse search.
const COARSE: usize = 1024;

/// Largest number of refinements of a frequency. On average each at least halves the interval.
const REFINEMENTS: usize = 60;

/// Tolerance of φ, rad.
const TOLERANCE_RAD: f64 = 1e-9;

/// Returns φ at the angle `omega`; both in rad.
fn phase(reflection: &[f64], omega: f64) -> f64 {
    let (sin, cos) = omega.sin_cos();
    // A of order m at ω, and e^(-jmω).
    let (mut re, mut im) = (1.0, 0.0);
    let (mut turn_re, mut turn_im) = (1.0, 0.0);
    let mut turns = 0.0;
    for &k in reflection {
        (turn_re, turn_im) = (turn_re * cos + turn_im * sin, turn_im * cos - turn_re * sin);
        // A(m) = A(m-1) + k e^(-jmω) A*(m-1)
        let next_re: f64 = re + k * (turn_re * re + turn_im * im);
        let next_im: f64 = im + k * (turn_im * re - turn_re * im);
        if (next_im < 0.0) != (im < 0.0) && re < 0.0 {
            turns += if im < 0.0 { -1.0 } else { 1.0 };
        }
        (re, im) = (next_re, next_im);
    }
    (reflection.len() + 1) as f64 * omega + 2.0 * (im.atan2(re) + 2.0 * PI * turns)
}

/// Returns the line spectral frequencies of a stable model, in rad, ascending, as many as its order.
pub fn frequencies(reflection: &[f64]) -> Vec<f64> {
    let grid: Vec<f64> = (0..=COARSE)
        .map(|step| PI * step as f64 / COARSE as f64)
        .collect();
    let phases: Vec<f64> = grid.iter().map(|&omega| phase(reflection, omega)).collect();
    let mut cell = 0;
    (1..=reflection.len())
        .map(|index| {
            let wanted = PI * index as f64;
            while cell + 1 < COARSE && phases[cell + 1] < wanted {
                cell += 1;
            }
            let ends = (grid[cell], phases[cell] - wanted);
            root(
                reflection,
                wanted,
                ends,
                (grid[cell + 1], phases[cell + 1] - wanted),
            )
        })
        .collect()
}

/// Returns the angle at which φ is `wanted`, in rad, by the Illinois method, which keeps the root bracketed. `low` and
/// `high` are an angle each with the excess of φ over `wanted` there.
fn root(reflection: &[f64], wanted: f64, mut low: (f64, f64), mut high: (f64, f64)) -> f64 {
    let mut last_side = 0;
    for count in 0..REFINEMENTS {
        let secant = (low.0 * high.1 - high.0 * low.1) / (high.1 - low.1);
        let inside = secant > low.0 && secant < high.0;
        let middle = if inside && count % 8 != 7 {
            secant
        } else {
            f64::midpoint(low.0, high.0)
        };
        let over = phase(reflection, middle) - wanted;
        if over.abs() < TOLERANCE_RAD || high.0 - low.0 < 1e-14 {
            return middle;
        }
        let side = if over < 0.0 { -1 } else { 1 };
        if over < 0.0 {
            low = (middle, over);
            if side == last_side {
                high.1 *= 0.5;
            }
        } else {
            high = (middle, over);
            if side == last_side {
                low.1 *= 0.5;
            }
        }
        last_side = side;
    }
    f64::midpoint(low.0, high.0)
}

/// Returns ln 1/|A|² at `bins` frequencies, for the model with these line spectral frequencies, in rad, ascending.
///
/// |A|² = (|P|² + |Q|²)/4, with P and Q as the products of their zeros.
pub fn log_spectrum(frequencies: &[f64], bins: usize) -> LogSpectrum {
    let order = frequencies.len();
    let cosines: Vec<f64> = frequencies.iter().map(|omega| omega.cos()).collect();
    let values = (0..bins).map(|bin| {
        let omega = PI * bin as f64 / (bins - 1) as f64;
        let x = omega.cos();
        let p = log_product(x, cosines.iter().step_by(2));
        let q = log_product(x, cosines.iter().skip(1).step_by(2));
        // P and Q have further zeros at z = 1 and z = -1.
        let (p_end, q_end) = if order.is_multiple_of(2) {
            (
                (2.0 * (0.5 * omega).cos()).powi(2),
                (2.0 * (0.5 * omega).sin()).powi(2),
            )
        } else {
            (1.0, (2.0 * omega.sin()).powi(2))
        };
        let largest = p.max(q);
        let sum = p_end * (p - largest).exp() + q_end * (q - largest).exp();
        -(largest + (0.25 * sum).max(f64::MIN_POSITIVE).ln())
    });
    LogSpectrum::from_values(values.collect())
}

/// Returns ln Π 4(x - c)² over all `cosines` c.
fn log_product<'a>(x: f64, cosines: impl Iterator<Item = &'a f64>) -> f64 {
    let (mut product, mut log) = (1.0f64, 0.0);
    for cosine in cosines {
        product *= 2.0 * (x - cosine);
        // A logarithm is needed only when the product approaches underflow or overflow.
        if !(1e-100..1e100).contains(&product.abs()) {
            log += product.abs().max(f64::MIN_POSITIVE).ln();
            product = 1.0;
        }
    }
    2.0 * (log + product.abs().max(f64::MIN_POSITIVE).ln())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dsp::linear_prediction::step_down;
    use proptest::prelude::*;

    /// The spectrum package's `poly2lsf`.
    #[test]
    fn a_published_case_comes_out_to_its_digits() {
        let reflection = step_down(&[0.6149, 0.9899, 0.0, 0.0031, -0.0082]).unwrap();
        let expected = [0.7842, 1.5605, 1.8776, 1.8984, 2.3593];
        for (got, want) in frequencies(&reflection).iter().zip(expected) {
            assert!((got - want).abs() < 5e-5, "{got} for {want}");
        }
    }

    proptest! {
        #[test]
        fn they_ascend_strictly_and_give_the_model_back(reflection in prop::collection::vec(-0.5f64..0.5, 1..24)) {
            let lines = frequencies(&reflection);
            prop_assert_eq!(lines.len(), reflection.len());
            prop_assert!(lines[0] > 0.0 && lines[lines.len() - 1] < PI);
            prop_assert!(lines.windows(2).all(|pair| pair[0] < pair[1]));
            let back = log_spectrum(&lines, crate::dsp::log_spectrum::BINS);
            let direct = LogSpectrum::of_model(&crate::dsp::model::Model {
                output_power: 1.0 / crate::dsp::linear_prediction::error_share(&reflection),
                reflection,
                flags: model_format::NodeFlags::NONE,
            });
            for (a, b) in back.values().iter().zip(direct.values()) {
                prop_assert!((a - b).abs() < 1e-5, "{} {}", a, b);
            }
        }
    }

    #[test]
    fn every_one_of_four_hundred_is_found() {
        let reflection: Vec<f64> = (1..=400u32)
            .map(|m| 0.97 * f64::from(m * m % 37).cos() / f64::from(m).sqrt())
            .collect();
        let lines = frequencies(&reflection);
        assert!(lines.windows(2).all(|pair| pair[0] < pair[1]));
        for (index, omega) in lines.iter().enumerate() {
            let over = phase(&reflection, *omega) - PI * (index + 1) as f64;
            assert!(over.abs() < 1e-6, "{index}: {over}");
        }
    }
}
