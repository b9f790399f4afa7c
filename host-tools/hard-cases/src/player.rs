//! A filter that is moved along a path and driven.

use model_format::{OutputSample, Texture};
use stylus_kernel::Motion;
use stylus_kernel::excitation::Excitation;

use crate::{Filter, Path};

/// The excitation of a sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Drive {
    /// The kernel's noise, with an RMS of an eighth of full scale.
    Noise,
    /// Noise with an RMS of a third of full scale.
    Loud,
    /// Silence, for which no noise is drawn.
    Nothing,
}

/// A filter that follows a path over its texture.
pub struct Player<'a, F: ?Sized> {
    /// The filter.
    pub filter: &'a mut F,
    texture: Texture<'a>,
    path: Path,
    noise: Excitation,
    sample: usize,
}

impl<'a, F: Filter + ?Sized> Player<'a, F> {
    /// Plays `texture` with `filter` from the beginning of `path`. `seed` is the noise's.
    pub fn new(filter: &'a mut F, texture: Texture<'a>, path: Path, seed: u64) -> Self {
        Self {
            filter,
            texture,
            path,
            noise: Excitation::new(seed),
            sample: 0,
        }
    }

    /// Goes on to the next sample's motion. Returns it if it begins there.
    pub fn move_on(&mut self) -> Option<Motion> {
        let change = self.path.change_at(self.sample);
        if let Some(motion) = change {
            // A ramp of one sample: the level jumps with the motion.
            self.filter.follow(&self.texture, motion, 0, 1);
        }
        self.sample += 1;
        change
    }

    /// Draws the excitation of the next sample, in steps of 2⁻²⁸ of a standard deviation.
    pub fn excitation(&mut self, drive: Drive) -> i32 {
        let gain = match drive {
            Drive::Noise => 1.0,
            Drive::Loud => 8.0 / 3.0,
            Drive::Nothing => return 0,
        };
        (f64::from(self.noise.next_sample()) * gain) as i32
    }

    /// Moves on and plays a sample. Returns the output, and whether it saturated.
    pub fn play(&mut self, drive: Drive) -> (OutputSample, bool) {
        self.move_on();
        let excitation = self.excitation(drive);
        self.filter.sample(excitation, 0)
    }
}
