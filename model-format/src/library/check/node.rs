//! A node's record and its coefficients.

use crate::error::Problem;
use crate::library::node::{Coefficients, NodeFlags};
use crate::library::texture::Texture;
use crate::limits;
use crate::wire::Structure;

/// Checks one node whose coefficients are due at byte `begin`, and returns the byte at which they end.
pub(super) fn check_node(
    texture: &Texture<'_>,
    speed: usize,
    force: usize,
    begin: usize,
) -> Result<usize, Problem> {
    let record = texture.record(speed, force);
    let order = usize::from(record.order);
    if order > limits::MAX_ORDER {
        return Err(Problem::Order(order));
    }
    let Some(flags) = NodeFlags::from_bits(record.flags) else {
        return Err(Problem::Flags(record.flags));
    };
    for (what, value) in [
        ("output", record.output_power),
        ("prediction error", record.prediction_error_power),
    ] {
        // A NaN is in no range. A -0.0 is refused because it would be a second way to write silence.
        if !(0.0..=limits::MAX_OUTPUT_POWER).contains(&value) || value.is_sign_negative() {
            return Err(Problem::Power { what, value });
        }
    }
    if record.prediction_error_power > record.output_power {
        return Err(Problem::PowerOrder);
    }
    let silent = record.output_power.to_bits() == 0;
    if flags.contains(NodeFlags::SILENT) != silent {
        return Err(Problem::SilentFlag);
    }
    let at_zero = texture.speed_axis.value(speed) <= 0.0 || texture.force_axis.value(force) <= 0.0;
    if at_zero && !silent {
        return Err(Problem::NotSilentAtZero);
    }
    if record.offset as usize != begin {
        return Err(Problem::Offset {
            found: record.offset,
            expected: begin,
        });
    }
    let end = begin + order * texture.structure.coefficient_bytes();
    if end > texture.coefficients.len() {
        return Err(Problem::CoefficientLength {
            found: texture.coefficients.len(),
            expected: end,
        });
    }
    let highest = match texture.structure {
        Structure::NormalisedLattice => 0,
        Structure::DirectForm16 | Structure::DirectForm32 => limits::MAX_EXPONENT,
    };
    if record.exponent > highest {
        return Err(Problem::Exponent {
            exponent: record.exponent,
            structure: texture.structure,
            highest,
        });
    }
    check_coefficients(texture.node(speed, force).coefficients)?;
    Ok(end)
}

fn check_coefficients(coefficients: Coefficients<'_>) -> Result<(), Problem> {
    match coefficients {
        Coefficients::Lattice { codes, .. } => {
            let full = |&code: &[u8; 2]| i16::from_le_bytes(code) == i16::MIN;
            match codes.iter().position(full) {
                Some(index) => Err(Problem::ReflectionCoefficient { stage: index + 1 }),
                None => Ok(()),
            }
        }
        Coefficients::Direct16 { exponent, codes } => {
            let magnitude = |&code: &[u8; 2]| u64::from(i16::from_le_bytes(code).unsigned_abs());
            let sum: u64 = codes.iter().map(magnitude).sum();
            check_sum(sum << exponent, 15)
        }
        Coefficients::Direct32 { exponent, codes } => {
            let magnitude = |&code: &[u8; 4]| u64::from(i32::from_le_bytes(code).unsigned_abs());
            let sum: u64 = codes.iter().map(magnitude).sum();
            // The first bound keeps the 64-bit sum of products from overflowing, whatever the history.
            if sum >= 1 << 32 {
                return Err(Problem::CoefficientSum);
            }
            check_sum(sum << exponent, 31)
        }
    }
}

/// Checks Σ|h|, given in steps of 2^-`fraction_bits`.
fn check_sum(sum: u64, fraction_bits: u32) -> Result<(), Problem> {
    if sum > limits::MAX_COEFFICIENT_SUM << fraction_bits {
        Err(Problem::CoefficientSum)
    } else {
        Ok(())
    }
}
