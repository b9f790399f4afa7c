//! The plan of a listening test: what is heard in which trial, decided by the seed alone.

use std::f64::consts::PI;

use model_format::{Library, SAMPLE_RATE_HZ};
use rand::seq::SliceRandom;
use rand::{RngExt, SeedableRng};
use rand_pcg::Pcg64;
use serde::Serialize;

use crate::evaluation::evaluate;
use crate::evaluation::evaluate::Evaluation;
use crate::evaluation::held_out::{Judge, JudgeKind};
use crate::evaluation::played::Played;
use crate::fit::record::FitRecord;
use crate::recording::RecordingSet;
use crate::support::error::{Error, Result};

/// A kind of signal.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Kind {
    /// A recording that was not fitted.
    Recording,
    /// The texture's filter, excited by Gaussian noise.
    Gaussian,
    /// The texture with all its parts.
    Fitted,
    /// The texture of another library.
    Before,
}

/// Two kinds that are compared.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, clap::ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub enum Pair {
    /// A recording and the texture as fitted.
    RecordingFitted,
    /// A recording and Gaussian noise through the filter.
    RecordingGaussian,
    /// Gaussian noise through the filter and the texture as fitted.
    GaussianFitted,
    /// A recording and the texture of another library.
    RecordingBefore,
    /// The textures of another library and of this one.
    BeforeFitted,
}

/// Options of a test.
#[derive(Clone, Debug)]
pub struct Options {
    /// The pairs; each has as many trials.
    pub pairs: Vec<Pair>,
    /// Trials per pair.
    pub trials: usize,
    /// Duration of an excerpt, s, at most.
    pub excerpt_s: f64,
    /// Seed of the order, the places and the choices of X.
    pub seed: u64,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            pairs: Pair::USUAL.to_vec(),
            trials: 12,
            excerpt_s: 1.5,
            seed: 1,
        }
    }
}

/// One trial: three excerpts, and what they are.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Trial {
    /// The pair.
    pub pair: Pair,
    /// The kind of A.
    pub a: Kind,
    /// The kind of B.
    pub b: Kind,
    /// The kind of X: that of A, or that of B.
    pub x: Kind,
    /// Texture, speed and force.
    pub surface: String,
    /// Indices of the excerpts of A, B and X; all three differ.
    pub sounds: [usize; 3],
}

/// A test.
#[derive(Clone, Debug)]
pub struct Plan {
    /// The trials in their order.
    pub trials: Vec<Trial>,
    /// All excerpts, 5 kHz, each with an RMS of 1.
    pub sounds: Vec<Vec<f64>>,
    /// Shortest and longest duration of an excerpt, s.
    pub excerpt_s: (f64, f64),
    /// Pairs that no texture has, because it is as fitted when it plays Gaussian noise.
    pub left_out: Vec<Pair>,
    /// The data that were held out, in words.
    pub held_out: String,
    /// True if any recording behind it is simulated.
    pub simulated: bool,
    /// The seed.
    pub seed: u64,
}

impl Kind {
    /// The kind's name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Recording => "recording",
            Self::Gaussian => "gaussian",
            Self::Fitted => "fitted",
            Self::Before => "before",
        }
    }
}

impl Pair {
    /// The pairs of one library.
    pub const USUAL: [Self; 3] = [
        Self::RecordingFitted,
        Self::RecordingGaussian,
        Self::GaussianFitted,
    ];

    /// The pairs of two libraries.
    pub const WITH_BEFORE: [Self; 3] = [
        Self::RecordingFitted,
        Self::RecordingBefore,
        Self::BeforeFitted,
    ];

    /// The pairs that are asked for, each once, or the usual ones; `has_before` if another library is compared, too.
    pub fn asked(pairs: &[Self], has_before: bool) -> Vec<Self> {
        let asked = match pairs {
            [] if has_before => &Self::WITH_BEFORE[..],
            [] => &Self::USUAL[..],
            asked => asked,
        };
        let mut each: Vec<Self> = Vec::new();
        for pair in asked {
            if !each.contains(pair) {
                each.push(*pair);
            }
        }
        each
    }

    /// Both kinds.
    pub fn kinds(self) -> [Kind; 2] {
        match self {
            Self::RecordingFitted => [Kind::Recording, Kind::Fitted],
            Self::RecordingGaussian => [Kind::Recording, Kind::Gaussian],
            Self::GaussianFitted => [Kind::Gaussian, Kind::Fitted],
            Self::RecordingBefore => [Kind::Recording, Kind::Before],
            Self::BeforeFitted => [Kind::Before, Kind::Fitted],
        }
    }

    /// The pair's name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::RecordingFitted => "recording-fitted",
            Self::RecordingGaussian => "recording-gaussian",
            Self::GaussianFitted => "gaussian-fitted",
            Self::RecordingBefore => "recording-before",
            Self::BeforeFitted => "before-fitted",
        }
    }
}

impl Plan {
    /// Notes on what was asked for and is not in the test: excerpts of `excerpt_s`, and pairs.
    pub fn notes(&self, excerpt_s: f64, has_takes: bool) -> Vec<String> {
        let remedy = if has_takes {
            ""
        } else {
            ": what is held out by blocks is fitted without codebooks and tracks, and other takes judge them"
        };
        let left_out = self.left_out.iter().map(|pair| {
            format!(
                "{}: left out, because no texture that is heard plays anything but Gaussian noise{remedy}",
                pair.name()
            )
        });
        let mut notes: Vec<String> = left_out.collect();
        if self.excerpt_s.0 < excerpt_s - 0.01 {
            notes.push(format!(
                "sounds take {:.1} s and more, not {excerpt_s} s: held-out recordings do not hold two of it",
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

/// Plans a test as [`plan`] does, of a library and, if there is one, of that of before, which the same `judges` judge.
///
/// # Errors
/// As [`plan`] and [`evaluate::prepare`].
pub fn plan_of(
    set: &RecordingSet,
    judges: &[Judge],
    fitted: Compared<'_>,
    before: Option<Compared<'_>>,
    evaluate: &evaluate::Options,
    options: &Options,
) -> Result<Plan> {
    let prepared =
        |of: Compared<'_>| evaluate::prepare(set, of.library, judges.to_vec(), of.record, evaluate);
    let evaluation = prepared(fitted)?;
    let of_before = before.map(prepared).transpose()?;
    let before = before.map(|before| before.library).zip(of_before.as_ref());
    plan(set, fitted.library, &evaluation, before, evaluate, options)
}

/// Excerpts of a trial of the set, by kind; none of the texture as fitted if that is Gaussian noise.
struct Heard {
    surface: String,
    recording: Vec<Vec<f64>>,
    gaussian: Vec<Vec<f64>>,
    fitted: Vec<Vec<f64>>,
    before: Vec<Vec<f64>>,
}

impl Heard {
    fn of(&self, kind: Kind) -> &[Vec<f64>] {
        match kind {
            Kind::Recording => &self.recording,
            Kind::Gaussian => &self.gaussian,
            Kind::Fitted => &self.fitted,
            Kind::Before => &self.before,
        }
    }

    /// True if a trial of this pair can be made: each kind has an excerpt beside the one that X takes.
    fn has(&self, pair: Pair) -> bool {
        pair.kinds().iter().all(|kind| self.of(*kind).len() >= 2)
    }
}

/// Plans a test of the trials of `set`, which `evaluation` has prepared, and with `before` of those of another library
/// too, with its own evaluation. Speeds and forces of a texture take turns, and so do textures.
///
/// # Errors
/// No trial, speed or pair to compare; recordings that are not held out; a recording that cannot be used any more.
pub fn plan(
    set: &RecordingSet,
    library: &Library<'_>,
    evaluation: &Evaluation,
    before: Option<(&Library<'_>, &Evaluation)>,
    evaluate: &evaluate::Options,
    options: &Options,
) -> Result<Plan> {
    let is_nothing = |index: &usize| evaluation.judges[*index].kind() == JudgeKind::Nothing;
    if (0..set.trials.len()).any(|index| is_nothing(&index)) {
        return Err(Error::Request(
            "nothing is known to be held out, because beside the library there is no record of what it was fitted to; \
             fit it again, which writes the record, or give --takes"
                .into(),
        ));
    }
    let mut generator = Pcg64::seed_from_u64(options.seed);
    let mut order = in_turns(set, &mut generator);
    order.truncate(options.trials);
    let mut heard = Vec::new();
    for index in order {
        let Some(mut read) = read(set, library, evaluation, evaluate, options, index)? else {
            continue;
        };
        if let Some((library, evaluation)) = before {
            let comparison = evaluation.compare(set, library, index, evaluate)?;
            let samples = read.recording.first().map_or(1, Vec::len);
            read.before = excerpts(&[&comparison.synthesised], samples);
            // Two libraries are compared as they are, with other parts than Gaussian noise or without.
            if read.fitted.is_empty() {
                read.fitted.clone_from(&read.gaussian);
            }
        }
        heard.push(read);
    }
    let mut trials = Vec::new();
    let mut sounds: Vec<Vec<f64>> = Vec::new();
    let mut left_out = Vec::new();
    for &pair in &options.pairs {
        let able: Vec<&Heard> = heard.iter().filter(|heard| heard.has(pair)).collect();
        if able.is_empty() {
            left_out.push(pair);
            continue;
        }
        for number in 0..options.trials {
            let heard = able[number % able.len()];
            trials.push(trial(pair, heard, &mut sounds, &mut generator));
        }
    }
    if trials.is_empty() {
        return Err(Error::Request(format!(
            "there is nothing to compare: no recording holds two excerpts of {SHORTEST_EXCERPT_S} s that were not \
             fitted, or no texture has what --pairs asks for"
        )));
    }
    trials.shuffle(&mut generator);
    let seconds = |samples: usize| samples as f64 / f64::from(model_format::SAMPLE_RATE_HZ);
    let lengths = || sounds.iter().map(Vec::len);
    Ok(Plan {
        excerpt_s: (
            seconds(lengths().min().unwrap_or(0)),
            seconds(lengths().max().unwrap_or(0)),
        ),
        trials,
        sounds,
        left_out,
        held_out: evaluation.held_out.clone(),
        simulated: evaluation.simulated,
        seed: options.seed,
    })
}

/// Indices of the set's trials, shuffled, textures by turns.
fn in_turns(set: &RecordingSet, generator: &mut Pcg64) -> Vec<usize> {
    let mut of_textures: Vec<Vec<usize>> = set
        .textures()
        .into_iter()
        .map(|name| {
            let trials = set.trials.iter().enumerate();
            let own = trials.filter(|(_, trial)| trial.texture == name);
            let mut own: Vec<usize> = own.map(|(index, _)| index).collect();
            own.shuffle(generator);
            own
        })
        .collect();
    of_textures.shuffle(generator);
    let longest = of_textures.iter().map(Vec::len).max().unwrap_or(0);
    (0..longest)
        .flat_map(|turn| of_textures.iter().filter_map(move |own| own.get(turn)))
        .copied()
        .collect()
}

/// The excerpts of a trial of the set; `None` if it is silent or too short.
fn read(
    set: &RecordingSet,
    library: &Library<'_>,
    evaluation: &Evaluation,
    evaluate: &evaluate::Options,
    options: &Options,
    index: usize,
) -> Result<Option<Heard>> {
    let comparison = evaluation.compare(set, library, index, evaluate)?;
    let Some(samples) = samples(&comparison.judged, options.excerpt_s) else {
        return Ok(None);
    };
    let judged: Vec<&[f64]> = comparison.judged.iter().map(Vec::as_slice).collect();
    let recording = excerpts(&judged, samples);
    let played = excerpts(&[&comparison.synthesised], samples);
    let versions = comparison.versions.iter();
    let gaussian = versions
        .filter(|version| version.played == Played::Gaussian)
        .map(|version| excerpts(&[&version.synthesised], samples))
        .next();
    let (gaussian, fitted) = match gaussian {
        Some(gaussian) => (gaussian, played),
        None => (played, Vec::new()),
    };
    let trial = &set.trials[index];
    Ok(Some(Heard {
        surface: format!(
            "{}, {} mm/s, {} N",
            trial.texture, trial.speed_mm_s, trial.force_n
        ),
        recording,
        gaussian,
        fitted,
        before: Vec::new(),
    }))
}

/// A trial of `pair`: which is A and which kind X has are thrown like a coin, and no excerpt is heard twice in it.
fn trial(pair: Pair, heard: &Heard, sounds: &mut Vec<Vec<f64>>, generator: &mut Pcg64) -> Trial {
    let [mut a, mut b] = pair.kinds();
    if generator.random_bool(0.5) {
        std::mem::swap(&mut a, &mut b);
    }
    let x = if generator.random_bool(0.5) { a } else { b };
    let mut index_of = |excerpt: &Vec<f64>| {
        // An excerpt of several trials is kept once.
        let known = sounds.iter().position(|sound| sound == excerpt);
        known.unwrap_or_else(|| {
            sounds.push(excerpt.clone());
            sounds.len() - 1
        })
    };
    let (own, other) = (heard.of(x), heard.of(if x == a { b } else { a }));
    let shown = generator.random_range(0..own.len());
    // Another one than is shown.
    let as_x = (shown + generator.random_range(1..own.len())) % own.len();
    let beside = generator.random_range(0..other.len());
    let (own, as_x, other) = (
        index_of(&own[shown]),
        index_of(&own[as_x]),
        index_of(&other[beside]),
    );
    Trial {
        pair,
        a,
        b,
        x,
        surface: heard.surface.clone(),
        sounds: if x == a {
            [own, other, as_x]
        } else {
            [other, own, as_x]
        },
    }
}

/// Duration of the fade at each end of an excerpt, s; short, and free of clicks.
pub const FADE_S: f64 = 0.02;

/// Shortest excerpt, s: shorter ones are mostly fades.
pub const SHORTEST_EXCERPT_S: f64 = 0.2;

/// Samples of excerpts of about `seconds`, of which `blocks` hold at least two that do not overlap; `None` if these
/// would be shorter than [`SHORTEST_EXCERPT_S`].
fn samples(blocks: &[Vec<f64>], seconds: f64) -> Option<usize> {
    let rate_hz = f64::from(SAMPLE_RATE_HZ);
    let mut lengths: Vec<usize> = blocks.iter().map(Vec::len).collect();
    lengths.sort_unstable();
    let longest = lengths.pop()?;
    // Both in the longest block, or one in it and one in the second.
    let most = (longest / 2).max(lengths.pop().unwrap_or(0));
    let samples = most.min((seconds * rate_hz) as usize);
    (samples as f64 >= SHORTEST_EXCERPT_S * rate_hz).then_some(samples)
}

/// Excerpts of `samples` of a signal in blocks, side by side, each with an RMS of 1 about its mean before its ends
/// fade. Silent ones are left out.
fn excerpts(blocks: &[&[f64]], samples: usize) -> Vec<Vec<f64>> {
    let parts = blocks.iter().flat_map(|block| block.chunks_exact(samples));
    parts.filter_map(levelled).collect()
}

fn levelled(part: &[f64]) -> Option<Vec<f64>> {
    let mean = part.iter().sum::<f64>() / part.len() as f64;
    let square = part.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / part.len() as f64;
    let gain = 1.0 / square.sqrt();
    let fade = (FADE_S * f64::from(SAMPLE_RATE_HZ)) as usize;
    let weight = |n: usize| {
        let from_end = n.min(part.len() - 1 - n);
        if from_end < fade {
            0.5 - 0.5 * (PI * (from_end as f64 + 0.5) / fade as f64).cos()
        } else {
            1.0
        }
    };
    let sample = |(n, x): (usize, &f64)| (x - mean) * gain * weight(n);
    gain.is_finite()
        .then(|| part.iter().enumerate().map(sample).collect())
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn heard() -> Heard {
        let of = |kind: usize| {
            let excerpt = |n: usize| vec![kind as f64, n as f64];
            (0..3).map(excerpt).collect::<Vec<_>>()
        };
        Heard {
            surface: "denim, 120 mm/s, 1 N".into(),
            recording: of(0),
            gaussian: of(1),
            fitted: of(2),
            before: of(3),
        }
    }

    fn planned(seed: u64, count: usize) -> (Vec<Trial>, Vec<Vec<f64>>) {
        let mut generator = Pcg64::seed_from_u64(seed);
        let mut sounds = Vec::new();
        let trials = (0..count)
            .map(|n| {
                let pair = Pair::WITH_BEFORE[n % 3];
                trial(pair, &heard(), &mut sounds, &mut generator)
            })
            .collect();
        (trials, sounds)
    }

    proptest! {
        #[test]
        fn x_is_another_excerpt_of_the_kind_of_a_or_b(seed: u64) {
            let (trials, sounds) = planned(seed, 30);
            for trial in &trials {
                prop_assert!(trial.x == trial.a || trial.x == trial.b);
                let kinds = [trial.a, trial.b, trial.x];
                for (kind, sound) in kinds.into_iter().zip(trial.sounds) {
                    prop_assert_eq!(sounds[sound][0] as usize, kind as usize);
                }
                let [a, b, x] = trial.sounds;
                prop_assert!(a != b && b != x && a != x);
                let mut pair = trial.pair.kinds().map(Kind::name);
                let mut played = [trial.a, trial.b].map(Kind::name);
                pair.sort_unstable();
                played.sort_unstable();
                prop_assert_eq!(pair, played);
            }
        }

        #[test]
        fn a_seed_decides_all(seed: u64) {
            prop_assert_eq!(planned(seed, 12), planned(seed, 12));
        }
    }

    #[test]
    fn coins_are_fair() {
        let (trials, _) = planned(5, 4000);
        let share = |is: fn(&Trial) -> bool| {
            trials.iter().filter(|trial| is(trial)).count() as f64 / trials.len() as f64
        };
        for share in [
            share(|trial| trial.x == trial.a),
            share(|trial| trial.a == trial.pair.kinds()[0]),
            share(|trial| (trial.x == trial.a) == (trial.a == trial.pair.kinds()[0])),
        ] {
            assert!((share - 0.5).abs() < 0.04, "{share}");
        }
    }

    proptest! {
        #[test]
        fn two_excerpts_fit_side_by_side(
            lengths in prop::collection::vec(0usize..30_000, 0..6),
            seconds in 0.2..5.0f64,
        ) {
            let blocks: Vec<Vec<f64>> = lengths
                .iter()
                .map(|&len| (0..len).map(|n| (n as f64 * 0.7).sin()).collect())
                .collect();
            if let Some(samples) = samples(&blocks, seconds) {
                let slices: Vec<&[f64]> = blocks.iter().map(Vec::as_slice).collect();
                prop_assert!(excerpts(&slices, samples).len() >= 2);
                prop_assert!(samples <= (seconds * 5000.0) as usize);
            }
        }
    }

    #[test]
    fn excerpts_have_one_rms_and_begin_and_end_near_zero() {
        let loud: Vec<f64> = (0..10_000)
            .map(|n| 40.0 * (f64::from(n) * 0.3).sin() + 7.0)
            .collect();
        let soft: Vec<f64> = loud.iter().map(|x| x * 1e-4).collect();
        for signal in [loud, soft] {
            let found = excerpts(&[&signal], 5000);
            assert_eq!(found.len(), 2);
            for excerpt in found {
                let middle = &excerpt[100..4900];
                let rms = (middle.iter().map(|x| x * x).sum::<f64>() / middle.len() as f64).sqrt();
                assert!((rms - 1.0).abs() < 0.01, "{rms}");
                assert!(excerpt[0].abs() < 1e-3 && excerpt[4999].abs() < 1e-3);
            }
        }
        assert_eq!(excerpts(&[&vec![3.0; 5000]], 1000), Vec::<Vec<f64>>::new());
    }
}
