//! A texture of a library.

use super::axis::Axis;
use super::certificate::Certificate;
use super::node::{Coefficients, Node, NodeFlags};
use crate::error::{DecodeError, Place, Problem};
use crate::units::{MillimetresPerSecond, Newton};
use crate::wire::{CertificateRecord, NodeRecord, Provenance, Structure, TextureRecord};

/// A texture: models on a rectangular grid over tangential speed and normal force.
#[derive(Clone, Copy, Debug)]
pub struct Texture<'a> {
    pub(super) name: &'a str,
    pub(super) sample_rate_hz: u32,
    pub(super) structure: Structure,
    pub(super) provenance: Provenance,
    pub(super) speed_axis: Axis<'a>,
    pub(super) force_axis: Axis<'a>,
    pub(super) nodes: &'a [u8],
    pub(super) coefficients: &'a [u8],
    pub(super) certificate: CertificateRecord<'a>,
}

impl<'a> Texture<'a> {
    /// Parses the header of texture `index`: the texture, and the bytes after it.
    pub(super) fn take(bytes: &'a [u8], index: usize) -> Result<(Self, &'a [u8]), DecodeError> {
        let (record, rest) = postcard::take_from_bytes::<TextureRecord<'a>>(bytes)
            .map_err(|_| Problem::Malformed.at(Place::Texture(index)))?;
        let texture = Self {
            name: record.name,
            sample_rate_hz: record.sample_rate_hz,
            structure: record.structure,
            provenance: record.provenance,
            speed_axis: Axis(record.speed_axis),
            force_axis: Axis(record.force_axis),
            nodes: record.nodes,
            coefficients: record.coefficients,
            certificate: record.certificate,
        };
        Ok((texture, rest))
    }

    /// Name, unique in its library.
    pub fn name(&self) -> &'a str {
        self.name
    }

    /// Sample rate of the models, Hz.
    pub fn sample_rate_hz(&self) -> u32 {
        self.sample_rate_hz
    }

    /// Structure that the coefficients are for.
    pub fn structure(&self) -> Structure {
        self.structure
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
        let record = self.record(speed, force);
        let begin = record.offset as usize;
        let length = usize::from(record.order) * self.structure.coefficient_bytes();
        let bytes = &self.coefficients[begin..begin + length];
        let exponent = record.exponent;
        Node {
            output_power: record.output_power,
            prediction_error_power: record.prediction_error_power,
            flags: NodeFlags(record.flags),
            coefficients: match self.structure {
                Structure::NormalisedLattice => Coefficients::Lattice(bytes.as_chunks().0),
                Structure::DirectForm16 => Coefficients::Direct16 {
                    exponent,
                    codes: bytes.as_chunks().0,
                },
                Structure::DirectForm32 => Coefficients::Direct32 {
                    exponent,
                    codes: bytes.as_chunks().0,
                },
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

    /// Numbers of cells along the speed and the force axis, at least one each. A cell lies between neighbouring
    /// values of the axis; an axis of one value counts as one cell.
    pub fn cell_counts(&self) -> (usize, usize) {
        let cells = |axis: Axis<'_>| (axis.len() - 1).max(1);
        (cells(self.speed_axis), cells(self.force_axis))
    }

    /// Certificate of the texture's stability.
    pub fn certificate(&self) -> Certificate<'a> {
        match self.certificate {
            CertificateRecord::None => Certificate::None,
            CertificateRecord::Lattice { largest_theta_code } => {
                Certificate::Lattice { largest_theta_code }
            }
            CertificateRecord::DirectForm { cell_margins, .. } => {
                Certificate::DirectForm { cell_margins }
            }
        }
    }

    /// Highest order of all nodes.
    pub fn max_order(&self) -> usize {
        let orders = self.nodes().map(|node| node.coefficients.order());
        orders.max().unwrap_or(0)
    }

    /// Highest output power of all nodes, (m/s²)².
    pub fn max_output_power(&self) -> f32 {
        self.nodes()
            .fold(0.0, |highest, node| node.output_power.max(highest))
    }

    pub(super) fn record(&self, speed: usize, force: usize) -> NodeRecord {
        let index = speed * self.force_axis.len() + force;
        NodeRecord::read(&self.nodes.as_chunks().0[index])
    }
}
