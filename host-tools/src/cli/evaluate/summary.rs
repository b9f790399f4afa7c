//! Summary of an evaluation on standard output.

use host_tools::dsp::liveliness::median;
use host_tools::dsp::spectrum::AMPLITUDE_JND_DB;
use host_tools::evaluation::evaluate::Evaluation;
use host_tools::evaluation::results::{Scores, TrialEvaluation};
use host_tools::evaluation::summary::{
    FEEL_COLUMNS, LIVELINESS_COLUMNS, LIVELINESS_EXPLANATION, SPECTRA_COLUMNS, TextureEvaluation,
};

use crate::cli::table::{folded_table, table};

/// The data that were held out, the tables with one line per texture, and an explanation of their columns.
pub fn summary(evaluation: &Evaluation) -> String {
    let textures = || evaluation.textures.iter();
    let spectra: Vec<Vec<String>> = textures().map(TextureEvaluation::spectra_cells).collect();
    let felt: Vec<Vec<String>> = textures().map(TextureEvaluation::feel_cells).collect();
    let origin = if evaluation.simulated {
        "\nThe recordings are SIMULATED."
    } else {
        ""
    };
    format!(
        "Held out: {}\n\nSpectra\n{}\n\nWhat is felt\n{}\n\nWhat the spectrum does not show\n{}\n\n\
         {}\n{}\n\
         C: equation (6) in per cent, amplitudes smoothed by a {}; LSD: log-spectral distance; |band|: \
         mean error of third octaves\n\
         level error: RMS error of third octaves in JND of {AMPLITUDE_JND_DB} dB, less the scatter of noise (another \
         seed 0, -6 dB 2.7)\nbalance: power below 100 Hz over that above; kurtosis: 3 for Gaussian noise; modulation: \
         the envelope's 8 to 64 Hz over its mean\n{LIVELINESS_EXPLANATION}{origin}",
        evaluation.held_out,
        table_of(&SPECTRA_COLUMNS, &spectra, 1),
        table_of(&FEEL_COLUMNS, &felt, 1),
        table_of(&LIVELINESS_COLUMNS, &evaluation.liveliness_cells(), 2),
        evaluation.judged_hz(),
        evaluation.other_in_words(),
        evaluation.smoothing
    )
}

/// Table of the distances of takes and syntheses from the takes that judged, with their means; none without takes. It
/// has one line per texture, or one per trial if `each` is set.
pub fn takes(evaluation: &Evaluation, each: bool) -> Option<String> {
    let rows: Vec<Vec<String>> = evaluation.trials.iter().filter_map(trial_cells).collect();
    let judged = || {
        let trials = evaluation.trials.iter();
        trials.filter(|trial| trial.other_take.is_some())
    };
    let mean = |values: Vec<f64>| values.iter().sum::<f64>() / values.len().max(1) as f64;
    let of = |scores: fn(&TrialEvaluation) -> &Scores| {
        let distances = judged().filter_map(|trial| scores(trial).log_spectral_distance_db);
        mean(distances.collect())
    };
    (!rows.is_empty()).then(|| {
        let of_what = if each {
            "of each trial"
        } else {
            "medians of each texture's trials"
        };
        let table = if each {
            table(&TRIAL_COLUMNS, &rows)
        } else {
            of_textures(evaluation)
        };
        let more = if each {
            "--json FILE has the take that judged each."
        } else {
            "--each shows every trial; --json FILE has all figures of each."
        };
        format!(
            "Log-spectral distance in dB from the takes that judged, {of_what}\n{table}\n\
             mean: fitted take {:.2} dB, synthesis {:.2} dB\n{more}",
            of(|trial| &trial.other),
            of(|trial| &trial.scores)
        )
    })
}

/// The columns of [`trial_cells`].
const TRIAL_COLUMNS: [&str; 7] = [
    "texture",
    "mm/s",
    "N",
    "fitted take",
    "synthesis",
    "further by",
    "file",
];

/// A trial that another take judged, under [`TRIAL_COLUMNS`]; `None` for other trials.
fn trial_cells(trial: &TrialEvaluation) -> Option<Vec<String>> {
    trial.other_take.as_ref()?;
    Some(vec![
        trial.texture.clone(),
        trial.speed_mm_s.to_string(),
        trial.force_n.to_string(),
        decibels(trial.other.log_spectral_distance_db),
        decibels(trial.scores.log_spectral_distance_db),
        decibels(further_db(trial)),
        trial.file.clone(),
    ])
}

/// By how much the synthesis is further from the take that judged than the fitted take is, dB.
fn further_db(trial: &TrialEvaluation) -> Option<f64> {
    let synthesis = trial.scores.log_spectral_distance_db;
    let other = trial.other.log_spectral_distance_db;
    (synthesis.zip(other)).map(|(synthesis, other)| synthesis - other)
}

fn decibels(value: Option<f64>) -> String {
    value.map_or_else(|| "-".to_owned(), |value| format!("{value:.2}"))
}

/// The table of textures, and below it the file of each one's worst trial: that whose synthesis is furthest.
fn of_textures(evaluation: &Evaluation) -> String {
    let mut rows = Vec::new();
    let mut files = Vec::new();
    for texture in &evaluation.textures {
        let judged = || {
            let trials = evaluation.trials.iter();
            trials.filter(|trial| trial.texture == texture.texture && trial.other_take.is_some())
        };
        if judged().next().is_none() {
            continue;
        }
        let middle = |of: &dyn Fn(&TrialEvaluation) -> Option<f64>| {
            decibels(median(judged().filter_map(of)))
        };
        let distance_db = |trial: &TrialEvaluation| trial.scores.log_spectral_distance_db;
        let worst = judged()
            .filter_map(|trial| Some((distance_db(trial)?, trial)))
            .max_by(|a, b| a.0.total_cmp(&b.0))
            .map(|(_, trial)| trial);
        let of_worst =
            |text: &dyn Fn(&TrialEvaluation) -> String| worst.map_or_else(|| "-".to_owned(), text);
        rows.push(vec![
            texture.texture.clone(),
            judged().count().to_string(),
            middle(&|trial| trial.other.log_spectral_distance_db),
            middle(&distance_db),
            middle(&further_db),
            of_worst(&|trial| decibels(distance_db(trial))),
            of_worst(&|trial| trial.speed_mm_s.to_string()),
            of_worst(&|trial| trial.force_n.to_string()),
        ]);
        files.extend(worst.map(|trial| format!("  {}: {}", texture.texture, trial.file)));
    }
    let header = [
        "texture",
        "trials",
        "fitted take",
        "synthesis",
        "further by",
        "worst synthesis",
        "at mm/s",
        "N",
    ];
    let table = folded_table(&header, &rows, 1);
    if files.is_empty() {
        return table;
    }
    format!("{table}\nworst, by file:\n{}", files.join("\n"))
}

fn table_of(columns: &[(&str, bool)], rows: &[Vec<String>], keys: usize) -> String {
    let header: Vec<&str> = columns.iter().map(|(heading, _)| *heading).collect();
    folded_table(&header, rows, keys)
}
