//! Fitted textures: first their models, then their excitation; and the fit that they form.

use model_format::{NodeSpec, Provenance, TextureSpec, limits};
use stylus_signals::recording::RecordingSet;
use stylus_signals::recording::triage::Kind;
use stylus_support::Warning;
use stylus_support::in_order::in_order;
use stylus_support::number::counted;
use stylus_support::{Error, Result};

use super::blocks::Part;
use super::excitation::{self, Axes, Choice, Chosen, Excess, ExcitationReport};
use super::grid::{Member, assemble};
use super::lines::Findings;
use super::notes;
use super::options::{FloorChoice, Options};
use super::recordings::{Recordings, Take};
use super::reports::TrialReport;
use super::room;
use super::trial::signal_of_judged;
use crate::texture::grid::Grid;
use crate::texture::library::{spec_of, stored_nodes};
use crate::texture::quantise::is_too_loud;

/// Least reduction of a node's level for which there is a note, dB: the just noticeable difference (Israr 2006).
const NOTABLE_SOFTER_DB: f64 = 2.2;

/// A fitted texture.
#[derive(Clone, Debug)]
pub struct FittedTexture {
    /// Name.
    pub name: String,
    /// Indices of the texture's trials in the set.
    pub members: Vec<usize>,
    /// Provenance of the texture's recordings.
    pub provenance: Provenance,
    /// Models of the texture on their grid, and its optional parts.
    pub grid: Grid,
    /// The models as they are stored.
    pub nodes: Vec<NodeSpec>,
    /// Sample rate of the models, Hz.
    pub sample_rate_hz: u32,
    /// Lines tied to position, or the reason for finding none.
    pub lines: Findings,
    /// Report on the excitation; `None` if only the models were fitted.
    pub excitation: Option<ExcitationReport>,
    /// Notes for the user.
    pub notes: Vec<Warning>,
}

impl FittedTexture {
    /// Fits the models of one texture to its recordings, with Gaussian excitation. `reports` says which
    /// recordings are used.
    pub(super) fn of(recordings: &Recordings<'_>, reports: &[TrialReport], options: &Options) -> Result<Self> {
        let all = &recordings.trials;
        let name = all.first().map_or_else(String::new, |own| own.trial.texture.clone());
        // Trials at rest or without contact, at which the stylus is silent whatever was recorded.
        let idle = all.iter().filter(|own| !own.trial.is_in_motion_and_contact()).count();
        let members: Vec<Member<'_>> = all
            .iter()
            .map(|own| Member {
                trial: own.trial,
                analysis: &own.analysis,
                report: &reports[own.number],
            })
            .filter(|member| member.report.used)
            .collect();
        if members.is_empty() {
            return Err(nothing_to_fit(&name, idle, all.len()));
        }
        let provenance = |member: &Member<'_>| match (member.trial.provenance, member.report.unscaled) {
            (Provenance::Recorded, Some(_)) => Provenance::Unscaled,
            (own, _) => own,
        };
        let assembled = assemble(&name, &members, &recordings.findings, options)?;
        let notes = notes::of(&name, &assembled, &members, idle, options);
        let grid = assembled.grid;
        Ok(Self {
            notes,
            members: all.iter().map(|own| own.number).collect(),
            provenance: Provenance::of_all(members.iter().map(provenance)),
            nodes: stored_nodes(&name, &grid, options.sample_rate_hz)
                .map_err(|failure| with_unit(failure, &grid, &members))?,
            grid,
            name,
            sample_rate_hz: options.sample_rate_hz,
            lines: recordings.findings.clone(),
            excitation: None,
        })
    }

    /// Adds the excitation of the models, in at most `room` bytes. Calls `progress` for each of the `takes` that is
    /// done.
    fn excite(&mut self, takes: Vec<Take<'_>>, room: usize, source: &Source<'_>, progress: &(impl Fn() + Sync)) {
        let choice = Choice {
            name: &self.name,
            axes: Axes {
                speeds_mm_s: &self.grid.speeds_mm_s,
                forces_n: &self.grid.forces_n,
            },
            options: source.options,
            room,
        };
        let Chosen {
            parts,
            report,
            notes,
            excess,
        } = excitation::of(choice, &self.nodes, takes, source.reports, source.part, progress);
        // The lines among the parts were found before, and stay.
        self.grid.parts.excitation = parts.excitation;
        self.excitation = Some(report);
        self.notes.extend(notes);
        self.lower(&excess);
    }

    /// Lowers the nodes that are too loud: to the level of their recordings, and further if their loudest moments
    /// exceed what is allowed over these.
    fn lower(&mut self, excess: &[Excess]) {
        for node in excess {
            // An excess is a ratio of amplitudes, the level a power.
            let index = self.grid.index(node.at.0, node.at.1);
            self.scale(index, (node.level * node.moments).powi(-2));
        }
        let softer_db: Vec<f64> = excess
            .iter()
            .map(|node| 20.0 * node.moments.log10())
            .filter(|db| *db >= NOTABLE_SOFTER_DB)
            .collect();
        let Some(most_db) = softer_db.iter().copied().reduce(f64::max) else {
            return;
        };
        let text = format!(
            "{} up to {most_db:.1} dB softer than recorded, because their loudest moments would be louder than any of \
             their recordings: --excitation gaussian plays them at their level",
            counted(softer_db.len(), "node")
        );
        let note = Warning::of_texture("softer", &self.name, most_db, text);
        self.notes.push(note);
    }

    /// Multiplies the power of the node at `index` by `share`, a factor.
    fn scale(&mut self, index: usize, share: f64) {
        self.grid.models[index].output_power *= share;
        let node = &mut self.nodes[index];
        // Both powers are scaled, because the coefficients fix their ratio.
        node.output_power *= share as f32;
        node.prediction_error_power *= share as f32;
    }

    /// Sets the levels of the nodes, one of `levels_db` per node, dB re 1 m/s². Silent nodes stay silent.
    pub(super) fn set_levels(&mut self, levels_db: &[f64]) {
        for (index, level_db) in levels_db.iter().enumerate() {
            let power = self.grid.models[index].output_power;
            if power > 0.0 {
                self.scale(index, 10f64.powf(level_db / 10.0) / power);
            }
        }
    }

    /// Returns the texture, ready to be encoded.
    pub fn spec(&self) -> TextureSpec {
        spec_of(
            &self.name,
            self.sample_rate_hz,
            self.provenance,
            &self.grid,
            self.nodes.clone(),
        )
    }
}

/// The recordings of a fit, and how they are read again.
#[derive(Clone, Copy)]
pub(super) struct Source<'s> {
    pub set: &'s RecordingSet,
    /// The report on every trial, in the order of the set.
    pub reports: &'s [TrialReport],
    pub options: &'s Options,
    /// The part of each trial that is fitted.
    pub part: Part,
}

impl<'s> Source<'s> {
    /// Adds the excitation to each of `textures`. It is fitted to the signals that are `held`, in the order of the
    /// textures, or to recordings that are read again. Calls `progress` for each trial that is done.
    pub fn excite(
        &self,
        textures: &mut [FittedTexture],
        held: impl IntoIterator<Item = Option<Vec<Take<'s>>>>,
        progress: &(impl Fn() + Sync),
    ) -> Result<()> {
        if !excitation::is_wanted(self.options) {
            return Ok(());
        }
        // The models come first. The textures share the bytes that these leave equally.
        let models = encoded(&specs(textures))?.len();
        let room = limits::MAX_LIBRARY_BYTES.saturating_sub(models) / textures.len().max(1);
        for (texture, held) in textures.iter_mut().zip(held) {
            let takes = held.map_or_else(|| self.takes(texture), Ok)?;
            texture.excite(takes, room, self, progress);
        }
        Ok(())
    }

    /// Reads the signals of a texture's trials again. It reads those that the fit used, or all trials if the texture
    /// has lines or the rig's noise is subtracted, because both are estimated from all trials.
    pub fn takes(&self, texture: &FittedTexture) -> Result<Vec<Take<'s>>> {
        let is_cleaned = self.options.floor == FloorChoice::Subtract;
        if is_cleaned || !texture.lines.lines.is_empty() {
            let recordings = Recordings::read(self.set, &texture.members, self.options, self.part, &|_| ())?;
            // Recordings that were just read hold all of their signals.
            return Ok(recordings.into_takes().unwrap_or_default());
        }
        let used = |number: &usize| self.reports[*number].used;
        let used: Vec<usize> = texture.members.iter().copied().filter(used).collect();
        in_order(&used, |&number| {
            let (trial, verdicts) = (&self.set.trials[number], &self.reports[number].verdicts);
            let signal = signal_of_judged(trial, verdicts, self.options.conditioning)?;
            Ok(Take { number, trial, signal })
        })
    }
}

/// Returns `textures`, ready to be encoded.
fn specs(textures: &[FittedTexture]) -> Vec<TextureSpec> {
    textures.iter().map(FittedTexture::spec).collect()
}

/// Returns the `failure` of a texture whose `grid` has a node that is too loud, with triage's finding on the unit of
/// that node's trials, or of any of the `members` if the node has none.
fn with_unit(failure: Error, grid: &Grid, members: &[Member<'_>]) -> Error {
    let mut nodes = grid.nodes();
    let loud = nodes.find(|(.., model)| is_too_loud(model));
    let at_node = |member: &&Member<'_>| {
        let place = (member.trial.speed_mm_s as f32, member.trial.force_n as f32);
        loud.is_some_and(|(speed_mm_s, force_n, _)| place == (speed_mm_s, force_n))
    };
    let mut verdicts = members
        .iter()
        .filter(at_node)
        .chain(members)
        .flat_map(|member| &member.report.verdicts);
    match verdicts.find(|verdict| verdict.kind() == Kind::Scale) {
        Some(verdict) => Error::Model(format!("{failure}: {verdict}")),
        None => failure,
    }
}

/// Returns the error of a texture of which no trial can be used; `idle` of all its trials are at speed 0 or force 0.
fn nothing_to_fit(name: &str, idle: usize, all: usize) -> Error {
    Error::Model(if idle == all {
        format!(
            "texture '{name}': every trial is at speed 0 or force 0, where the stylus is silent: record it in motion \
             and contact, or give light contact its force, such as 0.05 N"
        )
    } else {
        format!("texture '{name}': every trial was dropped; nothing is left to fit")
    })
}

/// The outcome of a fit.
#[derive(Clone, Debug)]
pub struct Fit {
    /// Every trial, in the order of the set.
    pub trials: Vec<TrialReport>,
    /// The textures, in the order of their first trials.
    pub textures: Vec<FittedTexture>,
    /// Notes for the user on the set as a whole.
    pub notes: Vec<Warning>,
}

impl Fit {
    /// Returns all notes for the user: on the set, and on each texture.
    pub fn warnings(&self) -> Vec<Warning> {
        let of_textures = self.textures.iter().flat_map(|texture| &texture.notes);
        self.notes.iter().chain(of_textures).cloned().collect()
    }

    /// Returns triage's verdicts on each trial, and whether the trial was used.
    pub fn verdicts(&self) -> Vec<Warning> {
        let of_trial = |trial: &TrialReport| {
            let outcome = match trial.used {
                true if trial.cut_s > 0.0 => format!("; used without {:.3} s", trial.cut_s),
                true => String::new(),
                false if trial.speed_mm_s > 0.0 && trial.force_n > 0.0 => "; dropped".to_owned(),
                false => "; not used, at speed 0 or force 0".to_owned(),
            };
            let file = trial.file.clone();
            trial.verdicts.clone().into_iter().map(move |verdict| {
                let text = format!("{verdict}{outcome}");
                Warning::of(verdict.name(), ("recording", &file), verdict.size(), text)
            })
        };
        self.trials.iter().flat_map(of_trial).collect()
    }

    /// Returns the reports on the excitations of all textures that have one.
    pub fn excitations(&self) -> Vec<ExcitationReport> {
        self.textures
            .iter()
            .filter_map(|texture| texture.excitation.clone())
            .collect()
    }

    /// Encodes the fit's textures as a library.
    pub fn library(&self) -> Result<Vec<u8>> {
        encoded(&specs(&self.textures))
    }
}

/// Encodes a library of `specs`.
pub fn encoded(specs: &[TextureSpec]) -> Result<Vec<u8>> {
    model_format::encode(specs).map_err(|failure| room::refused(&failure, specs))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::fit;
    use model_format::{NodeFlags, SAMPLE_RATE_HZ};
    use stylus_signals::recording::Trial;
    use stylus_support::float_wav::float_wav;
    use test_helpers::{holds, noise};

    #[test]
    fn a_node_that_is_too_loud_is_refused_with_the_unit_of_its_own_trial() {
        let folder = tempfile::tempdir().unwrap();
        let trial = |speed_mm_s: f64, rms: f64| {
            let file = folder.path().join(format!("{speed_mm_s}.wav"));
            let samples = noise(1, 10_000).into_iter().map(|x| rms * x);
            std::fs::write(&file, float_wav(1, SAMPLE_RATE_HZ, samples).unwrap()).unwrap();
            Trial::of(file, "surface", speed_mm_s, 1.0)
        };
        // The level of both is doubtful, but only the second is louder than a model can be.
        let set = RecordingSet {
            trials: vec![trial(80.0, 100.0), trial(120.0, 450.0)],
            is_listed: true,
        };
        let failure = fit(&set, &Options::default(), |_| ()).unwrap_err();
        holds(&failure.to_string(), &["at 120 mm/s", ": scale: an RMS of 4"]);
    }

    #[test]
    fn a_trial_without_contact_is_not_used_and_one_with_a_dropped_verdict_is_dropped() {
        let folder = tempfile::tempdir().unwrap();
        let trial = |speed_mm_s: f64, force_n: f64, rms: f64| {
            let file = folder.path().join(format!("{speed_mm_s}-{force_n}.wav"));
            let samples = noise(1, 10_000).into_iter().map(|x| rms * x);
            std::fs::write(&file, float_wav(1, SAMPLE_RATE_HZ, samples).unwrap()).unwrap();
            Trial::of(file, "surface", speed_mm_s, force_n)
        };
        let set = RecordingSet {
            trials: vec![trial(80.0, 1.0, 1.0), trial(80.0, 0.0, 0.0), trial(120.0, 1.0, 0.0)],
            is_listed: true,
        };
        let options = Options {
            drop: vec!["silent".into()],
            ..Options::default()
        };
        let fit = fit(&set, &options, |_| ()).unwrap();
        let verdicts: Vec<String> = fit.verdicts().iter().map(ToString::to_string).collect();
        let outcome = |file: &str| {
            let mut own = verdicts.iter().filter(|verdict| verdict.contains(file));
            own.find(|verdict| verdict.contains("silent")).unwrap()
        };
        assert!(outcome("80-0.wav").ends_with("; not used, at speed 0 or force 0"));
        assert!(outcome("120-1.wav").ends_with("; dropped"));
    }

    #[test]
    fn a_rest_that_is_left_out_leaves_no_doubt_about_its_node() {
        let folder = tempfile::tempdir().unwrap();
        // A rest of a second before the stroke, and the same in a recording that is clipped.
        let trial = |speed_mm_s: f64, most: f64| {
            let file = folder.path().join(format!("{speed_mm_s}.wav"));
            let level = |n: usize| if n < 5000 { 1e-4 } else { 1.0 };
            let samples = noise(1, 15_000)
                .into_iter()
                .enumerate()
                .map(|(n, x)| (level(n) * x).clamp(-most, most));
            std::fs::write(&file, float_wav(1, SAMPLE_RATE_HZ, samples).unwrap()).unwrap();
            Trial::of(file, "surface", speed_mm_s, 1.0)
        };
        let set = RecordingSet {
            trials: vec![trial(80.0, 9.0), trial(120.0, 1.0)],
            is_listed: true,
        };
        let fit = fit(&set, &Options::default(), |_| ()).unwrap();
        assert!(fit.trials.iter().all(|own| own.cut_s > 0.9 && !own.verdicts.is_empty()));
        let doubtful: Vec<bool> = fit.textures[0]
            .nodes
            .iter()
            .map(|node| node.flags.contains(NodeFlags::DOUBTFUL))
            .collect();
        assert_eq!(doubtful, [false, true]);
    }
}
