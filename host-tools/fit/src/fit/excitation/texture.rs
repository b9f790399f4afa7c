//! The choice of a texture's excitation, from the traces of its trials.

use crate::support::number::counted;
use model_format::{BLOCK_BYTES, BLOCK_SAMPLES, ExcitationSpec, ModulationSpec, PartsSpec, SAMPLE_RATE_HZ, limits};
use serde::{Deserialize, Serialize};

use super::bound::{self, Reach};
use super::choice::{self, Distances};
use super::codebook::{Coded, coded, coded_in_blocks};
use super::evidence::{Evidence, KURTOSIS_SAMPLES, LEAST_WINDOWS, LEVEL, Sums, kurtosis, spread};
use super::level::{BESIDE_CODEBOOK, BESIDE_NOISE, amplitude, track};
use super::material::{LEAST_STRETCHES, Level, MOST_STRETCHES, MOST_STRETCHES_OF_MOMENTS, STRETCH_SAMPLES, choose};
use super::regions::{Region, by_speed, regions};
use super::trace::Trace;
use crate::fit::options::{ExcitationChoice, ModulationChoice, Options};
use crate::support::warning::Warning;

/// Highest product of a codebook's peak and a track's level, standard deviations. If two pieces both peak where they
/// are joined, they reach 1.41 times this, which is still below the excitation's full scale of 64.
const HIGHEST_PEAK: f64 = 45.0;

/// Highest peak of recorded snippets before coding, standard deviations. Compensation for the power lost in coding
/// raises it to at most 40.
const HIGHEST_PEAK_OF_MOMENTS: f64 = 36.0;

/// Least improvement, dB, for which each range of speeds gets recorded snippets of its own. A smaller improvement may
/// be chance, and does not outweigh that each region has less material.
const LEAST_HEARD_GAIN_DB: f64 = 0.05;

/// Upper bound of the bytes of a part in addition to its codes, entries and nodes, and of a codebook in addition to its
/// codes.
const HEADER_BYTES: usize = 16;

/// Excitation and level of a texture, and the report on them.
#[derive(Clone, Debug)]
pub(in crate::fit) struct Chosen {
    /// Only the excitation and the modulation are set.
    pub parts: PartsSpec,
    pub report: ExcitationReport,
    /// Notes for the user.
    pub notes: Vec<Warning>,
    /// Nodes, by their indices of speed and force, that are still too loud, with the factor by which they are.
    pub excess: Vec<((usize, usize), f64)>,
}

/// Grid of a texture.
#[derive(Clone, Copy, Debug)]
pub(in crate::fit) struct Axes<'a> {
    pub speeds_mm_s: &'a [f32],
    pub forces_n: &'a [f32],
}

/// The texture for which an excitation is chosen, and the bytes that the excitation may take.
#[derive(Clone, Copy, Debug)]
pub(in crate::fit) struct Choice<'a> {
    /// Name of the texture.
    pub name: &'a str,
    pub axes: Axes<'a>,
    pub options: &'a Options,
    /// Bytes of the library that the excitation may take.
    pub room: usize,
}

/// A codebook for a region.
struct OfRegion {
    region: Region,
    coded: Coded,
    kurtosis: Evidence,
    trials: usize,
    seconds: f64,
}

impl Choice<'_> {
    /// Chooses the excitation by `traces`: recorded snippets if these are nearer to blocks that were not fitted, and
    /// otherwise an excitation with a separate level.
    pub(super) fn made(&self, traces: &[Trace]) -> Chosen {
        let apart = |reach: &Reach| Some(self.apart(traces, reach));
        let is_free =
            self.options.modulation == ModulationChoice::Auto && self.options.excitation == ExcitationChoice::Auto;
        // Snippets keep a level that varies. At a steady level there is nothing for them to keep.
        let chosen = if is_free && spread_of(traces).is_significant() {
            self.nearer(traces)
        } else {
            self.bounded(traces, apart).map(|(chosen, _)| chosen)
        };
        let mut chosen = chosen.unwrap_or_else(|| self.apart(traces, &Reach::FIRST));
        chosen.excess = bound::remaining_excess(traces, self.axes.forces_n.len(), &chosen.parts);
        chosen
    }

    /// Returns the nearer one of recorded snippets and an excitation with a separate level.
    fn nearer(&self, traces: &[Trace]) -> Option<Chosen> {
        let half = choice::fitted(traces);
        let division = self.division(traces, &half);
        let forces = self.axes.forces_n.len();
        let distance_db = |chosen: &Chosen| choice::distance_db(traces, forces, &chosen.parts);
        let moments_db = self
            .moments(&half, &Reach::FIRST, &division)
            .and_then(|moments| distance_db(&moments));
        let judged = |reach: &Reach| {
            let apart_db = distance_db(&self.apart(&half, reach))?;
            moments_db.map(|moments_db| Distances { moments_db, apart_db })
        };
        let apart = |reach: &Reach| Some(self.apart(traces, reach));
        // A codebook takes as many bytes as snippets, a track fewer, so this decides how much they must gain.
        let has_codebook = apart(&Reach::FIRST)?.parts.excitation.is_some();
        let is_for_moments =
            |judged: &Option<Distances>| judged.is_some_and(|judged| judged.is_for_moments(has_codebook));
        let mut found = judged(&Reach::FIRST);
        let mut chosen = None;
        if !is_for_moments(&found) {
            // An excitation that is near only because it is louder than the recordings is judged again after the bound.
            let (bounded, reach) = self.bounded(traces, apart)?;
            if reach != Reach::FIRST {
                found = judged(&reach);
            }
            chosen = Some(bounded);
        }
        if is_for_moments(&found) {
            let moments = self.bounded(traces, |reach| self.moments(traces, reach, &division));
            // If no snippets can be made of all traces, the other excitation stays.
            chosen = moments.map(|(moments, _)| moments).or(chosen);
        }
        let mut chosen = match chosen {
            Some(chosen) => chosen,
            None => self.bounded(traces, apart)?.0,
        };
        chosen.report.moments = found;
        Some(chosen)
    }

    /// Returns the excitation that `made` makes of `traces`. Its reach is lowered from the first one, a few times at
    /// most, until the nodes that are checked play no louder than aimed at.
    fn bounded(&self, traces: &[Trace], made: impl Fn(&Reach) -> Option<Chosen>) -> Option<(Chosen, Reach)> {
        /// Largest number of times that the reach is lowered.
        const ROUNDS: usize = 4;
        let mut reach = Reach::FIRST;
        let mut chosen = made(&reach)?;
        // What is still too loud after these rounds is taken off the nodes' levels by `remaining_excess`.
        for _ in 0..ROUNDS {
            let excess = bound::excess(traces, self.axes.forces_n.len(), &chosen.parts);
            if excess.values().all(|&excess| excess <= 1.0) {
                break;
            }
            reach.lower(&excess);
            chosen = made(&reach)?;
        }
        chosen.report.lowered_db = reach.lowered_db();
        Some((chosen, reach))
    }

    /// Returns the excitation with a separate level: a track, or a steady one.
    fn apart(&self, traces: &[Trace], reach: &Reach) -> Chosen {
        let all: Vec<&Trace> = traces.iter().collect();
        let loudest = bound::most(traces, reach.track);
        let (kurtosis, spread_db) = (kurtosis_of(traces), spread_of(traces));
        let is_level_wanted = match self.options.modulation {
            ModulationChoice::None => false,
            ModulationChoice::Track => true,
            ModulationChoice::Auto => spread_db.is_significant(),
        };
        let track = |resolution| {
            let found = is_level_wanted.then(|| track(&all, resolution, loudest)).flatten();
            found.filter(|(spec, _)| bytes_of(spec) <= self.room)
        };
        // The level is divided out of a codebook only if a track restores it.
        let beside = track(BESIDE_CODEBOOK);
        let (codebooks, source) = self.codebooks_beside(beside.as_ref().map(|(spec, _)| spec), traces, kurtosis, reach);
        // Noise has no fast changes of its own, so the track beside it must have a finer resolution.
        let chosen = if codebooks.is_empty() {
            track(BESIDE_NOISE)
        } else {
            beside
        };
        let level = reason_of_level(chosen.is_some(), is_level_wanted, spread_db, self.options.modulation);
        self.chosen(traces, codebooks, chosen, None, source, level)
    }

    /// Returns the codebooks that are played at the level of a `track`, or at a steady one, and the reason for the
    /// choice; `kurtosis` is that of all `traces`.
    fn codebooks_beside(
        &self,
        track: Option<&ModulationSpec>,
        traces: &[Trace],
        kurtosis: Evidence,
        reach: &Reach,
    ) -> (Vec<OfRegion>, String) {
        if self.options.excitation == ExcitationChoice::Gaussian {
            return (Vec::new(), "Gaussian noise, as asked for".to_owned());
        }
        // The track comes first, because codebooks can be shortened to what is left.
        let budget = self.budget(self.room.saturating_sub(track.map_or(0, bytes_of)));
        let wanted = Wanted {
            is_forced: self.options.excitation == ExcitationChoice::Residual,
            level: if track.is_some() { Level::Apart } else { Level::Steady },
            highest_peak: HIGHEST_PEAK / track.map_or(1.0, highest),
            reach: reach.codebooks,
        };
        let shape = (self.axes.speeds_mm_s.len(), self.axes.forces_n.len());
        let regions = regions(traces, shape, budget.codebooks(wanted.level));
        let found = codebooks(traces, regions, wanted, budget);
        let reason = reason_of_source(&found, kurtosis, wanted, budget);
        (found, reason)
    }

    /// Returns the regions for recorded snippets. They are those whose residuals differ; or more regions, of nearby
    /// speeds, if the output with snippets of `half` of the `traces` is then nearer to the other blocks. The reason is
    /// that a click lasts as long as the tip takes to cross a groove, so snippets of a slow trial are too long and too
    /// low in frequency at a fast node.
    fn division(&self, traces: &[Trace], half: &[Trace]) -> Vec<Region> {
        let shape = (self.axes.speeds_mm_s.len(), self.axes.forces_n.len());
        let most = self.budget(self.room).codebooks(Level::OfMoments);
        let tested = regions(traces, shape, most);
        let by_speed = (2..=most).map(|count| by_speed(self.axes.speeds_mm_s, shape.1, count));
        let by_speed: Vec<Vec<Region>> = by_speed.filter(|regions| regions.len() > 1).collect();
        if by_speed.is_empty() {
            return tested;
        }
        let heard_db = |division: &[Region]| {
            let moments = self.moments(half, &Reach::FIRST, division)?;
            // A region without a codebook would play noise of steady level.
            let is_whole = moments.report.codebooks.len() == division.len();
            choice::heard_db(traces, shape.1, &moments.parts).filter(|_| is_whole)
        };
        // If the tested division cannot be made, any other one is nearer.
        let tested_db = heard_db(&tested).unwrap_or(f64::INFINITY);
        let others = by_speed.into_iter();
        let others = others.filter_map(|division| Some((heard_db(&division)?, division)));
        let nearest = others.min_by(|a, b| a.0.total_cmp(&b.0));
        let nearer = nearest.filter(|(db, _)| db + LEAST_HEARD_GAIN_DB < tested_db);
        nearer.map_or(tested, |(_, division)| division)
    }

    /// Returns an excitation of recorded snippets, with a codebook for each region of `division`, whose residual keeps
    /// its level; `None` if there is too little material.
    fn moments(&self, traces: &[Trace], reach: &Reach, division: &[Region]) -> Option<Chosen> {
        let wanted = Wanted {
            // A region without impulses also needs a codebook, because it holds the level.
            is_forced: true,
            level: Level::OfMoments,
            highest_peak: HIGHEST_PEAK_OF_MOMENTS,
            reach: reach.codebooks,
        };
        let found = codebooks(traces, division.to_vec(), wanted, self.budget(self.room));
        // The format has one mean length for all codebooks, so the shortest decides.
        let shortest = found.iter().map(|own| own.seconds).reduce(f64::min)?;
        let samples = (shortest * f64::from(SAMPLE_RATE_HZ)) as usize;
        let moment_samples = moment_samples(samples, found.len());
        let source = format!(
            "{} of recorded snippets: local kurtosis {}",
            counted(found.len(), "codebook"),
            said(kurtosis_of(traces), "")
        );
        let level = format!(
            "that of the snippets: spread of 50 ms levels {}",
            said(spread_of(traces), " dB")
        );
        Some(self.chosen(traces, found, None, Some(moment_samples), source, level))
    }

    /// Returns the excitation with these codebooks and this track, and the report on it.
    fn chosen(
        &self,
        traces: &[Trace],
        codebooks: Vec<OfRegion>,
        track: Option<(ModulationSpec, usize)>,
        moment_samples: Option<u16>,
        source: String,
        level: String,
    ) -> Chosen {
        let reports = codebooks.iter().map(|own| codebook_report(own, self.axes));
        let report = ExcitationReport {
            texture: self.name.to_owned(),
            kurtosis: kurtosis_of(traces),
            spread_db: spread_of(traces),
            codebooks: reports.collect(),
            moment_s: moment_samples.map(|n| f64::from(n) / f64::from(SAMPLE_RATE_HZ)),
            moments: None,
            lowered_db: None,
            track: track.as_ref().map(|(spec, trials)| track_report(spec, *trials)),
            source,
            level,
        };
        let parts = PartsSpec {
            excitation: excitation(codebooks, self.axes, moment_samples),
            modulation: track.map(|(spec, _)| spec),
            ..PartsSpec::default()
        };
        Chosen {
            parts,
            report,
            notes: Vec::new(),
            excess: Vec::new(),
        }
    }

    /// Returns the budget of codebooks in `bytes` bytes.
    fn budget(&self, bytes: usize) -> Budget {
        Budget {
            bytes: bytes.min(limits::MAX_EXCITATION_BYTES),
            nodes: self.axes.speeds_mm_s.len() * self.axes.forces_n.len(),
        }
    }
}

/// Returns an upper bound of a track's bytes in a library.
fn bytes_of(track: &ModulationSpec) -> usize {
    HEADER_BYTES + track.entries.len()
}

/// Tests the spread of the levels of all trials.
fn spread_of(traces: &[Trace]) -> Evidence {
    spread(&traces.iter().map(|trace| trace.judged.levels).collect::<Vec<_>>())
}

/// Returns the mean length of recorded snippets for codebooks of which the shortest has `shortest` samples. It is a
/// fifth of that, so that they do not repeat soon, and at most the format's limit. With several codebooks it is
/// shorter, because a snippet of one region may still be playing in another.
fn moment_samples(shortest: usize, codebooks: usize) -> u16 {
    const SEVERAL: u16 = 1500;
    let longest = if codebooks > 1 {
        SEVERAL
    } else {
        limits::MAX_MOMENT_SAMPLES
    };
    // A fifth that does not fit into 16 bits is above the longest length anyway.
    let fifth = u16::try_from(shortest / 5).unwrap_or(longest);
    fifth.clamp(limits::MIN_MOMENT_SAMPLES, longest)
}

/// Bytes for the codebooks of a grid with `nodes` nodes.
#[derive(Clone, Copy)]
struct Budget {
    bytes: usize,
    nodes: usize,
}

impl Budget {
    /// Returns the number of stretches that each of `count` codebooks may have.
    fn stretches(self, count: usize, level: Level) -> usize {
        let codes = self.bytes.saturating_sub(HEADER_BYTES + self.nodes) / count.max(1);
        let bytes = codes.saturating_sub(HEADER_BYTES);
        if level == Level::OfMoments {
            let samples = bytes / BLOCK_BYTES * BLOCK_SAMPLES;
            (samples / STRETCH_SAMPLES).min(MOST_STRETCHES_OF_MOMENTS)
        } else {
            (bytes / STRETCH_SAMPLES).min(MOST_STRETCHES)
        }
    }

    /// Returns the largest number of codebooks with which all are long enough.
    fn codebooks(self, level: Level) -> usize {
        let long_enough = |&count: &usize| self.stretches(count, level) >= LEAST_STRETCHES;
        (1..=limits::MAX_CODEBOOKS).filter(long_enough).max().unwrap_or(0)
    }
}

/// Requirements on codebooks.
#[derive(Clone, Copy)]
struct Wanted {
    /// True if codebooks are made without a test.
    is_forced: bool,
    /// What is done with the level of the material.
    level: Level,
    /// Highest peak, standard deviations.
    highest_peak: f64,
    /// Expected loudness of each codebook, relative to that of the recordings.
    reach: [f64; limits::MAX_CODEBOOKS],
}

/// Returns the codebooks of those of `regions` that need one and have enough material.
fn codebooks(traces: &[Trace], regions: Vec<Region>, wanted: Wanted, budget: Budget) -> Vec<OfRegion> {
    let members =
        |region: &Region| -> Vec<&Trace> { traces.iter().filter(|trace| region.contains(trace.at)).collect() };
    let wanting: Vec<(Region, Vec<&Trace>, Evidence)> = regions
        .into_iter()
        .map(|region| {
            let own = members(&region);
            let kurtosis = kurtosis_of(own.iter().copied());
            (region, own, kurtosis)
        })
        .filter(|(.., kurtosis)| wanted.is_forced || kurtosis.is_significant())
        .collect();
    // Regions that get Gaussian noise leave their bytes to the others.
    let most = budget.stretches(wanting.len(), wanted.level);
    // A reach has the number of a codebook that is made, which is not that of a region if others have no material.
    let mut number = 0;
    let made = wanting.into_iter().filter_map(|(region, own, kurtosis)| {
        let loudest = bound::most(own.iter().copied(), wanted.reach[number]);
        let material = choose(&own, wanted.level, most, loudest)?;
        let code = match wanted.level {
            Level::OfMoments => coded_in_blocks,
            Level::Apart | Level::Steady => coded,
        };
        let coded = code(&material.samples, wanted.highest_peak)?;
        number += 1;
        Some(OfRegion {
            region,
            coded,
            seconds: material.samples.len() as f64 / f64::from(SAMPLE_RATE_HZ),
            kurtosis,
            trials: material.trials,
        })
    });
    made.collect()
}

fn kurtosis_of<'t>(traces: impl IntoIterator<Item = &'t Trace>) -> Evidence {
    let windows = traces.into_iter().map(|trace| trace.judged.kurtosis);
    kurtosis(windows.fold(Sums::default(), Sums::plus), KURTOSIS_SAMPLES)
}

/// Returns the highest amplitude of a track.
fn highest(spec: &ModulationSpec) -> f64 {
    spec.entries.iter().copied().max().map_or(1.0, amplitude)
}

fn excitation(codebooks: Vec<OfRegion>, axes: Axes<'_>, moment_samples: Option<u16>) -> Option<ExcitationSpec> {
    let (speeds, forces) = (axes.speeds_mm_s.len(), axes.forces_n.len());
    let nodes = (0..speeds).flat_map(|speed| (0..forces).map(move |force| (speed, force)));
    let number = |at: (usize, usize)| {
        let own = codebooks.iter().position(|own| own.region.contains(at));
        // Number 0 is Gaussian noise.
        own.map_or(0, |index| index as u8 + 1)
    };
    let of_nodes = nodes.map(number).collect();
    let codebooks: Vec<_> = codebooks.into_iter().map(|own| own.coded.spec).collect();
    (!codebooks.is_empty()).then_some(ExcitationSpec {
        codebooks,
        of_nodes,
        moment_samples,
    })
}

fn codebook_report(own: &OfRegion, axes: Axes<'_>) -> CodebookReport {
    let Region { speeds, forces } = &own.region;
    let ends = |axis: &[f32], range: &std::ops::Range<usize>| [axis[range.start], axis[range.end - 1]];
    CodebookReport {
        speeds_mm_s: ends(axes.speeds_mm_s, speeds),
        forces_n: ends(axes.forces_n, forces),
        kurtosis: own.kurtosis,
        trials: own.trials,
        seconds: own.seconds,
        peak: own.coded.spec.peak,
        cut_samples: own.coded.cut,
        snr_db: own.coded.snr_db,
    }
}

fn track_report(spec: &ModulationSpec, trials: usize) -> TrackReport {
    let level_db = |entry: Option<&i8>| 20.0 * amplitude(entry.copied().unwrap_or(0)).log10();
    TrackReport {
        trials,
        entries: spec.entries.len(),
        step_s: f64::from(spec.step_samples) / f64::from(SAMPLE_RATE_HZ),
        range_db: [level_db(spec.entries.iter().min()), level_db(spec.entries.iter().max())],
    }
}

/// Returns a test's result as text: `8.91 where more than 3.40 is significant at 1 %`.
fn said(evidence: Evidence, unit: &str) -> String {
    if evidence.windows == 0 {
        return "not known, because no recording has a residual to judge".to_owned();
    }
    if evidence.windows < LEAST_WINDOWS {
        return format!("{} windows are too few to judge", evidence.windows);
    }
    let per_cent = 100.0 * LEVEL;
    format!(
        "{:.2}{unit} where more than {:.2}{unit} is significant at {per_cent:.0} %",
        evidence.value, evidence.needed
    )
}

fn reason_of_source(found: &[OfRegion], all: Evidence, wanted: Wanted, budget: Budget) -> String {
    if let [first, ..] = found {
        let codebooks = counted(found.len(), "codebook");
        let why = if wanted.is_forced {
            "as asked for".to_owned()
        } else {
            format!("local kurtosis {}", said(first.kurtosis, ""))
        };
        return format!("{codebooks} of the residual: {why}");
    }
    let why = if !wanted.is_forced && !all.is_significant() {
        format!("local kurtosis {}", said(all, ""))
    } else if budget.codebooks(wanted.level) == 0 {
        "the library has no room for a codebook".to_owned()
    } else {
        let least_s = (LEAST_STRETCHES * STRETCH_SAMPLES) as f64 / f64::from(SAMPLE_RATE_HZ);
        format!("too short for a codebook, which takes {least_s} s that are sound and not quiet: record for longer")
    };
    format!("Gaussian noise: {why}")
}

fn reason_of_level(is_kept: bool, is_wanted: bool, spread: Evidence, choice: ModulationChoice) -> String {
    let tested = || format!("spread of 50 ms levels {}", said(spread, " dB"));
    match (is_kept, choice) {
        (true, ModulationChoice::Auto) => format!("that of the recordings: {}", tested()),
        (true, _) => "that of the recordings, as asked for".to_owned(),
        (false, ModulationChoice::None) => "steady, as asked for".to_owned(),
        (false, ModulationChoice::Auto) if !is_wanted => format!("steady: {}", tested()),
        (false, _) => "steady: too short for a level track of 1 s, or no room for it in the library".to_owned(),
    }
}

/// A codebook of a texture.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct CodebookReport {
    /// Lowest and highest speed of its nodes, mm/s.
    pub speeds_mm_s: [f32; 2],
    /// Lowest and highest force of its nodes, N.
    pub forces_n: [f32; 2],
    /// Local kurtosis of the region's trials, in data that was not fitted.
    pub kurtosis: Evidence,
    /// Number of trials that its material comes from.
    pub trials: usize,
    /// Duration, s.
    pub seconds: f64,
    /// Highest peak, standard deviations.
    pub peak: f32,
    /// Number of samples that were clipped, because the excitation's range does not hold their peaks.
    pub cut_samples: usize,
    /// Ratio of its power to that of the error of its codes, dB.
    pub snr_db: f64,
}

/// A level track of a texture.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrackReport {
    /// Number of trials that it is joined from.
    pub trials: usize,
    /// Number of levels in the track.
    pub entries: usize,
    /// Time between two levels, s.
    pub step_s: f64,
    /// Lowest and highest level, dB.
    pub range_db: [f64; 2],
}

/// The choice of a texture's excitation.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ExcitationReport {
    /// The texture.
    pub texture: String,
    /// Local kurtosis of all trials, in data that was not fitted. It is 2.9 for Gaussian noise.
    pub kurtosis: Evidence,
    /// Spread of levels of all trials, in data that was not fitted, dB. It is 0.4 for steady Gaussian noise.
    pub spread_db: Evidence,
    /// The codebooks; empty for Gaussian noise.
    pub codebooks: Vec<CodebookReport>,
    /// Mean length of the recorded snippets, s; `None` if there are none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub moment_s: Option<f64>,
    /// Distances by which recorded snippets were chosen or rejected; `None` if there was no choice.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub moments: Option<Distances>,
    /// Change of the loudness to which the excitation was limited, because it was louder than its recordings, dB.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lowered_db: Option<f64>,
    /// The level track; `None` for a steady level.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub track: Option<TrackReport>,
    /// Reason for the choice of the source.
    pub source: String,
    /// Reason for the choice of the level.
    pub level: String,
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::excitation::tests::{impulsive, trace};

    #[test]
    fn a_reach_is_that_of_the_codebook_of_its_number_even_if_a_region_before_has_too_little_material() {
        let short = trace(&impulsive(1, 3000), 20);
        let long = Trace {
            at: (1, 0),
            ..trace(&impulsive(2, 20_000), 20)
        };
        let regions = [0, 1].map(|speed| Region {
            speeds: speed..speed + 1,
            forces: 0..1,
        });
        let made = |lowered: usize| {
            let mut reach = Reach::FIRST.codebooks;
            reach[lowered] = 0.5;
            let wanted = Wanted {
                is_forced: true,
                level: Level::Steady,
                highest_peak: HIGHEST_PEAK,
                reach,
            };
            let budget = Budget {
                bytes: limits::MAX_EXCITATION_BYTES,
                nodes: 2,
            };
            let traces = [short.clone(), long.clone()];
            let made = codebooks(&traces, regions.to_vec(), wanted, budget);
            assert_eq!(made.len(), 1);
            made[0].coded.spec.peak
        };
        assert!(made(0) < made(1));
        assert_eq!(made(1), made(2));
    }
}
