//! The nodes of a texture: their records and coefficients, and what the texture's summary says of all.

use crate::error::{DecodeError, Place, Problem};
use crate::library::node::{NodeFlags, theta};
use crate::library::part::{levels, tails};
use crate::library::texture::Texture;
use crate::limits::{self, STEP_BYTES};
use crate::wire::{NodeRecord, Structure, Summary};

/// The check of all nodes of a texture whose header was found valid, in steps.
#[derive(Clone, Debug)]
pub(in crate::library) struct NodesCheck<'a> {
    texture: Texture<'a>,
    index: usize,
    /// Number of the next node, speed-major.
    number: usize,
    /// Byte at which its coefficients are due.
    begin: usize,
    summary: Summary,
    largest_theta: u32,
    last_fine_stage_is_used: bool,
}

/// The facts of a node's coefficients.
#[derive(Default)]
struct Found {
    needed_exponent: u8,
    largest_theta: u32,
    last_fine_stage_is_used: bool,
}

impl<'a> NodesCheck<'a> {
    /// The check of the nodes of texture number `index`.
    pub const fn new(texture: Texture<'a>, index: usize) -> Self {
        Self {
            texture,
            index,
            number: 0,
            begin: 0,
            summary: Summary {
                highest_order: 0,
                highest_output_power: 0.0,
                common_exponent: 0,
            },
            largest_theta: 0,
            last_fine_stage_is_used: false,
        }
    }

    /// The texture, and its index.
    pub const fn texture(&self) -> (Texture<'a>, usize) {
        (self.texture, self.index)
    }

    /// Checks some nodes; after the last one, returns the largest |θ| of all, which is 0 for a direct form.
    pub fn step(&mut self) -> Result<Option<u32>, DecodeError> {
        let records = self.texture.nodes.as_chunks::<{ NodeRecord::BYTES }>().0;
        let mut taken = 0;
        while taken < STEP_BYTES {
            let Some(record) = records.get(self.number) else {
                return self.end().map(Some);
            };
            let record = NodeRecord::read(record);
            let end = self.check_node(&record).map_err(|problem| {
                let forces = self.texture.force_axis.len();
                problem.at(Place::Node {
                    texture: self.index,
                    speed: self.number / forces,
                    force: self.number % forces,
                })
            })?;
            taken += NodeRecord::BYTES + (end - self.begin);
            self.begin = end;
            self.number += 1;
        }
        Ok(None)
    }

    /// Checks what holds of all nodes together.
    fn end(&self) -> Result<u32, DecodeError> {
        let here = |problem: Problem| Err(problem.at(Place::Texture(self.index)));
        let (found, expected) = (self.texture.coefficients.len(), self.begin);
        if found != expected {
            return here(Problem::CoefficientLength { found, expected });
        }
        if self.texture.parts.fine_theta.is_some() && !self.last_fine_stage_is_used {
            let stage = self.texture.fine_stages();
            return here(Problem::FineStageUnused { stage });
        }
        if self.texture.has_tails()
            && usize::from(self.summary.highest_order) <= limits::MAX_FINE_STAGES
        {
            return here(Problem::NoTail);
        }
        let (stored, found) = (self.texture.summary, self.summary);
        if stored.highest_order != found.highest_order {
            let (stored, found) = (stored.highest_order, found.highest_order);
            return here(Problem::HighestOrder { stored, found });
        }
        if stored.highest_output_power.to_bits() != found.highest_output_power.to_bits() {
            let (stored, found) = (stored.highest_output_power, found.highest_output_power);
            return here(Problem::HighestPower { stored, found });
        }
        if stored.common_exponent != found.common_exponent {
            let (stored, found) = (stored.common_exponent, found.common_exponent);
            return here(Problem::CommonExponent { stored, found });
        }
        Ok(self.largest_theta)
    }

    /// Checks the next node, and returns the byte at which its coefficients end.
    fn check_node(&mut self, record: &NodeRecord) -> Result<usize, Problem> {
        let texture = &self.texture;
        check_record(texture, self.number, record)?;
        if record.offset as usize != self.begin {
            return Err(Problem::Offset {
                found: record.offset,
                expected: self.begin,
            });
        }
        let order = usize::from(record.order);
        let end = self.begin + texture.bytes_of_order(order);
        let Some(bytes) = texture.coefficients.get(self.begin..end) else {
            return Err(Problem::CoefficientLength {
                found: texture.coefficients.len(),
                expected: end,
            });
        };
        let found = match texture.structure {
            Structure::NormalisedLattice => self.check_lattice(order, bytes)?,
            Structure::DirectForm16 => check_direct16(record.exponent, bytes.as_chunks().0)?,
            Structure::DirectForm32 => check_direct32(record.exponent, bytes.as_chunks().0)?,
        };
        let (power, exponent) = (record.output_power, found.needed_exponent);
        self.summary = self.summary.with_node(record.order, power, exponent);
        self.largest_theta = self.largest_theta.max(found.largest_theta);
        self.last_fine_stage_is_used |= found.last_fine_stage_is_used;
        Ok(end)
    }

    fn check_lattice(&self, order: usize, bytes: &'a [u8]) -> Result<Found, Problem> {
        let (codes, tail) = self.texture.lattice_codes(self.number, order, bytes);
        let in_tail = tails::check(tail)?;
        let found = self.check_first_stages(order, codes)?;
        Ok(Found {
            largest_theta: found.largest_theta.max(in_tail),
            ..found
        })
    }

    /// Checks the stages of a lattice that have codes of 16 bits, with their fractions.
    fn check_first_stages(&self, order: usize, codes: &[[u8; 2]]) -> Result<Found, Problem> {
        let mut largest_code = 0;
        for &code in codes {
            largest_code = i16::from_le_bytes(code).unsigned_abs().max(largest_code);
        }
        if largest_code == i16::MIN.unsigned_abs() {
            let full = |&code: &[u8; 2]| i16::from_le_bytes(code) == i16::MIN;
            let index = codes.iter().position(full).unwrap_or(0);
            return Err(Problem::ReflectionCoefficient { stage: index + 1 });
        }
        let largest_theta = u32::from(largest_code) << crate::THETA_FRACTION_BITS;
        let Some(part) = self.texture.parts.fine_theta else {
            return Ok(Found {
                largest_theta,
                ..Found::default()
            });
        };
        let nodes = self.texture.nodes.len() / NodeRecord::BYTES;
        let last_fine_stage_is_used = part.check_node(self.number, nodes, order)?;
        let fractions = part.of_node(self.number, nodes, order);
        let mut largest_theta = 0;
        let mut largest_code = 0;
        for (&code, &fraction) in codes.iter().zip(fractions) {
            let theta = theta(i16::from_le_bytes(code), fraction.cast_signed());
            largest_theta = theta.unsigned_abs().max(largest_theta);
        }
        for &code in &codes[fractions.len()..] {
            largest_code = i16::from_le_bytes(code).unsigned_abs().max(largest_code);
        }
        let without_fraction = u32::from(largest_code) << crate::THETA_FRACTION_BITS;
        Ok(Found {
            largest_theta: largest_theta.max(without_fraction),
            last_fine_stage_is_used,
            ..Found::default()
        })
    }
}

/// Checks all of node `number` that does not concern its coefficients.
fn check_record(texture: &Texture<'_>, number: usize, record: &NodeRecord) -> Result<(), Problem> {
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
        // As integers, the bits of a negative number, of -0.0, of an infinity and of a NaN are all larger. A -0.0 is
        // refused because it would be a second way to write silence.
        if value.to_bits() > limits::MAX_OUTPUT_POWER.to_bits() {
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
    if !silent {
        let forces = texture.force_axis.len();
        let (speed, force) = (number / forces, number % forces);
        if texture.speed_axis.value(speed) <= 0.0 || texture.force_axis.value(force) <= 0.0 {
            return Err(Problem::NotSilentAtZero);
        }
    }
    levels::check_node(texture.level_law(), texture.structure, record)?;
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
    Ok(())
}

fn check_direct16(exponent: u8, codes: &[[u8; 2]]) -> Result<Found, Problem> {
    let mut sum = 0;
    for &code in codes {
        // At most 400 times 2¹⁵.
        sum += u32::from(i16::from_le_bytes(code).unsigned_abs());
    }
    let sum = u64::from(sum);
    check_sum(sum << exponent, 15)?;
    Ok(Found {
        needed_exponent: Summary::exponent_of(exponent, sum << 16),
        ..Found::default()
    })
}

fn check_direct32(exponent: u8, codes: &[[u8; 4]]) -> Result<Found, Problem> {
    let mut sum = 0;
    for &code in codes {
        sum += u64::from(i32::from_le_bytes(code).unsigned_abs());
    }
    // The bound keeps the 64-bit sum of products from overflowing, whatever the history.
    if sum >= limits::CODE_SUM_LIMIT {
        return Err(Problem::CoefficientSum);
    }
    check_sum(sum << exponent, 31)?;
    Ok(Found {
        needed_exponent: Summary::exponent_of(exponent, sum),
        ..Found::default()
    })
}

/// Checks Σ|h|, given in steps of 2^-`fraction_bits`.
fn check_sum(sum: u64, fraction_bits: u32) -> Result<(), Problem> {
    if sum > limits::MAX_COEFFICIENT_SUM << fraction_bits {
        Err(Problem::CoefficientSum)
    } else {
        Ok(())
    }
}
