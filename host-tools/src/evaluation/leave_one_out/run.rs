//! The removed-node test itself.

use rayon::prelude::*;

use crate::fit::Order;
use crate::support::error::{Error, Result};

use super::options::{Options, SMOOTHING_WIDTHS_HZ};
use super::prepared::{Prepared, Target};
use super::removal::Removal;
use super::results::{LeaveOneOut, Removed, Row};

impl Prepared<'_> {
    /// Removes and predicts every inner node in every one of `rows`, telling `progress` of each node done.
    ///
    /// The result does not depend on the number of threads.
    ///
    /// # Errors
    /// A request that the kernel's renderer refuses.
    pub fn run(
        &self,
        rows: &[Row],
        options: &Options,
        progress: impl Fn() + Sync,
    ) -> Result<LeaveOneOut> {
        let all: Vec<usize> = (0..self.count(options.around)).collect();
        let removed = self.run_some(&all, rows, options, progress)?;
        Ok(LeaveOneOut {
            smoothing: format!("Hann kernel, {} Hz wide", options.smoothing_hz),
            order: match options.order {
                Order::Auto => "chosen for each node (AIC)".into(),
                Order::Bayesian => "chosen for each node (BIC)".into(),
                Order::AtMost(order) => format!("chosen for each node (AIC), at most {order}"),
                Order::Fixed(order) => order.to_string(),
            },
            around: options.around,
            simulated: self.simulated,
            papers_textures: self.papers_textures.clone(),
            rows: rows.to_vec(),
            smoothing_widths_hz: SMOOTHING_WIDTHS_HZ.to_vec(),
            removed,
        })
    }

    /// Removes and predicts some of the inner nodes, by their places in [`LeaveOneOut::removed`].
    ///
    /// # Errors
    /// A request that the kernel's renderer refuses.
    ///
    /// # Panics
    /// If there is no such node.
    pub fn run_some(
        &self,
        nodes: &[usize],
        rows: &[Row],
        options: &Options,
        progress: impl Fn() + Sync,
    ) -> Result<Vec<Removed>> {
        let targets = self.targets(options.around);
        let removed = nodes.par_iter().map(|&node| {
            let outcome = self.remove(targets[node], rows, options);
            progress();
            outcome
        });
        removed.collect()
    }

    /// The recording at a removed node, and what is played there in `row`; none if it cannot be.
    ///
    /// # Errors
    /// A node that is not of this set, and a request that the kernel's renderer refuses.
    pub fn hear(
        &self,
        node: &Removed,
        row: Row,
        options: &Options,
    ) -> Result<Option<(Vec<f64>, Vec<f64>)>> {
        let is_it = |target: &&Target| {
            self.set.trials[target.trial].file.display().to_string() == node.file
        };
        let targets = self.targets(options.around);
        let Some(&target) = targets.iter().find(is_it) else {
            let problem = format!("{} is not one of the removed nodes", node.file);
            return Err(Error::Request(problem));
        };
        let mut removal = Removal::new(self, target, options);
        let Some((at, power)) = removal.voice(row)? else {
            return Ok(None);
        };
        let played = removal.voices[at]
            .1
            .as_ref()
            .and_then(|voice| voice.at_power(power));
        Ok(played.map(|played| (self.signals[target.trial].clone(), played)))
    }

    fn remove(&self, target: Target, rows: &[Row], options: &Options) -> Result<Removed> {
        let trial = &self.set.trials[target.trial];
        let mut removal = Removal::new(self, target, options);
        let outcomes = rows.iter().map(|&row| removal.outcome(row));
        Ok(Removed {
            outcomes: outcomes.collect::<Result<Vec<_>>>()?,
            file: trial.file.display().to_string(),
            texture: trial.texture.clone(),
            speed_mm_s: trial.speed_mm_s,
            force_n: trial.force_n,
        })
    }
}
