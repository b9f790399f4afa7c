//! The dependence of a level on speed and force: a straight line over their logarithms.

/// A level at a motion.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LevelAt {
    /// Tangential speed, mm/s, above zero.
    pub speed_mm_s: f64,
    /// Normal force, N, above zero.
    pub force_n: f64,
    /// The level, dB.
    pub level_db: f64,
    /// Weight, above zero, such as a duration.
    pub weight: f64,
}

/// A level as a linear function of the logarithms of speed and force. The amplitude is then a product of powers of
/// both.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MotionLaw {
    /// Means of the natural logarithms of speed, mm/s, and force, N.
    centre: [f64; 2],
    /// Level at the centre, dB.
    level_db: f64,
    /// Slopes, dB per unit of the natural logarithms of speed and force.
    slopes_db: [f64; 2],
}

/// Ridge regularisation, as a fraction of the sum of both variances. It keeps the slopes finite if speed and force vary
/// together.
const RIDGE: f64 = 1e-6;

/// Variance of a logarithm below which a quantity counts as unchanged.
const UNCHANGED: f64 = 1e-4;

impl MotionLaw {
    /// Returns the law with the least weighted squared error; `None` without levels. A speed or force that never
    /// changed has a slope of zero.
    pub fn of(levels: &[LevelAt]) -> Option<Self> {
        let weight: f64 = levels.iter().map(|at| at.weight).sum();
        if weight <= 0.0 {
            return None;
        }
        let mean =
            |value: &dyn Fn(&LevelAt) -> f64| levels.iter().map(|at| at.weight * value(at)).sum::<f64>() / weight;
        let centre = [mean(&|at| at.speed_mm_s.ln()), mean(&|at| at.force_n.ln())];
        let level_db = mean(&|at| at.level_db);
        let off = |at: &LevelAt| logarithms(at.speed_mm_s, at.force_n, centre);
        let covariance = |a: usize, b: usize| mean(&|at| off(at)[a] * off(at)[b]);
        let with_level = |a: usize| mean(&|at| off(at)[a] * (at.level_db - level_db));
        let (speed, force, both) = (covariance(0, 0), covariance(1, 1), covariance(0, 1));
        let ridge = RIDGE * (speed + force);
        let slopes_db = match (speed > UNCHANGED, force > UNCHANGED) {
            (false, false) => [0.0; 2],
            (true, false) => [with_level(0) / speed, 0.0],
            (false, true) => [0.0, with_level(1) / force],
            (true, true) => {
                let (speed, force) = (speed + ridge, force + ridge);
                let determinant = speed * force - both * both;
                [
                    (with_level(0) * force - with_level(1) * both) / determinant,
                    (with_level(1) * speed - with_level(0) * both) / determinant,
                ]
            }
        };
        Some(Self {
            centre,
            level_db,
            slopes_db,
        })
    }

    /// Returns the level, dB, at a speed, mm/s, and a force, N, both above zero.
    pub fn level_db(&self, speed_mm_s: f64, force_n: f64) -> f64 {
        let off = logarithms(speed_mm_s, force_n, self.centre);
        self.level_db + self.slopes_db[0] * off[0] + self.slopes_db[1] * off[1]
    }
}

/// Returns the natural logarithms of a speed and a force, less those of the centre.
fn logarithms(speed_mm_s: f64, force_n: f64, centre: [f64; 2]) -> [f64; 2] {
    [speed_mm_s.ln() - centre[0], force_n.ln() - centre[1]]
}

#[cfg(test)]
mod tests {
    use super::*;
    use test_helpers::near;

    /// Levels of the law 3 + 4 ln v + 2 ln F, with different weights, which must not change the result.
    fn levels(motions: &[(f64, f64)]) -> Vec<LevelAt> {
        let at = |(index, &(speed_mm_s, force_n)): (usize, &(f64, f64))| LevelAt {
            speed_mm_s,
            force_n,
            level_db: 3.0 + 4.0 * speed_mm_s.ln() + 2.0 * force_n.ln(),
            weight: 1.0 + index as f64,
        };
        motions.iter().enumerate().map(at).collect()
    }

    #[test]
    fn a_law_is_found_and_holds_beyond_its_levels() {
        let law = MotionLaw::of(&levels(&[(20.0, 0.5), (100.0, 0.7), (60.0, 2.0)])).unwrap();
        let expected = 3.0 + 4.0 * 200f64.ln() + 2.0 * 4f64.ln();
        near(law.level_db(200.0, 4.0), expected, 0.01);
    }

    #[test]
    fn what_never_changed_has_no_slope() {
        let law = MotionLaw::of(&levels(&[(20.0, 0.5), (100.0, 0.5)])).unwrap();
        assert_eq!(law.level_db(50.0, 0.5), law.level_db(50.0, 3.0));
        let law = MotionLaw::of(&levels(&[(20.0, 0.5)])).unwrap();
        assert_eq!(law.level_db(50.0, 1.0), law.level_db(20.0, 0.5));
        assert_eq!(MotionLaw::of(&[]), None);
    }
}
