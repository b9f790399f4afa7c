//! The structures that are compared: how each is stored and played, and its state, for the hard cases.

use std::mem::size_of;

use model_format::limits::{self, MAX_ORDER};
use model_format::{OutputSample, Texture};
use stylus_costs::Structure;
use stylus_dsp::linear_prediction::{step_down, step_up};
use stylus_fit::texture::quantise::reflection;
use stylus_fit::texture::theta::{StoredTheta, bytes_per_node};
use stylus_hard_cases::{Filter, any_at_end, energy, full_scale};
use stylus_kernel::Motion;
use stylus_kernel::direct_form::{CODE_SUM_LIMIT, COEFFICIENT_FRACTION_BITS, DirectFrame, DirectState, MAX_EXPONENT};
use stylus_kernel::excitation::Excitation;
use stylus_kernel::grid::GridPoint;
use stylus_kernel::rotation::Rotation;

use crate::stress::lattice;

/// A texture that a direct form cannot hold.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NotHeld;

/// Returns the predictors with which `structure` plays `texture`; none for a lattice.
pub(super) fn predictors(structure: Structure, texture: &Texture<'_>) -> Result<Option<Predictors>, NotHeld> {
    let bits = match structure {
        Structure::DirectForm16 => 16,
        Structure::DirectForm32 => 32,
        Structure::NormalisedLattice32 => return Ok(None),
    };
    Predictors::of(texture, bits).map(Some).ok_or(NotHeld)
}

/// A filter of `structure` for `texture`.
pub fn filter_of(structure: Structure, texture: &Texture<'_>) -> Result<Box<dyn Filter>, NotHeld> {
    Ok(match predictors(structure, texture)? {
        Some(predictors) => Box::new(Direct {
            frame: DirectFrame::silent(texture, predictors.exponent()),
            state: DirectState::new(),
            predictors,
        }),
        None => lattice(texture),
    })
}

struct Direct {
    frame: DirectFrame,
    state: DirectState,
    predictors: Predictors,
}

impl Filter for Direct {
    fn follow(&mut self, texture: &Texture<'_>, motion: Motion, left: u32, samples: u32) {
        let point = GridPoint::locate(texture, motion);
        let (nodes, from) = (self.predictors.around(&point), self.frame.levels(left));
        self.frame.update(texture, &point, nodes, from, samples);
    }

    fn sample(&mut self, excitation: i32, left: u32) -> (OutputSample, bool) {
        self.state.next_sample(&self.frame, excitation, left)
    }

    fn newest(&self) -> i32 {
        self.state.history()[0]
    }

    fn energy(&self) -> u128 {
        energy(self.state.history())
    }

    fn is_at_full_scale(&self) -> bool {
        any_at_end(self.state.history())
    }

    fn glitch(&mut self, noise: &mut Excitation) {
        let history = std::array::from_fn::<_, MAX_ORDER, _>(|_| full_scale(noise));
        self.state = DirectState::from_history(&history);
    }

    fn settles(&self) -> bool {
        // Between two stable nodes, a direct form may be unstable.
        false
    }
}

/// The predictors of all nodes of a texture.
#[derive(Clone, Debug)]
pub struct Predictors {
    /// Codes by node, speed-major, each of as many taps as the texture's highest order.
    codes: Vec<Vec<i32>>,
    forces: usize,
    exponent: u32,
}

impl Predictors {
    /// The predictors of `texture`, each rounded to `bits` bits. `None` if one of them is too large for that, or not
    /// stable after rounding.
    pub fn of(texture: &Texture<'_>, bits: u32) -> Option<Self> {
        let taps = texture.max_order();
        let nodes = texture.nodes().map(|node| {
            let polynomial = step_up(&reflection(node.coefficients));
            // A predictor adds what the polynomial subtracts: hᵢ = -aᵢ.
            let mut predictor: Vec<f64> = polynomial.iter().map(|a| -a).collect();
            // The kernel's frame averages the taps of four nodes one by one, so all nodes have as many.
            predictor.resize(taps, 0.0);
            predictor
        });
        let nodes: Vec<Vec<f64>> = nodes.collect();
        let needed = nodes.iter().map(|predictor| exponent_of(predictor, bits));
        // Codes of different nodes are averaged, so they need one scale.
        let exponent = needed.max().unwrap_or(0);
        let codes = nodes.iter().map(|predictor| {
            let rounded = rounded(predictor, bits);
            let polynomial: Vec<f64> = rounded.iter().map(|h| -h).collect();
            // Rounding to 16 bits makes some stable filters unstable, such as the hard case H4.
            step_down(&polynomial)?;
            let one = 2f64.powi(COEFFICIENT_FRACTION_BITS as i32 - exponent);
            Some(rounded.iter().map(|h| (h * one) as i32).collect())
        });
        let codes = codes.collect::<Option<Vec<_>>>()?;
        let exponent = u32::try_from(exponent).ok().filter(|&e| e <= MAX_EXPONENT)?;
        Some(Self {
            codes,
            forces: texture.force_axis().len(),
            exponent,
        })
    }

    /// The binary exponent that all predictors have in common.
    pub fn exponent(&self) -> u32 {
        self.exponent
    }

    /// The predictors of the nodes around `point`.
    pub fn around(&self, point: &GridPoint) -> [&[i32]; 4] {
        point
            .nodes
            .map(|(speed, force)| self.codes[speed * self.forces + force].as_slice())
    }
}

/// Returns `predictor` rounded to `bits` bits. Its own exponent determines the step; the codes have the common
/// exponent.
fn rounded(predictor: &[f64], bits: u32) -> Vec<f64> {
    let step = 2f64.powi(exponent_of(predictor, bits) + 1 - bits as i32);
    predictor.iter().map(|h| (h / step).round() * step).collect()
}

/// Returns the least exponent at which the codes of `predictor` fit into their words of `bits` bits, and their sum into
/// the kernel's limit.
fn exponent_of(predictor: &[f64], bits: u32) -> i32 {
    let largest = predictor.iter().fold(0.0, |most: f64, h| most.max(h.abs()));
    let sum: f64 = predictor.iter().map(|h| h.abs()).sum();
    // Rounding may add half a step to each tap.
    let added = predictor.len() as f64 / 2f64.powi(bits as i32);
    let room = CODE_SUM_LIMIT as f64 / 2f64.powi(COEFFICIENT_FRACTION_BITS as i32) - added;
    let holds = |exponent: i32| {
        let scale = 2f64.powi(exponent);
        largest < 0.9999 * scale && sum < room * scale
    };
    (0..64).find(|&exponent| holds(exponent)).unwrap_or(64)
}

/// Returns the bytes of flash for a node's coefficients. A lattice takes the smallest form of θ that `fit` stores, and
/// a direct form takes its own words.
pub(super) fn library_bytes_per_node(structure: Structure, order: usize) -> usize {
    let theta = match structure {
        Structure::DirectForm16 => return order * size_of::<i16>(),
        Structure::DirectForm32 => return order * size_of::<i32>(),
        Structure::NormalisedLattice32 if order > limits::MAX_FINE_STAGES => StoredTheta::Compact,
        Structure::NormalisedLattice32 => StoredTheta::Fine,
    };
    bytes_per_node(theta, order, order)
}

/// Bytes of RAM for the coefficients of two frames, one in use and one being computed, and for the state.
pub(super) fn ram_bytes(structure: Structure, order: usize) -> usize {
    const FRAMES: usize = 2;
    if structure.is_direct() {
        // The history is written twice so that it never wraps.
        return (FRAMES + 2) * order * size_of::<i32>();
    }
    FRAMES * order * size_of::<Rotation>() + (order + 1) * size_of::<i32>()
}

/// A texture that a structure plays, from rest. The same seed gives all structures the same noise.
pub struct Voice<'a> {
    texture: Texture<'a>,
    filter: Box<dyn Filter>,
    excitation: Excitation,
    /// Number of samples that are left of the level's ramp.
    left: u32,
    saturations: u32,
}

impl<'a> Voice<'a> {
    /// Creates a voice that plays `texture` with `structure`, at rest.
    pub fn new(structure: Structure, texture: Texture<'a>, seed: u64) -> Result<Self, NotHeld> {
        Ok(Self {
            texture,
            filter: filter_of(structure, &texture)?,
            excitation: Excitation::new(seed),
            left: 0,
            saturations: 0,
        })
    }

    /// Follows `motion` from now on. The level reaches that of `motion` after `samples` samples.
    pub fn follow(&mut self, motion: Motion, samples: u32) {
        self.filter.follow(&self.texture, motion, self.left, samples);
        self.left = samples;
    }

    /// Appends the next samples, m/s², to `signal`. Their conversion from fixed point is exact.
    pub fn play(&mut self, samples: usize, signal: &mut Vec<f64>) {
        const UNIT: f64 = (1u32 << OutputSample::FRACTION_BITS) as f64;
        for _ in 0..samples {
            self.left = self.left.saturating_sub(1);
            let excitation = self.excitation.next_sample();
            let (output, is_full) = self.filter.sample(excitation, self.left);
            self.saturations += u32::from(is_full);
            signal.push(f64::from(output.0) / UNIT);
        }
    }

    /// Returns the number of samples at full scale.
    pub fn saturations(&self) -> u32 {
        self.saturations
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rounding_keeps_the_sum_of_as_many_taps_as_there_may_be_within_the_kernels_limit() {
        // Each of them is rounded up by half a step of 16 bits.
        let predictor = [163.5 / 32_768.0; MAX_ORDER];
        let exponent = exponent_of(&predictor, 16);
        let one = 2f64.powi(COEFFICIENT_FRACTION_BITS as i32 - exponent);
        let sum: f64 = rounded(&predictor, 16).iter().map(|h| h * one).sum();
        assert!(sum < CODE_SUM_LIMIT as f64, "{sum} at {exponent}");
    }
}
