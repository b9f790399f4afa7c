//! A hard case, driven along its motion and then left to fall silent.

use model_format::{OutputSample, Texture};
use rayon::prelude::*;
use stylus_kernel::excitation::{self, Excitation};
use stylus_kernel::grid::GridPoint;

use crate::support::error::Result;
use crate::texture::library::decoded;
use crate::texture::quantise::rms_m_s2;

use super::cases::Case;
use super::models;
use super::outcome::{Outcome, Rest};
use super::player::{Player, player};
use super::reference::{Deviation, FloatLattice, Mean};

/// Gain of the overdrive: from an RMS of an eighth of full scale to one of a third.
const OVERDRIVE: f64 = 8.0 / 3.0;

/// One standard deviation of the excitation.
const DEVIATION: f64 = (1u64 << excitation::FRACTION_BITS) as f64;

/// Runs all `cases`. Calls `progress` after each case.
///
/// # Errors
/// A case whose models cannot be encoded as a library; every case here can.
pub fn run(cases: &[Case], progress: impl Fn() + Sync) -> Result<Vec<Outcome>> {
    let outcomes = cases.par_iter().map(|case| {
        let outcome = play(case);
        progress();
        outcome
    });
    outcomes.collect()
}

/// Plays one case.
///
/// # Errors
/// A case whose models cannot be encoded as a library.
///
/// # Panics
/// Never: a lattice holds every texture.
pub fn play(case: &Case) -> Result<Outcome> {
    let outcome = play_with(case, |texture| Some(player(texture)))?;
    Ok(outcome.expect("a lattice holds every texture"))
}

/// Plays one case with the players that `new_player` creates for its texture, at rest each time. Returns `None` if it
/// creates none.
///
/// # Errors
/// A case whose models cannot be encoded as a library.
pub fn play_with(
    case: &Case,
    new_player: impl Fn(&Texture<'_>) -> Option<Box<dyn Player>>,
) -> Result<Option<Outcome>> {
    let mut outcome = Outcome {
        case: case.name.clone(),
        pole_radius: case.pole_radius(),
        ..Outcome::default()
    };
    let bytes = models::library(&case.nodes())?;
    let library = decoded(&bytes)?;
    let texture = library.textures().next().expect("one was encoded");
    let Some(first) = new_player(&texture) else {
        return Ok(None);
    };
    let again = || new_player(&texture).expect("it was made before");
    let mut bench = Bench::new(case, texture, first);
    outcome.samples = case.samples;
    outcome.spectrum_db = models::largest_difference_db(&case.nodes(), &texture);
    bench.drive(1.0, case.samples, &mut outcome);
    outcome.stopped = bench.rest();

    let mut bench = Bench::new(case, texture, again());
    for _ in 0..case.samples.min(50_000) {
        bench.sample(OVERDRIVE);
    }
    outcome.overdriven = bench.rest();

    let mut bench = Bench::new(case, texture, again());
    bench.move_on();
    let mut signs = Excitation::new(99);
    bench.player.glitch(&mut signs);
    outcome.glitched = bench.rest();
    Ok(Some(outcome))
}

/// A texture that is played along a case's motion.
struct Bench<'a> {
    case: &'a Case,
    texture: Texture<'a>,
    player: Box<dyn Player>,
    noise: Excitation,
    sample: usize,
}

impl<'a> Bench<'a> {
    fn new(case: &'a Case, texture: Texture<'a>, player: Box<dyn Player>) -> Self {
        Self {
            case,
            texture,
            player,
            noise: Excitation::new(1),
            sample: 0,
        }
    }

    /// Moves the player if the case's motion changes at this sample, and returns whether it does.
    fn move_on(&mut self) -> bool {
        let changes = self.case.path.changes_at(self.sample);
        if changes {
            let motion = self.case.path.motion(self.sample);
            // A ramp of one sample: the level jumps with the motion, as that of the reference does.
            self.player.follow(&self.texture, motion, 0, 1);
        }
        self.sample += 1;
        changes
    }

    fn sample(&mut self, drive: f64) -> (OutputSample, bool) {
        self.move_on();
        let excitation = f64::from(self.noise.next_sample()) * drive;
        self.player.sample(excitation as i32, 0)
    }

    /// Drives `samples` samples and measures them.
    fn drive(&mut self, drive: f64, samples: usize, outcome: &mut Outcome) {
        let mut reference = FloatLattice::new(self.texture.max_order());
        let mut gain = 0.0;
        let (mut snr, mut level) = (Deviation::default(), Deviation::default());
        let mut mean = Mean::of(samples);
        for _ in 0..samples {
            if self.move_on() {
                // `move_on` has counted this sample already.
                let motion = self.case.path.motion(self.sample - 1);
                let point = GridPoint::locate(&self.texture, motion);
                reference.rotate_by(self.player.rotations());
                gain = rms_m_s2(&self.texture, &point);
            }
            let excitation = (f64::from(self.noise.next_sample()) * drive) as i32;
            let (output, saturated) = self.player.sample(excitation, 0);
            outcome.saturated += usize::from(saturated || self.player.is_at_full_scale());
            mean.add(f64::from(self.player.newest()));
            if self.case.with_reference {
                let exact = reference.filter(f64::from(excitation));
                let played = f64::from(self.player.newest());
                snr.add(exact, played);
                level.add(
                    exact / DEVIATION * gain,
                    f64::from(output.metres_per_second_squared().0),
                );
            }
        }
        outcome.mean_standard_errors = mean.in_standard_errors();
        if self.case.with_reference {
            outcome.snr_db = Some(snr.snr_db());
            outcome.level_db = Some(level.level_db());
        }
    }

    /// Continues without excitation until there is silence, or until the longest wait is over.
    fn rest(&mut self) -> Rest {
        let limit = self.case.rest_limit(self.player.settles());
        let begin = self.player.energy();
        let mut rest = Rest {
            limit,
            ..Rest::default()
        };
        let (mut before, mut largest) = (begin, begin);
        for n in 0..limit {
            if before == 0 {
                rest.silent_after = Some(n);
                break;
            }
            self.move_on();
            self.player.sample(0, 0);
            let energy = self.player.energy();
            rest.growing += usize::from(energy > before);
            largest = largest.max(energy);
            before = energy;
            if n + 1000 >= limit {
                let share = f64::from(self.player.newest().unsigned_abs()) / 2f64.powi(31);
                rest.left = rest.left.max(share);
            }
        }
        // The last thousand samples of the wait may have begun before the silence did.
        if rest.silent_after.is_some() {
            rest.left = 0.0;
        }
        // A state that began at zero has no level to grow from.
        rest.growth_db = 10.0 * (largest as f64 / (begin as f64).max(1.0)).log10();
        rest
    }
}
