//! Recordings that are fitted, and recordings that are held out for judging.

use std::path::Path;

use model_format::Provenance;

use crate::recording;
use crate::recording::{RecordingSet, Trial};
use crate::rig::{self, RigFile};
use crate::support::error::{Error, Result};
use model_format::SAMPLE_RATE_HZ;

/// Seeds of the two simulated takes.
const SEEDS: [u64; 2] = [1, 2];

/// Recordings to fit, and others of the same nodes to judge by.
#[derive(Clone, Debug)]
pub struct Material {
    /// To fit.
    pub fit: RecordingSet,
    /// To judge by.
    pub held_out: RecordingSet,
    /// Description of the recordings, in a sentence.
    pub description: String,
}

impl Material {
    /// Two takes of the paper's protocol by the rig simulator, written below `folder`.
    ///
    /// # Errors
    /// A folder that cannot be written.
    pub fn simulated(folder: &Path) -> Result<Self> {
        let paper = RigFile::paper();
        let [fit, held_out] = SEEDS.map(|seed| {
            let take = folder.join(format!("take-{seed}"));
            rig::simulate_to_folder(&paper, seed, &take, false)?;
            RecordingSet::open(&[take])
        });
        let description = format!(
            "SIMULATED: the paper's protocol by the rig simulator (simulate-rig), seed {} fitted, seed {}, other \
             pieces of the same surfaces, held out",
            SEEDS[0], SEEDS[1]
        );
        Ok(Self {
            fit: fit?,
            held_out: held_out?,
            description,
        })
    }

    /// The first half of each recording of `set` to fit, its second half to judge by.
    ///
    /// # Errors
    /// A recording that cannot be read.
    pub fn halves(set: &RecordingSet) -> Result<Self> {
        let mut material = Self {
            fit: set.clone(),
            held_out: set.clone(),
            description: "the first half of each recording fitted, its second half held out"
                .to_owned(),
        };
        let halves = material
            .fit
            .trials
            .iter_mut()
            .zip(&mut material.held_out.trials);
        for (first, second) in halves {
            let samples = recording::read(first)?.axes.first().map_or(0, Vec::len);
            let half_s = samples as f64 / f64::from(SAMPLE_RATE_HZ) / 2.0;
            first.duration_s = Some(half_s);
            second.duration_s = Some(half_s);
            second.start_s += half_s;
        }
        Ok(material)
    }

    /// `set` to fit, and another take of the same nodes to judge by.
    ///
    /// # Errors
    /// Takes that have no node of `set`.
    pub fn takes(set: RecordingSet, takes: RecordingSet) -> Result<Self> {
        let material = Self {
            description: "one take of each recording fitted, another held out".to_owned(),
            fit: set,
            held_out: takes,
        };
        let common = material.held_out.trials.iter();
        if !common
            .into_iter()
            .any(|trial| material.take_of(trial).is_some())
        {
            return Err(Error::Request(
                "the takes have no texture, speed and force of the recordings; give takes of the same trials".into(),
            ));
        }
        Ok(material)
    }

    /// Returns whether any of it is simulated.
    pub fn is_simulated(&self) -> bool {
        let mut trials = self.fit.trials.iter().chain(&self.held_out.trials);
        trials.any(|trial| trial.provenance == Provenance::Simulated)
    }

    /// The fitted recording of the same node as `trial`.
    pub(super) fn take_of(&self, trial: &Trial) -> Option<&Trial> {
        self.fit.trials.iter().find(|other| {
            other.texture == trial.texture
                && other.speed_mm_s == trial.speed_mm_s
                && other.force_n == trial.force_n
        })
    }
}
