//! A texture of a library.

use super::node::{Coefficients, Node, NodeFlags, Tail};
use super::part::excitation::{Excitation, ExcitationPart};
use super::part::fine_theta::FineTheta;
use super::part::levels::{FadeLaw, Laws, LevelLaw, LevelsPart};
use super::part::lines::Lines;
use super::part::tails::Tails;
use super::part::{PartKind, Parts};
use crate::error::{DecodeError, Place, Problem};
use crate::units::{MillimetresPerSecond, Newton};
use crate::wire::{NodeRecord, Provenance, Reader, Summary, TextureRecord};

/// A texture: models on a rectangular grid over tangential speed and normal force.
#[derive(Clone, Copy, Debug)]
pub struct Texture<'a> {
    pub(super) name: &'a str,
    pub(super) sample_rate_hz: u32,
    pub(super) provenance: Provenance,
    pub(super) speed_axis: Axis<'a>,
    pub(super) force_axis: Axis<'a>,
    pub(super) nodes: &'a [u8],
    pub(super) coefficients: &'a [u8],
    pub(super) summary: Summary,
    pub(super) parts: Parts<'a>,
    /// The laws that `parts` contain, or the default laws.
    laws: Laws,
}

impl<'a> Texture<'a> {
    /// Parses the header of texture `index`, whose record and parts are `bytes`.
    pub(crate) fn parse(bytes: &'a [u8], index: usize) -> Result<Self, DecodeError> {
        let here = |problem: Problem| problem.at(Place::Texture(index));
        let mut reader = Reader(bytes);
        let record = TextureRecord::read(&mut reader).ok_or(here(Problem::Malformed("its header")))?;
        let parts = Parts::read(&mut reader).map_err(here)?;
        if !reader.0.is_empty() {
            return Err(here(Problem::LeftOver(reader.0.len())));
        }
        Ok(Self {
            name: record.name,
            sample_rate_hz: record.sample_rate_hz,
            provenance: record.provenance,
            speed_axis: Axis(record.speed_axis),
            force_axis: Axis(record.force_axis),
            nodes: record.nodes,
            coefficients: record.coefficients,
            summary: record.summary,
            parts,
            laws: parts.levels.map(LevelsPart::laws).unwrap_or_default(),
        })
    }

    /// Name of the texture whose record and parts are `bytes`, without parsing more.
    pub(super) fn name_of(bytes: &[u8]) -> Option<&[u8]> {
        Reader(bytes).string()
    }

    /// Name, unique in its library.
    pub fn name(&self) -> &'a str {
        self.name
    }

    /// Sample rate of the models, Hz.
    pub fn sample_rate_hz(&self) -> u32 {
        self.sample_rate_hz
    }

    /// Origin of the recordings.
    pub fn provenance(&self) -> Provenance {
        self.provenance
    }

    /// Tangential speeds of the grid, mm/s.
    pub fn speed_axis(&self) -> Axis<'a> {
        self.speed_axis
    }

    /// Normal forces of the grid, N.
    pub fn force_axis(&self) -> Axis<'a> {
        self.force_axis
    }

    /// Tangential speed at index `speed` of the grid, which must be below the axis's length.
    pub fn speed(&self, speed: usize) -> MillimetresPerSecond {
        MillimetresPerSecond(self.speed_axis.value(speed))
    }

    /// Normal force at index `force` of the grid, which must be below the axis's length.
    pub fn force(&self, force: usize) -> Newton {
        Newton(self.force_axis.value(force))
    }

    /// The model at the indices (`speed`, `force`), each below the length of its axis.
    pub fn node(&self, speed: usize, force: usize) -> Node<'a> {
        let index = speed * self.force_axis.len() + force;
        let record = self.record(speed, force);
        let begin = record.offset as usize;
        let order = usize::from(record.order);
        let length = self.bytes_of_order(order);
        // Validation has found that every node's coefficients lie within their string.
        let bytes = &self.coefficients[begin..begin + length];
        let (codes, tail) = self.lattice_codes(index, order, bytes);
        Node {
            output_power: record.output_power,
            prediction_error_power: record.prediction_error_power,
            flags: NodeFlags(record.flags as u8),
            coefficients: Coefficients {
                codes,
                fractions: self.fractions(index, order),
                tail,
            },
        }
    }

    /// All nodes, speed-major, in the order of the file.
    pub fn nodes(&self) -> impl Iterator<Item = Node<'a>> + use<'a> {
        let texture = *self;
        let forces = texture.force_axis.len();
        let count = texture.speed_axis.len() * forces;
        (0..count).map(move |index| texture.node(index / forces, index % forces))
    }

    /// Laws of the level between nodes and below the grid.
    pub fn laws(&self) -> Laws {
        self.laws
    }

    /// Law of the level between nodes.
    pub fn level_law(&self) -> LevelLaw {
        self.laws.level
    }

    /// Law of the level below the lowest speed and force of the grid.
    pub fn fade_law(&self) -> FadeLaw {
        self.laws.fade
    }

    /// Codebooks of the excitation, if there are any. Otherwise the excitation is Gaussian noise.
    pub fn excitation(&self) -> Option<Excitation<'a>> {
        let (nodes, forces) = (self.nodes.len() / NodeRecord::BYTES, self.force_axis.len());
        let view = |part: ExcitationPart<'a>| part.view(nodes, forces);
        self.parts.excitation.and_then(view)
    }

    /// Returns whether the excitation has codebooks.
    pub fn is_fed(&self) -> bool {
        self.parts.excitation.is_some()
    }

    /// The texture as it would be without its codebooks: Gaussian noise of the same power excites the filter.
    #[must_use]
    pub fn without_codebooks(mut self) -> Self {
        self.parts.excitation = None;
        self
    }

    /// The texture as it would be without its lines: only the model sounds.
    #[must_use]
    pub fn without_lines(mut self) -> Self {
        (self.parts.lines, self.parts.wander) = (None, None);
        self
    }

    /// Number of stages, counted from the first, whose θ has a fraction in addition to its 16-bit code. It is 0 in a
    /// texture without such fractions, and at most [`crate::limits::MAX_FINE_STAGES`].
    pub fn fine_stages(&self) -> usize {
        let nodes = self.nodes.len() / NodeRecord::BYTES;
        self.parts.fine_theta.map_or(0, |part| part.stages(nodes))
    }

    /// Returns whether the stages after the first [`crate::limits::MAX_FINE_STAGES`] have codes of one byte. This is
    /// the same for all nodes of a texture.
    pub fn has_tails(&self) -> bool {
        self.parts.tails.is_some()
    }

    /// Lines that are tied to position, if the texture has any.
    pub fn lines(&self) -> Option<Lines<'a>> {
        let nodes = self.nodes.len() / NodeRecord::BYTES;
        let part = self.parts.lines?;
        Some(part.lines(nodes, self.force_axis.len(), self.parts.wander))
    }

    /// Length of the coefficients of all nodes, bytes.
    pub fn coefficient_bytes(&self) -> usize {
        self.coefficients.len()
    }

    /// The optional parts that the texture has, each with the length of its content, bytes.
    pub fn parts(&self) -> impl Iterator<Item = (PartKind, usize)> + use<> {
        self.parts.lengths()
    }

    /// Highest order of all nodes.
    pub fn max_order(&self) -> usize {
        usize::from(self.summary.highest_order)
    }

    /// Highest output power of all nodes, (m/s²)².
    pub fn max_output_power(&self) -> f32 {
        self.summary.highest_output_power
    }

    /// Counts the nodes that have each of `flags`, in one pass over the nodes' records.
    pub fn count_flags<const N: usize>(&self, flags: [NodeFlags; N]) -> [u16; N] {
        let mut counts = [0; N];
        for bytes in self.nodes.as_chunks::<{ NodeRecord::BYTES }>().0 {
            // All known flags are in the low byte, and validation refuses others.
            let found = NodeFlags(bytes[NodeRecord::FLAGS]);
            for (count, flag) in counts.iter_mut().zip(flags) {
                *count += u16::from(found.contains(flag));
            }
        }
        counts
    }

    /// Fractions of the first stages of node number `index`, whose order is `order`.
    fn fractions(&self, index: usize, order: usize) -> &'a [u8] {
        let nodes = self.nodes.len() / NodeRecord::BYTES;
        let of_node = |part: FineTheta<'a>| part.of_node(index, nodes, order);
        self.parts.fine_theta.map_or(&[], of_node)
    }

    /// Length of the coefficients of a node of `order`, bytes.
    pub(super) const fn bytes_of_order(&self, order: usize) -> usize {
        match self.parts.tails {
            None => 2 * order,
            Some(_) => Tails::coefficient_bytes(order),
        }
    }

    /// The codes of 16 bits and the tail of node number `index`, whose coefficients are `bytes`.
    #[inline]
    pub(super) fn lattice_codes(&self, index: usize, order: usize, bytes: &'a [u8]) -> (&'a [[u8; 2]], Tail<'a>) {
        let Some(part) = self.parts.tails else {
            return (bytes.as_chunks().0, Tail::default());
        };
        let (codes, tail) = bytes.split_at(2 * Tails::stages_before(order));
        (codes.as_chunks().0, part.of_node(index, tail))
    }

    fn record(&self, speed: usize, force: usize) -> NodeRecord {
        let index = speed * self.force_axis.len() + force;
        NodeRecord::read(&self.nodes.as_chunks().0[index])
    }
}

/// Ascending values of a grid's axis, finite and not negative, in the axis's unit.
#[derive(Clone, Copy, Debug)]
pub struct Axis<'a>(pub(super) &'a [u8]);

impl Axis<'_> {
    pub(super) const VALUE_BYTES: usize = 4;

    /// Number of values, at least one.
    #[expect(clippy::len_without_is_empty, reason = "an axis is never empty")]
    pub fn len(&self) -> usize {
        self.0.len() / Self::VALUE_BYTES
    }

    /// Value `index`, which must be below [`Axis::len`].
    pub fn value(&self, index: usize) -> f32 {
        f32::from_le_bytes(self.0.as_chunks().0[index])
    }

    /// All values, ascending.
    pub fn values(&self) -> impl Iterator<Item = f32> {
        self.0.as_chunks().0.iter().copied().map(f32::from_le_bytes)
    }
}
