//! An evaluation as a folder: a self-contained page on recordings and their synthesis, and each of its pictures as a
//! separate file.

use std::path::{Path, PathBuf};

use model_format::{Axis, Library, Node, SAMPLE_RATE_HZ, Texture};
use stylus_dsp::spectrum::{PowerSpectrum, longest_segment};
use stylus_evaluation::evaluate::{Comparison, Evaluation, Excerpt, texture_named};
use stylus_evaluation::held_out::JudgeKind;
use stylus_evaluation::leave_one_out::LeaveOneOut;
use stylus_evaluation::liveliness::summaries;
use stylus_evaluation::summary::{LIVELINESS_EXPLANATION, TrialEvaluation, explanation, liveliness_table};
use stylus_evaluation::{evaluate, verdict};
use stylus_fit::texture::grid::as_written;
use stylus_fit::texture::library::unknown_levels;
use stylus_signals::recording::RecordingSet;
use stylus_support::Result;
use stylus_support::atomic_file;
use stylus_support::names::Stems;

use super::html::{Page, Sound};
use super::plot::{
    COST, Caption, Curve, GridCell, GridMap, Scale, Svg, WIDE, densities, grid_map, spectra, spectrograms, waveforms,
};
use super::sound::{SOUNDS_BYTES, clip, sound};

/// The page's name in its folder.
const PAGE: &str = "index.html";

/// Speed, mm/s, and force, N, of the paper's own example (its figure 10). The trial nearest to them represents its
/// texture.
const EXAMPLE: (f64, f64) = (120.0, 1.0);

/// Highest frequency of spectrograms, Hz.
const HIGHEST_HZ: f64 = 1000.0;

/// The sample rate of all signals, Hz.
const RATE_HZ: f64 = SAMPLE_RATE_HZ as f64;

/// The contents of the page.
pub struct Inputs<'a> {
    /// The recordings.
    pub set: &'a RecordingSet,
    /// The library that the recordings were compared with.
    pub library: &'a Library<'a>,
    /// The comparison.
    pub evaluation: &'a Evaluation,
    /// Options of the comparison.
    pub options: &'a evaluate::Options,
    /// The removed-node test, if it was made.
    pub removed_nodes: Option<&'a LeaveOneOut>,
    /// Recorded takes that were given but not used, each with the reason.
    pub unused_takes: &'a [String],
}

/// Writes the page and its pictures into the existing `folder`, and calls `progress` after each texture. Returns the
/// page's path.
pub fn write(inputs: &Inputs<'_>, folder: &Path, progress: impl Fn()) -> Result<PathBuf> {
    let mut report = Report::new(inputs, folder);
    report.overview();
    for summary in &inputs.evaluation.textures {
        report.texture(&summary.texture, &summary.verdict)?;
        progress();
    }
    report.maps()?;
    report.figures();
    let page = folder.join(PAGE);
    report.page.write(&page)?;
    Ok(page)
}

/// An evaluation while it is written as a page.
struct Report<'a> {
    inputs: &'a Inputs<'a>,
    folder: &'a Path,
    /// First part of the pictures' file names, for each texture.
    stems: Stems,
    /// Colour scale of C, %, in all maps of the page.
    cost_scale: Scale,
    /// Size of the sounds, bytes. It includes the excerpts of all nodes in advance, and the other sounds added so far.
    sound_bytes: usize,
    page: Page,
}

/// The example trial of a texture, with its synthesis.
struct Example<'a> {
    judged: &'a TrialEvaluation,
    comparison: Comparison,
    /// Texture, speed and force in words.
    title: String,
}

impl Example<'_> {
    /// Returns, in words, which part of the trial's recording is drawn, and whether the model was fitted to it.
    fn part(&self) -> String {
        let block_s = self.comparison.longest_block().len() as f64 / RATE_HZ;
        match self.judged.judge {
            JudgeKind::Blocks => format!("a block of {block_s:.1} s that was not fitted"),
            JudgeKind::OtherTake => "another take, which was not fitted".into(),
            JudgeKind::Unseen => "a recording that was not fitted".into(),
            JudgeKind::Nothing => {
                "in-sample if the library was fitted to it, and then not a measure of fidelity".into()
            }
        }
    }

    /// Returns, in words, the trial's own C, as in the map. The picture has only the C of the drawn block.
    fn cost(&self) -> String {
        self.judged.scores.cost.map_or_else(String::new, |cost| {
            format!(
                " C is the paper's mismatch of spectra, in the title of the block drawn; over all that judges this \
                 trial it is {:.1} %, which the map has.",
                100.0 * cost
            )
        })
    }

    /// Returns the recording, the synthesis and other versions, each with its name. They are the sounds, and the rows
    /// of the picture of waveforms.
    fn signals(&self) -> Vec<(String, &[f64])> {
        let comparison = &self.comparison;
        let mut signals = vec![
            ("recorded".to_owned(), comparison.recording.as_slice()),
            (
                format!("synthesis: {}", comparison.parts),
                comparison.synthesised.as_slice(),
            ),
        ];
        let versions = comparison.versions.iter();
        signals.extend(versions.map(|v| (v.parts.clone(), v.synthesised.as_slice())));
        signals
    }
}

impl<'a> Report<'a> {
    fn new(inputs: &'a Inputs<'a>, folder: &'a Path) -> Self {
        let evaluation = inputs.evaluation;
        let costs = evaluation.trials.iter().filter_map(|trial| trial.scores.cost);
        let nodes = evaluation
            .textures
            .iter()
            .flat_map(|texture| node_excerpts(evaluation, &texture.texture));
        // Each sample has two bytes.
        let of_node = |clips: &Excerpt| 2 * (clips.recorded.len() + clips.synthesised.len());
        Self {
            inputs,
            folder,
            stems: Stems::default(),
            cost_scale: Scale::of(costs.map(|cost| 100.0 * cost)),
            sound_bytes: nodes.map(|(_, clips)| of_node(clips)).sum(),
            page: Page::new("Recordings and what the stylus plays"),
        }
    }

    /// Writes what was compared, and by which method.
    fn overview(&mut self) {
        let (evaluation, page) = (self.inputs.evaluation, &mut self.page);
        if evaluation.simulated {
            page.notice(
                "SIMULATED: these recordings were computed by the rig simulator. No figure here says how near the \
                 stylus comes to a real surface.",
            );
        }
        if let Some(words) = unknown_levels(self.inputs.library.textures()) {
            page.notice(&format!("The {words}."));
        }
        page.list(&evaluation.verdicts().collect::<Vec<_>>()).folded(
            "What is compared, and what the verdicts mean",
            |page| {
                page.paragraph(&format!(
                    "Each recording is compared with {} s of what the stylus plays at its speed and force, computed by \
                     the device's own kernel. Held out: {}",
                    self.inputs.options.synthesis_s, evaluation.held_out
                ))
                .paragraph(&verdict::explanation());
            },
        );
    }

    /// Draws the maps of all textures.
    fn maps(&mut self) -> Result<()> {
        let Inputs {
            library, evaluation, ..
        } = self.inputs;
        self.page.section("Maps").paragraph(
            "C is the paper's mismatch of spectra in per cent, equation (6): 0 if they are equal. It is good where it \
             is as low as that of two parts of one recording, which the table under Scores has in brackets.",
        );
        for summary in &evaluation.textures {
            self.cost_map(&texture_named(library, &summary.texture)?)?;
        }
        Ok(())
    }

    /// Writes the scores, all tables but one folded, then the removed-node test and the takes that judged nothing.
    fn figures(&mut self) {
        let Inputs {
            evaluation,
            removed_nodes,
            unused_takes,
            ..
        } = self.inputs;
        let page = &mut self.page;
        let explanations = [
            format!(
                "{} Amplitudes of C are smoothed by a {} and averaged over blocks. |band| is the mean magnitude of the \
                 errors of third octaves; balance is power below 100 Hz over that above. 'Other' is the target. The \
                 level error is about 0 for another seed of one noise, 2.7 JND for a gain of -6 dB (Israr 2006).",
                evaluation.judged_hz(),
                evaluation.smoothing
            ),
            format!(
                "Two signals with one spectrum may feel different, because one has impulses, or a level that changes, \
                 and the other has not. {LIVELINESS_EXPLANATION}"
            ),
        ];
        page.section("Scores")
            .paragraph(&explanation())
            .table(&evaluation.table())
            .folded("All tables", |page| {
                for (explanation, table) in explanations.iter().zip(evaluation.tables()) {
                    if !table.rows.is_empty() {
                        page.paragraph(explanation).table(&table);
                    }
                }
            });
        if let Some(test) = removed_nodes {
            removed_node_tables(&mut self.page, test);
        }
        if !unused_takes.is_empty() {
            self.page
                .section("Takes")
                .notice("Takes that are in the fitted set, and judge nothing:")
                .list(unused_takes);
        }
    }

    /// Writes first what a reader looks for: both signals, as picture and sounds, the verdict, and both spectra. The
    /// rest on the example is folded.
    fn texture(&mut self, name: &str, verdict: &str) -> Result<()> {
        self.page.section(name);
        let Some(example) = self.example(name)? else {
            self.page.paragraph("Silent in every trial.");
            return Ok(());
        };
        let (title, comparison) = (self.caption(&example.title), &example.comparison);
        let stem = self.stems.of(name);
        // The picture and the sounds show all of the recording, and C below is of a block that was held out.
        let whole = (comparison.recording.as_slice(), comparison.synthesised.as_slice());
        let picture = spectrograms(&title, whole, RATE_HZ, HIGHEST_HZ)?;
        let sounds = self.sounds(&example)?;
        let heard = if sounds.is_empty() {
            ""
        } else {
            " Click or tap one to hear it from there. All sounds have one scale; what is heard is the acceleration."
        };
        self.figure(
            &picture,
            &format!("{stem}-spectrograms"),
            &format!(
                "Spectrograms of the recording and of the synthesis, to one scale, in shorter windows where the \
                 recording is impulsive.{heard}"
            ),
            &sounds,
        )?;
        self.page.verdict(verdict);
        self.nodes(name);
        let block = (comparison.longest_block(), comparison.synthesised.as_slice());
        let width_hz = self.inputs.options.smoothing_hz;
        self.figure(
            &spectra(&title, block, RATE_HZ, width_hz)?,
            &format!("{stem}-spectra"),
            &format!(
                "The example trial and its synthesis in frequency (the paper's figure 7): {}.{}",
                example.part(),
                example.cost()
            ),
            &[],
        )?;
        self.densities(&example, &stem)?;
        self.waveforms(&example, &stem)
    }

    /// Adds, folded, the mean power spectral densities of what judges the example and of its synthesis, which are also
    /// written as a table.
    fn densities(&mut self, example: &Example<'_>, stem: &str) -> Result<()> {
        let comparison = &example.comparison;
        let judged: Vec<&[f64]> = comparison.judged.iter().map(Vec::as_slice).collect();
        let segment = longest_segment(RATE_HZ).min(comparison.longest_block().len());
        let [recorded, synthesised] = [&judged[..], &[comparison.synthesised.as_slice()]].map(|blocks| {
            PowerSpectrum::of_blocks(blocks, segment, RATE_HZ)
                .densities()
                .map(|(hz, density)| (hz, 10.0 * density.log10()))
                .collect::<Vec<_>>()
        });
        let rows = recorded
            .iter()
            .zip(&synthesised)
            .map(|(&(hz, recorded), (_, synthesised))| format!("{hz},{recorded:.2},{synthesised:.2}\n"));
        let mark = if self.inputs.evaluation.simulated {
            "# SIMULATED\n"
        } else {
            ""
        };
        let csv = format!(
            "{mark}frequency_hz,recorded_db,synthesised_db\n{}",
            rows.collect::<String>()
        );
        atomic_file::write(&self.folder.join(format!("{stem}-psd.csv")), csv.as_bytes())?;
        let shown = |levels: &[(f64, f64)]| -> Vec<(f64, f64)> {
            levels
                .iter()
                .copied()
                .filter(|point| (16.0..=HIGHEST_HZ).contains(&point.0))
                .collect()
        };
        let points = [shown(&recorded), shown(&synthesised)];
        let curves =
            [("recorded", &points[0]), ("synthesised", &points[1])].map(|(name, points)| Curve { name, points });
        let picture = densities(&self.caption(&example.title), &curves)?;
        picture.write(&self.folder.join(format!("{stem}-psd.svg")))?;
        self.page.folded("Mean power spectral density", |page| {
            let caption = format!("Welch's estimate over all that judges the trial; the values are in {stem}-psd.csv.");
            page.figure(&picture, &caption, &[]);
        });
        Ok(())
    }

    /// Adds, folded, an example's waveforms and the figures on properties that the spectrum does not show.
    fn waveforms(&mut self, example: &Example<'_>, stem: &str) -> Result<()> {
        let signals = example.signals();
        let signals: Vec<(&str, &[f64])> = signals.iter().map(|(n, s)| (n.as_str(), *s)).collect();
        let picture = waveforms(&self.caption(&example.title), &signals, RATE_HZ)?;
        picture.write(&self.folder.join(format!("{stem}-waveforms.svg")))?;
        let summaries = example
            .judged
            .liveliness
            .as_ref()
            .map(|own| summaries(std::iter::once(own)));
        let words = "Waveforms, and what the spectrum does not show";
        self.page.folded(words, |page| {
            let caption = "Waveforms and envelopes, 0.1 s and 2 s from the middle of each. The recording is drawn \
                 whatever was fitted of it.";
            page.figure(&picture, caption, &[]);
            if let Some(summaries) = &summaries {
                page.table(&liveliness_table(
                    "What the spectrum does not show, of this trial",
                    &[(example.title.clone(), summaries)],
                ));
            }
        });
        Ok(())
    }

    /// Returns the non-silent trial of a texture nearest to the paper's own example, with its synthesis. `None` if all
    /// are silent.
    fn example(&self, texture: &str) -> Result<Option<Example<'a>>> {
        let Some(index) = self.example_index(texture) else {
            return Ok(None);
        };
        let Inputs {
            set,
            library,
            evaluation,
            options,
            ..
        } = self.inputs;
        let trial = &set.trials[index];
        Ok(Some(Example {
            judged: &evaluation.trials[index],
            comparison: evaluation.compare(set, library, index, options)?,
            title: format!("{texture}, {} mm/s, {} N", trial.speed_mm_s, trial.force_n),
        }))
    }

    /// Returns the index of the non-silent trial of a texture that is nearest to [`EXAMPLE`].
    fn example_index(&self, texture: &str) -> Option<usize> {
        let heard = self
            .inputs
            .evaluation
            .trials
            .iter()
            .enumerate()
            .filter(|(_, trial)| trial.texture == texture && !trial.is_silent);
        let far = |trial: &TrialEvaluation| distance(trial.speed_mm_s, trial.force_n);
        heard
            .min_by(|(_, a), (_, b)| far(a).total_cmp(&far(b)))
            .map(|(index, _)| index)
    }

    /// Returns an example's signals as sounds; none if they would exceed [`SOUNDS_BYTES`].
    fn sounds(&mut self, example: &Example<'_>) -> Result<Vec<Sound>> {
        let heard = example.signals();
        // All sounds have one scale, so that differences in level are heard.
        let full_scale = heard
            .iter()
            .flat_map(|(_, signal)| signal.iter())
            .map(|value| value.abs())
            .fold(0.0, f64::max);
        let simulated = self.inputs.evaluation.simulated;
        let origin = if simulated { " (SIMULATED)" } else { "" };
        let mut sounds: Vec<Sound> = Vec::new();
        for (index, (what, signal)) in heard.iter().enumerate() {
            // The panel of the synthesis has this name, whatever the synthesis's parts.
            let panel = if index == 1 { "synthesised" } else { what };
            sounds.push(Sound {
                panel: panel.to_owned(),
                label: format!("{}: {what}{origin}", example.title),
                wav: sound(signal, full_scale)?,
            });
        }
        let bytes: usize = sounds.iter().map(|sound| sound.wav.len()).sum();
        if self.sound_bytes + bytes > SOUNDS_BYTES {
            self.page.paragraph(&format!(
                "No sounds: the page holds {} MB of them already. stylus render makes them.",
                self.sound_bytes / 1_000_000
            ));
            return Ok(Vec::new());
        }
        self.sound_bytes += bytes;
        Ok(sounds)
    }

    /// Adds the excerpts of the nodes of `texture`, on one scale, for the maps to play.
    fn nodes(&mut self, texture: &str) {
        let own = node_excerpts(self.inputs.evaluation, texture);
        let values = own.iter().flat_map(|(_, e)| e.recorded.iter().chain(&e.synthesised));
        let full_scale = values.fold(0.0, |most: f64, value| most.max(f64::from(value.abs())));
        for (place, excerpt) in own {
            let clips = [&excerpt.recorded, &excerpt.synthesised].map(|signal| clip(signal, full_scale));
            let [recorded, synthesised] = &clips;
            self.page.node(texture, place, SAMPLE_RATE_HZ, [recorded, synthesised]);
        }
    }

    /// Draws C of every node of a texture that was judged. A texture of one node has no map.
    fn cost_map(&mut self, texture: &Texture<'_>) -> Result<()> {
        let (speeds, forces) = (texture.speed_axis(), texture.force_axis());
        // For a single node the table is enough.
        if speeds.len() * forces.len() <= 1 {
            return Ok(());
        }
        let places = speeds
            .values()
            .flat_map(|speed| forces.values().map(move |force| (speed, force)));
        let cell = |(node, (speed, force)): (Node<'_>, (f32, f32))| {
            let mut trials = self.inputs.evaluation.trials.iter();
            // A library's axes are the recordings' own values rounded to `f32`, so equal values compare as equal.
            let here = trials.find(|trial| {
                trial.texture == texture.name() && trial.speed_mm_s as f32 == speed && trial.force_n as f32 == force
            });
            GridCell {
                value: here.and_then(|t| t.scores.cost).map(|cost| 100.0 * cost),
                flags: node.flags,
            }
        };
        let cells: Vec<GridCell> = texture.nodes().zip(places).map(cell).collect();
        let axis = |axis: Axis<'_>| axis.values().map(as_written).collect::<Vec<f64>>();
        let map = GridMap {
            texture: texture.name(),
            speeds_mm_s: &axis(speeds),
            forces_n: &axis(forces),
            cells: &cells,
            quantity: COST,
            scale: self.cost_scale,
        };
        let playing = if self.inputs.evaluation.excerpts.is_empty() {
            "The page holds no sounds of nodes, because there are too many: stylus render makes them."
        } else {
            "Click or tap a node to hear its recording and then its synthesis."
        };
        let title = format!("{}: mismatch C over the grid", texture.name());
        let picture = grid_map(&self.caption(&title), &map, WIDE)?;
        let name = format!("{}-cost-map", self.stems.of(texture.name()));
        let caption = format!(
            "C of every node against what was held out of its recordings, in the colours of all maps of C on this \
             page. {playing}"
        );
        self.figure(&picture, &name, &caption, &[])
    }

    /// Adds a picture with players to the page, and writes it into the folder as `name`.
    fn figure(&mut self, picture: &Svg, name: &str, caption: &str, sounds: &[Sound]) -> Result<()> {
        picture.write(&self.folder.join(format!("{name}.svg")))?;
        self.page.figure(picture, caption, sounds);
        Ok(())
    }

    /// The heading of a picture, which says SIMULATED if the recordings are simulated.
    fn caption<'t>(&self, title: &'t str) -> Caption<'t> {
        Caption::new(title, self.inputs.evaluation.simulated)
    }
}

/// Returns the excerpts that the map of `texture` plays, each with the speed and force of its node.
fn node_excerpts<'a>(
    Evaluation { trials, excerpts, .. }: &'a Evaluation,
    texture: &str,
) -> Vec<((f64, f64), &'a Excerpt)> {
    let mut nodes: Vec<((f64, f64), &Excerpt)> = Vec::new();
    for (trial, excerpt) in trials.iter().zip(excerpts) {
        let place = (trial.speed_mm_s, trial.force_n);
        let is_own = trial.texture == texture && !excerpt.recorded.is_empty();
        // Of several trials at a node, the map shows the C of the first.
        if is_own && nodes.iter().all(|(known, _)| *known != place) {
            nodes.push((place, excerpt));
        }
    }
    nodes
}

/// Squared distance of a speed and a force from [`EXAMPLE`], both relative to it.
fn distance(speed_mm_s: f64, force_n: f64) -> f64 {
    (speed_mm_s / EXAMPLE.0 - 1.0).powi(2) + (force_n / EXAMPLE.1 - 1.0).powi(2)
}

/// Writes the removed-node test as the paper's Table I.
fn removed_node_tables(page: &mut Page, test: &LeaveOneOut) {
    page.section("Removed nodes: Table I of the paper")
        .paragraph(&format!(
            "Each of {} inner nodes was removed, predicted from its neighbours, played by the device's kernel and \
             compared with its recording. Models are of order {}. A prediction that cannot be played (an unstable \
             mean) counts with C = 100 %. σ² error is the mean difference of the excitation's variance; the paper \
             names no unit, here it is (m/s²)². The paper does not say either how its spectra are smoothed; here C is \
             of amplitudes smoothed by a {}. The last row is the node's own model, which was fitted to what \
             it is compared with (in-sample, not a measure of fidelity).",
            test.removed.len(),
            test.order,
            test.smoothing
        ))
        .table(&test.table());
}
