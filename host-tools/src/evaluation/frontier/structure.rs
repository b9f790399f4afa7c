//! The structures that are compared, and how each is stored and played.

use std::mem::size_of;

use model_format::{OutputSample, Texture, limits};
use serde::{Deserialize, Serialize};
use stylus_costs::Structure;
use stylus_kernel::excitation::Excitation;
use stylus_kernel::grid::GridPoint;
use stylus_kernel::rotation::Rotation;
use stylus_kernel::variants::direct::{DirectFrame, DirectState};
use stylus_kernel::variants::normalised16::{Lattice16Frame, Lattice16State, Rotation16};
use stylus_kernel::variants::two_multiplier::{TwoMultiplierFrame, TwoMultiplierState};
use stylus_kernel::{Motion, Synthesis};

use super::predictors::Predictors;
use crate::playing::wavefront::Wavefront;
use crate::texture::theta::{StoredTheta, bytes_per_node};

/// A structure and its word length, in the order of reports; the table of costs names it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(into = "Structure", from = "Structure")]
pub enum FilterStructure {
    /// Direct form with coefficients of 16 bits, played in 32; not shipped.
    DirectForm16,
    /// Direct form in 32 bits; not shipped.
    DirectForm32,
    /// Two-multiplier lattice in 32 bits; not shipped.
    TwoMultiplierLattice32,
    /// Normalised lattice in 16 bits; not shipped.
    NormalisedLattice16,
    /// Normalised lattice in 32 bits, the stylus's own.
    NormalisedLattice32,
}

impl std::fmt::Display for FilterStructure {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(Structure::from(*self).name())
    }
}

impl From<FilterStructure> for Structure {
    fn from(structure: FilterStructure) -> Self {
        match structure {
            FilterStructure::DirectForm16 => Self::DirectForm16,
            FilterStructure::DirectForm32 => Self::DirectForm32,
            FilterStructure::TwoMultiplierLattice32 => Self::TwoMultiplierLattice32,
            FilterStructure::NormalisedLattice16 => Self::NormalisedLattice16,
            FilterStructure::NormalisedLattice32 => Self::NormalisedLattice32,
        }
    }
}

impl From<Structure> for FilterStructure {
    fn from(structure: Structure) -> Self {
        match structure {
            Structure::DirectForm16 => Self::DirectForm16,
            Structure::DirectForm32 => Self::DirectForm32,
            Structure::TwoMultiplierLattice32 => Self::TwoMultiplierLattice32,
            Structure::NormalisedLattice16 => Self::NormalisedLattice16,
            Structure::NormalisedLattice32 => Self::NormalisedLattice32,
        }
    }
}

impl FilterStructure {
    /// All of them.
    pub const ALL: [Self; 5] = [
        Self::DirectForm16,
        Self::DirectForm32,
        Self::TwoMultiplierLattice32,
        Self::NormalisedLattice16,
        Self::NormalisedLattice32,
    ];

    /// Returns whether it sums over past outputs.
    pub fn is_direct(self) -> bool {
        matches!(self, Self::DirectForm16 | Self::DirectForm32)
    }

    /// Returns whether the stylus plays it.
    pub fn is_shipped(self) -> bool {
        self == Self::NormalisedLattice32
    }

    /// The predictors that it plays `texture` by; none of a lattice.
    ///
    /// # Errors
    /// A direct form cannot hold the texture.
    pub fn predictors(self, texture: &Texture<'_>) -> Result<Option<Predictors>, NotHeld> {
        let bits = match self {
            Self::DirectForm16 => 16,
            Self::DirectForm32 => 32,
            _ => return Ok(None),
        };
        Predictors::of(texture, bits).map(Some).ok_or(NotHeld)
    }

    /// Bytes of flash that a node's coefficients take: of a lattice in the smallest form that `fit` stores, of a direct
    /// form in its own words.
    pub fn library_bytes_per_node(self, order: usize) -> usize {
        match self {
            Self::DirectForm16 => return order * size_of::<i16>(),
            Self::DirectForm32 => return order * size_of::<i32>(),
            _ => {}
        }
        let theta = if order > limits::MAX_FINE_STAGES {
            StoredTheta::Compact
        } else {
            StoredTheta::Fine
        };
        bytes_per_node(theta, order, order)
    }

    /// Bytes of RAM for the coefficients of two frames, one played and one in the making, and for the state.
    pub fn ram_bytes(self, order: usize) -> usize {
        const FRAMES: usize = 2;
        let lattice = |stage: usize, signal: usize| FRAMES * order * stage + (order + 1) * signal;
        // The history is written twice so that it never wraps.
        let direct = (FRAMES + 2) * order * size_of::<i32>();
        match self {
            Self::DirectForm16 | Self::DirectForm32 => direct,
            Self::TwoMultiplierLattice32 => lattice(size_of::<i32>(), size_of::<i32>()),
            Self::NormalisedLattice16 => lattice(size_of::<Rotation16>(), size_of::<i16>()),
            Self::NormalisedLattice32 => lattice(size_of::<Rotation>(), size_of::<i32>()),
        }
    }
}

/// A texture being played by a structure, from rest; a seed gives the same noise in all of them.
pub enum Voice<'a> {
    /// The very synthesis of the stylus, but for its beginning, which is the variants'.
    Shipped(Box<Synthesis<'a, Wavefront>>),
    /// A variant.
    TwoMultiplier(Box<Variant<'a, TwoMultiplierFrame, TwoMultiplierState>>),
    /// A variant.
    Lattice16(Box<Variant<'a, Lattice16Frame, Lattice16State>>),
    /// A variant, with its predictors.
    Direct(Box<Variant<'a, DirectFrame, DirectState>>, Predictors),
}

/// A texture that a direct form cannot hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NotHeld;

/// A variant that is being played.
pub struct Variant<'a, F, S> {
    texture: Texture<'a>,
    frame: F,
    state: S,
    excitation: Excitation,
    left: u32,
    saturations: u32,
}

impl<'a, F, S: Default> Variant<'a, F, S> {
    fn new(texture: Texture<'a>, seed: u64, frame: F) -> Self {
        Self {
            texture,
            frame,
            state: S::default(),
            excitation: Excitation::new(seed),
            left: 0,
            saturations: 0,
        }
    }
}

impl<F, S> Variant<'_, F, S> {
    /// Fills `block` with samples of `next`: state, frame, excitation, and the samples of the level's ramp to come.
    fn fill(
        &mut self,
        block: &mut [OutputSample],
        next: impl Fn(&mut S, &F, i32, u32) -> (OutputSample, bool),
    ) {
        for sample in block {
            self.left = self.left.saturating_sub(1);
            let excitation = self.excitation.next_sample();
            let (output, full) = next(&mut self.state, &self.frame, excitation, self.left);
            self.saturations += u32::from(full);
            *sample = output;
        }
    }
}

impl<'a> Voice<'a> {
    /// `texture` by `structure`, at rest.
    ///
    /// # Errors
    /// A direct form cannot hold the texture.
    pub fn new(
        structure: FilterStructure,
        texture: Texture<'a>,
        seed: u64,
    ) -> Result<Self, NotHeld> {
        let stages = texture.max_order();
        if let Some(predictors) = structure.predictors(&texture)? {
            let frame = DirectFrame::silent(&texture, predictors.exponent());
            let variant = Variant::new(texture, seed, frame);
            return Ok(Self::Direct(Box::new(variant), predictors));
        }
        Ok(match structure {
            FilterStructure::TwoMultiplierLattice32 => {
                let frame = TwoMultiplierFrame::silent(stages);
                Self::TwoMultiplier(Box::new(Variant::new(texture, seed, frame)))
            }
            FilterStructure::NormalisedLattice16 => {
                let frame = Lattice16Frame::silent(stages);
                Self::Lattice16(Box::new(Variant::new(texture, seed, frame)))
            }
            _ => Self::Shipped(Box::new(Synthesis::from_rest(texture, seed))),
        })
    }

    /// Takes over a motion; the level goes there in `samples` samples.
    pub fn follow(&mut self, motion: Motion, samples: u32) {
        match self {
            Self::Shipped(synthesis) => synthesis.follow(motion, samples),
            Self::TwoMultiplier(variant) => {
                let Variant {
                    texture,
                    frame,
                    left,
                    ..
                } = variant.as_mut();
                let point = GridPoint::locate(texture, motion);
                frame.update(texture, &point, frame.levels(*left), samples);
                *left = samples;
            }
            Self::Lattice16(variant) => {
                let Variant {
                    texture,
                    frame,
                    left,
                    ..
                } = variant.as_mut();
                let point = GridPoint::locate(texture, motion);
                frame.update(texture, &point, frame.levels(*left), samples);
                *left = samples;
            }
            Self::Direct(variant, predictors) => {
                let Variant {
                    texture,
                    frame,
                    left,
                    ..
                } = variant.as_mut();
                let point = GridPoint::locate(texture, motion);
                let (nodes, from) = (predictors.around(&point), frame.levels(*left));
                frame.update(texture, &point, nodes, from, samples);
                *left = samples;
            }
        }
    }

    /// The next samples, m/s², exactly, behind those in `signal`.
    pub fn play(&mut self, samples: usize, signal: &mut Vec<f64>) {
        let mut block = vec![OutputSample::SILENCE; samples];
        match self {
            Self::Shipped(synthesis) => synthesis.next_block(&mut block),
            Self::TwoMultiplier(variant) => {
                variant.fill(&mut block, TwoMultiplierState::next_sample);
            }
            Self::Lattice16(variant) => variant.fill(&mut block, Lattice16State::next_sample),
            Self::Direct(variant, _) => variant.fill(&mut block, DirectState::next_sample),
        }
        let unit = f64::from(1u32 << OutputSample::FRACTION_BITS);
        signal.extend(block.into_iter().map(|sample| f64::from(sample.0) / unit));
    }

    /// Returns the number of samples at full scale.
    pub fn saturations(&self) -> u32 {
        match self {
            Self::Shipped(synthesis) => synthesis.saturations(),
            Self::TwoMultiplier(variant) => variant.saturations,
            Self::Lattice16(variant) => variant.saturations,
            Self::Direct(variant, _) => variant.saturations,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluation::stress::models::{fixtures, library};
    use model_format::{Library, MillimetresPerSecond, Newton};

    /// The same models and the same noise.
    #[test]
    fn all_structures_play_the_same_to_within_their_words() {
        let models = fixtures();
        let nodes: Vec<_> = [0, 1, 3, 0].map(|index| (&models[index], 4.0)).to_vec();
        let bytes = library(&nodes).unwrap();
        let library = Library::decode(&bytes).unwrap();
        let texture = library.textures().next().unwrap();
        let play = |structure| {
            let mut voice = Voice::new(structure, texture, 7).unwrap();
            let mut signal = Vec::new();
            for n in (0..5000u16).step_by(10) {
                let speed = MillimetresPerSecond(150.0 + f32::from(n) / 100.0);
                voice.follow(Motion::new(speed, Newton(0.7)).unwrap(), 10);
                voice.play(10, &mut signal);
            }
            signal
        };
        let exact = play(FilterStructure::NormalisedLattice32);
        let power: f64 = exact.iter().map(|x| x * x).sum();
        for (structure, least_db) in [
            (FilterStructure::TwoMultiplierLattice32, 40.0),
            (FilterStructure::NormalisedLattice16, 40.0),
        ] {
            let other = play(structure);
            let error: f64 = exact.iter().zip(other).map(|(a, b)| (a - b).powi(2)).sum();
            let snr_db = 10.0 * (power / error).log10();
            println!("{structure}: {snr_db:.1} dB");
            assert!(snr_db > least_db, "{structure}: {snr_db} dB");
        }
    }
}
