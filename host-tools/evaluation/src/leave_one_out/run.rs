//! The removed-node test itself: each node that is removed, and everything that is played in its place.

use rayon::prelude::*;

use crate::dsp::linear_prediction::error_share;
use crate::dsp::model::Model;
use crate::fit::Order;
use crate::support::error::Result;
use crate::support::file_name::portable;
use crate::texture::domain::{Domain, Level, Method, Neighbour};

use super::Options;
use super::play::{self, Judged, Voice};
use super::prepared::{Prepared, PreparedTexture, Target};
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
            smoothing: format!("Hann kernel, {} Hz wide", options.smoothing_hz),
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
        let mut removal = Removal::new(self, target, options);
        let outcomes = rows.iter().map(|row| removal.outcome(row));
        Ok(Removed {
            outcomes: outcomes.collect::<Result<Vec<_>>>()?,
            file: portable(&trial.file),
            texture: trial.texture.clone(),
            speed_mm_s: trial.speed_mm_s,
            force_n: trial.force_n,
            bands: self.ranges[target.trial].map_or(0, |range| range.bands()),
        })
    }
}

/// The part of a row that determines its timbre. The level is a gain after the filter, so methods that differ only in
/// level share one synthesis, which is scaled.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Timbre {
    Own,
    Interpolated(Domain),
}

/// A node that is being removed.
struct Removal<'p, 's> {
    prepared: &'p Prepared<'s>,
    target: Target,
    options: &'p Options,
    neighbours: Vec<Neighbour<'p>>,
    /// Syntheses so far.
    voices: Vec<(Timbre, Option<Voice>)>,
}

impl<'p, 's> Removal<'p, 's> {
    fn new(prepared: &'p Prepared<'s>, target: Target, options: &'p Options) -> Self {
        Self {
            prepared,
            target,
            options,
            neighbours: prepared.neighbours(target.texture, target.place),
            voices: Vec::new(),
        }
    }

    fn texture(&self) -> &'p PreparedTexture {
        &self.prepared.textures[self.target.texture]
    }

    /// The model that is played for a timbre.
    fn model(&self, timbre: Timbre) -> Option<Model> {
        let (texture, place) = (self.texture(), self.target.place);
        match timbre {
            Timbre::Own => Some(texture.model(place).clone()),
            Timbre::Interpolated(domain) => {
                // Any level would do, because the voice is scaled to the power of each row.
                let level = Level::Power;
                Method { domain, level }.predict(&self.neighbours)
            }
        }
    }

    /// Returns the index of the voice of `row`, and the power at which the voice is played; none if the device cannot
    /// play it.
    fn voice(&mut self, row: &Row) -> Result<Option<(usize, f64)>> {
        let timbre = match row {
            Row::Own => Timbre::Own,
            Row::Interpolated(method) => Timbre::Interpolated(method.domain),
        };
        let known = self.voices.iter().position(|(known, _)| *known == timbre);
        let at = known.unwrap_or(self.voices.len());
        if known.is_none() {
            let seed = self.options.seed.wrapping_add(self.target.trial as u64);
            let model = self.model(timbre);
            let voice = model.map(|model| Voice::of(model, self.options, seed));
            self.voices.push((timbre, voice.transpose()?.flatten()));
        }
        Ok(self.voices[at].1.as_ref().map(|voice| {
            let power = match row {
                Row::Interpolated(method) => method.level.power(&self.neighbours, &voice.model.reflection),
                Row::Own => voice.model.output_power,
            };
            (at, power)
        }))
    }

    fn outcome(&mut self, row: &Row) -> Result<Outcome> {
        let voice = self
            .voice(row)?
            .and_then(|(at, power)| Some((self.voices[at].1.as_ref()?, power)));
        let played = voice.and_then(|(voice, power)| voice.at_power(power));
        let recorded = &self.prepared.signals[self.target.trial];
        let range = self.prepared.ranges[self.target.trial].as_ref();
        let judged = played
            .zip(range)
            .and_then(|(played, range)| play::judge(recorded, &played, range, self.options));
        let own = self.texture().model(self.target.place);
        // The variance of the excitation is the power of the output times Π(1 - k²).
        let excitation_error = voice.filter(|_| judged.is_some()).map(|(voice, power)| {
            power * error_share(&voice.model.reflection) - own.output_power * error_share(&own.reflection)
        });
        Ok(Outcome {
            is_playable: judged.is_some(),
            order: voice.map_or(0, |(voice, _)| voice.model.reflection.len()),
            excitation_error,
            judged: judged.unwrap_or_else(Judged::silence),
        })
    }
}
