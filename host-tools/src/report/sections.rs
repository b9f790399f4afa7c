//! Sections that the pages share: the overview, order against cost, and a texture's example with its maps.

use std::path::Path;

use model_format::{Axis, Library, Node, Texture};

use super::html::{Column, Page};
use super::plot::{
    Caption, GridCell, GridMap, OrderSeries, SpectraView, Svg, band_error_chart, grid_map,
    order_against_cost, time_and_frequency, waveforms,
};
use crate::dsp::spectrum::AMPLITUDE_JND_DB;
use crate::evaluation::evaluate;
use crate::evaluation::evaluate::{Comparison, Evaluation, cost_by_order, texture_named};
use crate::evaluation::held_out::JudgeKind;
use crate::evaluation::liveliness::summaries;
use crate::evaluation::results::TrialEvaluation;
use crate::evaluation::summary::{
    FEEL_COLUMNS, LIVELINESS_COLUMNS, LIVELINESS_EXPLANATION, SPECTRA_COLUMNS, TextureEvaluation,
    liveliness_cells,
};
use crate::recording::{RecordingSet, Trial};
use crate::support::error::Result;
use crate::support::file_name::Stems;
use crate::texture::grid::as_written;
use model_format::SAMPLE_RATE_HZ;

/// Speed, mm/s, and force, N, of the paper's own example (its figure 10); the nearest trial stands for its texture.
const EXAMPLE: (f64, f64) = (120.0, 1.0);

/// Orders of the picture of order against cost. The paper's goes up to 1000, a stylus to 400.
const ORDERS: [usize; 10] = [0, 2, 5, 10, 20, 50, 100, 200, 300, 400];

/// An evaluation that is being written as a page.
pub(super) struct Sections<'a> {
    /// The recordings.
    pub set: &'a RecordingSet,
    /// The library that they were compared with.
    pub library: &'a Library<'a>,
    /// The comparison.
    pub evaluation: &'a Evaluation,
    /// Options of the comparison.
    pub options: &'a evaluate::Options,
    /// Folder that takes each picture as a file of its own, too.
    pub pictures: Option<&'a Path>,
    /// Stems of the pictures' names in that folder, by texture.
    pub stems: Stems,
    /// The page.
    pub page: Page,
}

/// The example trial of a texture, with its synthesis.
pub(super) struct Example<'a> {
    /// The trial.
    pub trial: &'a Trial,
    /// The comparison's figures.
    pub judged: &'a TrialEvaluation,
    /// The signals.
    pub comparison: Comparison,
    /// Texture, speed and force in words.
    pub title: String,
}

impl Example<'_> {
    /// Returns in words what the drawn block of the recording is to the model that is drawn beside it.
    pub fn part(&self) -> String {
        let block_s = self.comparison.longest_block().len() as f64 / f64::from(SAMPLE_RATE_HZ);
        match self.judged.judge {
            JudgeKind::Blocks => format!("a block of {block_s:.1} s that was not fitted"),
            JudgeKind::OtherTake => "another take, which was not fitted".into(),
            JudgeKind::Unseen => "a recording that was not fitted".into(),
            JudgeKind::Nothing => {
                "in-sample if the library was fitted to it, and then not a measure of fidelity"
                    .into()
            }
        }
    }
}

/// Columns of a page's table from headings, each with true for numbers.
pub(super) fn columns<'h>(headings: &[(&'h str, bool)]) -> Vec<Column<'h>> {
    let column = |&(heading, is_number): &(&'h str, bool)| {
        if is_number {
            Column::Number(heading)
        } else {
            Column::Text(heading)
        }
    };
    headings.iter().map(column).collect()
}

impl<'a> Sections<'a> {
    /// Writes what was compared, how, and a line per texture.
    pub fn overview(&mut self) {
        if self.evaluation.simulated {
            self.page.notice(
                "SIMULATED: these recordings were computed by the rig simulator. No figure here says how near the \
                 stylus comes to a real surface.",
            );
        }
        self.page.section("How near the stylus comes");
        self.page
            .notice(&format!("Held out: {}", self.evaluation.held_out));
        self.page.paragraph(&format!(
            "Each held-out recording is compared with {} s of what the stylus plays at its speed and force, computed \
             by the device's own kernel. {} {}",
            self.options.synthesis_s,
            self.evaluation.judged_hz(),
            self.evaluation.other_in_words()
        ));
        self.page.paragraph(&format!(
            "C is equation (6) of Romano, Yoshioka and Kuchenbecker (ICRA 2010), with DFT amplitudes smoothed by a {} \
             and averaged over blocks. LSD is the log-spectral distance in sliding third octaves. |band| is the mean \
             magnitude of the errors of third octaves, and the next columns are the share of them below \
             {AMPLITUDE_JND_DB} dB, the amplitude JND (Israr 2006), which are not felt.",
            self.evaluation.smoothing
        ));
        let textures = || self.evaluation.textures.iter();
        let rows: Vec<Vec<String>> = textures().map(TextureEvaluation::spectra_cells).collect();
        let felt: Vec<Vec<String>> = textures().map(TextureEvaluation::feel_cells).collect();
        self.page
            .table("Spectra", &columns(&SPECTRA_COLUMNS), &rows);
        self.page.paragraph(&format!(
            "Level error: RMS error of third octaves in just noticeable differences of {AMPLITUDE_JND_DB} dB, less \
             what two estimates of one noise differ by: about 0 for another seed, 2.7 for a gain of -6 dB. Balance: \
             power below 100 Hz over that above, against the judge's. Kurtosis: 3 for Gaussian noise, more for \
             impulses. Modulation: the envelope's 8 to 64 Hz over its mean."
        ));
        self.page
            .table("What is felt", &columns(&FEEL_COLUMNS), &felt);
        let lively = self.evaluation.liveliness_cells();
        if !lively.is_empty() {
            self.page.paragraph(&format!(
                "Two signals with one spectrum may feel different, because one has impulses, or a level that changes, \
                 and the other has not. {LIVELINESS_EXPLANATION}"
            ));
            self.page.table(
                "What the spectrum does not show",
                &columns(&LIVELINESS_COLUMNS),
                &lively,
            );
        }
    }

    /// Draws the cost of each texture's example trial by the order of its model: the paper's figure 8.
    ///
    /// # Errors
    /// A recording that cannot be used any more, or a file that cannot be written.
    pub fn orders(&mut self) -> Result<()> {
        let mut series = Vec::new();
        for summary in &self.evaluation.textures {
            let Some(index) = self.example_index(&summary.texture) else {
                continue;
            };
            let trial = &self.set.trials[index];
            let costs = cost_by_order(trial, &ORDERS, self.options)?;
            let chosen = node_order(&texture_named(self.library, &summary.texture)?, trial);
            series.push((summary.texture.as_str(), costs, chosen));
        }
        if series.is_empty() {
            return Ok(());
        }
        let series: Vec<OrderSeries<'_>> = series
            .iter()
            .map(|(name, costs, chosen)| OrderSeries {
                name,
                costs,
                chosen: *chosen,
            })
            .collect();
        let picture = order_against_cost(&self.caption("Order against cost"), &series)?;
        self.page.section("Cost by order");
        self.figure(
            &picture,
            "order-against-cost.svg",
            "C of the example trial of each texture by the order of its model (the paper's figure 8), fitted on every \
             other block of the recording and judged on the rest. The mark is the order that the library has there.",
        )
    }

    /// Reads and plays the trial of `texture` that is nearest to the paper's own example. `None` if all are silent.
    ///
    /// # Errors
    /// A recording that cannot be used any more.
    pub fn example(&self, texture: Texture<'_>) -> Result<Option<Example<'a>>> {
        let name = texture.name();
        let Some(index) = self.example_index(name) else {
            return Ok(None);
        };
        let trial = &self.set.trials[index];
        let evaluation = self.evaluation;
        Ok(Some(Example {
            trial,
            judged: &evaluation.trials[index],
            comparison: evaluation.compare(self.set, self.library, index, self.options)?,
            title: format!("{name}, {} mm/s, {} N", trial.speed_mm_s, trial.force_n),
        }))
    }

    /// Draws an example in time and frequency.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn time_and_frequency(&mut self, example: &Example<'_>) -> Result<()> {
        let view = SpectraView {
            smoothing_width_hz: self.options.smoothing_hz,
            ..SpectraView::default()
        };
        let stem = self.stems.of(&example.trial.texture);
        let picture = time_and_frequency(
            &self.caption(&example.title),
            example.comparison.longest_block(),
            &example.comparison.synthesised,
            f64::from(SAMPLE_RATE_HZ),
            &view,
        )?;
        self.figure(
            &picture,
            &format!("{stem}-time-and-frequency.svg"),
            &format!(
                "The example trial and its synthesis in time and frequency (the paper's figure 7): {}. C is of what is \
                 drawn here.",
                example.part()
            ),
        )
    }

    /// Draws an example's waveforms and envelopes, and writes its measures of what a spectrum does not show below.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn waveforms(&mut self, example: &Example<'_>) -> Result<()> {
        let comparison = &example.comparison;
        let synthesis = format!("synthesis: {}", comparison.parts);
        let mut signals: Vec<(&str, &[f64])> = vec![
            ("recording", &comparison.recording),
            (&synthesis, &comparison.synthesised),
        ];
        let versions = comparison.versions.iter();
        signals.extend(versions.map(|v| (v.parts.as_str(), v.synthesised.as_slice())));
        let stem = self.stems.of(&example.trial.texture);
        let rate_hz = f64::from(SAMPLE_RATE_HZ);
        let picture = waveforms(&self.caption(&example.title), &signals, rate_hz)?;
        self.figure(
            &picture,
            &format!("{stem}-waveforms.svg"),
            "Waveforms and envelopes to one scale, 0.1 s and 2 s from the middle of each. The recording is drawn \
             whatever was fitted of it; the figures below are of what was held out.",
        )?;
        if let Some(liveliness) = &example.judged.liveliness {
            let summaries = summaries(std::iter::once(liveliness));
            let rows = liveliness_cells(&example.title, &summaries);
            self.page.table(
                "What the spectrum does not show, of this trial",
                &columns(&LIVELINESS_COLUMNS),
                &rows,
            );
        }
        Ok(())
    }

    /// Draws an example's errors in third-octave bands.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn bands(&mut self, example: &Example<'_>) -> Result<()> {
        if example.judged.judge == JudgeKind::Nothing {
            return Ok(());
        }
        let stem = self.stems.of(&example.trial.texture);
        let picture = band_error_chart(
            &self.caption(&example.title),
            &example.judged.scores.band_errors_db,
        )?;
        self.figure(
            &picture,
            &format!("{stem}-bands.svg"),
            "Level of the synthesis over the held-out recording's in third-octave bands; shaded: not felt.",
        )
    }

    /// Draws C over the grid of `texture`, if it has more than one node.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn cost_map(&mut self, texture: &Texture<'_>) -> Result<()> {
        if texture.speed_axis().len() * texture.force_axis().len() <= 1 {
            return Ok(());
        }
        let title = format!("{}: C over the grid", texture.name());
        let stem = self.stems.of(texture.name());
        let picture = cost_map(&self.caption(&title), texture, self.evaluation)?;
        self.figure(
            &picture,
            &format!("{stem}-cost-map.svg"),
            "C of every node against what was held out of its recordings.",
        )
    }

    /// Puts a picture on the page, and into the folder of pictures as `file`.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn figure(&mut self, picture: &Svg, file: &str, caption: &str) -> Result<()> {
        if let Some(folder) = self.pictures {
            picture.write(&folder.join(file))?;
        }
        self.page.figure(picture, caption);
        Ok(())
    }

    /// Returns the heading of a picture, which says whether it is simulated.
    pub fn caption<'t>(&self, title: &'t str) -> Caption<'t> {
        Caption {
            title,
            simulated: self.evaluation.simulated,
        }
    }

    /// Index of the trial of a texture that is nearest to [`EXAMPLE`] and not silent.
    fn example_index(&self, texture: &str) -> Option<usize> {
        let trials = self.evaluation.trials.iter().enumerate();
        let heard = trials.filter(|(_, trial)| trial.texture == texture && !trial.is_silent);
        let far = |trial: &TrialEvaluation| distance(trial.speed_mm_s, trial.force_n);
        heard
            .min_by(|(_, a), (_, b)| far(a).total_cmp(&far(b)))
            .map(|(index, _)| index)
    }
}

/// Squared distance of a speed and a force from [`EXAMPLE`], as shares of it.
pub(super) fn distance(speed_mm_s: f64, force_n: f64) -> f64 {
    (speed_mm_s / EXAMPLE.0 - 1.0).powi(2) + (force_n / EXAMPLE.1 - 1.0).powi(2)
}

/// The order of the library's model at a trial's node, if the trial stands at one.
fn node_order(texture: &Texture<'_>, trial: &Trial) -> Option<usize> {
    let at = |axis: Axis<'_>, value: f64| axis.values().position(|v| v == value as f32);
    let speed = at(texture.speed_axis(), trial.speed_mm_s)?;
    let force = at(texture.force_axis(), trial.force_n)?;
    Some(texture.node(speed, force).coefficients.order())
}

/// C of every node of a texture that was judged, over the grid.
fn cost_map(caption: &Caption<'_>, texture: &Texture<'_>, evaluation: &Evaluation) -> Result<Svg> {
    let (speeds, forces) = (texture.speed_axis(), texture.force_axis());
    let places = speeds
        .values()
        .flat_map(|speed| forces.values().map(move |force| (speed, force)));
    let cell = |(node, (speed, force)): (Node<'_>, (f32, f32))| {
        let here = |trial: &&TrialEvaluation| {
            trial.texture == texture.name()
                && trial.speed_mm_s as f32 == speed
                && trial.force_n as f32 == force
        };
        GridCell {
            value: evaluation
                .trials
                .iter()
                .find(here)
                .and_then(|t| t.scores.cost),
            flags: node.flags,
        }
    };
    let cells: Vec<GridCell> = texture.nodes().zip(places).map(cell).collect();
    let map = GridMap {
        speeds_mm_s: &speeds.values().map(as_written).collect::<Vec<_>>(),
        forces_n: &forces.values().map(as_written).collect::<Vec<_>>(),
        cells: &cells,
        quantity: "C",
        decimals: 2,
    };
    grid_map(caption, &map)
}
