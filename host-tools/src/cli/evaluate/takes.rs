//! `stylus evaluate --takes`

use std::path::Path;

use host_tools::dsp::reduction::Reduction;
use host_tools::evaluation::evaluate::Evaluation;
use host_tools::evaluation::takes;
use host_tools::evaluation::takes::TakeDistance;
use host_tools::recording::RecordingSet;
use host_tools::support::error::Result;

use crate::cli::table::table;

/// Table of the distances to other takes.
pub fn compare(
    set: &RecordingSet,
    others: &Path,
    evaluation: &Evaluation,
    reduction: Reduction,
) -> Result<String> {
    let others = RecordingSet::open(&[others.to_owned()])?;
    let distances = takes::distances(set, &others, evaluation, reduction)?;
    let number = |value: Option<f64>| value.map_or("-".into(), |value| format!("{value:.2}"));
    let rows: Vec<Vec<String>> = distances
        .iter()
        .map(|distance| {
            vec![
                distance.texture.clone(),
                number(distance.take_db),
                number(distance.synthesis_db),
                number(distance.excess_db()),
                number(distance.level_db),
            ]
        })
        .collect();
    let header = [
        "texture",
        "other take, LSD dB",
        "synthesis, LSD dB",
        "further by dB",
        "take's level dB",
    ];
    let mean = |of: fn(&TakeDistance) -> Option<f64>| {
        let values: Vec<f64> = distances.iter().filter_map(of).collect();
        values.iter().sum::<f64>() / values.len().max(1) as f64
    };
    Ok(format!(
        "Log-spectral distance, 30 to 1000 Hz, from each recording\n{}\nmean: other take {:.2} dB, synthesis {:.2} dB",
        table(&header, &rows),
        mean(|d| d.take_db),
        mean(|d| d.synthesis_db)
    ))
}
