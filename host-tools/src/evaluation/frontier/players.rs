//! The variants with their state laid open, for the hard cases.

use model_format::limits::MAX_ORDER;
use model_format::{OutputSample, Texture};
use stylus_kernel::Motion;
use stylus_kernel::excitation::Excitation;
use stylus_kernel::grid::GridPoint;
use stylus_kernel::lattice::LatticeFrame;
use stylus_kernel::rotation::Rotation;
use stylus_kernel::variants::direct::{DirectFrame, DirectState};
use stylus_kernel::variants::normalised16::{Lattice16Frame, Lattice16State};
use stylus_kernel::variants::two_multiplier::{self, TwoMultiplierFrame, TwoMultiplierState};

use super::FilterStructure;
use super::predictors::Predictors;
use super::structure::NotHeld;
use crate::evaluation::stress::player::{Player, any_at, energy, player};
use crate::playing::wavefront::Wavefront;

/// A player of `structure` for `texture`, which a direct form must be able to hold.
pub fn player_of(structure: FilterStructure, texture: &Texture<'_>) -> Box<dyn Player> {
    let stages = texture.max_order();
    match structure {
        FilterStructure::TwoMultiplierLattice32 => Box::new(TwoMultiplier {
            exact: LatticeFrame::silent(stages),
            frame: TwoMultiplierFrame::silent(stages),
            state: TwoMultiplierState::new(),
            stages,
        }),
        FilterStructure::NormalisedLattice16 => Box::new(Lattice16 {
            exact: LatticeFrame::silent(stages),
            frame: Lattice16Frame::silent(stages),
            state: Lattice16State::new(),
            stages,
        }),
        _ => match structure.predictors(texture) {
            Ok(Some(predictors)) => Box::new(Direct {
                frame: DirectFrame::silent(texture, predictors.exponent()),
                state: DirectState::new(),
                predictors,
            }),
            Ok(None) | Err(NotHeld) => player(texture),
        },
    }
}

struct TwoMultiplier {
    /// Frame of the float64 filter: θ as it is stored.
    exact: LatticeFrame,
    frame: TwoMultiplierFrame,
    state: TwoMultiplierState,
    stages: usize,
}

struct Direct {
    frame: DirectFrame,
    state: DirectState,
    predictors: Predictors,
}

struct Lattice16 {
    /// Frame of the float64 filter: θ as it is stored.
    exact: LatticeFrame,
    frame: Lattice16Frame,
    state: Lattice16State,
    stages: usize,
}

fn full_scale(noise: &mut Excitation, (low, high): (i32, i32)) -> i32 {
    if noise.next_sample() < 0 { low } else { high }
}

impl Player for TwoMultiplier {
    fn follow(&mut self, texture: &Texture<'_>, motion: Motion) {
        let point = GridPoint::locate(texture, motion);
        self.frame.update(texture, &point, self.frame.levels(0), 1);
    }

    fn sample(&mut self, excitation: i32) -> (OutputSample, bool) {
        self.state.next_sample(&self.frame, excitation, 0)
    }

    /// Its full scale is 2²⁹, and it is kept doubled.
    fn newest(&self) -> i32 {
        self.state.doubled(1)[0].saturating_mul(1 << (31 - two_multiplier::FULL_SCALE_BITS - 1))
    }

    fn energy(&self) -> u128 {
        energy(self.state.doubled(self.stages).iter().copied())
    }

    fn is_at_full_scale(&self) -> bool {
        const FULL_SCALE: i32 = 2 << two_multiplier::FULL_SCALE_BITS;
        let signals = self.state.doubled(self.stages).iter().copied();
        any_at(signals, (-FULL_SCALE, FULL_SCALE - 2))
    }

    fn glitch(&mut self, noise: &mut Excitation) {
        let ends = (i32::MIN, i32::MAX);
        let state = std::array::from_fn::<_, MAX_ORDER, _>(|_| full_scale(noise, ends));
        self.state = TwoMultiplierState::from_backward(state);
    }

    fn rotations(&mut self, texture: &Texture<'_>, point: &GridPoint) -> &[Rotation] {
        let from = self.exact.levels(0);
        self.exact.update::<Wavefront>(texture, point, from, 1);
        self.exact.rotations()
    }
}

impl Player for Lattice16 {
    fn follow(&mut self, texture: &Texture<'_>, motion: Motion) {
        let point = GridPoint::locate(texture, motion);
        self.frame.update(texture, &point, self.frame.levels(0), 1);
    }

    fn sample(&mut self, excitation: i32) -> (OutputSample, bool) {
        self.state.next_sample(&self.frame, excitation, 0)
    }

    fn newest(&self) -> i32 {
        i32::from(self.state.backward(1)[0]) << 16
    }

    fn energy(&self) -> u128 {
        let signals = self.state.backward(self.stages).iter();
        energy(signals.map(|&signal| i32::from(signal)))
    }

    fn is_at_full_scale(&self) -> bool {
        let signals = self.state.backward(self.stages).iter();
        let ends = (i32::from(i16::MIN), i32::from(i16::MAX));
        any_at(signals.map(|&signal| i32::from(signal)), ends)
    }

    fn glitch(&mut self, noise: &mut Excitation) {
        let ends = (i32::from(i16::MIN), i32::from(i16::MAX));
        let state = std::array::from_fn::<_, MAX_ORDER, _>(|_| full_scale(noise, ends) as i16);
        self.state = Lattice16State::from_backward(state);
    }

    fn rotations(&mut self, texture: &Texture<'_>, point: &GridPoint) -> &[Rotation] {
        let from = self.exact.levels(0);
        self.exact.update::<Wavefront>(texture, point, from, 1);
        self.exact.rotations()
    }
}

impl Player for Direct {
    fn follow(&mut self, texture: &Texture<'_>, motion: Motion) {
        let point = GridPoint::locate(texture, motion);
        let (nodes, from) = (self.predictors.around(&point), self.frame.levels(0));
        self.frame.update(texture, &point, nodes, from, 1);
    }

    fn sample(&mut self, excitation: i32) -> (OutputSample, bool) {
        self.state.next_sample(&self.frame, excitation, 0)
    }

    fn newest(&self) -> i32 {
        self.state.history()[0]
    }

    fn energy(&self) -> u128 {
        energy(self.state.history().iter().copied())
    }

    fn is_at_full_scale(&self) -> bool {
        any_at(self.state.history().iter().copied(), (i32::MIN, i32::MAX))
    }

    fn glitch(&mut self, noise: &mut Excitation) {
        let ends = (i32::MIN, i32::MAX);
        let history = std::array::from_fn::<_, MAX_ORDER, _>(|_| full_scale(noise, ends));
        self.state = DirectState::from_history(&history);
    }

    fn settles(&self) -> bool {
        false
    }
}
