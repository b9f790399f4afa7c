//! Hard cases on the target: textures, motions and states that break filters, sample by sample.
//!
//! The host makes them (`stylus stress`). Each is played in two ways here: like the product plays a texture, and
//! through its filter only. The filter is driven, stopped and overdriven, and starts from a state with full scale in
//! every signal.

use model_format::{DecodeError, Library, OutputSample};
use serde::{Deserialize, Serialize};
use stylus_hard_cases::{Drive, Filter, Lattice, Path, Player};
use stylus_kernel::Synthesis;
use stylus_kernel::arithmetic::Arithmetic;
use stylus_kernel::digest::Digest;
use stylus_kernel::excitation::Excitation;

/// A library's first texture, and a motion over it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct HardCase<'a> {
    /// Name in reports.
    pub name: &'a str,
    /// The library.
    pub library: &'a [u8],
    /// The motion.
    pub path: Path,
    /// Number of samples per phase.
    pub samples: u32,
}

/// The call that computes a sample.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Way {
    /// [`Synthesis::next_sample`].
    Synthesis,
    /// The filter state's own call, without the generator of the excitation.
    Filter,
}

impl<'a> HardCase<'a> {
    /// Reads the first of the cases in `bytes`. Returns the case and the bytes after it; `None` if there are no bytes.
    pub fn take(bytes: &'a [u8]) -> Result<Option<(Self, &'a [u8])>, postcard::Error> {
        if bytes.is_empty() {
            return Ok(None);
        }
        postcard::take_from_bytes(bytes).map(Some)
    }

    /// Returns the bytes that [`HardCase::take`] reads.
    ///
    /// # Panics
    /// Never: encoding can only run out of memory.
    #[cfg(feature = "library")]
    pub fn to_bytes(&self) -> alloc::vec::Vec<u8> {
        postcard::to_allocvec(self).expect("a case has a form in bytes")
    }

    /// Plays the case. Each call that computes a sample goes through `measure`. Returns a digest of all samples.
    pub fn play<A: Arithmetic>(
        &self,
        measure: &mut dyn FnMut(Way, &mut dyn FnMut() -> OutputSample) -> OutputSample,
    ) -> Result<u32, DecodeError> {
        let library = Library::decode(self.library)?;
        let mut digest = Digest::default();
        for texture in library.textures().take(1) {
            let mut synthesis = Synthesis::<A>::new(texture, 1);
            for n in 0..self.samples {
                if let Some(motion) = self.path.change_at(n as usize) {
                    synthesis.follow(motion, self.path.every().unwrap_or(self.samples));
                }
                digest.add(measure(Way::Synthesis, &mut || synthesis.next_sample()));
            }
            let mut lattice = Lattice::<A>::new(&texture);
            let mut player = Player::new(&mut lattice, texture, self.path, 2);
            let mut phase = |player: &mut Player<'_, Lattice<A>>, drive| {
                for _ in 0..self.samples {
                    player.move_on();
                    let excitation = player.excitation(drive);
                    let mut sample = || player.filter.sample(excitation, 0).0;
                    digest.add(measure(Way::Filter, &mut sample));
                }
            };
            for drive in [Drive::Noise, Drive::Nothing, Drive::Loud, Drive::Nothing] {
                phase(&mut player, drive);
            }
            for drive in [Drive::Nothing, Drive::Loud] {
                player.filter.glitch(&mut Excitation::new(99));
                phase(&mut player, drive);
            }
        }
        Ok(digest.value())
    }
}
