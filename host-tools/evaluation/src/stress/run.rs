//! A hard case, driven along its motion and then left to fall silent, and the mean of what it plays.

use model_format::Texture;
use rayon::prelude::*;
use stylus_fit::texture::library::decoded;
use stylus_fit::texture::quantise::rms_m_s2;
use stylus_hard_cases::{Case, Deviation, Drive, Filter, FloatLattice, Lattice, Player};
use stylus_kernel::excitation::{self, Excitation};
use stylus_kernel::grid::GridPoint;
use stylus_signals::playing::wavefront::Wavefront;
use stylus_support::Result;

use super::models;
use super::outcome::{Outcome, Rest};

/// Seed of the noise.
const SEED: u64 = 1;

/// One standard deviation of the excitation.
const DEVIATION: f64 = (1u64 << excitation::FRACTION_BITS) as f64;

/// Runs all `cases`. Calls `progress` after each case.
///
/// # Errors
/// A case whose models cannot be encoded as a library; every case here can.
pub fn run(cases: &[Case], progress: impl Fn() + Sync) -> Result<Vec<Outcome>> {
    cases
        .par_iter()
        .map(|case| {
            let outcome = play(case);
            progress();
            outcome
        })
        .collect()
}

/// Plays one case.
///
/// # Panics
/// Never: a lattice holds every texture.
pub fn play(case: &Case) -> Result<Outcome> {
    Ok(play_with(case, |texture| Some(lattice(texture)))?.expect("a lattice holds every texture"))
}

/// The kernel's lattice for `texture`, at rest, by the host's fastest arithmetic.
pub(crate) fn lattice(texture: &Texture<'_>) -> Box<dyn Filter> {
    Box::new(Lattice::<Wavefront>::new(texture))
}

/// Plays one case with the filters that `new_filter` creates for its texture, at rest each time. Returns `None` if it
/// creates none.
pub fn play_with(case: &Case, new_filter: impl Fn(&Texture<'_>) -> Option<Box<dyn Filter>>) -> Result<Option<Outcome>> {
    let mut outcome = Outcome {
        case: case.name.clone(),
        pole_radius: case.pole_radius(),
        samples: case.samples,
        ..Outcome::default()
    };
    let bytes = models::library(&case.nodes())?;
    let library = decoded(&bytes)?;
    let texture = library.textures().next().expect("one was encoded");
    let Some(mut filter) = new_filter(&texture) else {
        return Ok(None);
    };
    let again = || new_filter(&texture).expect("it was made before");
    outcome.spectrum_db = models::largest_difference_db(&case.nodes(), &texture);
    let mut player = Player::new(&mut *filter, texture, case.path, SEED);
    drive(case, &texture, &mut player, &mut outcome);
    outcome.stopped = rest(case, &mut player);

    let mut filter = again();
    let mut player = Player::new(&mut *filter, texture, case.path, SEED);
    for _ in 0..case.samples.min(50_000) {
        player.play(Drive::Loud);
    }
    outcome.overdriven = rest(case, &mut player);

    let mut filter = again();
    let mut player = Player::new(&mut *filter, texture, case.path, SEED);
    player.move_on();
    player.filter.glitch(&mut Excitation::new(99));
    outcome.glitched = rest(case, &mut player);
    Ok(Some(outcome))
}

/// Drives a case's samples and measures them.
fn drive(case: &Case, texture: &Texture<'_>, player: &mut Player<'_, dyn Filter>, outcome: &mut Outcome) {
    let mut reference = FloatLattice::new(texture.max_order());
    let mut gain = 0.0;
    let (mut snr, mut level) = (Deviation::default(), Deviation::default());
    let mut mean = Mean::of(case.samples);
    for _ in 0..case.samples {
        if let Some(motion) = player.move_on() {
            reference.rotate_by(player.filter.rotations());
            gain = rms_m_s2(texture, &GridPoint::locate(texture, motion));
        }
        let excitation = player.excitation(Drive::Noise);
        let (output, saturated) = player.filter.sample(excitation, 0);
        outcome.saturated += usize::from(saturated || player.filter.is_at_full_scale());
        let played = f64::from(player.filter.newest());
        mean.add(played);
        if case.with_reference {
            let exact = reference.filter(f64::from(excitation));
            snr.add(exact, played);
            level.add(
                exact / DEVIATION * gain,
                f64::from(output.metres_per_second_squared().0),
            );
        }
    }
    outcome.mean_standard_errors = mean.in_standard_errors();
    if case.with_reference {
        outcome.snr_db = Some(snr.snr_db());
        outcome.level_db = Some(level.level_db());
    }
}

/// Continues without excitation until there is silence, or until the longest wait is over.
fn rest(case: &Case, player: &mut Player<'_, dyn Filter>) -> Rest {
    let limit = case.rest_limit(player.filter.settles());
    let begin = player.filter.energy();
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
        player.play(Drive::Nothing);
        let energy = player.filter.energy();
        rest.growing += usize::from(energy > before);
        largest = largest.max(energy);
        before = energy;
        if n + 1000 >= limit {
            let share = f64::from(player.filter.newest().unsigned_abs()) / 2f64.powi(31);
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

/// The mean of a correlated signal, and its standard error from the scatter of the means of batches.
pub struct Mean {
    batch: usize,
    sum: f64,
    in_batch: usize,
    means: Vec<f64>,
}

impl Mean {
    /// Batches that a signal is divided into.
    const BATCHES: usize = 64;

    /// An empty mean for a signal of `samples` samples.
    pub fn of(samples: usize) -> Self {
        Self {
            batch: (samples / Self::BATCHES).max(1),
            sum: 0.0,
            in_batch: 0,
            means: Vec::with_capacity(Self::BATCHES),
        }
    }

    /// Adds the next sample.
    pub fn add(&mut self, sample: f64) {
        self.sum += sample;
        self.in_batch += 1;
        if self.in_batch == self.batch {
            self.means.push(self.sum / self.batch as f64);
            (self.sum, self.in_batch) = (0.0, 0);
        }
    }

    /// The mean's magnitude in standard errors; zero for silence.
    pub fn in_standard_errors(&self) -> f64 {
        let count = self.means.len() as f64;
        let mean = self.means.iter().sum::<f64>() / count;
        let scatter: f64 = self.means.iter().map(|batch| (batch - mean).powi(2)).sum();
        // The error follows from the means of batches, because the samples of a correlated signal are not independent.
        // A batch is longer than the signal's correlation, unless a narrow line rings for longer.
        let error = (scatter / (count - 1.0) / count).sqrt();
        if error > 0.0 { mean.abs() / error } else { 0.0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use test_helpers::noise;

    #[test]
    fn a_mean_that_is_not_zero_is_seen_and_one_that_is_is_not() {
        let errors = |offset: f64| {
            let mut mean = Mean::of(64_000);
            noise(3, 64_000).iter().for_each(|x| mean.add(x + offset));
            mean.in_standard_errors()
        };
        // The standard error is 1/253.
        assert!(errors(0.0) < 4.0);
        assert!((6.0..14.0).contains(&errors(0.04)), "{}", errors(0.04));
    }
}
