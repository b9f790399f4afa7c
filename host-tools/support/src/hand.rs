//! Bounds of the motion of a hand or a drum rig, which detect values in wrong units.
//!
//! A hand presses with tens of newtons and moves at a few metres per second; drum rigs turn slower. A value ten times
//! as large must be in another unit, such as grams instead of newtons.

/// Highest speed, mm/s.
pub const MAX_SPEED_MM_S: f64 = 10_000.0;

/// Highest force, N.
pub const MAX_FORCE_N: f64 = 100.0;

/// Returns, in words, what is wrong with a speed, in mm/s, that no hand and no drum reaches. The sign is the direction.
pub fn speed_fault(speed_mm_s: f64) -> Option<String> {
    // NaN is in no range.
    if speed_mm_s.abs() <= MAX_SPEED_MM_S {
        return None;
    }
    Some(format!(
        "a speed of {speed_mm_s} mm/s, and no hand or drum exceeds {MAX_SPEED_MM_S}: give it in mm/s"
    ))
}

/// Returns, in words, what is wrong with a normal force, in N, that no hand and no drum reaches. A negative force means
/// no contact.
pub fn force_fault(force_n: f64) -> Option<String> {
    if force_n.abs() <= MAX_FORCE_N {
        return None;
    }
    Some(format!(
        "a force of {force_n} N, and no hand or drum exceeds {MAX_FORCE_N}: give it in newtons (100 g press with 1 N)"
    ))
}

/// Returns, in words, what is wrong with a position, in mm, that exceeds the range of single precision.
pub fn position_fault(position_mm: f64) -> Option<String> {
    let is_finite = (position_mm as f32).is_finite();
    (!is_finite).then(|| "no path is as long: give it in mm".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_hand_can_do_passes_in_both_directions_and_other_units_do_not() {
        for speed_mm_s in [0.0, -150.0, 5000.0, -MAX_SPEED_MM_S] {
            assert_eq!(speed_fault(speed_mm_s), None);
        }
        for force_n in [0.0, -0.3, 40.0, MAX_FORCE_N] {
            assert_eq!(force_fault(force_n), None);
        }
        for wrong in [1.2e5, -1.2e5, f64::NAN, f64::INFINITY] {
            assert!(speed_fault(wrong).is_some_and(|fault| fault.contains("mm/s")));
            assert!(force_fault(wrong).is_some_and(|fault| fault.contains("newtons")));
        }
    }
}
