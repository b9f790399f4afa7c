//! The plan of a listening test: which sounds are heard in which trial. Its random choices depend only on the seed.

use model_format::Library;
use rand::SeedableRng;
use rand::seq::SliceRandom;
use rand_pcg::Pcg64;
use serde::Serialize;
use stylus_fit::fit::record::FitRecord;
use stylus_signals::recording::RecordingSet;
use stylus_support::names::listed;
use stylus_support::{Error, Result};

use super::Pair;
use super::abx::{Trial, trials};
use super::excerpts::{Excerpt, SHORTEST_EXCERPT_S, Sounds, TrialExcerpts, WINDOWS, able, excerpts, samples};
use super::similarity::{Ratings, ratings};
use super::staircase::{Part, Staircases, Strands, Track, track};
use crate::evaluate::{self, Evaluation};
use crate::held_out::{Judge, JudgeKind, is_same};
use crate::liveliness::slices;
use crate::played::Played;

/// Question to a listener.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Design {
    /// X is like A or like B: which?
    Abx,
    /// Rating of how alike A and B are, from 0 to 100.
    Similarity,
    /// X is like A or like B: which? The difference adapts until the listener can just tell it.
    Staircase,
}

impl Design {
    /// Returns the usual number of trials per pair, or the largest number of a staircase.
    pub fn usual_trials(self) -> usize {
        match self {
            Self::Abx => 12,
            Self::Similarity => 6,
            Self::Staircase => 80,
        }
    }
}

/// The trials of a design.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(tag = "design", rename_all = "snake_case")]
pub enum Task {
    /// A, B and X.
    Abx {
        /// The trials in their order.
        trials: Vec<Trial>,
    },
    /// Ratings.
    Similarity(Ratings),
    /// Staircases.
    Staircase(Staircases),
}

impl Task {
    /// Returns the largest number of trials that a listener has.
    pub fn trials(&self) -> usize {
        match self {
            Self::Abx { trials } => trials.len(),
            Self::Similarity(ratings) => ratings.trials.len(),
            Self::Staircase(staircases) => staircases.most_trials(),
        }
    }
}

/// Options of a test.
#[derive(Clone, Debug)]
pub struct Options {
    /// The question to a listener.
    pub design: Design,
    /// The pairs. All have the same number of trials.
    pub pairs: Vec<Pair>,
    /// The parts. Each has a staircase.
    pub parts: Vec<Part>,
    /// Number of trials per pair. In ratings, each kind with itself has as many. For staircases, it is the largest
    /// number per part.
    pub trials: usize,
    /// Duration of an excerpt, s, at most.
    pub excerpt_s: f64,
    /// Seed of the order, the places and the choices of X.
    pub seed: u64,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            design: Design::Abx,
            pairs: Pair::USUAL.to_vec(),
            parts: Part::ALL.to_vec(),
            trials: Design::Abx.usual_trials(),
            excerpt_s: 1.5,
            seed: 1,
        }
    }
}

/// A test.
#[derive(Clone, Debug)]
pub struct Plan {
    /// The question and the trials.
    pub task: Task,
    /// All excerpts, at 5 kHz. Each has an RMS of 1, except those that must differ in level.
    pub sounds: Vec<Vec<f64>>,
    /// Shortest and longest duration of an excerpt, s.
    pub excerpt_s: (f64, f64),
    /// Names of the pairs and parts that are left out because no texture has the part that they need, such as when all
    /// play only Gaussian noise.
    pub left_out: Vec<String>,
    /// Surfaces of which too little is held out for two excerpts.
    pub too_short: Vec<String>,
    /// Names of pairs, and the other surfaces that these are not heard on.
    pub without: Vec<(String, Vec<String>)>,
    /// The data that were held out, in words.
    pub held_out: String,
    /// True if any recording of the test is simulated.
    pub simulated: bool,
    /// The seed.
    pub seed: u64,
}

impl Plan {
    /// Returns notes on what was requested and is not in the test: excerpts as long as `excerpt_s`, pairs, parts, and
    /// surfaces of pairs.
    pub fn notes(&self, excerpt_s: f64, has_takes: bool) -> Vec<String> {
        let remedy = if has_takes {
            ""
        } else {
            ": blocks are fitted to half of each recording, and --takes plays the library as it is"
        };
        let is_staircase = matches!(self.task, Task::Staircase(_));
        let same = "plays Gaussian noise alone, so that 'fitted' and 'gaussian' are one sound, which \
                    recording-gaussian compares";
        let left_out = self.left_out.iter().map(|name| {
            let reason = if is_staircase {
                "no texture that is heard has it".to_owned()
            } else {
                format!("every texture that is heard {same}")
            };
            format!("{name}: left out, because {reason}{remedy}")
        });
        let without = self.without.iter().map(|(name, surfaces)| {
            let surfaces = listed("", surfaces);
            format!("{name}: not asked of {surfaces}: each is silent, or {same}{remedy}")
        });
        let mut notes: Vec<String> = left_out.chain(without).collect();
        if !self.too_short.is_empty() {
            let surfaces = listed("", &self.too_short);
            notes.push(format!("left out, because too little is held out: {surfaces}"));
        }
        if self.excerpt_s.0 < excerpt_s - 0.01 {
            notes.push(format!(
                "sounds take {:.1} s and more, not {excerpt_s} s: held-out recordings do not hold more",
                self.excerpt_s.0
            ));
        }
        notes
    }
}

/// A library that is compared, with the record of its fit.
#[derive(Clone, Copy)]
pub struct Compared<'a> {
    /// The library.
    pub library: &'a Library<'a>,
    /// The record, if there is one.
    pub record: Option<&'a FitRecord>,
}

/// Plans a listening test of `fitted`, and of `before` if given, on the trials of `set` against their `judges`.
/// Surfaces at a speed and force are taken from each texture in turn, in random order.
///
/// # Errors
/// Those of [`evaluate::prepare`]; no trial, speed or pair to compare; recordings that are not held out; a recording
/// that cannot be used any more.
pub fn plan<'a>(
    set: &RecordingSet,
    judges: &[Judge],
    fitted: Compared<'a>,
    before: Option<Compared<'a>>,
    evaluate: &evaluate::Options,
    options: &Options,
) -> Result<Plan> {
    // Each of a trial's sounds takes a window of its own. A little more, so that no rounding takes the last one.
    let least_s = WINDOWS as f64 * options.excerpt_s + 0.01;
    let evaluate = &evaluate::Options {
        synthesis_s: evaluate.synthesis_s.max(least_s),
        ..*evaluate
    };
    let prepared = |of: Compared<'a>| -> Result<_> {
        let evaluation = evaluate::prepare(set, of.library, judges.to_vec(), of.record, evaluate)?;
        Ok((of.library, evaluation))
    };
    let mut generator = Pcg64::seed_from_u64(options.seed);
    let mut planner = Planner {
        set,
        fitted: prepared(fitted)?,
        before: before.map(prepared).transpose()?,
        evaluate,
        options,
        order: in_turns(set, &mut generator),
        sounds: Sounds::default(),
        too_short: Vec::new(),
        without: Vec::new(),
        generator,
    };
    if judges.iter().any(|judge| judge.kind() == JudgeKind::Nothing) {
        return Err(Error::Request(
            "nothing is known to be held out, because beside the library there is no record of what it was fitted to; \
             fit it again, which writes the record, or give --takes"
                .into(),
        ));
    }
    let (task, left_out) = match options.design {
        Design::Staircase => planner.staircases()?,
        Design::Abx | Design::Similarity => planner.pairs()?,
    };
    let Planner {
        fitted,
        sounds,
        too_short,
        without,
        ..
    } = planner;
    let seconds = |samples: usize| samples as f64 / f64::from(model_format::SAMPLE_RATE_HZ);
    let lengths = || sounds.all().iter().map(Vec::len);
    Ok(Plan {
        excerpt_s: (
            seconds(lengths().min().unwrap_or(0)),
            seconds(lengths().max().unwrap_or(0)),
        ),
        task,
        sounds: sounds.all().to_vec(),
        left_out,
        too_short,
        without,
        held_out: fitted.1.held_out,
        simulated: fitted.1.simulated,
        seed: options.seed,
    })
}

/// Returns the set's surfaces at a speed and force, shuffled within each texture, with textures in turn. Each is given
/// by the indices of its takes.
fn in_turns(set: &RecordingSet, generator: &mut Pcg64) -> Vec<Vec<usize>> {
    let mut of_textures: Vec<Vec<Vec<usize>>> = set
        .textures()
        .into_iter()
        .map(|name| {
            let mut own: Vec<usize> = set
                .trials
                .iter()
                .enumerate()
                .filter(|(_, trial)| trial.texture == name)
                .map(|(index, _)| index)
                .collect();
            own.shuffle(generator);
            let mut surfaces: Vec<Vec<usize>> = Vec::new();
            for index in own {
                let is_of = |takes: &&mut Vec<usize>| is_same(&set.trials[takes[0]], &set.trials[index]);
                match surfaces.iter_mut().find(is_of) {
                    Some(takes) => takes.push(index),
                    None => surfaces.push(vec![index]),
                }
            }
            surfaces
        })
        .collect();
    of_textures.shuffle(generator);
    let longest = of_textures.iter().map(Vec::len).max().unwrap_or(0);
    (0..longest)
        .flat_map(|turn| of_textures.iter().filter_map(move |own| own.get(turn)))
        .cloned()
        .collect()
}

/// A test that is being planned: the sources of its signals, and the sounds so far.
struct Planner<'a> {
    set: &'a RecordingSet,
    fitted: (&'a Library<'a>, Evaluation),
    before: Option<(&'a Library<'a>, Evaluation)>,
    evaluate: &'a evaluate::Options,
    options: &'a Options,
    /// Surfaces at a speed and force, as the indices of their takes in the set.
    order: Vec<Vec<usize>>,
    sounds: Sounds,
    /// As in [`Plan`].
    too_short: Vec<String>,
    /// As in [`Plan`].
    without: Vec<(String, Vec<String>)>,
    generator: Pcg64,
}

impl Planner<'_> {
    /// Plans the trials of pairs of kinds. Also returns the names of the pairs whose kinds no texture has.
    fn pairs(&mut self) -> Result<(Task, Vec<String>)> {
        let options = self.options;
        // Trials would not reach further surfaces, or further takes. All ratings of a block are of one surface.
        let most = match options.design {
            Design::Similarity => options.trials,
            Design::Abx | Design::Staircase => options.trials * options.pairs.len(),
        };
        let takes = most.div_ceil(self.order.len().max(1));
        let mut heard: Vec<Vec<TrialExcerpts>> = Vec::new();
        for surface in self.order.iter().take(most) {
            let own: Vec<TrialExcerpts> = surface
                .iter()
                .take(takes)
                .map(|n| self.heard(*n))
                .filter_map(Result::transpose)
                .collect::<Result<_>>()?;
            if own.is_empty() {
                self.too_short.push(self.surface(surface[0]));
            } else {
                heard.push(own);
            }
        }
        let is_able = |pair: &Pair| !able(&heard, pair.kinds()).is_empty();
        let (pairs, others): (Vec<Pair>, Vec<Pair>) = options.pairs.iter().partition(|p| is_able(p));
        if pairs.is_empty() {
            return Err(Error::Request(format!(
                "there is nothing to compare: no recording holds two excerpts of {SHORTEST_EXCERPT_S} s that were not \
                 fitted, or no texture has what --pairs asks for"
            )));
        }
        let left_out = others.into_iter().map(Pair::name).collect();
        for pair in &pairs {
            let is_missing = |takes: &&Vec<TrialExcerpts>| !takes.iter().any(|take| take.has(pair.kinds()));
            let names: Vec<String> = heard
                .iter()
                .filter(is_missing)
                .map(|takes| takes[0].surface.clone())
                .collect();
            self.without.extend((!names.is_empty()).then(|| (pair.name(), names)));
        }
        let (sounds, generator) = (&mut self.sounds, &mut self.generator);
        if options.design == Design::Similarity {
            let ratings = ratings(&pairs, &heard, options.trials, sounds, generator);
            return Ok((Task::Similarity(ratings), left_out));
        }
        let trials = trials(&pairs, &heard, options.trials, sounds, generator);
        Ok((Task::Abx { trials }, left_out))
    }

    /// Plans a staircase for each part, at the first speed and force whose texture has the part. Also returns the names
    /// of the parts that no texture has.
    fn staircases(&mut self) -> Result<(Task, Vec<String>)> {
        let options = self.options;
        let mut left_out = options.parts.clone();
        let mut tracks: Vec<Track> = Vec::new();
        for index in self.order.concat() {
            if left_out.is_empty() {
                break;
            }
            let strands = self.strands(index)?;
            let (sounds, generator) = (&mut self.sounds, &mut self.generator);
            left_out.retain(|&part| {
                let (seconds, trials) = (options.excerpt_s, options.trials);
                let found = track(part, &strands, seconds, trials, sounds, generator);
                let is_missing = found.is_none();
                tracks.extend(found);
                is_missing
            });
        }
        if tracks.is_empty() {
            return Err(Error::Request(
                "no texture has a part of --parts, or all are too short; blocks are fitted to half of each recording, \
                 and --takes plays the library as it is"
                    .into(),
            ));
        }
        let left_out = left_out.into_iter().map(|part| part.name().to_owned()).collect();
        Ok((Task::Staircase(Staircases::of(tracks)), left_out))
    }

    fn surface(&self, index: usize) -> String {
        let trial = &self.set.trials[index];
        let (speed, force) = (trial.speed_mm_s, trial.force_n);
        format!("{}, {speed} mm/s, {force} N", trial.texture)
    }

    /// Signals that the texture of a trial of the set plays, with parts and without.
    fn strands(&self, index: usize) -> Result<Strands> {
        let evaluate = evaluate::Options {
            // Beside the texture without its lines, a comparison plays the other two versions: whole and Gaussian.
            played: Played::Residual,
            ..*self.evaluate
        };
        let (library, evaluation) = &self.fitted;
        let comparison = evaluation.compare(self.set, library, index, &evaluate)?;
        let of = |played: Played| {
            comparison
                .versions
                .iter()
                .find(|v| v.played == played)
                .map(|version| version.synthesised.clone())
        };
        let (fitted, gaussian) = (of(Played::Fitted), of(Played::Gaussian));
        let without_lines = comparison.synthesised;
        Ok(Strands {
            surface: self.surface(index),
            has_codebook: gaussian.is_some(),
            has_lines: fitted.is_some(),
            fitted: fitted.unwrap_or_else(|| without_lines.clone()),
            gaussian: gaussian.unwrap_or_else(|| without_lines.clone()),
            without_lines,
        })
    }

    /// The excerpts of a trial of the set; `None` if it is too short. A silent signal has no excerpts.
    fn heard(&self, index: usize) -> Result<Option<TrialExcerpts>> {
        let (library, evaluation) = &self.fitted;
        let comparison = evaluation.compare(self.set, library, index, self.evaluate)?;
        let Some(samples) = samples(&comparison.judged, self.options.excerpt_s) else {
            return Ok(None);
        };
        let played = excerpts(&[&comparison.synthesised], samples);
        let gaussian = comparison
            .versions
            .iter()
            .filter(|version| version.played == Played::Gaussian)
            .map(|version| excerpts(&[&version.synthesised], samples))
            .next();
        let (gaussian, mut fitted): (_, Vec<Excerpt>) = match gaussian {
            Some(gaussian) => (gaussian, played),
            None => (played, Vec::new()),
        };
        let mut before = Vec::new();
        if let Some((library, evaluation)) = &self.before {
            let comparison = evaluation.compare(self.set, library, index, self.evaluate)?;
            before = excerpts(&[&comparison.synthesised], samples);
            // Two libraries are compared as they are, even if this one plays only Gaussian noise.
            if fitted.is_empty() {
                fitted.clone_from(&gaussian);
            }
        }
        Ok(Some(TrialExcerpts {
            surface: self.surface(index),
            recording: excerpts(&slices(&comparison.judged), samples),
            gaussian,
            fitted,
            before,
        }))
    }
}
