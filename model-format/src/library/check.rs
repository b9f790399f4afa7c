//! The checks that a texture of a library must pass, in bounded steps. The header takes one step. Each further step
//! checks some nodes, some amplitudes of lines, or some bytes of codebooks.

use super::node::NodeFlags;
use super::part::excitation::ExcitationCheck;
use super::part::lines::{AMPLITUDE_BYTES, Lines};
use super::part::{levels, tails};
use super::texture::{Axis, Texture};
use crate::error::{DecodeError, Place, Problem};
use crate::limits::{self, MAX_LINE_AMPLITUDE, STEP_BYTES};
use crate::wire::{NodeRecord, Summary};

/// Checks the header of texture number `index` of a library. Its nodes, its lines' amplitudes and its codebooks are
/// checked by the types below.
///
/// # Errors
/// The first fault found, with its place.
pub(super) fn check_header(texture: &Texture<'_>, index: usize) -> Result<(), DecodeError> {
    let here = |problem: Problem| problem.at(Place::Texture(index));
    let lengths = [1, limits::MAX_NAME_BYTES];
    Problem::count("the length of the name in bytes", texture.name.len(), lengths).map_err(here)?;
    if texture.name.chars().any(char::is_control) {
        return Err(here(Problem::Rule("a name with a control character")));
    }
    let (rate, rates) = (texture.sample_rate_hz, [1, limits::MAX_SAMPLE_RATE_HZ]);
    Problem::count("the sample rate in Hz", rate as usize, rates.map(|hz| hz as usize)).map_err(here)?;
    check_axis(texture.speed_axis, Place::SpeedAxis(index))?;
    check_axis(texture.force_axis, Place::ForceAxis(index))?;
    whole_records(texture.nodes, NodeRecord::BYTES).map_err(here)?;
    // A tail may have an odd number of bytes.
    if !texture.has_tails() {
        whole_records(texture.coefficients, 2).map_err(here)?;
    }
    let expected = texture.speed_axis.len() * texture.force_axis.len();
    Problem::same("nodes", texture.nodes.len() / NodeRecord::BYTES, expected).map_err(here)?;
    texture.parts.check(expected).map_err(here)
}

fn check_axis(axis: Axis<'_>, place: Place) -> Result<(), DecodeError> {
    let at = |problem: Problem| problem.at(place);
    whole_records(axis.0, Axis::VALUE_BYTES).map_err(at)?;
    Problem::count("the number of values", axis.len(), [1, limits::MAX_AXIS_LEN]).map_err(at)?;
    let mut before = None;
    for value in axis.values() {
        Problem::within("a value", value, [0.0, f32::MAX]).map_err(at)?;
        if before.is_some_and(|before| value <= before) {
            return Err(at(Problem::Rule("the values do not ascend")));
        }
        before = Some(value);
    }
    Ok(())
}

fn whole_records(bytes: &[u8], record: usize) -> Result<(), Problem> {
    if bytes.len().is_multiple_of(record) {
        Ok(())
    } else {
        Err(Problem::Rule("a string holds no whole number of records"))
    }
}

/// The check of all nodes of a texture whose header was found valid, in steps.
#[derive(Clone, Debug)]
pub(super) struct NodesCheck<'a> {
    texture: Texture<'a>,
    index: usize,
    /// Number of the next node, speed-major.
    number: usize,
    /// Byte at which the next node's coefficients must begin.
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

    /// Checks the rules that concern all nodes together.
    fn end(&self) -> Result<(), DecodeError> {
        let here = |problem: Problem| Err(problem.at(Place::Texture(self.index)));
        self.check_length(self.begin).or_else(here)?;
        // A part with fewer stages would state the same, and a texture has only one encoding.
        if self.texture.parts.fine_theta.is_some() && !self.last_fine_stage_is_used {
            return here(Problem::Needless("the last stage of fractions of θ"));
        }
        // Without a node of more stages, all steps are 0 and the part states nothing.
        if self.texture.has_tails() && usize::from(self.summary.highest_order) <= limits::MAX_FINE_STAGES {
            return here(Problem::Needless("the part with the steps of tails"));
        }
        let (stored, found) = (self.texture.summary, self.summary);
        let orders = [stored, found].map(|summary| usize::from(summary.highest_order));
        Problem::same("the highest order", orders[0], orders[1]).or_else(here)?;
        // Compared as bits, because -0.0 equals 0.0 and would be a second encoding.
        if stored.highest_output_power.to_bits() != found.highest_output_power.to_bits() {
            return here(Problem::Rule("the highest output power is not the nodes'"));
        }
        Ok(())
    }

    /// Checks that the coefficients end at byte `end`.
    fn check_length(&self, end: usize) -> Result<(), Problem> {
        Problem::same("bytes of coefficients", self.texture.coefficients.len(), end)
    }

    /// Checks the next node, and returns the byte at which its coefficients end.
    fn check_node(&mut self, record: &NodeRecord) -> Result<usize, Problem> {
        let texture = &self.texture;
        check_record(texture, self.number, record)?;
        // Nodes lie one after the other, so that no two share coefficients and none are left over.
        Problem::same("the begin of its coefficients", record.offset as usize, self.begin)?;
        let order = usize::from(record.order);
        let end = self.begin + texture.bytes_of_order(order);
        let Some(bytes) = texture.coefficients.get(self.begin..end) else {
            return Err(Problem::Rule("the coefficients end within those of this node"));
        };
        self.summary = self.summary.with_node(record.order, record.output_power);
        self.last_fine_stage_is_used |= self.check_stages(order, bytes)?;
        Ok(end)
    }

    /// Checks the stages of the next node, and returns whether the last of its fractions of θ is not 0.
    fn check_stages(&self, order: usize, bytes: &[u8]) -> Result<bool, Problem> {
        let (codes, tail) = self.texture.lattice_codes(self.number, order, bytes);
        tails::check(tail)?;
        // A code of -2¹⁵ is a θ of -π/2, where |k| is 1.
        let full = |&code: &[u8; 2]| i16::from_le_bytes(code) == i16::MIN;
        if let Some(index) = codes.iter().position(full) {
            let (stage, what) = (index + 1, "a reflection coefficient of magnitude 1");
            return Err(Problem::Stage { stage, what });
        }
        let nodes = self.texture.nodes.len() / NodeRecord::BYTES;
        match self.texture.parts.fine_theta {
            Some(part) => part.check_node(self.number, nodes, order),
            None => Ok(false),
        }
    }
}

/// Checks everything about node `number` except its coefficients and where they begin.
fn check_record(texture: &Texture<'_>, number: usize, record: &NodeRecord) -> Result<(), Problem> {
    let order = usize::from(record.order);
    Problem::count("the order", order, [0, limits::MAX_ORDER])?;
    let Some(flags) = NodeFlags::from_bits(record.flags) else {
        let (what, code) = ("flags", record.flags.into());
        return Err(Problem::Unknown { what, code });
    };
    for (what, value) in [
        ("the output power in (m/s²)²", record.output_power),
        (
            "the power of the prediction error in (m/s²)²",
            record.prediction_error_power,
        ),
    ] {
        // As integers, the bits of a negative number, of -0.0, of an infinity and of a NaN are all larger than those of
        // the limit. A -0.0 is refused because it would be a second way to write silence.
        if value.to_bits() > limits::MAX_OUTPUT_POWER.to_bits() {
            let range = [0.0, limits::MAX_OUTPUT_POWER];
            return Err(Problem::Range { what, value, range });
        }
    }
    if record.prediction_error_power > record.output_power {
        return Err(Problem::Rule("the prediction error's power is above the output's"));
    }
    let silent = record.output_power.to_bits() == 0;
    if flags.contains(NodeFlags::SILENT) != silent {
        return Err(Problem::Rule(
            "the silent flag is set exactly where the output power is zero; here they disagree",
        ));
    }
    if !silent {
        let forces = texture.force_axis.len();
        let (speed, force) = (number / forces, number % forces);
        if texture.speed_axis.value(speed) <= 0.0 || texture.force_axis.value(force) <= 0.0 {
            return Err(Problem::Rule("a node at speed 0 or force 0 must be silent"));
        }
    }
    levels::check_node(texture.level_law(), record)?;
    Ok(())
}

/// The check of all amplitudes of a texture whose header was found valid, in steps.
#[derive(Clone, Debug)]
pub(super) struct LinesCheck<'a> {
    texture: Texture<'a>,
    index: usize,
    lines: Lines<'a>,
    /// Index of the line that is checked.
    line: usize,
    /// Index of the next speed of that line; `force` is the index of the next force.
    speed: usize,
    force: usize,
    /// True if an amplitude of that line was found to be above 0.
    sounds: bool,
}

impl<'a> LinesCheck<'a> {
    /// The check of texture number `index`; none if it has no lines.
    pub fn new(texture: Texture<'a>, index: usize) -> Option<Self> {
        Some(Self {
            texture,
            index,
            lines: texture.lines()?,
            line: 0,
            speed: 0,
            force: 0,
            sounds: false,
        })
    }

    /// The texture, and its index.
    pub const fn texture(&self) -> (Texture<'a>, usize) {
        (self.texture, self.index)
    }

    /// Checks some amplitudes; returns true after the last one.
    pub fn step(&mut self) -> Result<bool, DecodeError> {
        let (speeds, forces) = (self.texture.speed_axis(), self.texture.force_axis());
        let mut left = STEP_BYTES / AMPLITUDE_BYTES;
        while self.line < self.lines.len() {
            let line = self.lines.line(self.line);
            while self.speed < speeds.len() {
                let rests = speeds.value(self.speed) <= 0.0;
                while self.force < forces.len() {
                    if left == 0 {
                        return Ok(false);
                    }
                    left -= 1;
                    let value = line.amplitude(self.speed, self.force);
                    // As integers, the bits of a negative number, of -0.0, of an infinity and of a NaN are all larger
                    // than those of the limit.
                    if value.to_bits() > MAX_LINE_AMPLITUDE.to_bits() {
                        let what = "the amplitude of a line in m/s²";
                        let range = [0.0, MAX_LINE_AMPLITUDE];
                        return Err(self.at_node(Problem::Range { what, value, range }));
                    }
                    if value > 0.0 {
                        self.sounds = true;
                        // Only the first force can be 0, because the axis ascends.
                        if rests || (self.force == 0 && forces.value(0) <= 0.0) {
                            let rule = "a line must have an amplitude of 0 at speed 0 and at force 0";
                            return Err(self.at_node(Problem::Rule(rule)));
                        }
                    }
                    self.force += 1;
                }
                (self.speed, self.force) = (self.speed + 1, 0);
            }
            if !core::mem::take(&mut self.sounds) {
                let silent = Problem::Needless("a line of amplitude 0");
                return Err(silent.at(Place::Texture(self.index)));
            }
            (self.line, self.speed) = (self.line + 1, 0);
        }
        Ok(true)
    }

    fn at_node(&self, problem: Problem) -> DecodeError {
        problem.at(Place::Node {
            texture: self.index,
            speed: self.speed,
            force: self.force,
        })
    }
}

/// The check of the codebooks of a texture whose header was found valid, in steps.
#[derive(Clone, Debug)]
pub(super) struct FedCheck<'a> {
    texture: Texture<'a>,
    index: usize,
    excitation: ExcitationCheck,
}

impl<'a> FedCheck<'a> {
    /// The check of texture number `index`, if it has codebooks.
    pub fn new(texture: Texture<'a>, index: usize) -> Option<Self> {
        texture.is_fed().then(|| Self {
            texture,
            index,
            excitation: ExcitationCheck::default(),
        })
    }

    /// Runs one step of the check; returns true once all codebooks were found valid.
    pub fn step(&mut self) -> Result<bool, DecodeError> {
        let Some(excitation) = self.texture.excitation() else {
            return Ok(true);
        };
        self.excitation
            .step(&excitation, STEP_BYTES)
            .map_err(|(node, problem)| {
                let forces = self.texture.force_axis.len();
                let of_node = |number| Place::Node {
                    texture: self.index,
                    speed: number / forces,
                    force: number % forces,
                };
                problem.at(node.map_or(Place::Texture(self.index), of_node))
            })
    }
}
