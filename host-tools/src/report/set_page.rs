//! One page, which needs nothing else, on a recording set and what the stylus makes of it: the paper's figures 5 and 7
//! to 10 and its Table I from the user's own recordings, the interpolation domains, maps, spectrograms and sounds.

use std::path::Path;

use model_format::{Library, Texture};

use super::figures;
use super::html::Page;
use super::plot::{forward_prediction, grid_and_motion, spectrograms};
use super::removed_nodes::{self, RemovedNodeTest};
use super::sections::{Example, HIGHEST_HZ, OWN_SCALE, Sections, columns, is_small};
use crate::dsp::linear_prediction::{Prediction, corrected, step_up};
use crate::evaluation::evaluate;
use crate::evaluation::evaluate::{Comparison, Evaluation, texture_named};
use crate::evaluation::held_out::JudgeKind;
use crate::evaluation::summary::{TAKE_COLUMNS, take_cells};
use crate::fit::Estimator;
use crate::fit::part::lags_of_blocks;
use crate::recording::RecordingSet;
use crate::support::error::Result;
use crate::texture::grid::as_written;
use model_format::SAMPLE_RATE_HZ;

/// A stretch of a recording in the picture of its prediction, s.
const PREDICTION_S: f64 = 0.1;

/// The contents of the page.
pub struct Inputs<'a> {
    /// The recordings.
    pub set: &'a RecordingSet,
    /// The library that they were compared with.
    pub library: &'a Library<'a>,
    /// The comparison.
    pub evaluation: &'a Evaluation,
    /// Options of the comparison.
    pub options: &'a evaluate::Options,
    /// The removed-node test with the set it was made from; none where no node lies between others.
    pub test: Option<RemovedNodeTest<'a>>,
    /// Takes that were given and not used, with the reason; may be none.
    pub unused_takes: &'a [String],
}

/// Writes the page, and the data of its pictures into the folder `data`, telling `progress` of each texture done.
///
/// # Errors
/// A recording that cannot be used any more, or a file that cannot be written.
pub fn write(
    inputs: &Inputs<'_>,
    path: &Path,
    data: Option<&Path>,
    progress: impl Fn(),
) -> Result<()> {
    let removed = inputs.test.iter().flat_map(|of| &of.test.removed);
    let further_costs = removed.flat_map(|node| node.outcomes.iter().map(|o| o.judged.cost));
    let mut sections = Sections::new(
        inputs.set,
        inputs.library,
        inputs.evaluation,
        inputs.options,
        further_costs,
    );
    sections.data = data.map(figures::Folder::new).transpose()?;
    sections.share_scales()?;
    sections.overview();
    takes(&mut sections.page, inputs.evaluation, inputs.unused_takes);
    if let Some(RemovedNodeTest { test, .. }) = inputs.test {
        removed_nodes::table_one(&mut sections.page, test);
        removed_nodes::domains(&mut sections.page, test);
        removed_nodes::smoothing(&mut sections.page, test);
    }
    sections.orders()?;
    for summary in &inputs.evaluation.textures {
        let texture = texture_named(inputs.library, &summary.texture)?;
        write_texture(&mut sections, inputs.test.as_ref(), texture)?;
        progress();
    }
    sections.write(path)
}

fn write_texture(
    sections: &mut Sections<'_>,
    test: Option<&RemovedNodeTest<'_>>,
    texture: Texture<'_>,
) -> Result<()> {
    sections.page.section(texture.name());
    let Some(example) = sections.example(texture)? else {
        sections.page.paragraph("Silent in every trial.");
        return Ok(());
    };
    spectrogram(sections, &example)?;
    sections.nodes(texture.name());
    if example.judged.judge != JudgeKind::Nothing {
        prediction(sections, &example)?;
    }
    sections.time_and_frequency(&example)?;
    sections.waveforms(&example)?;
    sections.bands(&example)?;
    if texture.speed_axis().len() * texture.force_axis().len() > 1 {
        grid(sections, &texture)?;
        sections.cost_map(&texture)?;
    }
    match test {
        Some(test) => removed_nodes::maps(sections, test, texture.name()),
        None => Ok(()),
    }
}

/// Draws the spectrograms of an example, with the sounds that they show.
fn spectrogram(sections: &mut Sections<'_>, example: &Example<'_>) -> Result<()> {
    let sounds = sections.sounds_of(example)?;
    let Comparison {
        recording,
        synthesised,
        ..
    } = &example.comparison;
    let picture = spectrograms(
        &sections.caption(&example.title),
        recording,
        synthesised,
        f64::from(SAMPLE_RATE_HZ),
        HIGHEST_HZ,
        sections.ends.level_db,
    )?;
    let heard = if sounds.is_empty() {
        ""
    } else {
        " Click in one to hear it from there. All sounds below have one scale; what is heard is the acceleration."
    };
    let caption = format!(
        "Spectrograms of the recording and of the synthesis, to one scale with those of the other textures.{heard}"
    );
    let stem = sections.stems.of(&example.trial.texture).clone();
    let name = format!("{stem}-spectrograms");
    sections.figure_with_sounds(&picture, &name, &caption, &sounds)
}

fn takes(page: &mut Page, evaluation: &Evaluation, unused: &[String]) {
    let rows: Vec<Vec<String>> = evaluation.trials.iter().filter_map(take_cells).collect();
    if rows.is_empty() && unused.is_empty() {
        return;
    }
    page.section("Takes");
    if !unused.is_empty() {
        page.notice("Takes that are in the fitted set, and judge nothing:");
        page.list(unused);
    }
    if rows.is_empty() {
        return;
    }
    page.paragraph(
        "Log-spectral distance from each take that judged: of the fitted take of the same surface, and of the \
         synthesis. A model need not come nearer to another take than the take that it was fitted to.",
    );
    page.table("Takes", &columns(&TAKE_COLUMNS), &rows);
}

/// Draws the forward prediction of a held-out block: the paper's figure 5.
///
/// The model has the order that the library has there, or the highest, as far as the fitted blocks give it.
fn prediction(sections: &mut Sections<'_>, example: &Example<'_>) -> Result<()> {
    let comparison = &example.comparison;
    let (fitted, recorded) = comparison.fitted_and_left();
    let samples: usize = fitted.iter().map(|block| block.len()).sum();
    let order = example
        .order
        .unwrap_or(model_format::limits::MAX_ORDER)
        .min(samples / 4);
    let lags = lags_of_blocks(&fitted, Estimator::Rectangular, order);
    let model = Prediction::levinson_durbin(&corrected(lags), order);
    let a = step_up(&model.reflection);
    let shown = ((PREDICTION_S * f64::from(SAMPLE_RATE_HZ)) as usize).min(recorded.len());
    let begin = (recorded.len() - shown) / 2;
    let predicted: Vec<f64> = (begin..begin + shown)
        .map(|n| {
            let past = recorded[..n].iter().rev();
            -a.iter().zip(past).map(|(a, x)| a * x).sum::<f64>()
        })
        .collect();
    let title = format!("{}: order {}", example.title, a.len());
    let stretch = &recorded[begin..begin + shown];
    let rate_hz = f64::from(SAMPLE_RATE_HZ);
    let stem = sections.stems.of(&example.trial.texture).clone();
    let shared = sections.ends.peak_m_s2;
    let own = stretch.iter().map(|value| value.abs()).reduce(f64::max);
    let mut scales = vec![(
        shared,
        "prediction",
        "Forward prediction of a part of the recording by a model that was fitted to another part, and what it leaves \
         (the paper's figure 5). The scale is that of all textures.",
    )];
    if is_small(own, shared) {
        scales.push((None, "prediction-own-scale", OWN_SCALE));
    }
    for (peak, name, caption) in scales {
        let title = sections.caption(&title);
        let picture = forward_prediction(&title, stretch, &predicted, rate_hz, peak)?;
        sections.figure(&picture, &format!("{stem}-{name}"), caption)?;
    }
    Ok(())
}

/// Draws the models over speed and force, with a motion: the paper's figure 9.
fn grid(sections: &mut Sections<'_>, texture: &Texture<'_>) -> Result<()> {
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
    let picture = grid_and_motion(
        &sections.caption(&title),
        texture.name(),
        &nodes,
        &motion,
        sections.ends.variance,
    )?;
    let stem = sections.stems.of(texture.name()).clone();
    let caption = format!(
        "Models over speed and force, and a motion (the paper's figure 9). Areas are to the scale of all textures.{}",
        sections.playing_in_words()
    );
    sections.figure(&picture, &format!("{stem}-grid"), &caption)
}
