//! The evaluation as a page that one can put before a colleague: pictures and tables, one file, with the pictures
//! beside it as files of their own.

use std::path::{Path, PathBuf};

use model_format::{Axis, Library, Node, Texture};

use crate::dsp::MODEL_RATE_HZ;
use crate::dsp::spectrum::AMPLITUDE_JND_DB;
use crate::evaluation::evaluate::{
    Evaluation, Options, TrialEvaluation, compare, cost_by_order, texture_named,
};
use crate::recording::RecordingSet;
use crate::report::html::{Column, Page};
use crate::report::plot::{
    Caption, GridCell, GridMap, OrderSeries, SpectraView, Svg, band_error_chart, grid_map,
    order_against_cost, time_and_frequency,
};
use crate::support::error::{Error, Result};
use crate::support::progress;
use crate::texture::grid::as_written;

/// The page's name in its folder.
const PAGE: &str = "index.html";

/// Where the paper shows its own example (its figure 10): the trial nearest to it stands for its texture.
const EXAMPLE: (f64, f64) = (120.0, 1.0);

/// Orders of the picture of order against cost; the paper's goes on to 1000, a stylus to 400.
const ORDERS: [usize; 10] = [0, 2, 5, 10, 20, 50, 100, 200, 300, 400];

/// Writes the report on an evaluation of `set` into `folder`, and gives the page's path.
///
/// # Errors
/// A folder that cannot be written to, or a recording that cannot be used any more.
pub fn write(
    set: &RecordingSet,
    library: &Library<'_>,
    evaluation: &Evaluation,
    options: &Options,
    folder: &Path,
) -> Result<PathBuf> {
    std::fs::create_dir_all(folder).map_err(Error::io("create", folder))?;
    let mut report = Report {
        set,
        evaluation,
        options,
        folder,
        page: Page::new("Recordings and what the stylus plays"),
    };
    let bar = progress::bar(evaluation.textures.len() as u64 + 1, "reporting");
    report.overview();
    report.orders(library)?;
    bar.inc(1);
    for summary in &evaluation.textures {
        report.texture(texture_named(library, &summary.texture)?)?;
        bar.inc(1);
    }
    bar.finish_and_clear();
    let page = folder.join(PAGE);
    report.page.write(&page)?;
    Ok(page)
}

struct Report<'a> {
    set: &'a RecordingSet,
    evaluation: &'a Evaluation,
    options: &'a Options,
    folder: &'a Path,
    page: Page,
}

impl Report<'_> {
    fn overview(&mut self) {
        if self.evaluation.simulated {
            self.page.notice(
                "SIMULATED: these recordings were computed by the rig simulator. No figure here says how near the \
                 stylus comes to a real surface.",
            );
        }
        self.page.paragraph(&format!(
            "Each recording is compared with what the stylus plays at its speed and force: {} s of synthesis by the \
             device's own kernel. C is the paper's equation (6) (Romano, Yoshioka, Kuchenbecker, ICRA 2010), with DFT \
             amplitudes smoothed by a {}. A synthesis is noise of its own, so that a perfect model of broadband noise \
             does not score 0 but the floor shown. Bands are third octaves from 20 to 1000 Hz; errors below {} dB \
             (amplitude JND, Israr 2006) are not felt; the table has their mean magnitude and the share that is not \
             felt. LSD is the log-spectral distance from 30 to 1000 Hz.",
            self.options.synthesis_s, self.evaluation.smoothing, AMPLITUDE_JND_DB
        ));
        let within = format!("within {AMPLITUDE_JND_DB} dB");
        let columns = [
            Column::Text("texture"),
            Column::Number("trials"),
            Column::Number("silent"),
            Column::Number("mean C"),
            Column::Number("sd of C"),
            Column::Number("floor of C"),
            Column::Number("band error (dB)"),
            Column::Number(&within),
            Column::Number("LSD (dB)"),
        ];
        let rows: Vec<Vec<String>> = self
            .evaluation
            .textures
            .iter()
            .map(|texture| texture.cells().to_vec())
            .collect();
        self.page.table("Textures", &columns, &rows);
    }

    /// The paper's figure 8.
    fn orders(&mut self, library: &Library<'_>) -> Result<()> {
        let mut series = Vec::new();
        for summary in &self.evaluation.textures {
            let Some(index) = self.example(&summary.texture) else {
                continue;
            };
            let trial = &self.set.trials[index];
            let costs = cost_by_order(trial, &ORDERS, self.options)?;
            let chosen = node_order(&texture_named(library, &summary.texture)?, trial);
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
        self.page.section("How high an order is worth it");
        self.figure(
            &picture,
            "order-against-cost.svg",
            "C of the example trial of each texture against the order of its model, as in the paper's figure 8; \
             marked: the order that the library has there.",
        )
    }

    fn texture(&mut self, texture: Texture<'_>) -> Result<()> {
        let name = texture.name();
        self.page.section(name);
        let stem = file_stem(name);
        if texture.speed_axis().len() * texture.force_axis().len() > 1 {
            self.cost_map(&texture, &stem)?;
        }
        let Some(index) = self.example(name) else {
            self.page.paragraph("Silent in every trial.");
            return Ok(());
        };
        let trial = &self.set.trials[index];
        let judged = &self.evaluation.trials[index];
        let place = format!("{name}, {} mm/s, {} N", trial.speed_mm_s, trial.force_n);
        let seed = self.options.seed.wrapping_add(index as u64);
        let comparison = compare(trial, texture, self.options, seed)?;
        let view = SpectraView {
            smoothing_width_hz: self.options.smoothing_hz,
            ..SpectraView::default()
        };
        let picture = time_and_frequency(
            &self.caption(&place),
            &comparison.recorded,
            &comparison.synthesised,
            f64::from(MODEL_RATE_HZ),
            &view,
        )?;
        let file = format!("{stem}-time-and-frequency.svg");
        self.figure(
            &picture,
            &file,
            "The example trial and its synthesis in time and frequency, as in the paper's figures 5 and 7.",
        )?;
        let picture = band_error_chart(&self.caption(&place), &judged.band_errors_db)?;
        let file = format!("{stem}-bands.svg");
        self.figure(
            &picture,
            &file,
            "Level of the synthesis over the recording's in third-octave bands; shaded: not felt.",
        )
    }

    fn cost_map(&mut self, texture: &Texture<'_>, stem: &str) -> Result<()> {
        let title = format!("{}: C over the grid", texture.name());
        let picture = cost_map(&self.caption(&title), texture, self.evaluation)?;
        self.figure(
            &picture,
            &format!("{stem}-cost-map.svg"),
            "C of every node against its own recording.",
        )
    }

    fn figure(&mut self, picture: &Svg, file: &str, caption: &str) -> Result<()> {
        picture.write(&self.folder.join(file))?;
        self.page.figure(picture, caption);
        Ok(())
    }

    fn caption<'t>(&self, title: &'t str) -> Caption<'t> {
        Caption {
            title,
            simulated: self.evaluation.simulated,
        }
    }

    /// The trial of a texture that is nearest to [`EXAMPLE`] and not silent.
    fn example(&self, texture: &str) -> Option<usize> {
        let distance = |trial: &TrialEvaluation| {
            let speed = (trial.speed_mm_s / EXAMPLE.0 - 1.0).powi(2);
            let force = (trial.force_n / EXAMPLE.1 - 1.0).powi(2);
            speed + force
        };
        let trials = self.evaluation.trials.iter().enumerate();
        let heard = trials.filter(|(_, trial)| trial.texture == texture && !trial.is_silent());
        heard
            .min_by(|(_, a), (_, b)| distance(a).total_cmp(&distance(b)))
            .map(|(index, _)| index)
    }
}

/// The order of the library's model at a trial's node, if the trial stands at one.
fn node_order(texture: &Texture<'_>, trial: &crate::recording::Trial) -> Option<usize> {
    let at = |axis: Axis<'_>, value: f64| axis.values().position(|v| v == value as f32);
    let speed = at(texture.speed_axis(), trial.speed_mm_s)?;
    let force = at(texture.force_axis(), trial.force_n)?;
    Some(texture.node(speed, force).coefficients.order())
}

/// C of every node of a texture that was judged, over the grid.
pub(crate) fn cost_map(
    caption: &Caption<'_>,
    texture: &Texture<'_>,
    evaluation: &Evaluation,
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
            value: evaluation.trials.iter().find(here).and_then(|t| t.cost),
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

/// A texture's name as a part of a file's name.
fn file_stem(name: &str) -> String {
    name.chars()
        .map(|c| if c.is_alphanumeric() { c } else { '_' })
        .collect()
}
