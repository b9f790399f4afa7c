//! A proof on a cell's edges, in float64: the tests' second opinion on the product's proof.
//!
//! 1. On no edge of the cell (four sides, two diagonals) does A have a zero on the unit circle: for no frequency is 0
//!    on the segment from A(j) to A(k) in the complex plane, which is the segment lemma's condition that A(j)/A(k) is
//!    never real and negative. This is shown for whole intervals of frequency, not at samples: in an interval every
//!    A(k) stays in a disc about its value in the middle, whose radius follows from three derivatives there and a bound
//!    on the fourth, and the segments are farther from 0 than those discs reach. Intervals are halved until they are.
//! 2. The first node's A turns around 0 no time while the frequency goes around the circle, so that 1/A is stable
//!    there.
//! 3. Then 1/A is stable at every point. For A's values at one frequency fill at most the convex hull of the four A(k),
//!    whose border is made of edges. At 0 Hz the hull is a real interval whose ends are on edges, so 0 is outside; as
//!    the frequency goes on 0 would have to cross an edge to come in. No zero ever reaches the circle, and none is
//!    outside it at the first node. (This is the edge theorem of Bartlett, Hollot and Lin, 1988, for this case.)

use realfft::num_complex::Complex;

use super::circle::{Circle, Disc};

/// Half width at which an interval is not halved any more, rad: 1 nHz at 5 kHz.
const LEAST_HALF_WIDTH: f64 = 1e-12;

/// Most halvings for one cell. Cells that can be proved need a few thousand.
const MOST_HALVINGS: usize = 200_000;

/// Proves that no weighted mean of one to four polynomials has a zero on or outside the unit circle, and gives a lower
/// bound of |A| on the circle, at least half of the exact minimum, though every mean may be off by `rounding` in |A|.
///
/// # Errors
/// The frequency, rad, at which the proof came to its end: a mean with a zero on the circle, or one too near to tell;
/// or 0 where none has, but the first polynomial has zeros outside the circle.
pub(super) fn prove(corners: &[&Circle], rounding: f64) -> Result<f64, f64> {
    let mut proof = Proof {
        corners,
        rounding,
        halvings: 0,
        margin: f64::INFINITY,
        turned: 0.0,
        last: None,
    };
    let first = corners[0];
    for index in 0..first.len() {
        let discs = discs(corners, |circle| circle.disc_of(index));
        let (middle, half_width) = first.interval(index);
        proof.interval(&discs, middle, half_width)?;
    }
    // From 0 Hz to half the rate A goes from a real value to a real value, half a turn for each zero outside. The first
    // and the last value seen are within 30° of those.
    if proof.turned.abs() < std::f64::consts::FRAC_PI_2 {
        Ok(proof.margin)
    } else {
        Err(0.0)
    }
}

/// The discs of the corners; where there are fewer than four the last stands for the rest.
fn discs(corners: &[&Circle], disc: impl Fn(&Circle) -> Disc) -> [Disc; 4] {
    let mut discs = [disc(corners[0]); 4];
    for index in 1..4 {
        discs[index] = match corners.get(index) {
            Some(corner) => disc(corner),
            None => discs[index - 1],
        };
    }
    discs
}

struct Proof<'a> {
    corners: &'a [&'a Circle],
    rounding: f64,
    halvings: usize,
    margin: f64,
    /// Angle that the first corner's value has turned around 0 so far, rad.
    turned: f64,
    last: Option<Complex<f64>>,
}

impl Proof<'_> {
    /// Shows that 0 is on no edge in an interval, or in both of its halves.
    fn interval(&mut self, discs: &[Disc; 4], middle: f64, half_width: f64) -> Result<(), f64> {
        if let Some(margin) = least_distance(discs, self.rounding) {
            self.margin = self.margin.min(margin);
            // The first and the last interval reach beyond the half circle: their parts out there do not count.
            if middle + half_width >= 0.0 && middle - half_width <= std::f64::consts::PI {
                self.turn_to(discs[0].centre);
            }
            return Ok(());
        }
        self.halvings += 1;
        if self.halvings > MOST_HALVINGS || half_width < LEAST_HALF_WIDTH {
            return Err(middle);
        }
        // A little more than a half, so that rounding leaves no gap.
        let half = half_width / 2.0;
        for middle in [middle - half, middle + half] {
            let half_width = half * (1.0 + 1e-9);
            let corners = self.corners;
            let discs = self::discs(corners, |circle| circle.disc_at(middle, half_width));
            self.interval(&discs, middle, half_width)?;
        }
        Ok(())
    }

    /// Adds the angle from the last value to this one. Both see their discs within 30°, and neighbouring discs share a
    /// value, so that the angle is below 60° and never in doubt.
    fn turn_to(&mut self, value: Complex<f64>) {
        if let Some(last) = self.last {
            self.turned += (value * last.conj()).arg();
        }
        self.last = Some(value);
    }
}

/// The least distance of 0 from the six edges for all values of their ends in their discs, if 0 is at least twice as
/// far from each edge's middle line as its ends may be off, and more than `rounding` beyond.
fn least_distance(discs: &[Disc; 4], rounding: f64) -> Option<f64> {
    let mut least = f64::INFINITY;
    for (index, a) in discs.iter().enumerate() {
        for b in &discs[index + 1..] {
            let (distance, off) = (distance(a.centre, b.centre), a.radius.max(b.radius));
            let distance = distance - rounding;
            // Every point of the segment moves by no more than its ends do.
            if distance < 2.0 * off || !distance.is_finite() {
                return None;
            }
            least = least.min(distance - off);
        }
    }
    Some(least)
}

/// Distance of 0 from the segment between two points.
fn distance(a: Complex<f64>, b: Complex<f64>) -> f64 {
    let along = b - a;
    let length = along.norm_sqr();
    let share = if length > 0.0 {
        (-(a * along.conj()).re / length).clamp(0.0, 1.0)
    } else {
        0.0
    };
    (a + along * share).norm()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dsp::linear_prediction::{step_down, step_up};
    use proptest::prelude::*;

    fn circles(tails: &[Vec<f64>]) -> Vec<Circle> {
        let order = tails.iter().map(Vec::len).max().unwrap_or(0);
        let padded = |tail: &Vec<f64>| {
            let mut polynomial = vec![1.0];
            polynomial.extend(tail);
            polynomial.resize(order + 1, 0.0);
            Circle::new(&polynomial)
        };
        tails.iter().map(padded).collect()
    }

    fn proved(tails: &[Vec<f64>]) -> Result<f64, f64> {
        prove(&circles(tails).iter().collect::<Vec<_>>(), 0.0)
    }

    /// The means of (1 - 0.9 z⁻¹)³ and (1 + 0.9 z⁻¹)³ have poles of radius up to 1.56.
    #[test]
    fn the_known_pair_of_order_three_is_refused_and_each_alone_is_proved() {
        let (a, b) = (vec![-2.7, 2.43, -0.729], vec![2.7, 2.43, 0.729]);
        assert!(proved(std::slice::from_ref(&a)).unwrap() <= 0.001);
        assert!(proved(std::slice::from_ref(&b)).is_ok());
        let frequency = proved(&[a, b]).unwrap_err();
        // Three times the angle of (1 - 0.9 e^(-jω)) / (1 + 0.9 e^(-jω)) is half a turn: tan 60° = 1.8 sin ω / 0.19.
        let expected = (3f64.sqrt() * 0.19 / 1.8).asin();
        assert!((frequency - expected).abs() < 1e-3, "{frequency}");
    }

    #[test]
    fn an_unstable_polynomial_is_refused_though_it_is_never_zero_on_the_circle() {
        assert_eq!(proved(&[vec![-2.5, 1.0]]), Err(0.0));
        assert_eq!(proved(&[vec![0.0, 4.0]]), Err(0.0));
        assert_eq!(proved(&[vec![1.5]]), Err(0.0));
    }

    #[test]
    fn a_zero_on_the_circle_is_refused_at_its_frequency() {
        let frequency = proved(&[vec![-2.0 * 0.7f64.cos(), 1.0]]).unwrap_err();
        assert!((frequency - 0.7).abs() < 1e-6);
        assert!(proved(&[vec![-1.0]]).unwrap_err().abs() < 1e-6);
    }

    #[test]
    fn a_margin_that_rounding_could_use_up_is_none() {
        let circles = circles(&[vec![-0.999]]);
        let corners: Vec<_> = circles.iter().collect();
        assert!(prove(&corners, 0.9e-3).unwrap() <= 0.1001e-3);
        assert_eq!(
            prove(&corners, 1.1e-3).map_err(|at| at.abs() < 0.01),
            Err(true)
        );
    }

    #[test]
    fn the_margin_is_a_lower_bound_and_at_least_half_of_the_minimum() {
        // |1 - r e^(-jω)| is least at 0 Hz: 1 - r.
        for radius in [0.0, 0.5, 0.99, 0.99999] {
            let margin = proved(&[vec![-radius]]).unwrap();
            assert!(
                margin <= 1.0 - radius && margin >= 0.499 * (1.0 - radius),
                "{margin}"
            );
        }
    }

    /// Steps of a weight from 0 to 1 in the test below.
    const STEPS: u32 = 12;

    /// A shrunk counterexample to a proof that counted a turn from before 0 Hz, on an interval that reaches beyond it.
    #[test]
    fn a_zero_near_the_end_of_the_half_circle_leaves_the_turn_in_no_doubt() {
        let mut k = [0.0; 24];
        (k[13], k[23]) = (-0.959_218_121_307_582_7, -0.589_485_317_860_388_5);
        assert!(proved(&[step_up(&k)]).is_ok());
    }

    fn stable() -> impl Strategy<Value = Vec<f64>> {
        prop::collection::vec(-0.98f64..0.98, 0..8).prop_map(|k| step_up(&k))
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(256))]

        /// Against the step-down recursion on a lattice of weights: what is proved holds everywhere; what is refused
        /// fails somewhere, or nearly.
        #[test]
        fn proofs_hold_at_all_weights_and_refusals_have_their_reason(
            tails in prop::collection::vec(stable(), 1..=4),
        ) {
            let proof = proved(&tails);
            let order = tails.iter().map(Vec::len).max().unwrap_or(0);
            let mut unstable = 0;
            for w0 in 0..=STEPS {
                for w1 in 0..=STEPS - w0 {
                    for w2 in 0..=STEPS - w0 - w1 {
                        let weights = [w0, w1, w2, STEPS - w0 - w1 - w2];
                        let mut mean = vec![0.0; order];
                        for (index, weight) in weights.into_iter().enumerate() {
                            let tail = &tails[index.min(tails.len() - 1)];
                            for (sum, a) in mean.iter_mut().zip(tail) {
                                *sum += a * f64::from(weight) / f64::from(STEPS);
                            }
                        }
                        unstable += usize::from(step_down(&mean).is_none());
                    }
                }
            }
            if proof.is_ok() {
                prop_assert_eq!(unstable, 0);
            }
            if unstable > 0 {
                prop_assert!(proof.is_err());
            }
        }

        /// Zeros may come near the circle: one node by itself is always proved.
        #[test]
        fn every_stable_polynomial_alone_is_proved(k in prop::collection::vec(-0.999f64..0.999, 0..30)) {
            let tail = step_up(&k);
            let margin = proved(&[tail]);
            // |A(m)| is at least 1 - |k| of |A(m-1)| everywhere on the circle.
            let least: f64 = k.iter().map(|k| 1.0 - k.abs()).product();
            prop_assert!(margin.is_ok() || least < 1e-9, "{:?} for {:e}", margin, least);
        }
    }
}
