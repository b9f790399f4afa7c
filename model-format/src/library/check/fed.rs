//! The content of the parts that feed a texture's excitation: codebooks and level track.

use crate::error::{DecodeError, Place};
use crate::library::part::excitation::ExcitationCheck;
use crate::library::part::modulation::ModulationCheck;
use crate::library::texture::Texture;
use crate::limits::STEP_BYTES;

/// The check of both parts of a texture whose header was found valid, in steps.
#[derive(Clone, Debug)]
pub(in crate::library) struct FedCheck<'a> {
    texture: Texture<'a>,
    index: usize,
    /// The rest of the codebooks' check.
    excitation: Option<ExcitationCheck>,
    modulation: ModulationCheck,
}

impl<'a> FedCheck<'a> {
    /// The check of texture number `index`, if it has one of the parts.
    pub fn new(texture: Texture<'a>, index: usize) -> Option<Self> {
        texture.is_fed().then(|| Self {
            texture,
            index,
            excitation: texture.excitation().map(|_| ExcitationCheck::default()),
            modulation: ModulationCheck::default(),
        })
    }

    /// Takes one step; returns true if both parts hold.
    pub fn step(&mut self) -> Result<bool, DecodeError> {
        let here = Place::Texture(self.index);
        if let (Some(check), Some(excitation)) = (&mut self.excitation, self.texture.excitation()) {
            let taken = check.step(&excitation, STEP_BYTES);
            let taken = taken.map_err(|(node, problem)| {
                let forces = self.texture.force_axis.len();
                problem.at(node.map_or(here, |number| Place::Node {
                    texture: self.index,
                    speed: number / forces,
                    force: number % forces,
                }))
            })?;
            if taken < STEP_BYTES {
                self.excitation = None;
            }
            return Ok(self.excitation.is_none() && self.texture.modulation().is_none());
        }
        let Some(modulation) = self.texture.modulation() else {
            return Ok(true);
        };
        let stepped = self.modulation.step(&modulation, STEP_BYTES);
        stepped.map_err(|problem| problem.at(here))
    }
}
