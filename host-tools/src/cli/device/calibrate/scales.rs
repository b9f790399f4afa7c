//! The scales of force and path, measured with known weights on the tip and over a known distance.

use std::sync::mpsc;

use model_format::link::{SettingChange, Settings};
use serde::Serialize;
use stylus_link::procedures::calibrate::{AtRest, ForceScale, PathScale, Travel, Weighed, order};
use stylus_support::{Error, Result};

use super::{CalibrationRun, answer};
use crate::cli::input::positive;
use crate::cli::output::tell;

#[derive(clap::Args)]
pub struct Scales {
    /// Measure the force's scale and the threshold of contact too, with one or two known weights in grams
    #[arg(
        long,
        value_name = "G1[,G2]",
        value_delimiter = ',',
        num_args = 1,
        value_parser = positive,
        conflicts_with_all = ["yes", "keep_force"]
    )]
    weights: Vec<f64>,
    /// Measure the encoder's path per count too, over a known distance in millimetres
    #[arg(long, value_name = "MM", value_parser = positive, conflicts_with = "yes")]
    distance: Option<f64>,
}

impl Scales {
    pub fn are_wanted(&self) -> bool {
        !self.weights.is_empty() || self.distance.is_some()
    }
}

/// Results of the measurements with weights and distance.
#[derive(Serialize)]
pub struct ScalesReport {
    force: Option<ForceScale>,
    weighed: Vec<Weighed>,
    path: Option<PathScale>,
}

impl ScalesReport {
    pub fn changes(&self) -> impl Iterator<Item = SettingChange> {
        self.force
            .iter()
            .flat_map(ForceScale::changes)
            .chain(self.path.iter().map(PathScale::change))
    }
}

fn nothing_stored(fault: impl std::fmt::Display) -> Error {
    Error::Request(format!("nothing was stored: {fault}"))
}

impl CalibrationRun<'_> {
    /// Measures the scales that were requested.
    pub fn scales(&self) -> Result<ScalesReport> {
        let Scales { weights, distance } = &self.arguments.scales;
        if weights.len() > 2 {
            let what = "--weights takes one or two weights: the lighter one shows that the force is linear";
            return Err(Error::Request(what.to_owned()));
        }
        let mut weighed = Vec::new();
        if !weights.is_empty() {
            tell("weights: fix the stylus upright, tip up, so that a weight can lie on the tip");
            for grams in order(weights) {
                weighed.push(self.weigh(grams)?);
            }
        }
        let force = match &weighed[..] {
            [] => None,
            measured => Some(ForceScale::of(measured).map_err(nothing_stored)?),
        };
        if let Some(scale) = &force {
            tell(&format!(
                "the force is within {:.3} N of a line, {:.3} N apart on the ways up and down, with a noise of {:.4} N",
                scale.residual_n, scale.hysteresis_n, scale.noise_n
            ));
        }
        let path = distance.map(|mm| self.path(mm)).transpose()?;
        Ok(ScalesReport { force, weighed, path })
    }

    fn weigh(&self, grams: f64) -> Result<Weighed> {
        let pose = match grams {
            0.0 => "with nothing on the tip".to_owned(),
            grams => format!("with {grams} g on the tip"),
        };
        let at_rest = self.measure(&pose, &AtRest::FORCE)?;
        Ok(Weighed { grams, at_rest })
    }

    fn path(&self, mm: f64) -> Result<PathScale> {
        tell(&format!("distance: mark two places that are {mm} mm apart"));
        let ways = [
            self.travel("the first mark", "to the second one")?,
            self.travel("the second mark", "back to the first one")?,
        ];
        let scale = PathScale::of(mm, ways).map_err(nothing_stored)?;
        tell(&format!(
            "the ways there and back, {} and {} counts, differ by {:.2} mm",
            scale.counts[0], scale.counts[1], scale.difference_mm
        ));
        Ok(scale)
    }

    /// Records the path of the tip until the operator reports that it has ended.
    fn travel(&self, from: &str, to: &str) -> Result<Travel> {
        answer(&format!("put the tip on {from}, then press Enter"))?;
        let (sender, answers) = mpsc::channel();
        let question = format!("move {to} in a straight line, then press Enter");
        // A separate thread waits for the keyboard, because the recording continues meanwhile.
        let ask = move || drop(std::thread::spawn(move || sender.send(answer(&question))));
        let mut answered = None;
        // The question is asked once the recording runs, so that no count of the movement is missed.
        let travel = Travel::record(self.device, ask, || {
            if let Ok(answer) = answers.try_recv() {
                answered = Some(answer);
            }
            answered.is_some() || self.interrupt.is_raised()
        })?;
        let interrupted = || Err(Error::Request("interrupted".to_owned()));
        answered.unwrap_or_else(interrupted)?;
        Ok(travel)
    }

    /// Measures the largest weight and the distance again, with the `stored` settings.
    pub fn verify_scales(&self, scales: &ScalesReport, stored: &Settings) -> Result<()> {
        let refuse = |fault: &dyn std::fmt::Display| Error::Request(fault.to_string());
        let grams = scales.weighed.iter().map(|weighed| weighed.grams);
        if let Some(grams) = grams.reduce(f64::max) {
            tell("to verify: fix the stylus upright again, tip up");
            let pair = [self.weigh(0.0)?, self.weigh(grams)?];
            ForceScale::verify(pair, stored).map_err(|fault| refuse(&fault))?;
        }
        if let (Some(mm), true) = (self.arguments.scales.distance, scales.path.is_some()) {
            tell("to verify: the same distance again");
            let way = self.travel("the first mark", "to the second one")?;
            PathScale::verify(mm, way, stored).map_err(|fault| refuse(&fault))?;
        }
        Ok(())
    }
}
