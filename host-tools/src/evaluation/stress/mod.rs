//! Hard cases: models, grids, motions and states that break filters, played by the device's kernel, with what it promises of
//! a normalised lattice checked and the direct form's behaviour beside.
//!
//! Each case is driven with noise, at the level that the kernel always has, an RMS of an eighth of full scale, along its
//! motion; then the drive stops, and the motion goes on until there is silence. Then it is driven with 8/3 of that, an RMS
//! of a third of full scale, and stopped again; and once more from a state that is full scale throughout.
//!
//! *Level* is measured against the same filter in float64 on the same noise, whose power is known exactly: a lattice's is one for
//! noise of power one, whatever its rotations. So it needs no minutes of averaging. *SNR* is against float64 with the
//! same coefficients. *Spectrum* is the largest difference, at any frequency, between the model as it was fitted and as
//! it is stored.

pub mod cases;
pub mod models;
pub mod player;
pub mod reference;
mod spectrum;

use model_format::{Coefficients, Library, OutputSample, Structure, THETA_STEP_RAD, Texture};
use rayon::prelude::*;
use serde::Serialize;
use stylus_kernel::excitation::{self, Excitation};
use stylus_kernel::grid::{GridPoint, ONE};
use stylus_kernel::level::rms_in_steps;

use crate::dsp::linear_prediction::step_down;
use crate::support::error::{Error, Result};
use crate::texture::quantise::StructureChoice;

use cases::Case;
use player::{Player, player};
use reference::{Deviation, FloatDirect, FloatLattice, Mean};

/// What a lattice must hold: dB from the node's power.
pub const LEVEL_DB: f64 = 0.2;
/// What a lattice must hold: dB above the noise of its arithmetic; see [`snr_limit_db`].
pub const SNR_DB: f64 = 108.0;
/// What a lattice must hold: standard errors of the mean from zero.
pub const MEAN_STANDARD_ERRORS: f64 = 4.0;
/// What a lattice must hold: dB between fitted and stored spectrum; see [`spectrum_limit_db`].
pub const SPECTRUM_DB: f64 = 0.05;

/// Largest pole radius up to which [`SNR_DB`] is promised.
const SNR_RADIUS: f64 = 0.999;

/// The SNR that is promised of models of this pole radius, dB.
///
/// What truncation takes from a signal it takes in proportion to no more than a step a stage and sample, always toward zero: it
/// damps. A line that rings for 1/(1 - r) samples adds that up, in phase with itself, so that each tenth of 1 - r beyond
/// 0.999 costs 20 dB. 3 dB more are for lines that have not rung up yet. The level stays; at radius 0.99999 it is off by two
/// thousandths of a dB.
pub fn snr_limit_db(pole_radius: f64) -> f64 {
    let beyond = (1.0 - SNR_RADIUS) / (1.0 - pole_radius).max(f64::MIN_POSITIVE);
    // Not for 0.999 itself and the rounding of it.
    if beyond < 1.0 + 1e-9 {
        SNR_DB
    } else {
        SNR_DB - 3.0 - 20.0 * beyond.log10()
    }
}

/// The difference of spectra that is promised of models of this pole radius, dB.
///
/// Half a step of θ moves a line by 2.4e-5 rad, 0.02 Hz at 5 kHz. A line of half width 1 - r that is moved by s half widths
/// differs from itself by up to 20 log₁₀((s + √(s² + 4)) / 2), on its flank: 0.05 dB at radius 0.998, 8.8 dB at 0.99999, a line
/// 0.016 Hz wide.
pub fn spectrum_limit_db(pole_radius: f64) -> f64 {
    let shift = THETA_STEP_RAD / 2.0 / (1.0 - pole_radius).max(f64::MIN_POSITIVE);
    let flank = 20.0 * (shift.midpoint((shift * shift + 4.0).sqrt())).log10();
    flank.max(SPECTRUM_DB)
}

/// How much louder than ever the third run is driven: from an RMS of an eighth of full scale to one of a third.
const OVERDRIVE: f64 = 8.0 / 3.0;

/// One standard deviation of the excitation.
const DEVIATION: f64 = (1u64 << excitation::FRACTION_BITS) as f64;

/// What came of a case in a structure.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Outcome {
    /// Models and motion.
    pub case: String,
    /// The structure, as the format calls it.
    pub structure: String,
    /// Largest pole radius of the models.
    pub pole_radius: f64,
    /// How many samples were driven.
    pub samples: usize,
    /// Why `fit` would not make such a texture, if so; then nothing was played.
    pub refused: Option<String>,
    /// Samples in which any signal of the state was at full scale while driven.
    pub saturated: usize,
    /// Level over the model's, dB, where it is known.
    pub level_db: Option<f64>,
    /// Signal to noise of the arithmetic, dB, where there is a float64 filter to compare with.
    pub snr_db: Option<f64>,
    /// The mean's distance from zero in standard errors.
    pub mean_standard_errors: f64,
    /// Largest difference of the stored from the fitted spectrum, dB.
    pub spectrum_db: f64,
    /// After the drive stopped.
    pub stopped: Rest,
    /// After an overdrive stopped.
    pub overdriven: Rest,
    /// After full scale in every signal of the state.
    pub glitched: Rest,
}

/// What came after the drive.
#[derive(Clone, Copy, Debug, Default, Serialize)]
pub struct Rest {
    /// Samples until nothing was left in the state; `None` if there was something to the end.
    pub silent_after: Option<usize>,
    /// How many samples the end was.
    pub limit: usize,
    /// Samples at which the state's norm grew, without any input.
    pub growing: usize,
    /// Largest norm over that at the begin, dB.
    pub growth_db: f64,
    /// Largest magnitude in the last thousand samples, as a share of full scale.
    pub left: f64,
}

impl Outcome {
    /// What a lattice promises and this does not hold, each in a few words.
    pub fn broken(&self) -> Vec<String> {
        if let Some(refusal) = &self.refused {
            return vec![format!("refused: {refusal}")];
        }
        let (mut broken, lattice) = (Vec::new(), self.is_lattice());
        let mut unless = |holds: bool, what: String| {
            if !holds {
                broken.push(what);
            }
        };
        unless(self.saturated == 0, format!("{} saturated", self.saturated));
        let level = self.level_db.unwrap_or(0.0);
        unless(level.abs() <= LEVEL_DB, format!("level {level:+.2} dB"));
        let snr = self.snr_db.unwrap_or(f64::INFINITY);
        unless(
            snr >= snr_limit_db(self.pole_radius),
            format!("SNR {snr:.0} dB"),
        );
        let mean = self.mean_standard_errors;
        unless(mean <= MEAN_STANDARD_ERRORS, format!("mean {mean:.1} SE"));
        let spectrum = self.spectrum_db;
        unless(
            spectrum <= spectrum_limit_db(self.pole_radius),
            format!("spectrum {spectrum:.2} dB"),
        );
        for (rest, after) in [
            (self.stopped, "stop"),
            (self.overdriven, "overdrive"),
            (self.glitched, "glitch"),
        ] {
            unless(
                // A direct form's state may well grow by a little; that is not worth a word.
                rest.growing == 0 || !lattice && rest.growth_db < 0.1,
                format!("grows {:.1} dB after {after}", rest.growth_db),
            );
            unless(
                rest.silent_after.is_some(),
                match rest.left {
                    left if left > 0.01 => format!("latched at {left:.2} FS after {after}"),
                    left => format!("{left:.0e} FS left after {after}"),
                },
            );
        }
        broken
    }

    /// Whether SNR and spectrum are within what is promised of all but narrow lines.
    pub fn is_within_common_limits(&self) -> bool {
        self.snr_db.is_none_or(|snr| snr >= SNR_DB) && self.spectrum_db <= SPECTRUM_DB
    }

    /// Whether the promises of SNR and spectrum are the weaker ones of narrow lines.
    pub fn is_narrow(&self) -> bool {
        snr_limit_db(self.pole_radius) < SNR_DB || spectrum_limit_db(self.pole_radius) > SPECTRUM_DB
    }

    /// Whether it is the structure that all of this is promised of.
    pub fn is_lattice(&self) -> bool {
        self.structure == Structure::NormalisedLattice.to_string()
    }
}

/// Runs all of `cases` in all structures; `progress` is told of each that is done.
///
/// # Errors
/// A case that makes no library of lattices, which none does.
pub fn run(cases: &[Case], progress: impl Fn() + Sync) -> Result<Vec<Outcome>> {
    const STRUCTURES: [StructureChoice; 3] = [
        StructureChoice::Lattice,
        StructureChoice::Direct,
        StructureChoice::Direct16,
    ];
    let runs: Vec<(&Case, StructureChoice)> = cases
        .iter()
        .flat_map(|case| STRUCTURES.map(|structure| (case, structure)))
        .filter(|(case, structure)| !case.lattice_only || *structure == StructureChoice::Lattice)
        .collect();
    let outcomes = runs.into_par_iter().map(|(case, structure)| {
        let outcome = play(case, structure);
        progress();
        outcome
    });
    outcomes.collect()
}

/// Plays one case in one structure.
///
/// # Errors
/// A lattice that makes no library.
pub fn play(case: &Case, structure: StructureChoice) -> Result<Outcome> {
    play_with(case, structure, player)
}

/// Plays one case, stored in one structure, by what `new_player` makes for its texture, at rest each time.
///
/// # Errors
/// A lattice that makes no library.
pub fn play_with(
    case: &Case,
    structure: StructureChoice,
    new_player: impl Fn(&Texture<'_>) -> Box<dyn Player>,
) -> Result<Outcome> {
    let mut outcome = Outcome {
        case: case.name.clone(),
        pole_radius: case.pole_radius(),
        structure: structure.structure().to_string(),
        ..Outcome::default()
    };
    let bytes = match models::library(&case.nodes(), structure) {
        Ok(bytes) => bytes,
        Err(refusal) if structure != StructureChoice::Lattice => {
            outcome.refused = Some(refusal.to_string());
            return Ok(outcome);
        }
        Err(failure) => return Err(failure),
    };
    let library =
        Library::decode_uncertified(&bytes).map_err(|failure| Error::Model(failure.to_string()))?;
    let texture = library.textures().next().expect("one was encoded");
    let mut bench = Bench::new(case, texture, new_player(&texture));
    outcome.samples = case.samples;
    outcome.spectrum_db = spectrum::largest_difference_db(&case.nodes(), &texture);
    bench.drive(1.0, case.samples, &mut outcome);
    outcome.stopped = bench.rest();

    let mut bench = Bench::new(case, texture, new_player(&texture));
    for _ in 0..case.samples.min(50_000) {
        bench.sample(OVERDRIVE);
    }
    outcome.overdriven = bench.rest();

    let mut bench = Bench::new(case, texture, new_player(&texture));
    bench.move_on();
    let mut signs = Excitation::new(99);
    bench.player.glitch(&mut signs);
    outcome.glitched = bench.rest();
    Ok(outcome)
}

/// A texture on its way along a case's motion.
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

    /// Takes over the motion if it changes here, and tells so.
    fn move_on(&mut self) -> bool {
        let changes = self.case.path.changes_at(self.sample);
        if changes {
            let motion = self.case.path.motion(self.sample);
            self.player.follow(&self.texture, motion);
        }
        self.sample += 1;
        changes
    }

    fn sample(&mut self, drive: f64) -> (OutputSample, bool) {
        self.move_on();
        let excitation = f64::from(self.noise.next_sample()) * drive;
        self.player.sample(excitation as i32)
    }

    /// Drives `samples` samples and measures them.
    fn drive(&mut self, drive: f64, samples: usize, outcome: &mut Outcome) {
        let mut reference = Reference::of(&self.texture, self.case.is_still());
        let (mut snr, mut level) = (Deviation::default(), Deviation::default());
        let mut mean = Mean::of(samples);
        for _ in 0..samples {
            if self.move_on() {
                let motion = self.case.path.motion(self.sample - 1);
                let point = GridPoint::locate(&self.texture, motion);
                reference.follow(self.player.as_ref(), &self.texture, &point);
            }
            let excitation = (f64::from(self.noise.next_sample()) * drive) as i32;
            let (output, saturated) = self.player.sample(excitation);
            outcome.saturated += usize::from(saturated || self.player.is_at_full_scale());
            mean.add(f64::from(self.player.newest()));
            if self.case.with_reference
                && let Some(exact) = reference.sample(f64::from(excitation))
            {
                snr.add(exact.state, f64::from(self.player.newest()));
                level.add(
                    exact.output,
                    f64::from(output.metres_per_second_squared().0),
                );
            }
        }
        outcome.mean_standard_errors = mean.in_standard_errors();
        if self.case.with_reference && reference.exists() {
            outcome.snr_db = Some(snr.snr_db());
            outcome.level_db = Some(level.level_db());
        }
    }

    /// Goes on without excitation until there is silence.
    fn rest(&mut self) -> Rest {
        let lattice = self.texture.structure() == Structure::NormalisedLattice;
        let limit = self.case.rest_limit(lattice);
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
            self.player.sample(0);
            let energy = self.player.energy();
            rest.growing += usize::from(energy > before);
            largest = largest.max(energy);
            before = energy;
            if n + 1000 >= limit {
                let share = f64::from(self.player.newest().unsigned_abs()) / 2f64.powi(31);
                rest.left = rest.left.max(share);
            }
        }
        if rest.silent_after.is_some() {
            rest.left = 0.0;
        }
        rest.growth_db = 10.0 * (largest as f64 / (begin as f64).max(1.0)).log10();
        rest
    }
}

/// What a float64 filter gives.
struct Exact {
    /// What the newest signal of the state should be.
    state: f64,
    /// What the output should be in level, m/s².
    output: f64,
}

/// The float64 filter that belongs to a texture.
enum Reference {
    Lattice {
        filter: FloatLattice,
        /// m/s² for a standard deviation.
        gain: f64,
    },
    /// A direct form that rests on one node.
    Direct {
        filter: FloatDirect,
        /// Steps of the history for a standard deviation.
        deviation: f64,
        /// The lattice of the same coefficients, whose power is known.
        level: FloatLattice,
        gain: f64,
    },
    /// There is none: an unstable direct form, or one that moves.
    None,
}

impl Reference {
    fn of(texture: &Texture<'_>, still: bool) -> Self {
        if texture.structure() == Structure::NormalisedLattice {
            return Self::Lattice {
                filter: FloatLattice::new(texture.max_order()),
                gain: 0.0,
            };
        }
        let node = texture.node(0, 0);
        let predictor = predictor(node.coefficients);
        let a: Vec<f64> = predictor.iter().map(|h| -h).collect();
        match step_down(&a) {
            Some(reflection) if still => {
                let mut level = FloatLattice::new(reflection.len());
                level.reflect_by(&reflection);
                let steps = rms_in_steps(node.prediction_error_power, OutputSample::FRACTION_BITS);
                Self::Direct {
                    filter: FloatDirect::new(predictor),
                    deviation: f64::from(steps),
                    level,
                    gain: f64::from(node.output_power).sqrt(),
                }
            }
            _ => Self::None,
        }
    }

    fn exists(&self) -> bool {
        !matches!(self, Self::None)
    }

    fn follow(&mut self, player: &dyn Player, texture: &Texture<'_>, point: &GridPoint) {
        if let Self::Lattice { filter, gain } = self {
            filter.rotate_by(player.rotations());
            let power = point.mean(|speed, force| texture.node(speed, force).output_power);
            let fade = f64::from(point.fade) / f64::from(ONE);
            *gain = f64::from(power).sqrt() * fade;
        }
    }

    fn sample(&mut self, excitation: f64) -> Option<Exact> {
        match self {
            Self::Lattice { filter, gain } => {
                let state = filter.filter(excitation);
                let output = state / DEVIATION * *gain;
                Some(Exact { state, output })
            }
            Self::Direct {
                filter,
                deviation,
                level,
                gain,
            } => Some(Exact {
                state: filter.filter(excitation / DEVIATION * *deviation),
                output: level.filter(excitation / DEVIATION) * *gain,
            }),
            Self::None => None,
        }
    }
}

/// h(1), h(2) ... of a direct form, exactly as stored.
pub(crate) fn predictor(coefficients: Coefficients<'_>) -> Vec<f64> {
    match coefficients {
        Coefficients::Direct16 { exponent, codes } => {
            let step = 2f64.powi(i32::from(exponent) - 15);
            let code = |&code: &[u8; 2]| f64::from(i16::from_le_bytes(code)) * step;
            codes.iter().map(code).collect()
        }
        Coefficients::Direct32 { exponent, codes } => {
            let step = 2f64.powi(i32::from(exponent) - 31);
            let code = |&code: &[u8; 4]| f64::from(i32::from_le_bytes(code)) * step;
            codes.iter().map(code).collect()
        }
        Coefficients::Lattice(_) => Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn narrow_lines_have_limits_of_their_own_and_others_the_common_ones() {
        assert_eq!(
            (snr_limit_db(0.99), spectrum_limit_db(0.99)),
            (SNR_DB, SPECTRUM_DB)
        );
        assert!((snr_limit_db(0.9999) - 85.0).abs() < 1e-6);
        assert!((snr_limit_db(0.999_99) - 65.0).abs() < 1e-6);
        assert!((8.0..9.0).contains(&spectrum_limit_db(0.999_99)));
    }
}
