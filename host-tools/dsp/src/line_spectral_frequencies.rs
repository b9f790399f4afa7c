//! Line spectral frequencies: the angles at which P(z) = A(z) + z⁻⁽ⁿ⁺¹⁾A(1/z) and Q(z) = A(z) - z⁻⁽ⁿ⁺¹⁾A(1/z) are zero
//! (Itakura, J. Acoust. Soc. Am. 57, 1975, S35), by a method that finds all of them at any order.
//!
//! On the unit circle z⁻⁽ⁿ⁺¹⁾A(1/z)/A(z) has magnitude one and phase -φ, with φ(ω) = (n + 1)ω + 2 arg A(ω), which rises
//! from 0 to (n + 1)π. Frequency i is the ω at which φ = iπ. The argument of A needs no unwrapping, because each step
//! of the order recursion turns it by less than a right angle.

use std::f64::consts::PI;

use crate::log_spectrum::LogSpectrum;

/// Number of steps of the coarse search.
const COARSE: usize = 1024;

/// Largest number of refinements of a frequency. On average, each refinement at least halves the interval.
const REFINEMENTS: usize = 60;

/// Tolerance of φ, rad.
const TOLERANCE_RAD: f64 = 1e-9;

/// Number of angles at which φ is computed together, because each step of the recursion waits for the one before.
const LANES: usize = 4;

/// Returns φ at the angles `omegas`; all in rad.
fn phases(reflection: &[f64], omegas: [f64; LANES]) -> [f64; LANES] {
    let (sin, cos) = (omegas.map(f64::sin), omegas.map(f64::cos));
    // A of order m at ω, and e^(-jmω).
    let (mut re, mut im) = ([1.0; LANES], [0.0; LANES]);
    let (mut turn_re, mut turn_im) = ([1.0; LANES], [0.0; LANES]);
    let mut turns = [0.0; LANES];
    for &k in reflection {
        for lane in 0..LANES {
            let (turned_re, turned_im) = (turn_re[lane], turn_im[lane]);
            let turned: (f64, f64) = (
                turned_re * cos[lane] + turned_im * sin[lane],
                turned_im * cos[lane] - turned_re * sin[lane],
            );
            (turn_re[lane], turn_im[lane]) = turned;
            let (last_re, last_im): (f64, f64) = (re[lane], im[lane]);
            // A(m) = A(m-1) + k e^(-jmω) A*(m-1)
            re[lane] = last_re + k * (turned.0 * last_re + turned.1 * last_im);
            im[lane] = last_im + k * (turned.1 * last_re - turned.0 * last_im);
            // A turns by less than a right angle per step, so it crosses the branch cut of `atan2` exactly if its
            // imaginary part changes its sign and its real part was negative.
            let crosses = (im[lane] < 0.0) != (last_im < 0.0) && last_re < 0.0;
            let turn = if last_im < 0.0 { -1.0 } else { 1.0 };
            turns[lane] += if crosses { turn } else { 0.0 };
        }
    }
    let order = reflection.len();
    std::array::from_fn(|lane| {
        let argument = im[lane].atan2(re[lane]) + 2.0 * PI * turns[lane];
        (order + 1) as f64 * omegas[lane] + 2.0 * argument
    })
}

/// Returns the line spectral frequencies of a stable model, in rad, ascending, as many as its order.
pub fn frequencies(reflection: &[f64]) -> Vec<f64> {
    let grid: Vec<f64> = (0..=COARSE).map(|step| PI * step as f64 / COARSE as f64).collect();
    let grid_phases: Vec<f64> = grid
        .chunks(LANES)
        .flat_map(|omegas| {
            let lanes = std::array::from_fn(|lane| omegas[lane.min(omegas.len() - 1)]);
            phases(reflection, lanes).into_iter().take(omegas.len())
        })
        .collect();
    let mut cell = 0;
    let mut waiting = (1..=reflection.len()).map(|index| {
        let wanted = PI * index as f64;
        // φ rises, so no later frequency lies in an earlier cell.
        while cell + 1 < COARSE && grid_phases[cell + 1] < wanted {
            cell += 1;
        }
        let end = |end: usize| (grid[end], grid_phases[end] - wanted);
        Search {
            index,
            wanted,
            low: end(cell),
            high: end(cell + 1),
            last_side: 0,
            refinements: 0,
        }
    });
    let mut frequencies = vec![0.0; reflection.len()];
    let mut lanes: [Option<Search>; LANES] = std::array::from_fn(|_| waiting.next());
    while lanes.iter().any(Option::is_some) {
        let middles = (lanes.each_ref()).map(|lane| lane.as_ref().map_or(0.0, Search::middle));
        let found = phases(reflection, middles);
        for (lane, (middle, phase)) in lanes.iter_mut().zip(middles.into_iter().zip(found)) {
            let Some(search) = lane else { continue };
            if let Some(frequency) = search.refine(middle, phase) {
                frequencies[search.index - 1] = frequency;
                *lane = waiting.next();
            }
        }
    }
    frequencies
}

/// A search for the angle at which φ is `wanted`, by the Illinois method, which keeps the root bracketed.
struct Search {
    /// Index of the frequency, from 1.
    index: usize,
    /// Value of φ at the angle sought, rad.
    wanted: f64,
    /// An angle below the one sought, rad, with the excess of φ over `wanted`.
    low: (f64, f64),
    /// An angle above the one sought, rad, with the excess of φ over `wanted`.
    high: (f64, f64),
    /// The end that moved last: -1 for the lower one, 1 for the upper one, 0 at the beginning.
    last_side: i32,
    refinements: usize,
}

impl Search {
    /// The angle to try next, rad.
    fn middle(&self) -> f64 {
        let (low, high) = (self.low, self.high);
        let secant = (low.0 * high.1 - high.0 * low.1) / (high.1 - low.1);
        let inside = secant > low.0 && secant < high.0;
        // Every eighth angle bisects, so that the interval also narrows where the secant's one end hardly moves.
        if inside && self.refinements % 8 != 7 {
            secant
        } else {
            f64::midpoint(low.0, high.0)
        }
    }

    /// Narrows the bracket by `phase`, the value of φ at the angle `middle`. Returns the angle when it is found.
    fn refine(&mut self, middle: f64, phase: f64) -> Option<f64> {
        let over = phase - self.wanted;
        if over.abs() < TOLERANCE_RAD || self.high.0 - self.low.0 < 1e-14 {
            return Some(middle);
        }
        let side = if over < 0.0 { -1 } else { 1 };
        let (moved, other) = if over < 0.0 {
            (&mut self.low, &mut self.high)
        } else {
            (&mut self.high, &mut self.low)
        };
        *moved = (middle, over);
        // Illinois: the end that stays counts half. Otherwise a curved φ would leave it where it is.
        if side == self.last_side {
            other.1 *= 0.5;
        }
        self.last_side = side;
        self.refinements += 1;
        (self.refinements == REFINEMENTS).then(|| f64::midpoint(self.low.0, self.high.0))
    }
}

/// Returns ln 1/|A|² at `bins` frequencies, for the model with these line spectral frequencies, in rad, ascending.
///
/// |A|² = (|P|² + |Q|²)/4, with P and Q as the products of their zeros.
pub fn log_spectrum(frequencies: &[f64], bins: usize) -> LogSpectrum {
    let order = frequencies.len();
    let cosines: Vec<f64> = frequencies.iter().map(|omega| omega.cos()).collect();
    let of_p: Vec<f64> = cosines.iter().step_by(2).copied().collect();
    let of_q: Vec<f64> = cosines.iter().skip(1).step_by(2).copied().collect();
    let omega = |bin: usize| PI * bin as f64 / (bins - 1) as f64;
    let products = (0..bins).step_by(LANES).flat_map(|bin| {
        let x = std::array::from_fn(|lane| omega(bin + lane).cos());
        let (p, q) = (log_products(x, &of_p), log_products(x, &of_q));
        p.into_iter().zip(q)
    });
    let values = (0..bins).zip(products).map(|(bin, (p, q))| {
        let omega = omega(bin);
        // P and Q have further zeros at z = 1 and z = -1.
        let (p_end, q_end) = if order.is_multiple_of(2) {
            ((2.0 * (0.5 * omega).cos()).powi(2), (2.0 * (0.5 * omega).sin()).powi(2))
        } else {
            (1.0, (2.0 * omega.sin()).powi(2))
        };
        // The larger product is factored out, so that the exponentials do not overflow or both vanish.
        let largest = p.max(q);
        let sum = p_end * (p - largest).exp() + q_end * (q - largest).exp();
        -(largest + (0.25 * sum).max(f64::MIN_POSITIVE).ln())
    });
    LogSpectrum::from_values(values.collect())
}

/// Returns ln Π 4(x - c)² over all `cosines` c, for each x.
fn log_products(x: [f64; LANES], cosines: &[f64]) -> [f64; LANES] {
    let (mut products, mut logs) = ([1.0f64; LANES], [0.0; LANES]);
    // A logarithm is taken only when the product approaches underflow or overflow.
    let is_sound = |product: f64| (product.abs() >= 1e-100) & (product.abs() < 1e100);
    for cosine in cosines {
        for (product, x) in products.iter_mut().zip(x) {
            *product *= 2.0 * (x - cosine);
        }
        if !products.into_iter().fold(true, |all, product| all & is_sound(product)) {
            for (product, log) in products.iter_mut().zip(&mut logs) {
                if !is_sound(*product) {
                    *log += product.abs().max(f64::MIN_POSITIVE).ln();
                    *product = 1.0;
                }
            }
        }
    }
    std::array::from_fn(|lane| 2.0 * (logs[lane] + products[lane].abs().max(f64::MIN_POSITIVE).ln()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::linear_prediction::step_down;
    use proptest::prelude::*;
    use test_helpers::near;

    /// Reference: `poly2lsf` of the spectrum package.
    #[test]
    fn a_published_case_comes_out_to_its_digits() {
        let reflection = step_down(&[0.6149, 0.9899, 0.0, 0.0031, -0.0082]).unwrap();
        let expected = [0.7842, 1.5605, 1.8776, 1.8984, 2.3593];
        for (got, want) in frequencies(&reflection).iter().zip(expected) {
            near(*got, want, 5e-5);
        }
    }

    proptest! {
        #[test]
        fn they_ascend_strictly_and_give_the_model_back(reflection in prop::collection::vec(-0.5f64..0.5, 1..24)) {
            let lines = frequencies(&reflection);
            prop_assert_eq!(lines.len(), reflection.len());
            prop_assert!(lines[0] > 0.0 && lines[lines.len() - 1] < PI);
            prop_assert!(lines.windows(2).all(|pair| pair[0] < pair[1]));
            let bins = crate::log_spectrum::BINS;
            let back = log_spectrum(&lines, bins);
            let power = 1.0 / crate::linear_prediction::error_share(&reflection);
            let direct = LogSpectrum::of_model_at(&crate::model::Model::new(reflection, power), bins);
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
            let over = phases(&reflection, [*omega; LANES])[0] - PI * (index + 1) as f64;
            assert!(over.abs() < 1e-6, "{index}: {over}");
        }
    }
}
