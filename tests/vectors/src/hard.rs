//! Hard cases on the target: textures, motions and states that break filters, sample by sample.
//!
//! The host makes them (`stylus stress`). Each is played in two ways here: like the product plays a texture, and
//! through its filter only. The filter is driven, stopped and overdriven, and starts from a state with full scale in
//! every signal.

use model_format::{DecodeError, Library, MillimetresPerSecond, Newton, OutputSample, Texture};
use serde::{Deserialize, Serialize};
use stylus_kernel::arithmetic::Arithmetic;
use stylus_kernel::digest::Digest;
use stylus_kernel::excitation::Excitation;
use stylus_kernel::grid::GridPoint;
use stylus_kernel::lattice::{LatticeFrame, LatticeState};
use stylus_kernel::{Motion, Synthesis};

/// A library's first texture, and a motion over it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct HardCase<'a> {
    /// Name in reports.
    pub name: &'a str,
    /// The library.
    pub library: &'a [u8],
    /// The motions: speed, mm/s, and force, N, each as a little-endian float. They are repeated.
    pub motions: &'a [u8],
    /// Number of samples per motion.
    pub every: u32,
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

/// The excitation that drives the filter in a phase.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Drive {
    Noise,
    Nothing,
    /// Noise of 8/3 the amplitude.
    Loud,
}

impl<'a> HardCase<'a> {
    /// Reads the first of the cases in `bytes`. Returns the case and the bytes after it; `None` if there are no bytes.
    ///
    /// # Errors
    /// The bytes are not a case.
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

    /// Returns the motion that begins at sample `sample`, if one begins there.
    fn motion(&self, sample: u32) -> Option<Motion> {
        let pairs = self.motions.as_chunks::<8>().0;
        if !sample.is_multiple_of(self.every) || pairs.is_empty() {
            return None;
        }
        let pair = pairs[(sample / self.every) as usize % pairs.len()];
        let half = |at: usize| {
            pair[at..]
                .first_chunk()
                .map_or(0.0, |&bytes| f32::from_le_bytes(bytes))
        };
        Motion::new(MillimetresPerSecond(half(0)), Newton(half(4))).ok()
    }

    /// Plays the case. Each call that computes a sample goes through `measure`. Returns a digest of all samples.
    ///
    /// # Errors
    /// The bytes are not a library.
    pub fn play<A: Arithmetic>(
        &self,
        measure: &mut dyn FnMut(Way, &mut dyn FnMut() -> OutputSample) -> OutputSample,
    ) -> Result<u32, DecodeError> {
        let library = Library::decode(self.library)?;
        let mut digest = Digest::default();
        for texture in library.textures().take(1) {
            let mut synthesis = Synthesis::<A>::new(texture, 1);
            for n in 0..self.samples {
                if let Some(motion) = self.motion(n) {
                    synthesis.follow(motion, self.every);
                }
                digest.add(measure(Way::Synthesis, &mut || synthesis.next_sample()));
            }
            let mut lattice = Lattice::<A>::new(&texture);
            self.phases(&mut lattice, &texture, &mut digest, measure);
        }
        Ok(digest.value())
    }

    fn phases<A: Arithmetic>(
        &self,
        filter: &mut Lattice<A>,
        texture: &Texture<'_>,
        digest: &mut Digest,
        measure: &mut dyn FnMut(Way, &mut dyn FnMut() -> OutputSample) -> OutputSample,
    ) {
        let mut noise = Excitation::new(2);
        for drive in [Drive::Noise, Drive::Nothing, Drive::Loud, Drive::Nothing] {
            self.phase(drive, filter, texture, &mut noise, digest, measure);
        }
        for drive in [Drive::Nothing, Drive::Loud] {
            filter.glitch(&mut noise);
            self.phase(drive, filter, texture, &mut noise, digest, measure);
        }
    }

    fn phase<A: Arithmetic>(
        &self,
        drive: Drive,
        filter: &mut Lattice<A>,
        texture: &Texture<'_>,
        noise: &mut Excitation,
        digest: &mut Digest,
        measure: &mut dyn FnMut(Way, &mut dyn FnMut() -> OutputSample) -> OutputSample,
    ) {
        for n in 0..self.samples {
            if let Some(motion) = self.motion(n) {
                filter.follow(texture, motion);
            }
            let drawn = noise.next_sample();
            let excitation = match drive {
                Drive::Noise => drawn,
                Drive::Nothing => 0,
                Drive::Loud => (drawn / 3).saturating_mul(8),
            };
            digest.add(measure(Way::Filter, &mut || filter.sample(excitation)));
        }
    }
}

/// A lattice with an external excitation.
struct Lattice<A> {
    frame: LatticeFrame,
    state: LatticeState,
    arithmetic: core::marker::PhantomData<A>,
}

impl<A: Arithmetic> Lattice<A> {
    fn new(texture: &Texture<'_>) -> Self {
        Self {
            frame: LatticeFrame::silent(texture.max_order()),
            state: LatticeState::new(),
            arithmetic: core::marker::PhantomData,
        }
    }

    fn follow(&mut self, texture: &Texture<'_>, motion: Motion) {
        let from = self.frame.levels(0);
        self.frame
            .update::<A>(texture, &GridPoint::locate(texture, motion), from, 1);
    }

    fn sample(&mut self, excitation: i32) -> OutputSample {
        self.state.next_sample::<A>(&self.frame, excitation, 0).0
    }

    /// Sets every signal of the state to full scale, with random signs.
    fn glitch(&mut self, noise: &mut Excitation) {
        self.state = LatticeState::from_backward(core::array::from_fn(|_| full_scale(noise)));
    }
}

fn full_scale(noise: &mut Excitation) -> i32 {
    if noise.next_sample() < 0 {
        i32::MIN
    } else {
        i32::MAX
    }
}
