//! Sections that the pages share: the overview, order against cost, and a texture's example with its sounds and maps.

use std::path::Path;

use model_format::{Axis, Library, Node, Texture};

use super::figures;
use super::html::{Column, Page, Sound};
#[cfg(feature = "spectrograms")]
use super::plot::highest_level_db;
use super::plot::{
    COST, Caption, GridCell, GridMap, OrderSeries, Scale, SpectraEnds, SpectraView, Svg,
    band_error_chart, grid_map, order_against_cost, peak, spectra_ends, time_and_frequency,
    waveforms,
};
use super::sound::{SOUNDS_BYTES, clip, sound};
use crate::dsp::spectrum::AMPLITUDE_JND_DB;
use crate::evaluation::evaluate;
use crate::evaluation::evaluate::{Comparison, Evaluation, Excerpt, cost_by_order, texture_named};
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

/// Highest frequency of spectrograms, Hz.
#[cfg(feature = "spectrograms")]
pub(super) const HIGHEST_HZ: f64 = 1000.0;

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
    /// Takes the data of each picture.
    pub data: Option<figures::Folder>,
    /// Colours of C, %, in all maps of the page.
    pub cost_scale: Scale,
    /// Ends of the axes of all textures' pictures.
    pub ends: Ends,
    /// Bytes of the sounds of the nodes, all of which the page will hold, and of those that it holds besides so far.
    pub sound_bytes: usize,
    /// The page.
    pub page: Page,
}

/// Ends of the axes that the pictures of all textures have in common; `None` for those of each picture's own.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Ends {
    /// Of pictures in time and frequency.
    pub spectra: SpectraEnds,
    /// Of waveforms, m/s².
    pub peak_m_s2: Option<f64>,
    /// Of errors in bands, dB.
    pub band_error_db: Option<f64>,
    /// Of spectrograms, dB re 1 (m/s²)²/Hz.
    #[cfg(feature = "spectrograms")]
    pub level_db: Option<f64>,
    /// Of the variance of the excitation, (m/s²)².
    #[cfg(feature = "spectrograms")]
    pub variance: Option<f64>,
}

impl Ends {
    /// The ends that an example's pictures need.
    fn of(example: &Example<'_>, view: &SpectraView) -> Self {
        let rate_hz = f64::from(SAMPLE_RATE_HZ);
        let errors = example.judged.scores.band_errors_db.iter().flatten();
        let comparison = &example.comparison;
        let synthesised = &comparison.synthesised;
        Self {
            spectra: spectra_ends(comparison.longest_block(), synthesised, rate_hz, view),
            peak_m_s2: peak(example.signals().map(|(_, signal)| signal), rate_hz),
            band_error_db: errors.map(|error| error.abs()).reduce(f64::max),
            #[cfg(feature = "spectrograms")]
            level_db: highest_level_db(&[&comparison.recording, synthesised], rate_hz, HIGHEST_HZ),
            #[cfg(feature = "spectrograms")]
            variance: None,
        }
    }

    /// The ends that hold the pictures of both.
    fn with(self, other: Self) -> Self {
        let larger = |a: Option<f64>, b: Option<f64>| [a, b].into_iter().flatten().reduce(f64::max);
        Self {
            spectra: self.spectra.with(other.spectra),
            peak_m_s2: larger(self.peak_m_s2, other.peak_m_s2),
            band_error_db: larger(self.band_error_db, other.band_error_db),
            #[cfg(feature = "spectrograms")]
            level_db: larger(self.level_db, other.level_db),
            #[cfg(feature = "spectrograms")]
            variance: larger(self.variance, other.variance),
        }
    }
}

/// Share of the common scale below which a picture is drawn once more to its own: less of it is hard to see.
const SMALL: f64 = 0.2;

/// Said of a picture to its own scale.
pub(super) const OWN_SCALE: &str =
    "The same to a scale of its own, because it is small beside the other textures.";

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
    /// The order of the library's model there, if the trial stands at a node.
    #[cfg_attr(not(feature = "spectrograms"), allow(dead_code))]
    pub order: Option<usize>,
}

impl Example<'_> {
    /// The signals of the picture of waveforms, with their names.
    fn signals(&self) -> impl Iterator<Item = (&str, &[f64])> {
        let comparison = &self.comparison;
        let first = [
            ("recording", comparison.recording.as_slice()),
            ("synthesis", comparison.synthesised.as_slice()),
        ];
        let versions = comparison.versions.iter();
        let versions = versions.map(|v| (v.parts.as_str(), v.synthesised.as_slice()));
        first.into_iter().chain(versions)
    }

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
    /// The sections of a page that is still empty; `further_costs` are shares that its maps show beside the
    /// comparison's.
    pub fn new(
        set: &'a RecordingSet,
        library: &'a Library<'a>,
        evaluation: &'a Evaluation,
        options: &'a evaluate::Options,
        further_costs: impl Iterator<Item = f64>,
    ) -> Self {
        let costs = evaluation.trials.iter();
        let costs = costs.filter_map(|trial| trial.scores.cost);
        let of_node = |clips: &Excerpt| 2 * (clips.recorded.len() + clips.synthesised.len());
        let node_bytes = evaluation.excerpts.iter().map(of_node).sum();
        Self {
            set,
            library,
            evaluation,
            options,
            pictures: None,
            data: None,
            ends: Ends::default(),
            stems: Stems::default(),
            cost_scale: Scale::of(costs.chain(further_costs).map(|cost| 100.0 * cost)),
            sound_bytes: node_bytes,
            page: Page::new("Recordings and what the stylus plays"),
        }
    }

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
            "C is equation (6) of Romano, Yoshioka and Kuchenbecker (ICRA 2010) in per cent, with DFT amplitudes \
             smoothed by a {} and averaged over blocks. LSD is the log-spectral distance in sliding third octaves. \
             |band| is the mean magnitude of the errors of third octaves, and the next columns are the share of them \
             below {AMPLITUDE_JND_DB} dB, the amplitude JND (Israr 2006), which are not felt.",
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
            "order-against-cost",
            "C of the example trial of each texture by the order of its model (the paper's figure 8), fitted to every \
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
            order: node_order(&texture, trial),
            comparison: evaluation.compare(self.set, self.library, index, self.options)?,
            title: format!("{name}, {} mm/s, {} N", trial.speed_mm_s, trial.force_n),
        }))
    }

    /// Looks through the examples of all textures for the ends of the axes that their pictures have in common. Each is
    /// played once more for it, because those of all textures together may not fit into memory.
    ///
    /// # Errors
    /// A recording that cannot be used any more.
    pub fn share_scales(&mut self) -> Result<()> {
        for summary in &self.evaluation.textures {
            let texture = texture_named(self.library, &summary.texture)?;
            if let Some(example) = self.example(texture)? {
                self.ends = self.ends.with(Ends::of(&example, &self.view()));
            }
            #[cfg(feature = "spectrograms")]
            {
                let variances = texture.nodes().map(|n| f64::from(n.prediction_error_power));
                let own = variances.reduce(f64::max);
                let own = Ends {
                    variance: own,
                    ..Ends::default()
                };
                self.ends = self.ends.with(own);
            }
        }
        Ok(())
    }

    fn view(&self) -> SpectraView {
        SpectraView {
            smoothing_width_hz: self.options.smoothing_hz,
            ends: self.ends.spectra,
            ..SpectraView::default()
        }
    }

    /// Returns an example's recording and syntheses as sounds, or none when the page holds [`SOUNDS_BYTES`] of them.
    ///
    /// # Errors
    /// A signal that cannot be made a sound.
    pub fn sounds_of(&mut self, example: &Example<'_>) -> Result<Vec<Sound>> {
        let comparison = &example.comparison;
        let mut heard = vec![
            ("recorded", &comparison.recording),
            ("synthesised", &comparison.synthesised),
        ];
        let versions = comparison.versions.iter();
        heard.extend(versions.map(|version| (version.parts.as_str(), &version.synthesised)));
        let values = heard.iter().flat_map(|(_, signal)| signal.iter());
        let full_scale = values.map(|value| value.abs()).fold(0.0, f64::max);
        let origin = if self.evaluation.simulated {
            " (SIMULATED)"
        } else {
            ""
        };
        let mut sounds: Vec<Sound> = Vec::new();
        for (what, signal) in heard {
            sounds.push(Sound {
                panel: what.to_owned(),
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

    /// Puts players for an example's recording and syntheses on the page, as long as there is room.
    ///
    /// # Errors
    /// A signal that cannot be made a sound.
    pub fn sounds(&mut self, example: &Example<'_>) -> Result<()> {
        let sounds = self.sounds_of(example)?;
        if !sounds.is_empty() {
            self.page.sounds(&sounds);
            self.page
                .paragraph("All of them have one scale; what is heard is the acceleration.");
        }
        Ok(())
    }

    /// Puts the excerpts of all trials at nodes of `texture` on the page, all to one scale, to be played by its maps.
    pub fn nodes(&mut self, texture: &str) {
        let excerpts = self.evaluation.trials.iter().zip(&self.evaluation.excerpts);
        let own = || {
            let own = excerpts
                .clone()
                .filter(|(trial, _)| trial.texture == texture);
            own.filter(|(_, excerpt)| !excerpt.recorded.is_empty())
        };
        let values = own().flat_map(|(_, e)| e.recorded.iter().chain(&e.synthesised));
        let full_scale = values.fold(0.0, |most: f64, value| most.max(f64::from(value.abs())));
        let mut places: Vec<(f64, f64)> = Vec::new();
        for (trial, excerpt) in own() {
            let place = (trial.speed_mm_s, trial.force_n);
            // The first of several trials at a node is the one whose C the map shows.
            if places.contains(&place) {
                continue;
            }
            places.push(place);
            let clips = [&excerpt.recorded, &excerpt.synthesised];
            let clips = clips.map(|signal| clip(signal, full_scale));
            let [recorded, synthesised] = &clips;
            self.page
                .node(texture, place, SAMPLE_RATE_HZ, [recorded, synthesised]);
        }
    }

    /// Said of a map whose nodes can be played.
    pub fn playing_in_words(&self) -> &'static str {
        if self.evaluation.excerpts.is_empty() {
            " The page holds no sounds of nodes, because there are too many: stylus render makes them."
        } else {
            " Click a node, or press Enter on it, to hear its recording and then its synthesis."
        }
    }

    /// Draws an example in time and frequency.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn time_and_frequency(&mut self, example: &Example<'_>) -> Result<()> {
        let stem = self.stems.of(&example.trial.texture).clone();
        let comparison = &example.comparison;
        let caption = format!(
            "The example trial and its synthesis in time and frequency (the paper's figure 7): {}. C is of what is \
             drawn here.",
            example.part()
        );
        self.spectra(
            &example.title,
            (comparison.longest_block(), &comparison.synthesised),
            &format!("{stem}-time-and-frequency"),
            &caption,
        )
    }

    /// Draws a recording and its synthesis in time and frequency, as `name`, to the scales of all textures; once more
    /// to their own where they are small beside them.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn spectra(
        &mut self,
        title: &str,
        (recorded, synthesised): (&[f64], &[f64]),
        name: &str,
        caption: &str,
    ) -> Result<()> {
        let rate_hz = f64::from(SAMPLE_RATE_HZ);
        let shared = self.view();
        let own = spectra_ends(recorded, synthesised, rate_hz, &shared);
        // Beyond the scale of the examples, such as where a node is removed, a picture is to its own alone.
        let fits = |own: Option<f64>, shared: Option<f64>| own <= shared;
        let is_within = fits(own.amplitude, shared.ends.amplitude)
            && fits(own.acceleration_m_s2, shared.ends.acceleration_m_s2);
        let is_small = is_small(own.amplitude, shared.ends.amplitude)
            || is_small(own.acceleration_m_s2, shared.ends.acceleration_m_s2);
        let to_its_own = SpectraView {
            ends: SpectraEnds::default(),
            ..shared
        };
        let mut views = Vec::new();
        if is_within {
            let caption = format!("{caption} The scales are those of all textures.");
            views.push((shared, name.to_owned(), caption));
        } else {
            let caption =
                format!("{caption} The scales are its own, because it is beyond the others'.");
            views.push((to_its_own, name.to_owned(), caption));
        }
        if is_within && is_small {
            views.push((
                to_its_own,
                format!("{name}-own-scale"),
                OWN_SCALE.to_owned(),
            ));
        }
        for (view, name, caption) in views {
            let title = self.caption(title);
            let picture = time_and_frequency(&title, recorded, synthesised, rate_hz, &view)?;
            self.figure(&picture, &name, &caption)?;
        }
        Ok(())
    }

    /// Draws an example's waveforms and envelopes, and writes its measures of what a spectrum does not show below.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn waveforms(&mut self, example: &Example<'_>) -> Result<()> {
        let synthesis = format!("synthesis: {}", example.comparison.parts);
        let mut signals: Vec<(&str, &[f64])> = example.signals().collect();
        signals[1].0 = &synthesis;
        let stem = self.stems.of(&example.trial.texture).clone();
        let rate_hz = f64::from(SAMPLE_RATE_HZ);
        let shared = self.ends.peak_m_s2;
        let own = peak(example.signals().map(|(_, signal)| signal), rate_hz);
        let mut scales = vec![(
            shared,
            "waveforms",
            "Waveforms and envelopes, 0.1 s and 2 s from the middle of each, to the scale of all textures. The \
             recording is drawn whatever was fitted of it; the figures below are of what was held out.",
        )];
        if is_small(own, shared) {
            scales.push((None, "waveforms-own-scale", OWN_SCALE));
        }
        for (peak, name, caption) in scales {
            let title = self.caption(&example.title);
            let picture = waveforms(&title, &signals, rate_hz, peak)?;
            self.figure(&picture, &format!("{stem}-{name}"), caption)?;
        }
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
        let stem = self.stems.of(&example.trial.texture).clone();
        let picture = band_error_chart(
            &self.caption(&example.title),
            &example.judged.scores.band_errors_db,
            self.ends.band_error_db,
        )?;
        self.figure(
            &picture,
            &format!("{stem}-bands"),
            "Level of the synthesis over the held-out recording's in third-octave bands, to the scale of all textures; \
             shaded: not felt.",
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
        let stem = self.stems.of(texture.name()).clone();
        let picture = cost_map(
            &self.caption(&title),
            texture,
            self.evaluation,
            self.cost_scale,
        )?;
        self.figure(
            &picture,
            &format!("{stem}-cost-map"),
            &format!(
                "C of every node against what was held out of its recordings, in the colours of all maps of C on this \
                 page.{}",
                self.playing_in_words()
            ),
        )
    }

    /// Puts a picture on the page, and as `name` into the folder of pictures and into that of data.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn figure(&mut self, picture: &Svg, name: &str, caption: &str) -> Result<()> {
        self.figure_with_sounds(picture, name, caption, &[])
    }

    /// As [`Self::figure`], with players below the picture.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn figure_with_sounds(
        &mut self,
        picture: &Svg,
        name: &str,
        caption: &str,
        sounds: &[Sound],
    ) -> Result<()> {
        if let Some(folder) = self.pictures {
            picture.write(&folder.join(format!("{name}.svg")))?;
        }
        if let Some(data) = &mut self.data {
            data.add(name, picture)?;
        }
        self.page.figure_with_sounds(picture, caption, sounds);
        Ok(())
    }

    /// Writes the page, and ends the files of data.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn write(self, page: &Path) -> Result<()> {
        self.data.map_or(Ok(()), figures::Folder::finish)?;
        self.page.write(page)
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

/// Returns whether a picture fills little of the scale that it shares.
pub(super) fn is_small(own: Option<f64>, shared: Option<f64>) -> bool {
    own.zip(shared)
        .is_some_and(|(own, shared)| own < SMALL * shared)
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
fn cost_map(
    caption: &Caption<'_>,
    texture: &Texture<'_>,
    evaluation: &Evaluation,
    scale: Scale,
) -> Result<Svg> {
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
                .and_then(|t| t.scores.cost)
                .map(|cost| 100.0 * cost),
            flags: node.flags,
        }
    };
    let cells: Vec<GridCell> = texture.nodes().zip(places).map(cell).collect();
    let map = GridMap {
        texture: texture.name(),
        speeds_mm_s: &speeds.values().map(as_written).collect::<Vec<_>>(),
        forces_n: &forces.values().map(as_written).collect::<Vec<_>>(),
        cells: &cells,
        quantity: COST,
        scale,
        decimals: 1,
    };
    grid_map(caption, &map)
}
