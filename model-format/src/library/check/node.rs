//! The nodes of a texture: their records and coefficients, and what the texture's summary says of all.

use crate::error::{DecodeError, Place, Problem};
use crate::library::node::NodeFlags;
use crate::library::part::{levels, tails};
use crate::library::texture::Texture;
use crate::limits::{self, STEP_BYTES};
use crate::wire::{NodeRecord, Summary};

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
            },
            last_fine_stage_is_used: false,
        }
    }

    /// The texture, and its index.
    pub const fn texture(&self) -> (Texture<'a>, usize) {
        (self.texture, self.index)
    }

    /// Checks some nodes; returns true after the last one.
    pub fn step(&mut self) -> Result<bool, DecodeError> {
        let records = self.texture.nodes.as_chunks::<{ NodeRecord::BYTES }>().0;
        let mut taken = 0;
        while taken < STEP_BYTES {
            let Some(record) = records.get(self.number) else {
                return self.end().map(|()| true);
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
        Ok(false)
    }

    /// Checks what holds of all nodes together.
    fn end(&self) -> Result<(), DecodeError> {
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
        Ok(())
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
        self.summary = self.summary.with_node(record.order, record.output_power);
        self.last_fine_stage_is_used |= self.check_stages(order, bytes)?;
        Ok(end)
    }

    /// Checks the stages of the next node, and returns whether the last fine one is used.
    fn check_stages(&self, order: usize, bytes: &[u8]) -> Result<bool, Problem> {
        let (codes, tail) = self.texture.lattice_codes(self.number, order, bytes);
        tails::check(tail)?;
        // ±2¹⁵ would be ±π/2.
        let full = |&code: &[u8; 2]| i16::from_le_bytes(code) == i16::MIN;
        if let Some(index) = codes.iter().position(full) {
            return Err(Problem::ReflectionCoefficient { stage: index + 1 });
        }
        let nodes = self.texture.nodes.len() / NodeRecord::BYTES;
        match self.texture.parts.fine_theta {
            Some(part) => part.check_node(self.number, nodes, order),
            None => Ok(false),
        }
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
    levels::check_node(texture.level_law(), record)?;
    Ok(())
}
