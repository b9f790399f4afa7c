//! The removed-node test itself: each node that is removed, and every model that the device's kernel plays in its place
//! and that is compared with a recording.

use model_format::{MillimetresPerSecond, Newton, SAMPLE_RATE_HZ};
use rayon::prelude::*;
use stylus_dsp::model::Model;
use stylus_dsp::spectrum;
use stylus_fit::fit::Order;
use stylus_fit::texture::grid::Grid;
use stylus_fit::texture::library::{decoded, library_of};
use stylus_signals::playing::motion::MotionPath;
use stylus_signals::playing::render::render;
use stylus_support::Result;
use stylus_support::names::portable;

use super::Options;
use super::prepared::{Prepared, Target};
use super::results::{Judged, LeaveOneOut, Outcome, Removed, Row};
use crate::evaluate::WARM_UP_S;
use crate::perception::ScoringRange;

impl Prepared<'_> {
    /// Removes every inner node and predicts it by each method. Calls `progress` after each node.
    ///
    /// The result does not depend on the number of threads.
    pub fn run(&self, options: &Options, progress: impl Fn() + Sync) -> Result<LeaveOneOut> {
        let rows = Row::all();
        let removed: Vec<Removed> = self
            .targets()
            .into_par_iter()
            .map(|target| {
                let outcome = self.remove(target, &rows, options);
                progress();
                outcome
            })
            .collect::<Result<_>>()?;
        Ok(LeaveOneOut {
            smoothing: format!("Hann kernel, {} Hz wide", options.judging.smoothing_hz),
            order: match options.order {
                Order::Auto => "chosen for each node".into(),
                Order::Bayesian => "chosen for each node (BIC)".into(),
                Order::Fixed(order) => order.to_string(),
            },
            simulated: self.simulated,
            rows,
            removed,
        })
    }

    fn remove(&self, target: Target, rows: &[Row], options: &Options) -> Result<Removed> {
        let trial = &self.set.trials[target.trial];
        let outcomes = rows.iter().map(|row| self.outcome(target, *row, options));
        Ok(Removed {
            outcomes: outcomes.collect::<Result<Vec<_>>>()?,
            file: portable(&trial.file),
            texture: trial.texture.clone(),
            speed_mm_s: trial.speed_mm_s,
            force_n: trial.force_n,
            bands: self.ranges[target.trial].map_or(0, |range| range.bands()),
        })
    }

    fn outcome(&self, target: Target, row: Row, options: &Options) -> Result<Outcome> {
        let texture = &self.textures[target.texture];
        let own = texture.model(target.place);
        let model = row.model(own, &texture.neighbours(target.place));
        let seed = options.judging.seed.wrapping_add(target.trial as u64);
        let played = model
            .as_ref()
            .map(|model| synthesis(model, options.judging.synthesis_s / 2.0, seed));
        let played = played.transpose()?.flatten();
        let model = model.filter(|_| played.is_some());
        let (recorded, range) = (&self.signals[target.trial], self.ranges[target.trial].as_ref());
        let judged = played
            .zip(range)
            .and_then(|(played, range)| judge(recorded, &played, range, options));
        let error = |model: &Model| model.error_power() - own.error_power();
        Ok(Outcome {
            is_playable: judged.is_some(),
            order: model.as_ref().map_or(0, |model| model.reflection.len()),
            excitation_error: model.as_ref().filter(|_| judged.is_some()).map(error),
            judged: judged.unwrap_or_else(Judged::silence),
        })
    }
}

/// Speed and force of the only node of a library for a test. Any values in contact and in motion serve.
const PLACE: (f32, f32) = (100.0, 1.0);

/// Plays `seconds` of `model` with the device's kernel, m/s², after a warm-up. Returns `None` if it is too loud.
fn synthesis(model: &Model, seconds: f64, seed: u64) -> Result<Option<Vec<f64>>> {
    const NAME: &str = "removed node";
    let grid = Grid::new(vec![PLACE.0], vec![PLACE.1], vec![model.clone()]);
    let Ok(bytes) = library_of(NAME, &grid) else {
        return Ok(None);
    };
    let library = decoded(&bytes)?;
    let texture = library.textures().next().expect("one was encoded");
    let motion = MotionPath::constant(MillimetresPerSecond(PLACE.0), Newton(PLACE.1))?;
    let mut samples = render(texture, &motion, seconds + WARM_UP_S, seed)?.accelerations_m_s2();
    Ok(Some(
        samples.split_off((WARM_UP_S * f64::from(SAMPLE_RATE_HZ)) as usize),
    ))
}

/// Compares a synthesis with a recording, both in m/s² at the models' rate, at the frequencies of `range`. `None` if
/// there is nothing to compare.
fn judge(recorded: &[f64], synthesised: &[f64], range: &ScoringRange, options: &Options) -> Option<Judged> {
    let rate_hz = f64::from(SAMPLE_RATE_HZ);
    // Both spectra have segments of one length, so that the window's leakage is the same in both.
    let of_blocks = |signal: &[f64]| spectrum::PowerSpectrum::of_blocks(&[signal], range.segment, rate_hz);
    let (a, b) = (of_blocks(recorded), of_blocks(synthesised));
    let (low_hz, high_hz) = range.distance_hz();
    Some(Judged {
        cost: spectrum::cost_of_blocks(
            &[recorded],
            &[synthesised],
            rate_hz,
            options.judging.smoothing_hz,
            range.cost_hz,
        )?,
        band_errors_db: spectrum::band_errors_within_db(&a, &b, range.band_edges_hz()),
        log_spectral_distance_db: spectrum::distance_of_spectra_db(&a, &b, low_hz, high_hz),
    })
}
