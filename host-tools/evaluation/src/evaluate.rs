//! Comparison with recordings: each trial is played by the device's own kernel at its speed and force, and compared
//! with recordings that were not fitted.
//!
//! Each figure of the synthesis is accompanied by the figure of another recording of the same surface, judged in the
//! same way: the fitted blocks against the judged blocks, or one take against another. A synthesis need not come closer
//! than that.

use std::collections::HashMap;

use model_format::{Library, MillimetresPerSecond, Newton, SAMPLE_RATE_HZ, Texture};
use serde::Serialize;
use stylus_dsp::high_pass::high_pass;
use stylus_dsp::spectrum::{self, BAND_COUNT, BAND_LABELS_HZ, DEFAULT_SMOOTHING_WIDTH_HZ};
use stylus_dsp::sums::rms;
use stylus_fit::fit::blocks::{Blocks, Part};
use stylus_fit::fit::conditioning::Conditioning;
use stylus_fit::fit::lines::Lines;
use stylus_fit::fit::record::FitRecord;
use stylus_fit::fit::{self, FloorChoice, Recordings, Signal};
use stylus_fit::texture::library::{decoded, library_of};
use stylus_signals::playing::motion::MotionPath;
use stylus_signals::playing::render::{Rendered, render};
use stylus_signals::recording::{RecordingSet, Trial};
use stylus_support::in_order::in_order;
use stylus_support::names::portable;
use stylus_support::names::{listed, nearly};
use stylus_support::number::{not_negative, positive};
use stylus_support::{Error, Result};

use super::held_out::{Judge, JudgeKind, in_words};
use super::liveliness::{self, Signals, TrialLiveliness, slices};
use super::loudness::{self, TrialLoudness};
use super::perception::{Perceived, ScoringRange};
use super::played::{self, Played, Version};
use super::summary::{
    Scores, TextureEvaluation, TrialEvaluation, judged_hz, summarise, table, tables, target_in_words,
};
use super::table::Table;
use super::verdict;

/// Beginning of a synthesis that no comparison uses, s: the frontier's filters begin at rest.
pub(super) const WARM_UP_S: f64 = 0.5;

/// Options of an evaluation, which the command and Python have by this description.
#[derive(Clone, Copy, Debug, clap::Args)]
pub struct Options {
    /// From three axes to one signal, as for the fit
    #[command(flatten)]
    pub conditioning: Conditioning,
    /// Full width of the Hann kernel that smooths amplitudes for the cost C, in hertz
    #[arg(
        long = "smoothing",
        value_name = "HZ",
        value_parser = not_negative,
        default_value_t = DEFAULT_SMOOTHING_WIDTH_HZ
    )]
    pub smoothing_hz: f64,
    /// Least duration of each synthesis, in seconds; those of removed nodes take half of it. Band levels are more exact
    /// in longer ones
    #[arg(long = "synthesis", value_name = "S", value_parser = positive, default_value_t = 10.0)]
    pub synthesis_s: f64,
    /// Seed of the noise; each trial has its own
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Parts of each texture that are played: all as fitted, none (Gaussian noise), or the residual and its level
    /// without lines that are tied to position
    #[arg(long, value_enum, default_value = "fitted")]
    pub played: Played,
    /// Duration of the excerpts of each trial and its synthesis that are kept for listening, s; none to keep no
    /// excerpts.
    #[arg(skip)]
    pub excerpt_s: Option<f64>,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            conditioning: Conditioning::default(),
            smoothing_hz: DEFAULT_SMOOTHING_WIDTH_HZ,
            synthesis_s: 10.0,
            seed: 1,
            played: Played::Fitted,
            excerpt_s: None,
        }
    }
}

/// The outcome of an evaluation.
#[derive(Clone, Debug, Serialize)]
pub struct Evaluation {
    /// The data that were held out, in words.
    pub held_out: String,
    /// The kernel that smooths amplitudes for C.
    pub smoothing: String,
    /// The bands' nominal centre frequencies, Hz.
    pub bands_hz: [&'static str; BAND_COUNT],
    /// True if any recording of the evaluation is simulated.
    pub simulated: bool,
    /// One line per texture.
    pub textures: Vec<TextureEvaluation>,
    /// Properties that a spectrum does not show, over all trials.
    pub liveliness: Vec<liveliness::Summary>,
    /// Every trial, in the order of the set.
    pub trials: Vec<TrialEvaluation>,
    /// The judge of each trial.
    #[serde(skip)]
    pub judges: Vec<Judge>,
    /// Excerpts of every trial, in the order of the set; none unless they were asked for.
    #[serde(skip)]
    pub excerpts: Vec<Excerpt>,
    /// Models that were fitted to blocks.
    #[serde(skip)]
    refitted: Refitted,
    /// Signals without the rig's noise, by the index of the trial, if the fit subtracted the noise.
    #[serde(skip)]
    without_noise: HashMap<usize, Signal>,
}

/// Excerpts to listen to, at the models' rate, m/s²: the middle of the longest block that judges a trial, and the
/// middle of the synthesis.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Excerpt {
    /// Excerpt of the recording.
    pub recorded: Vec<f32>,
    /// Excerpt of the synthesis.
    pub synthesised: Vec<f32>,
}

impl Excerpt {
    fn of(comparison: &Comparison, seconds: f64) -> Self {
        let middle = |signal: &[f64]| -> Vec<f32> {
            let samples = (seconds * f64::from(SAMPLE_RATE_HZ)).round() as usize;
            let len = samples.min(signal.len());
            let begin = (signal.len() - len) / 2;
            let part = signal[begin..begin + len].iter();
            // Pages keep 16 bits per sample, so single precision is enough.
            part.map(|value| *value as f32).collect()
        };
        Self {
            recorded: middle(comparison.longest_block()),
            synthesised: middle(&comparison.synthesised),
        }
    }
}

/// Libraries of one texture each: name and bytes.
type Refitted = Vec<(String, Vec<u8>)>;

/// The recording that judges a trial, the other recording, and the synthesis, at the models' rate, m/s².
#[derive(Clone, Debug)]
pub struct Comparison {
    /// The whole recording; `judged` is a part of it, or all. It is for pictures and sounds, not for figures.
    pub recording: Vec<f64>,
    /// The held-out recording in blocks; one block if nothing of it was fitted.
    pub judged: Vec<Vec<f64>>,
    /// Another recording, to be compared with `beside`: the blocks that a fit to blocks uses, or the set's own take.
    pub other: Vec<Vec<f64>>,
    /// Recording that `other` is compared with. If empty, that is `judged`.
    beside: Vec<Vec<f64>>,
    /// The synthesis after warming up. It is at least as long as the judged blocks together.
    pub synthesised: Vec<f64>,
    /// Synthesis by the library itself, if `synthesised` is that of models refitted to blocks. The loudest events are
    /// judged by it.
    of_library: Option<Vec<f64>>,
    /// Samples of the synthesis at full scale.
    pub saturations: u32,
    /// The parts that the synthesis plays, in words.
    pub parts: String,
    /// Versions of the texture with other parts and the same seed, if it has parts.
    pub versions: Vec<Version>,
    /// The lowest sample rate of the compared files, Hz.
    source_rate_hz: f64,
    /// The highest cut-off frequency of the high-pass filters that the compared recordings have passed, Hz; none
    /// without a filter.
    cut_hz: Option<f64>,
}

impl Comparison {
    /// The longest judged block.
    pub fn longest_block(&self) -> &[f64] {
        self.judged
            .iter()
            .max_by_key(|block| block.len())
            .map_or(&[], Vec::as_slice)
    }

    /// The frequencies that can be judged; `None` if blocks are too short.
    fn range(&self) -> Option<ScoringRange> {
        let blocks = [&self.judged, &self.other, &self.beside];
        // All spectra of a comparison have segments of one length, so that the window's leakage is the same in them.
        let shortest = blocks.into_iter().flatten().map(Vec::len).min();
        ScoringRange::of_filtered(self.source_rate_hz, shortest?, self.cut_hz)
    }

    /// Filters a synthesis like the recording that it is compared with.
    fn condition(&self, synthesised: &mut [f64]) {
        // The model fills the band below the cut of the recordings, and their kurtosis and levels lack that band.
        if let Some(cut_hz) = self.cut_hz {
            high_pass(synthesised, f64::from(SAMPLE_RATE_HZ), cut_hz);
        }
    }
}

/// The texture of `library` that a trial names.
///
/// # Errors
/// A texture that the library does not have. The error lists those that it has.
pub fn texture_named<'a>(library: &Library<'a>, name: &str) -> Result<Texture<'a>> {
    library.texture(name).ok_or_else(|| {
        let names: Vec<&str> = library.textures().map(|texture| texture.name()).collect();
        let scenes: Vec<String> = library.scenes().map(|scene| scene.name.to_string()).collect();
        let scene = nearly(name, &scenes).map(|scene| format!("; '{scene}' is a scene of it"));
        Error::Request(format!(
            "the library has no texture '{name}'; it has {}{}",
            listed(name, &names),
            scene.unwrap_or_default()
        ))
    })
}

/// Plays `texture` at the speed and force of `trial` for at least `samples` samples after warming up. Returns the
/// synthesis, m/s², and the number of samples at full scale.
fn play(texture: Texture<'_>, trial: &Trial, samples: usize, options: &Options, seed: u64) -> Result<(Vec<f64>, u32)> {
    let rate_hz = f64::from(SAMPLE_RATE_HZ);
    let seconds = (samples as f64 / rate_hz).max(options.synthesis_s) + WARM_UP_S;
    let motion = MotionPath::constant(
        MillimetresPerSecond(trial.speed_mm_s as f32),
        Newton(trial.force_n as f32),
    )?;
    let rendered: Rendered = render(texture, &motion, seconds, seed)?;
    let warm_up = (WARM_UP_S * rate_hz) as usize;
    let synthesised = rendered.accelerations_m_s2().split_off(warm_up);
    Ok((synthesised, rendered.saturations))
}

/// Returns the signals of `set` without the rig's noise, by the index of the trial, if the fit of `record` subtracted
/// it. Leaves out textures whose noise is not known here.
fn without_noise(set: &RecordingSet, record: Option<&FitRecord>, conditioning: Conditioning) -> HashMap<usize, Signal> {
    let is_taken_off = |record: &&FitRecord| record.options.floor == FloorChoice::Subtract;
    let Some(record) = record.filter(is_taken_off) else {
        return HashMap::new();
    };
    let options = fit::Options {
        conditioning,
        // A search for lines would take them out of the signals that judge.
        lines: Lines::None,
        sample_rate_hz: SAMPLE_RATE_HZ,
        ..record.options.clone()
    };
    let of_texture = |(_, members): (&str, Vec<usize>)| {
        // Recordings that cannot be read are reported by the comparison.
        Recordings::read(set, &members, &options, Part::Whole, &|_| ())
            .ok()
            .map_or_else(Vec::new, |own| own.trials)
    };
    set.by_texture()
        .into_iter()
        .flat_map(of_texture)
        .filter(|own| own.trial.is_in_motion_and_contact())
        .filter_map(|own| Some((own.number, own.signal?)))
        .collect()
}

/// Prepares the comparison of a trial with its judge, from the trial's `signal` and without a synthesis yet.
fn read(signal: Signal, judge: &Judge, conditioning: Conditioning) -> Result<Comparison> {
    let Signal {
        samples: own,
        mut source_rate_hz,
        mut cut_hz,
        ..
    } = signal;
    let blocks = Blocks::of(own.len());
    let fitted = blocks.fitted().map(|block| own[block].to_vec()).collect();
    let left = blocks.judged().map(|block| own[block].to_vec()).collect();
    let (judged, other, beside): (Vec<Vec<f64>>, _, _) = match judge {
        Judge::Blocks => (left, fitted, Vec::new()),
        Judge::OtherTake(take) => {
            let take = fit::signal(take, conditioning)?;
            // Frequencies that either recording lacks cannot be judged.
            source_rate_hz = source_rate_hz.min(take.source_rate_hz);
            cut_hz = cut_hz.into_iter().chain(take.cut_hz).reduce(f64::max);
            (vec![take.samples], vec![own.clone()], Vec::new())
        }
        // All of it judges. Its two halves in blocks only show how far parts of one recording are from each other.
        Judge::Unseen | Judge::Nothing => (vec![own.clone()], fitted, left),
    };
    let recording = match judge {
        Judge::OtherTake(_) => judged[0].clone(),
        Judge::Blocks | Judge::Unseen | Judge::Nothing => own,
    };
    Ok(Comparison {
        recording,
        judged,
        other,
        beside,
        synthesised: Vec::new(),
        of_library: None,
        saturations: 0,
        parts: String::new(),
        versions: Vec::new(),
        source_rate_hz,
        cut_hz,
    })
}

/// Fits the trials that blocks judge, without an evaluation. [`Evaluation::compare`] then works.
///
/// # Errors
/// A texture that the library does not have or that plays at another rate, a recording that cannot be used, or blocks
/// to judge without a record.
pub fn prepare(
    set: &RecordingSet,
    library: &Library<'_>,
    judges: Vec<Judge>,
    record: Option<&FitRecord>,
    options: &Options,
) -> Result<Evaluation> {
    // Checked before anything is fitted, which may take minutes.
    for name in set.textures() {
        let rate_hz = texture_named(library, name)?.sample_rate_hz();
        if rate_hz != SAMPLE_RATE_HZ {
            return Err(Error::Request(format!(
                "texture '{name}' plays at {rate_hz} Hz, recordings are compared at {SAMPLE_RATE_HZ}"
            )));
        }
    }
    let (refitted, blocks_s) = refit(set, &judges, record, options)?;
    let without_noise = without_noise(set, record, options.conditioning);
    Ok(Evaluation {
        held_out: in_words(&judges, blocks_s) + &noise_in_words(record, &judges, &without_noise),
        smoothing: format!("Hann kernel, {} Hz wide", options.smoothing_hz),
        bands_hz: BAND_LABELS_HZ,
        simulated: set.is_simulated(),
        textures: Vec::new(),
        liveliness: Vec::new(),
        trials: Vec::new(),
        judges,
        excerpts: Vec::new(),
        refitted,
        without_noise,
    })
}

/// Returns a text that says which recordings have the rig's noise that the fit of `record` subtracted; empty if it
/// subtracted none.
fn noise_in_words(record: Option<&FitRecord>, judges: &[Judge], without_noise: &HashMap<usize, Signal>) -> String {
    if record.is_none_or(|record| record.options.floor != FloorChoice::Subtract) {
        return String::new();
    }
    let is_take = |judge: &Judge| matches!(judge, Judge::OtherTake(_));
    if without_noise.is_empty() || judges.iter().any(is_take) {
        return " The fit took the rig's noise off, and the recordings that judge it have it: where that is strong, \
                the synthesis is softer."
            .to_owned();
    }
    " The rig's noise is taken off the recordings as it was for the fit.".to_owned()
}

/// Evaluates every trial of `set` with its judge in `judges`. Calls `progress` after each trial.
///
/// For trials judged by blocks, the library is fitted again to the blocks between, with the options of `record`. Trials
/// judged by other recordings are played from `library` as it is. The result does not depend on the number of threads.
pub fn evaluate(
    set: &RecordingSet,
    library: &Library<'_>,
    judges: Vec<Judge>,
    record: Option<&FitRecord>,
    options: &Options,
    progress: impl Fn() + Sync,
) -> Result<Evaluation> {
    let mut evaluation = prepare(set, library, judges, record, options)?;
    let indices: Vec<usize> = (0..set.trials.len()).collect();
    let judged = in_order(&indices, |&index| -> Result<_> {
        let comparison = evaluation.compare(set, library, index, options)?;
        let trial = &set.trials[index];
        let judge = &evaluation.judges[index];
        let mut judged = judged(trial, judge.kind(), &comparison, options);
        if let Judge::OtherTake(take) = judge {
            judged.other_take = Some(portable(&take.file));
        }
        let excerpt = options.excerpt_s.map(|s| Excerpt::of(&comparison, s));
        progress();
        Ok((judged, excerpt))
    })?;
    for (trial, excerpt) in judged {
        evaluation.trials.push(trial);
        evaluation.excerpts.extend(excerpt);
    }
    evaluation.textures = set
        .textures()
        .into_iter()
        .map(|name| {
            let own = evaluation.trials.iter_mut().filter(|t| t.texture == name);
            // This must come before the summary and the verdict, which read the ratios that it sets.
            loudness::set_around(&mut own.filter_map(TrialEvaluation::placed).collect::<Vec<_>>());
            let mut texture = summarise(name, &evaluation.trials);
            let own = evaluation.trials.iter().filter(|t| t.texture == name);
            texture.verdict = verdict::of_texture(&texture, &own.collect::<Vec<_>>());
            texture
        })
        .collect();
    let heard = evaluation.trials.iter().filter(|trial| !trial.is_silent);
    evaluation.liveliness = liveliness::summaries(heard.filter_map(|t| t.liveliness.as_ref()));
    Ok(evaluation)
}

impl Options {
    /// The seed of trial `index`.
    fn seed_of(&self, index: usize) -> u64 {
        // A user may give any seed, up to the largest.
        self.seed.wrapping_add(index as u64)
    }
}

impl Evaluation {
    /// The frequencies of all figures, in words.
    pub fn judged_hz(&self) -> String {
        judged_hz(&self.trials)
    }

    /// The verdict on each texture, after its name.
    pub fn verdicts(&self) -> impl Iterator<Item = String> {
        self.textures
            .iter()
            .map(|texture| format!("{}: {}", texture.texture, texture.verdict))
    }

    /// The table of all textures: the figures of the synthesis and, in brackets, those of the target, which the title
    /// explains.
    pub fn table(&self) -> Table {
        table(&self.textures, target_in_words(&self.trials))
    }

    /// Further tables of all textures: of spectra, and of what a spectrum does not show.
    pub fn tables(&self) -> [Table; 2] {
        tables(&self.textures, &self.liveliness)
    }

    /// Reads the judge of trial `index` of the evaluated set, and plays what it judges.
    pub fn compare(
        &self,
        set: &RecordingSet,
        library: &Library<'_>,
        index: usize,
        options: &Options,
    ) -> Result<Comparison> {
        let trial = &set.trials[index];
        // Triage cuts the same parts here as for the fit, so the blocks that are left out here are those that the fit
        // left out.
        let signal = match self.without_noise.get(&index) {
            Some(signal) => signal.clone(),
            None => fit::signal(trial, options.conditioning)?,
        };
        let mut comparison = read(signal, &self.judges[index], options.conditioning)?;
        let samples = comparison.judged.iter().map(Vec::len).sum();
        let seed = options.seed_of(index);
        let refitted = self
            .refitted
            .iter()
            // Other trials of the same texture may be judged by other takes, which judge the library itself.
            .find(|(name, _)| *name == trial.texture && self.judges[index] == Judge::Blocks);
        let refitted = refitted.map(|(_, bytes)| decoded(bytes)).transpose()?;
        let texture = texture_named(refitted.as_ref().unwrap_or(library), &trial.texture)?;
        let stored = played::parts(&texture);
        comparison.parts = played::in_words(&options.played.of(&stored));
        let play = |texture: &Texture<'_>, played| -> Result<_> {
            let (mut synthesised, saturations) =
                played::with(texture, played, |texture| play(texture, trial, samples, options, seed))?;
            comparison.condition(&mut synthesised);
            Ok((synthesised, saturations))
        };
        let (played, saturations) = play(&texture, options.played)?;
        // The refitted models never saw half of the recording, so that a click of the library could hide from them.
        let of_library = match refitted {
            Some(_) => Some(play(&texture_named(library, &trial.texture)?, options.played)?.0),
            None => None,
        };
        let mut versions = Vec::new();
        for version in options.played.beside(&stored) {
            let (synthesised, _) = play(&texture, version)?;
            versions.push(Version {
                played: version,
                parts: played::in_words(&version.of(&stored)),
                synthesised,
            });
        }
        Ok(Comparison {
            synthesised: played,
            of_library,
            saturations,
            versions,
            ..comparison
        })
    }
}

/// If blocks judge any trial, fits all trials that the fit of `record` used to the blocks between. Returns a library
/// for each of their textures, and the durations of the shortest and the longest block, s.
fn refit(
    set: &RecordingSet,
    judges: &[Judge],
    record: Option<&FitRecord>,
    options: &Options,
) -> Result<(Refitted, (f64, f64))> {
    if !judges.contains(&Judge::Blocks) {
        return Ok((Vec::new(), (0.0, 0.0)));
    }
    let Some(record) = record else {
        return Err(Error::Request(
            "blocks of a recording judge a fit whose options are known; none are".into(),
        ));
    };
    let mut part = RecordingSet {
        trials: Vec::new(),
        is_listed: set.is_listed,
    };
    for (trial, judge) in set.trials.iter().zip(judges) {
        let is_fitted = match judge {
            Judge::Blocks => true,
            // Takes judge these trials, but a texture's lines and codebooks are found in all of its trials together.
            Judge::OtherTake(_) => record.used(trial)?,
            Judge::Unseen | Judge::Nothing => false,
        };
        part.trials.extend(is_fitted.then(|| trial.clone()));
    }
    let fit_options = fit::Options {
        conditioning: options.conditioning,
        // A strict fit has the same models. It only refuses findings of triage and samples without a scale, which were
        // accepted when the library was fitted.
        strict: false,
        sample_rate_hz: SAMPLE_RATE_HZ,
        ..record.options.clone()
    };
    // All signals are held, because the excitation is fitted to them.
    let recordings = fit::read(&part, &fit_options, Part::Blocks, usize::MAX, &|_| ())?;
    let blocks_s = recordings
        .iter()
        .flat_map(|own| &own.trials)
        .map(|own| Blocks::of(own.samples().len()).block_s());
    let range_s = blocks_s.fold((f64::INFINITY, 0.0f64), |(low, high), s| (low.min(s), high.max(s)));
    let fit = fit::fit_recordings(&part, recordings, &fit_options, Part::Blocks, &|_| ())?;
    let libraries = fit.textures.into_iter().map(|texture| {
        let bytes = library_of(&texture.name, &texture.grid)?;
        Ok((texture.name, bytes))
    });
    Ok((libraries.collect::<Result<_>>()?, range_s))
}

impl Comparison {
    /// Returns the part of the judge with which the other recording is compared.
    fn beside(&self) -> Vec<&[f64]> {
        let is_all = self.beside.is_empty();
        slices(if is_all { &self.judged } else { &self.beside })
    }

    /// Cuts a synthesis into blocks as long as the longest of the judge.
    fn in_blocks<'s>(&self, synthesised: &'s [f64]) -> Vec<&'s [f64]> {
        // `chunks_exact` panics on 0, the length without a block.
        let len = self.longest_block().len().max(1);
        synthesised.chunks_exact(len).collect()
    }
}

/// Judges a comparison.
fn judged(trial: &Trial, judge: JudgeKind, comparison: &Comparison, options: &Options) -> TrialEvaluation {
    let judged_blocks = slices(&comparison.judged);
    let other = slices(&comparison.other);
    // Amplitudes of signals of different lengths cannot be compared.
    let played = comparison.in_blocks(&comparison.synthesised);
    let (recorded_rms, synthesised_rms) = (rms(&comparison.judged.concat()), rms(&comparison.synthesised));
    let is_silent = recorded_rms <= 0.0 || synthesised_rms <= 0.0;
    let range = comparison.range();
    let usable = range.filter(|_| !is_silent);
    let scores = usable.map_or(Scores::NONE, |range| {
        scores_of(&judged_blocks, &played, &range, options)
    });
    let is_held_out = judge != JudgeKind::Nothing;
    let is_judged = is_held_out && !is_silent;
    // These figures need no data that are held out, because no model takes part.
    let others = usable.map(|range| scores_of(&comparison.beside(), &other, &range, options));
    let block = comparison.longest_block().len();
    TrialEvaluation {
        file: portable(&trial.file),
        texture: trial.texture.clone(),
        speed_mm_s: trial.speed_mm_s,
        force_n: trial.force_n,
        judge,
        other_take: None,
        range,
        is_silent,
        recorded_rms_m_s2: recorded_rms,
        synthesised_rms_m_s2: synthesised_rms,
        liveliness: is_judged.then(|| {
            TrialLiveliness::of(&Signals {
                judged: &comparison.judged,
                synthesised: &comparison.synthesised,
                parts: &comparison.parts,
                versions: &comparison.versions,
                other: &comparison.other,
            })
        }),
        loudest_5_ms: TrialLoudness::of(
            &comparison.judged,
            &comparison.synthesised,
            &comparison.other,
            comparison.of_library.as_deref(),
        )
        .filter(|_| is_judged),
        scores: if is_held_out { scores } else { Scores::NONE },
        cost_floor: spectrum::expected_cost_of_blocks(
            judged_blocks.len(),
            block,
            f64::from(SAMPLE_RATE_HZ),
            options.smoothing_hz,
        ),
        other: others.unwrap_or(Scores::NONE),
        saturations: comparison.saturations,
    }
}

/// Scores `signal` against `reference`, both in blocks.
fn scores_of(reference: &[&[f64]], signal: &[&[f64]], range: &ScoringRange, options: &Options) -> Scores {
    let rate_hz = f64::from(SAMPLE_RATE_HZ);
    let spectrum = |of: &[&[f64]]| spectrum::PowerSpectrum::of_blocks(of, range.segment, rate_hz);
    let (judge, played) = (spectrum(reference), spectrum(signal));
    let (low_hz, high_hz) = range.distance_hz();
    Scores {
        cost: spectrum::cost_of_blocks(reference, signal, rate_hz, options.smoothing_hz, range.cost_hz),
        band_errors_db: spectrum::band_errors_within_db(&judge, &played, range.band_edges_hz()),
        log_spectral_distance_db: spectrum::distance_of_spectra_db(&judge, &played, low_hz, high_hz),
        perceived: Some(Perceived::of(&judge, &played, range)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use stylus_support::float_wav::float_wav;
    use test_helpers::noise;

    /// A trial of 6 s of noise, with a silence in its third second that triage cuts.
    fn trial_with_a_silent_part(folder: &std::path::Path) -> Trial {
        let file = folder.join("noise.wav");
        let mut samples = noise(5, 30_000);
        samples.iter_mut().for_each(|x| *x *= 2.0);
        samples[10_300..13_900].fill(0.0);
        let bytes = float_wav(1, SAMPLE_RATE_HZ, samples).unwrap();
        std::fs::write(&file, bytes).unwrap();
        Trial::of(file, "felt", 100.0, 1.0)
    }

    #[test]
    fn the_blocks_that_judge_are_those_that_the_fit_left_also_where_triage_cuts() {
        let folder = tempfile::tempdir().unwrap();
        let trial = trial_with_a_silent_part(folder.path());
        let (analysis, signal) = fit::analyse(&trial, &fit::Options::default(), Part::Blocks).unwrap();
        assert!(analysis.cut_s > 0.5, "{}", analysis.cut_s);
        let of_signal = |block: std::ops::Range<usize>| signal.samples[block].to_vec();
        let blocks = Blocks::of(signal.samples.len());
        let left: Vec<Vec<f64>> = blocks.judged().map(of_signal).collect();
        let used: Vec<Vec<f64>> = blocks.fitted().map(of_signal).collect();
        let fitted: usize = used.iter().map(Vec::len).sum();
        assert_eq!(analysis.samples, fitted);
        let signal = fit::signal(&trial, Conditioning::default()).unwrap();
        let comparison = read(signal, &Judge::Blocks, Conditioning::default()).unwrap();
        assert_eq!(comparison.judged, left);
        assert_eq!(comparison.other, used);
    }
}
