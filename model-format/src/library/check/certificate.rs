//! Check of a texture's certificate against nodes that were found valid.

use crate::error::{DecodeError, Place, Problem};
use crate::library::axis::Axis;
use crate::library::certificate::UNCERTIFIED_CELL;
use crate::library::texture::Texture;
use crate::wire::{self, CertificateRecord, Structure};

/// The certificates that a decoder demands of direct forms.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(in crate::library) enum Demand {
    /// A certificate for every texture.
    Certificate,
    /// No certificate, but one that is there must hold.
    Nothing,
}

/// Checks the certificate against nodes that were found valid.
pub(super) fn check_certificate(
    texture: &Texture<'_>,
    index: usize,
    demand: Demand,
) -> Result<(), DecodeError> {
    let here = |problem: Problem| Err(problem.at(Place::Texture(index)));
    match (texture.structure, texture.certificate) {
        (
            Structure::NormalisedLattice,
            CertificateRecord::Lattice {
                largest_theta: stored,
            },
        ) => {
            let found = largest_theta(texture);
            if stored != found {
                return here(Problem::CertifiedTheta { stored, found });
            }
        }
        (
            Structure::DirectForm16 | Structure::DirectForm32,
            CertificateRecord::DirectForm {
                crc32: stored,
                cell_margins,
            },
        ) => {
            let (speeds, forces) = texture.cell_counts();
            let (found, expected) = (cell_margins.len(), speeds * forces);
            if found != expected {
                return here(Problem::CertifiedCells { found, expected });
            }
            let computed = checksum(texture, cell_margins);
            if stored != computed {
                return here(Problem::CertificateChecksum { stored, computed });
            }
            if let Some(cell) = cell_margins.iter().position(|&m| m == UNCERTIFIED_CELL) {
                let (speed, force) = (cell / forces, cell % forces);
                return Err(Problem::UncertifiedCell.at(Place::Cell {
                    texture: index,
                    speed,
                    force,
                }));
            }
        }
        (Structure::DirectForm16 | Structure::DirectForm32, CertificateRecord::None) => {
            if demand == Demand::Certificate {
                return here(Problem::Uncertified(texture.structure));
            }
        }
        _ => return here(Problem::CertificateKind(texture.structure)),
    }
    Ok(())
}

fn checksum(texture: &Texture<'_>, cell_margins: &[u8]) -> u32 {
    let (Axis(speeds), Axis(forces)) = (texture.speed_axis, texture.force_axis);
    wire::checksum_of_strings([
        speeds,
        forces,
        texture.nodes,
        texture.coefficients,
        cell_margins,
    ])
}

/// Largest |θ| of all nodes of a lattice, in steps of [`crate::FINE_THETA_STEP_RAD`].
fn largest_theta(texture: &Texture<'_>) -> u32 {
    let thetas = texture.nodes().flat_map(|node| node.coefficients.thetas());
    thetas.map(i32::unsigned_abs).max().unwrap_or(0)
}
