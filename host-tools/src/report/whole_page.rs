//! Everything that is to be known of a recording set and of what the stylus makes of it, on one page that needs nothing
//! else: the paper's figures 5 and 7 to 10 and its Table I from the user's own recordings, the table of interpolation
//! domains, maps, spectrograms and sounds.

use std::path::Path;

use model_format::{Library, Texture};

use crate::dsp::MODEL_RATE_HZ;
use crate::dsp::linear_prediction::step_up;
use crate::dsp::spectrum::AMPLITUDE_JND_DB;
use crate::evaluation::evaluate;
use crate::evaluation::evaluate::{
    Evaluation, TrialEvaluation, compare, cost_by_order, texture_named,
};
use crate::evaluation::leave_one_out::{
    LeaveOneOut, PAPER_TABLE_I, PaperColumn, Prepared, Removed, Row, SMOOTHING_WIDTHS_HZ, summarise,
};
use crate::evaluation::takes::TakeDistance;
use crate::recording::{RecordingSet, resample};
use crate::report::evaluation_page::cost_map;
use crate::report::html::{Column, Page};
use crate::report::plot::{
    Caption, GridCell, GridMap, OrderSeries, SpectraView, band_error_chart, forward_prediction,
    grid_and_motion, grid_map, order_against_cost, spectrograms, time_and_frequency,
};
use crate::support::error::Result;
use crate::texture::domain::Method;
use crate::texture::grid::as_written;

/// Where the paper shows its own examples (figure 10, and speeds of figures 5 and 7): the nearest trial stands for its texture.
const EXAMPLE: (f64, f64) = (120.0, 1.0);

/// Orders of the picture of order against cost.
const ORDERS: [usize; 10] = [0, 2, 5, 10, 20, 50, 100, 200, 300, 400];

/// A stretch of a recording in the picture of its prediction, s.
const PREDICTION_S: f64 = 0.1;

/// Sample rate of the page's sounds, Hz: every browser plays it.
const SOUND_RATE_HZ: u32 = 20_000;

/// Longest sound, s.
const SOUND_S: f64 = 3.0;

/// The rows of Table I.
const TABLE_ONE: [Row; 4] = [
    Row::Interpolated(Method::PAPER),
    Row::Interpolated(Method::DEVICE),
    Row::Densified,
    Row::Own,
];

/// What the page is about.
pub struct Inputs<'a> {
    /// The recordings.
    pub set: &'a RecordingSet,
    /// What the stylus has for them.
    pub library: &'a Library<'a>,
    /// How near it comes to them.
    pub evaluation: &'a Evaluation,
    /// How that was found.
    pub options: &'a evaluate::Options,
    /// The removed-node test with the set it was made from; none where no node lies between others.
    pub test: Option<(
        &'a LeaveOneOut,
        &'a Prepared<'a>,
        crate::evaluation::leave_one_out::Options,
    )>,
    /// Distances to other takes; may be none.
    pub takes: &'a [TakeDistance],
}

/// Writes the page, telling `progress` of each texture done.
///
/// # Errors
/// A recording that cannot be used any more, or a file that cannot be written.
pub fn write(inputs: &Inputs<'_>, path: &Path, progress: impl Fn()) -> Result<()> {
    let mut report = Report {
        inputs,
        page: Page::new("Recordings and what the stylus plays"),
    };
    report.overview();
    report.takes();
    if let Some((test, ..)) = inputs.test {
        report.table_one(test);
        report.domains(test);
        report.smoothing(test);
    }
    report.orders()?;
    for summary in &inputs.evaluation.textures {
        report.texture(texture_named(inputs.library, &summary.texture)?)?;
        progress();
    }
    report.page.write(path)
}

struct Report<'a> {
    inputs: &'a Inputs<'a>,
    page: Page,
}

impl Report<'_> {
    fn overview(&mut self) {
        let evaluation = self.inputs.evaluation;
        if evaluation.simulated {
            self.page.notice(
                "SIMULATED: these recordings were computed by the rig simulator. No figure here says how near the \
                 stylus comes to a real surface.",
            );
        }
        self.page.section("How near the stylus comes");
        self.page.paragraph(&format!(
            "Each recording is compared with {} s of what the stylus plays at its speed and force, computed by the \
             device's own kernel. C is equation (6) of Romano, Yoshioka and Kuchenbecker (ICRA 2010), with DFT amplitudes \
             smoothed by a {}. A synthesis is noise of its own: a perfect model of broadband noise scores the floor, not 0. \
             Bands are third octaves from 20 to 1000 Hz; errors below {AMPLITUDE_JND_DB} dB (Israr 2006) are not felt. LSD \
             is the log-spectral distance from 30 to 1000 Hz.",
            self.inputs.options.synthesis_s, evaluation.smoothing
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
        let textures = evaluation.textures.iter();
        let rows: Vec<Vec<String>> = textures.map(|t| t.cells().to_vec()).collect();
        self.page.table("Textures", &columns, &rows);
    }

    fn takes(&mut self) {
        if self.inputs.takes.is_empty() {
            return;
        }
        self.page.section("Against another take");
        self.page.paragraph(
            "Log-spectral distance from each recording, 30 to 1000 Hz: of another take of the same surface, and of the \
             synthesis. A model need not come nearer to a recording than another take does.",
        );
        let number =
            |value: Option<f64>| value.map_or(String::new(), |value| format!("{value:.2}"));
        let rows: Vec<Vec<String>> = self
            .inputs
            .takes
            .iter()
            .map(|take| {
                vec![
                    take.texture.clone(),
                    number(take.take_db),
                    number(take.synthesis_db),
                    number(take.excess_db()),
                ]
            })
            .collect();
        let columns = [
            Column::Text("texture"),
            Column::Number("other take (dB)"),
            Column::Number("synthesis (dB)"),
            Column::Number("further by (dB)"),
        ];
        self.page.table("Takes", &columns, &rows);
    }

    fn table_one(&mut self, test: &LeaveOneOut) {
        self.page.section("Removed nodes: Table I of the paper");
        self.page.paragraph(&format!(
            "Each of {} inner nodes was removed, predicted from its neighbours, played by the device's kernel and \
             compared with its recording. Models are of order {}. A prediction that cannot be played (an unstable mean) \
             counts with C = 100 %. σ² error is the mean difference of the excitation's variance; the paper names no \
             unit, here it is (m/s²)².",
            test.removed.len(),
            test.order
        ));
        let mut textures: Vec<&str> = Vec::new();
        for node in &test.removed {
            if !textures.contains(&node.texture.as_str()) {
                textures.push(&node.texture);
            }
        }
        let percent = |mean: f64, sd: f64| format!("{:.1} ± {:.1}", 100.0 * mean, 100.0 * sd);
        let mut columns = vec![Column::Text("C (%), mean ± sd")];
        columns.extend(textures.iter().map(|name| Column::Number(name)));
        columns.extend(["all", "σ² error", "not playable"].map(Column::Number));
        let known = |name: &str| PAPER_TABLE_I.iter().find(|column| column.texture == name);
        let mut first = vec!["the paper's figures, real recordings".to_owned()];
        first.extend(textures.iter().map(|name| {
            known(name).map_or(String::new(), |c| percent(c.mean_cost, c.cost_deviation))
        }));
        let mean = |of: fn(&PaperColumn) -> f64| {
            PAPER_TABLE_I.iter().map(of).sum::<f64>() / PAPER_TABLE_I.len() as f64
        };
        first.push(percent(mean(|c| c.mean_cost), mean(|c| c.cost_deviation)));
        first.push(format!("{:.1e}", mean(|c| c.excitation_error)));
        let mut rows = vec![first];
        for row in TABLE_ONE {
            let mut cells = vec![row.name()];
            for name in &textures {
                let summary = summarise(test, row, Some(name));
                cells.push(
                    summary.map_or(String::new(), |s| percent(s.mean_cost, s.cost_deviation)),
                );
            }
            if let Some(all) = summarise(test, row, None) {
                cells.push(percent(all.mean_cost, all.cost_deviation));
                cells.push(format!("{:.1e}", all.excitation_error));
                cells.push(all.unplayable.to_string());
            }
            rows.push(cells);
        }
        self.page
            .table("Table I, and the same test here", &columns, &rows);
    }

    fn domains(&mut self, test: &LeaveOneOut) {
        self.page.section("What to interpolate");
        self.page.paragraph(
            "The same test in every domain: what of the models is averaged, and how their level is. The last rows are \
             what fitting a denser grid puts there, and the node's own model, which is as near as its order comes.",
        );
        let within = format!("within {AMPLITUDE_JND_DB} dB");
        let columns = [
            Column::Text("domain, level"),
            Column::Number("C ± sd"),
            Column::Number("σ² error"),
            Column::Number("band (dB)"),
            Column::Number(&within),
            Column::Number("LSD (dB)"),
            Column::Number("not playable"),
        ];
        let rows: Vec<Vec<String>> = test
            .rows
            .iter()
            .filter_map(|&row| {
                let s = summarise(test, row, None)?;
                Some(vec![
                    row.name(),
                    format!("{:.3} ± {:.3}", s.mean_cost, s.cost_deviation),
                    format!("{:.1e}", s.excitation_error),
                    format!("{:.2}", s.mean_band_error_db),
                    format!("{:.1} %", 100.0 * s.bands_within_jnd),
                    format!("{:.2}", s.mean_log_spectral_distance_db),
                    s.unplayable.to_string(),
                ])
            })
            .collect();
        self.page.table("Domains", &columns, &rows);
    }

    fn smoothing(&mut self, test: &LeaveOneOut) {
        self.page.section("How C depends on its smoothing");
        self.page.paragraph(&format!(
            "The paper does not say how its spectra are smoothed. Here it is a Hann kernel whose full width is an option \
             (this page: {}); at 0 Hz there is no smoothing and C is the scatter of noise, with a wide kernel it tells of \
             levels only.",
            test.smoothing
        ));
        let widths: Vec<String> = SMOOTHING_WIDTHS_HZ.map(|w| format!("{w} Hz")).to_vec();
        let mut columns = vec![Column::Text("mean C")];
        columns.extend(widths.iter().map(|width| Column::Number(width)));
        let rows: Vec<Vec<String>> = TABLE_ONE
            .iter()
            .filter_map(|&row| {
                let costs = summarise(test, row, None)?.costs_by_width;
                let costs = costs.iter().map(|cost| format!("{cost:.3}"));
                Some(std::iter::once(row.name()).chain(costs).collect())
            })
            .collect();
        self.page
            .table("C by the width of its kernel", &columns, &rows);
    }

    /// The paper's figure 8.
    fn orders(&mut self) -> Result<()> {
        let mut series = Vec::new();
        for summary in &self.inputs.evaluation.textures {
            let Some(index) = self.example(&summary.texture) else {
                continue;
            };
            let trial = &self.inputs.set.trials[index];
            let costs = cost_by_order(trial, &ORDERS, self.inputs.options)?;
            series.push((summary.texture.as_str(), costs));
        }
        let series: Vec<OrderSeries<'_>> = series
            .iter()
            .map(|(name, costs)| OrderSeries {
                name,
                costs,
                chosen: None,
            })
            .collect();
        let picture = order_against_cost(&self.caption("Order against cost"), &series)?;
        self.page.section("How high an order is worth it");
        self.page.figure(
            &picture,
            "C of the example trial of each texture against the order of its model (the paper's figure 8).",
        );
        Ok(())
    }

    fn texture(&mut self, texture: Texture<'_>) -> Result<()> {
        let name = texture.name();
        self.page.section(name);
        let Some(index) = self.example(name) else {
            self.page.paragraph("Silent in every trial.");
            return Ok(());
        };
        let trial = &self.inputs.set.trials[index];
        let place = format!("{name}, {} mm/s, {} N", trial.speed_mm_s, trial.force_n);
        let seed = self.inputs.options.seed.wrapping_add(index as u64);
        let comparison = compare(trial, texture, self.inputs.options, seed)?;
        let (recorded, played) = (&comparison.recorded, &comparison.synthesised);
        let origin = if self.inputs.evaluation.simulated {
            " (SIMULATED)"
        } else {
            ""
        };
        let full_scale = loudest(&[recorded, played]);
        for (what, signal) in [("recorded", recorded), ("synthesised", played)] {
            let wav = sound(signal, full_scale)?;
            self.page.sound(&format!("{place}: {what}{origin}"), &wav);
        }
        self.page
            .paragraph("Both sounds have one scale; what is heard is the acceleration.");
        self.prediction(&place, recorded)?;
        let rate_hz = f64::from(MODEL_RATE_HZ);
        let view = SpectraView {
            smoothing_width_hz: self.inputs.options.smoothing_hz,
            ..SpectraView::default()
        };
        let picture = time_and_frequency(&self.caption(&place), recorded, played, rate_hz, &view)?;
        self.page.figure(
            &picture,
            "The example trial and its synthesis in time and frequency (the paper's figure 7).",
        );
        let picture = spectrograms(&self.caption(&place), recorded, played, rate_hz, 1000.0)?;
        self.page
            .figure(&picture, "Spectrograms of both, to one scale.");
        let judged = &self.inputs.evaluation.trials[index];
        let picture = band_error_chart(&self.caption(&place), &judged.band_errors_db)?;
        self.page.figure(
            &picture,
            "Level of the synthesis over the recording's in third-octave bands; shaded: not felt.",
        );
        if texture.speed_axis().len() * texture.force_axis().len() > 1 {
            self.grid(texture)?;
        }
        self.removed(name)
    }

    /// The paper's figure 5.
    fn prediction(&mut self, place: &str, recorded: &[f64]) -> Result<()> {
        let order = model_format::limits::MAX_ORDER.min(recorded.len() / 4);
        let lags = crate::dsp::autocorrelation::Autocorrelation::of(recorded, order).lags;
        let model = crate::dsp::linear_prediction::Prediction::levinson_durbin(
            &crate::dsp::linear_prediction::corrected(lags),
            order,
        );
        let a = step_up(&model.reflection);
        let shown = ((PREDICTION_S * f64::from(MODEL_RATE_HZ)) as usize).min(recorded.len());
        let begin = (recorded.len() - shown) / 2;
        let predicted: Vec<f64> = (begin..begin + shown)
            .map(|n| {
                let past = recorded[..n].iter().rev();
                -a.iter().zip(past).map(|(a, x)| a * x).sum::<f64>()
            })
            .collect();
        let title = format!("{place}: n = {}", a.len());
        let stretch = &recorded[begin..begin + shown];
        let rate_hz = f64::from(MODEL_RATE_HZ);
        let picture = forward_prediction(&self.caption(&title), stretch, &predicted, rate_hz)?;
        self.page.figure(
            &picture,
            "Forward prediction of the recording and what it leaves (the paper's figure 5).",
        );
        Ok(())
    }

    /// The paper's figure 9, and the map of C.
    fn grid(&mut self, texture: Texture<'_>) -> Result<()> {
        let speeds: Vec<f64> = texture.speed_axis().values().map(as_written).collect();
        let forces: Vec<f64> = texture.force_axis().values().map(as_written).collect();
        let places = speeds
            .iter()
            .flat_map(|&speed| forces.iter().map(move |&force| (speed, force)));
        let nodes: Vec<(f64, f64, f64)> = texture
            .nodes()
            .zip(places)
            .map(|(node, (v, f))| (v, f, f64::from(node.prediction_error_power)))
            .collect();
        let (fast, firm) = (speeds[speeds.len() - 1], forces[forces.len() - 1]);
        let motion: Vec<(f64, f64)> = (0..=100)
            .map(|step| {
                let turn = std::f64::consts::TAU * f64::from(step) / 100.0;
                (
                    fast * (0.5 - 0.38 * turn.cos()),
                    firm * (0.5 + 0.3 * (2.0 * turn).sin()),
                )
            })
            .collect();
        let title = format!("{}: the grid of models", texture.name());
        let picture = grid_and_motion(&self.caption(&title), &nodes, &motion)?;
        self.page.figure(
            &picture,
            "Models over speed and force, and a motion (the paper's figure 9).",
        );
        let title = format!("{}: C over the grid", texture.name());
        let picture = cost_map(&self.caption(&title), &texture, self.inputs.evaluation)?;
        self.page
            .figure(&picture, "C of every node against its own recording.");
        Ok(())
    }

    /// Maps of the removed-node error, and the paper's figure 10.
    fn removed(&mut self, texture: &str) -> Result<()> {
        let Some((test, prepared, options)) = &self.inputs.test else {
            return Ok(());
        };
        let nodes: Vec<&Removed> = test
            .removed
            .iter()
            .filter(|n| n.texture == texture)
            .collect();
        if nodes.is_empty() {
            return Ok(());
        }
        self.page.subsection("Removed nodes");
        for row in [
            Row::Interpolated(Method::PAPER),
            Row::Interpolated(Method::DEVICE),
            Row::Densified,
        ] {
            let Some(column) = test.rows.iter().position(|&r| r == row) else {
                continue;
            };
            let axis = |of: fn(&Removed) -> f64| {
                let mut values: Vec<f64> = nodes.iter().map(|n| of(n)).collect();
                values.sort_by(f64::total_cmp);
                values.dedup();
                values
            };
            let (speeds, forces) = (axis(|n| n.speed_mm_s), axis(|n| n.force_n));
            let cells: Vec<GridCell> = speeds
                .iter()
                .flat_map(|&speed| forces.iter().map(move |&force| (speed, force)))
                .map(|(speed, force)| GridCell {
                    value: nodes
                        .iter()
                        .find(|n| n.speed_mm_s == speed && n.force_n == force)
                        .map(|n| n.outcomes[column].judged.cost),
                    flags: model_format::NodeFlags::NONE,
                })
                .collect();
            let title = format!("{texture}: C of removed nodes, {}", row.name());
            let map = GridMap {
                speeds_mm_s: &speeds,
                forces_n: &forces,
                cells: &cells,
                quantity: "C",
                decimals: 2,
            };
            let picture = grid_map(&self.caption(&title), &map)?;
            self.page
                .figure(&picture, "C of every removed node against its recording.");
        }
        let example = nodes.iter().min_by(|a, b| {
            let far = |n: &Removed| distance(n.speed_mm_s, n.force_n);
            far(a).total_cmp(&far(b))
        });
        let Some(example) = example else {
            return Ok(());
        };
        for row in [Row::Interpolated(Method::PAPER), Row::Densified] {
            let place = format!(
                "{texture}, {} mm/s, {} N removed; {}",
                example.speed_mm_s,
                example.force_n,
                row.name()
            );
            let Some((recorded, played)) = prepared.hear(example, row, options)? else {
                self.page.paragraph(&format!("{place}: cannot be played."));
                continue;
            };
            let view = SpectraView {
                smoothing_width_hz: options.smoothing_hz,
                ..SpectraView::default()
            };
            let rate_hz = f64::from(MODEL_RATE_HZ);
            let picture =
                time_and_frequency(&self.caption(&place), &recorded, &played, rate_hz, &view)?;
            self.page.figure(
                &picture,
                "A recording, and what is played there when its node is removed (the paper's figure 10).",
            );
        }
        Ok(())
    }

    fn caption<'t>(&self, title: &'t str) -> Caption<'t> {
        Caption {
            title,
            simulated: self.inputs.evaluation.simulated,
        }
    }

    /// The trial of a texture that is nearest to [`EXAMPLE`] and not silent.
    fn example(&self, texture: &str) -> Option<usize> {
        let trials = self.inputs.evaluation.trials.iter().enumerate();
        let heard = trials.filter(|(_, trial)| trial.texture == texture && !trial.is_silent());
        let far = |trial: &TrialEvaluation| distance(trial.speed_mm_s, trial.force_n);
        heard
            .min_by(|(_, a), (_, b)| far(a).total_cmp(&far(b)))
            .map(|(index, _)| index)
    }
}

/// How far a place is from [`EXAMPLE`], in shares.
fn distance(speed_mm_s: f64, force_n: f64) -> f64 {
    (speed_mm_s / EXAMPLE.0 - 1.0).powi(2) + (force_n / EXAMPLE.1 - 1.0).powi(2)
}

fn loudest(signals: &[&Vec<f64>]) -> f64 {
    let values = signals.iter().flat_map(|signal| signal.iter());
    values.map(|value| value.abs()).fold(0.0, f64::max)
}

/// A signal as the bytes of a WAV file, 16 bits, at a rate that every browser plays.
fn sound(signal: &[f64], full_scale: f64) -> Result<Vec<u8>> {
    let most = ((SOUND_S * f64::from(MODEL_RATE_HZ)) as usize).min(signal.len());
    let there = resample(&[signal[..most].to_vec()], MODEL_RATE_HZ, SOUND_RATE_HZ)
        .map_err(crate::support::error::Error::Request)?;
    let spec = hound::WavSpec {
        channels: 1,
        sample_rate: SOUND_RATE_HZ,
        bits_per_sample: 16,
        sample_format: hound::SampleFormat::Int,
    };
    let mut bytes = std::io::Cursor::new(Vec::new());
    let failed = |failure: hound::Error| crate::support::error::Error::Request(failure.to_string());
    let mut writer = hound::WavWriter::new(&mut bytes, spec).map_err(failed)?;
    let scale = f64::from(i16::MAX) * 0.9 / full_scale.max(f64::MIN_POSITIVE);
    for sample in &there[0] {
        let sample = (sample * scale).clamp(f64::from(i16::MIN), f64::from(i16::MAX));
        writer.write_sample(sample as i16).map_err(failed)?;
    }
    writer.finalize().map_err(failed)?;
    Ok(bytes.into_inner())
}
