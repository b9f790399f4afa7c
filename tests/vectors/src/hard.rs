//! Hard input on the target: operands at the ends of their ranges, which the noise of no texture reaches, and hard
//! cases: textures, motions and states that break filters, sample by sample.
//!
//! The host makes the cases (`stylus stress`). Each is played in two ways here: like the product plays a texture, and
//! through its filter only. The filter is driven, stopped and overdriven, and starts from a state with full scale in
//! every signal.

use model_format::limits::MAX_ORDER;
use model_format::{DecodeError, Library, OutputSample};
use serde::{Deserialize, Serialize};
use stylus_hard_cases::{Drive, Filter, Lattice, Path, Player};
use stylus_kernel::Synthesis;
use stylus_kernel::arithmetic::Arithmetic;
use stylus_kernel::digest::Digest;
use stylus_kernel::excitation::Excitation;
use stylus_kernel::lattice::LatticeState;
use stylus_kernel::rotation::{Rotation, THETA_QUARTER_TURN};
use stylus_kernel::theta::{Codes, PER_CODE, PER_FRACTION, Run};

const SAMPLES: usize = 32;
const MOST_FEW_STAGES: usize = 80;

/// Passes to `sink` the results of the kernel's arithmetic for operands at the ends of their ranges.
pub fn edges<A: Arithmetic>(mut sink: impl FnMut(u32)) {
    for theta in [-THETA_QUARTER_TURN, -1, THETA_QUARTER_TURN / 2, i32::MAX] {
        lattice_at_full_scale::<A>(theta, &mut sink);
    }
    lattices_of_few_stages::<A>(&mut sink);
    for weights in [
        [1 << 16, 0, 0, 0],
        [0, 0, 1, (1 << 16) - 1],
        [20_011, 29_990, 9_999, 5536],
    ] {
        rotations_of_means::<A>(weights, &mut sink);
    }
}

/// Bytes for codes of any kind. The ends of their range occur more often than in random bytes.
const CODES: [u8; 1024] = {
    let mut bytes = [0; 1024];
    let (mut at, mut seed) = (0, 1u32);
    while at < bytes.len() {
        seed = seed.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        bytes[at] = match seed >> 29 {
            0 => 0x7F,
            1 => 0x81,
            2 => 0xFF,
            3 => 0,
            _ => (seed >> 16) as u8,
        };
        at += 1;
    }
    bytes
};

/// Rotations of means with `weights`, for every number of stages modulo the number that is computed together, and for
/// codes at odd and even addresses.
fn rotations_of_means<A: Arithmetic>(weights: [u32; 4], sink: &mut impl FnMut(u32)) {
    let mut rotations = [Rotation::NONE; MOST_FEW_STAGES];
    for stages in 0..=MOST_FEW_STAGES {
        let bytes = |from: usize| [0, 111, 200, 301].map(|node| &CODES[from + node..][..stages]);
        let codes = Codes {
            codes: [400, 511, 600, 701].map(|node| {
                let bytes = &CODES[node..][..2 * stages];
                bytes.as_chunks().0
            }),
            factors: weights.map(|weight| (weight * PER_CODE).cast_signed()),
        };
        let fine = Run::Fine {
            codes,
            fractions: bytes(3),
            factors: weights.map(|weight| (weight * PER_FRACTION).cast_signed()),
        };
        let tail = Run::Tail {
            codes: bytes(9),
            factors: weights.map(|weight| (weight * 17_001).cast_signed()),
        };
        for run in [Run::Codes(codes), fine, tail] {
            let rotations = &mut rotations[..stages];
            A::mean_rotations(&run, rotations);
            for rotation in rotations {
                for word in [rotation.cos, rotation.sin, rotation.neg_sin] {
                    sink(word.cast_unsigned());
                }
            }
        }
    }
}

/// Lattices whose stages all rotate by ±`theta` and whose signals all begin at an end of their range, so that sums
/// saturate.
fn lattice_at_full_scale<A: Arithmetic>(theta: i32, sink: &mut impl FnMut(u32)) {
    let to_and_fro = [Rotation::from_theta(theta), Rotation::from_theta(-theta)];
    let rotations: [Rotation; MAX_ORDER] = core::array::from_fn(|stage| to_and_fro[stage / 2 % 2]);
    let ends = [i32::MAX, i32::MIN, i32::MIN];
    let state = LatticeState::from_backward(core::array::from_fn(|stage| ends[stage % 3]));
    samples_and_state::<A>(&rotations, state, |n| ends[n % 3], sink);
}

/// Lattices of every number of stages modulo the number that is computed together. Each stage rotates differently.
fn lattices_of_few_stages<A: Arithmetic>(sink: &mut impl FnMut(u32)) {
    let rotations: [Rotation; MOST_FEW_STAGES] =
        core::array::from_fn(|stage| Rotation::from_theta(THETA_QUARTER_TURN / 9 * (stage as i32 % 17 - 8)));
    for stages in 0..=MOST_FEW_STAGES {
        let excitation = |n: usize| (n as i32 - 11) * 0x0654_3217;
        let rotations = &rotations[..stages];
        samples_and_state::<A>(rotations, LatticeState::new(), excitation, sink);
    }
}

/// Passes to `sink` the samples of a lattice that begins at `state`, and its final state.
fn samples_and_state<A: Arithmetic>(
    rotations: &[Rotation],
    mut state: LatticeState,
    excitation: impl Fn(usize) -> i32,
    sink: &mut impl FnMut(u32),
) {
    for n in 0..SAMPLES {
        sink(state.filter::<A>(rotations, excitation(n)) as u32);
    }
    for &backward in state.backward(rotations.len()) {
        sink(backward as u32);
    }
}

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
