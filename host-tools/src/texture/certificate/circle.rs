//! The values of a polynomial on the unit circle, with bounds on how far it goes from them in between.

use realfft::num_complex::Complex;

use crate::dsp::with_planner;

/// Most intervals that the half circle is divided into to begin with.
const MOST_INTERVALS: usize = 8192;

/// Share of Σ|a| that a value in float64 may be off by. Sums of 401 terms and transforms of 2¹⁴ points are off by 4e-13 of it
/// at worst.
const ROUNDING: f64 = 1e-12;

/// A value, and how far any value in the interval of frequency around it may be from it.
#[derive(Clone, Copy, Debug)]
pub(super) struct Disc {
    pub centre: Complex<f64>,
    pub radius: f64,
}

/// A(z) = Σ a(i) z⁻ⁱ on the upper half of the unit circle; the lower half mirrors it.
pub(super) struct Circle {
    polynomial: Vec<f64>,
    /// Discs of the intervals about 0, 1, ... times π / (length - 1).
    discs: Vec<Disc>,
    /// Σ i⁴ |a(i)|, which no fourth derivative exceeds.
    fourth: f64,
    rounding: f64,
}

/// Powers of the index that multiply a coefficient: one for each derivative with respect to frequency.
const DERIVATIVES: usize = 3;

impl Circle {
    /// `polynomial` is a(0), a(1) ...; circles that are to be compared have equally many.
    pub fn new(polynomial: &[f64]) -> Self {
        let intervals = (16 * polynomial.len())
            .next_power_of_two()
            .clamp(256, MOST_INTERVALS);
        let weighted = |power: usize| -> Vec<f64> {
            let terms = polynomial.iter().zip(0u32..);
            terms
                .map(|(a, i)| a * f64::from(i).powi(power as i32))
                .collect()
        };
        let magnitude = |terms: Vec<f64>| terms.iter().map(|term| term.abs()).sum::<f64>();
        let mut circle = Self {
            polynomial: polynomial.to_vec(),
            discs: Vec::new(),
            fourth: magnitude(weighted(DERIVATIVES + 1)),
            rounding: ROUNDING * magnitude(weighted(0)),
        };
        let spectra: [_; DERIVATIVES + 1] =
            std::array::from_fn(|power| spectrum(weighted(power), 2 * intervals));
        let half_width = half_width(intervals);
        let values = |bin: usize| std::array::from_fn(|power: usize| spectra[power][bin]);
        circle.discs = (0..=intervals)
            .map(|bin| circle.disc(values(bin), half_width))
            .collect();
        circle
    }

    /// Number of intervals at the beginning. The first and the last reach beyond the half circle, where A mirrors.
    pub fn len(&self) -> usize {
        self.discs.len()
    }

    /// Middle and half width of interval `index`, rad.
    pub fn interval(&self, index: usize) -> (f64, f64) {
        let intervals = self.discs.len() - 1;
        let middle = std::f64::consts::PI * index as f64 / intervals as f64;
        (middle, half_width(intervals))
    }

    /// The disc of interval `index`.
    pub fn disc_of(&self, index: usize) -> Disc {
        self.discs[index]
    }

    /// The disc of an interval of any middle and half width, rad.
    pub fn disc_at(&self, middle: f64, half_width: f64) -> Disc {
        let mut sums = [Complex::new(0.0, 0.0); DERIVATIVES + 1];
        let step = Complex::from_polar(1.0, -middle);
        let mut turned = Complex::new(1.0, 0.0);
        for (a, i) in self.polynomial.iter().zip(0u32..) {
            let mut term = turned * *a;
            for sum in &mut sums {
                *sum += term;
                term *= f64::from(i);
            }
            turned *= step;
        }
        self.disc(sums, half_width)
    }

    /// Taylor's theorem: sums of a(i) iᵖ e^(-jiω) have the magnitude of A's p-th derivative with respect to ω.
    fn disc(&self, sums: [Complex<f64>; DERIVATIVES + 1], half_width: f64) -> Disc {
        let h = half_width;
        let [value, first, second, third] = sums;
        let radius = first.norm() * h
            + second.norm() * h * h / 2.0
            + third.norm() * h.powi(3) / 6.0
            + self.fourth * h.powi(4) / 24.0;
        Disc {
            centre: value,
            // The derivatives' own rounding is within the same share of the radius.
            radius: radius * (1.0 + 1e-6) + self.rounding,
        }
    }
}

/// Half of the width of each of `intervals`, rad.
fn half_width(intervals: usize) -> f64 {
    // A little more, so that rounding leaves no gap between neighbours.
    std::f64::consts::FRAC_PI_2 / intervals as f64 * (1.0 + 1e-9)
}

fn spectrum(mut terms: Vec<f64>, length: usize) -> Vec<Complex<f64>> {
    let forward = with_planner(|planner| planner.plan_fft_forward(length));
    terms.resize(length, 0.0);
    let mut spectrum = forward.make_output_vec();
    forward
        .process(&mut terms, &mut spectrum)
        .expect("lengths come from the plan");
    spectrum
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn exact(polynomial: &[f64], frequency: f64) -> Complex<f64> {
        let terms = polynomial.iter().zip(0u32..);
        terms
            .map(|(a, i)| Complex::from_polar(*a, -frequency * f64::from(i)))
            .sum()
    }

    proptest! {
        #[test]
        fn every_value_of_an_interval_lies_in_its_disc(
            tail in prop::collection::vec(-2.0f64..2.0, 0..60), index in 0usize..8192,
            at in -1.0f64..=1.0, width in prop_oneof![Just(1.0), 1e-6f64..1.0],
        ) {
            let mut polynomial = vec![1.0];
            polynomial.extend(tail);
            let circle = Circle::new(&polynomial);
            let index = index % circle.len();
            let (middle, half_width) = circle.interval(index);
            for disc in [circle.disc_of(index), circle.disc_at(middle, half_width)] {
                let value = exact(&polynomial, middle + at * half_width);
                prop_assert!((value - disc.centre).norm() <= disc.radius);
            }
            let narrow = circle.disc_at(middle, half_width * width);
            let value = exact(&polynomial, middle + at * half_width * width);
            prop_assert!((value - narrow.centre).norm() <= narrow.radius);
        }

        #[test]
        fn intervals_cover_the_half_circle(order in 0usize..=400, share in 0.0f64..=1.0) {
            let circle = Circle::new(&vec![1.0; order + 1]);
            let frequency = share * std::f64::consts::PI;
            let covers = |index| {
                let (middle, half_width) = circle.interval(index);
                (frequency - middle).abs() <= half_width
            };
            prop_assert!((0..circle.len()).any(covers));
        }
    }
}
