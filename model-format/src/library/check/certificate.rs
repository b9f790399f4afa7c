//! Check of a texture's certificate against nodes that were found valid.

use crate::error::{DecodeError, Place, Problem};
use crate::library::axis::Axis;
use crate::library::certificate::UNCERTIFIED_CELL;
use crate::library::texture::Texture;
use crate::limits::STEP_BYTES;
use crate::wire::{CRC32, CertificateRecord, Structure};

/// The certificates that a decoder demands of direct forms.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::library) enum Demand {
    /// A certificate for every texture.
    Certificate,
    /// No certificate, but one that is there must hold.
    Nothing,
}

/// The check of a certificate, in steps.
#[derive(Clone)]
pub(in crate::library) struct CertificateCheck<'a> {
    texture: Texture<'a>,
    index: usize,
    demand: Demand,
    /// Largest |θ| of the nodes.
    largest_theta: u32,
    /// The bytes that a checksum covers and that are still to come, and the checksum of those before.
    strings: [&'a [u8]; 5],
    digest: crc::Digest<'static, u32>,
}

impl<'a> CertificateCheck<'a> {
    /// The check of the certificate of texture number `index`, whose nodes were found valid.
    pub fn new(texture: Texture<'a>, index: usize, demand: Demand, largest_theta: u32) -> Self {
        let (Axis(speeds), Axis(forces)) = (texture.speed_axis, texture.force_axis);
        let strings = match texture.certificate {
            CertificateRecord::DirectForm { cell_margins, .. } => [
                speeds,
                forces,
                texture.nodes,
                texture.coefficients,
                cell_margins,
            ],
            CertificateRecord::None | CertificateRecord::Lattice { .. } => [&[][..]; 5],
        };
        Self {
            texture,
            index,
            demand,
            largest_theta,
            strings,
            digest: CRC32.digest(),
        }
    }

    /// The texture, and its index.
    pub const fn texture(&self) -> (Texture<'a>, usize) {
        (self.texture, self.index)
    }

    /// Takes one step; returns true if the certificate holds.
    pub fn step(&mut self) -> Result<bool, DecodeError> {
        let here = |problem: Problem| Err(problem.at(Place::Texture(self.index)));
        let structure = self.texture.structure;
        match (structure, self.texture.certificate) {
            (
                Structure::NormalisedLattice,
                CertificateRecord::Lattice {
                    largest_theta: stored,
                },
            ) => {
                let found = self.largest_theta;
                if stored != found {
                    return here(Problem::CertifiedTheta { stored, found });
                }
                Ok(true)
            }
            (
                Structure::DirectForm16 | Structure::DirectForm32,
                CertificateRecord::DirectForm {
                    crc32,
                    cell_margins,
                },
            ) => self.step_of_direct_form(crc32, cell_margins),
            (Structure::DirectForm16 | Structure::DirectForm32, CertificateRecord::None) => {
                if self.demand == Demand::Certificate {
                    return here(Problem::Uncertified(structure));
                }
                Ok(true)
            }
            _ => here(Problem::CertificateKind(structure)),
        }
    }

    fn step_of_direct_form(
        &mut self,
        stored: u32,
        cell_margins: &[u8],
    ) -> Result<bool, DecodeError> {
        let here = |problem: Problem| Err(problem.at(Place::Texture(self.index)));
        let (speeds, forces) = self.texture.cell_counts();
        let (found, expected) = (cell_margins.len(), speeds * forces);
        if found != expected {
            return here(Problem::CertifiedCells { found, expected });
        }
        let mut room = STEP_BYTES;
        for string in &mut self.strings {
            let (now, later) = string.split_at(string.len().min(room));
            self.digest.update(now);
            (*string, room) = (later, room - now.len());
        }
        if room == 0 {
            return Ok(false);
        }
        let computed = self.digest.clone().finalize();
        if stored != computed {
            return here(Problem::CertificateChecksum { stored, computed });
        }
        if let Some(cell) = cell_margins.iter().position(|&m| m == UNCERTIFIED_CELL) {
            let (speed, force) = (cell / forces, cell % forces);
            return Err(Problem::UncertifiedCell.at(Place::Cell {
                texture: self.index,
                speed,
                force,
            }));
        }
        Ok(true)
    }
}
