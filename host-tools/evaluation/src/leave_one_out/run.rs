//! The removed-node test itself: each node that is removed, and everything that is played in its place.

use rayon::prelude::*;
use stylus_dsp::model::Model;
use stylus_fit::fit::Order;
use stylus_support::Result;
use stylus_support::names::portable;

use super::Options;
use super::play::{self, Judged};
use super::prepared::{Prepared, Target};
use super::results::{LeaveOneOut, Outcome, Removed, Row};

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
            .map(|model| play::synthesis(model, options.judging.synthesis_s / 2.0, seed));
        let played = played.transpose()?.flatten();
        let model = model.filter(|_| played.is_some());
        let (recorded, range) = (&self.signals[target.trial], self.ranges[target.trial].as_ref());
        let judged = played
            .zip(range)
            .and_then(|(played, range)| play::judge(recorded, &played, range, options));
        let error = |model: &Model| model.error_power() - own.error_power();
        Ok(Outcome {
            is_playable: judged.is_some(),
            order: model.as_ref().map_or(0, |model| model.reflection.len()),
            excitation_error: model.as_ref().filter(|_| judged.is_some()).map(error),
            judged: judged.unwrap_or_else(Judged::silence),
        })
    }
}
