//! Summary of an evaluation on standard output.

use host_tools::dsp::spectrum::AMPLITUDE_JND_DB;
use host_tools::evaluation::evaluate::Evaluation;
use host_tools::evaluation::results::{Scores, TrialEvaluation};
use host_tools::evaluation::summary::{
    FEEL_COLUMNS, LIVELINESS_COLUMNS, LIVELINESS_EXPLANATION, SPECTRA_COLUMNS, TAKE_COLUMNS,
    TextureEvaluation, take_cells,
};

use crate::cli::table::table;

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
         C: equation (6), amplitudes smoothed by a {}; LSD: log-spectral distance; |band|: mean error of third \
         octaves\n\
         level error: RMS error of third octaves in JND of {AMPLITUDE_JND_DB} dB, less the scatter of noise (another \
         seed 0, -6 dB 2.7)\nbalance: power below 100 Hz over that above; kurtosis: 3 for Gaussian noise; modulation: \
         the envelope's 8 to 64 Hz over its mean\n{LIVELINESS_EXPLANATION}{origin}",
        evaluation.held_out,
        table_of(&SPECTRA_COLUMNS, &spectra),
        table_of(&FEEL_COLUMNS, &felt),
        table_of(&LIVELINESS_COLUMNS, &evaluation.liveliness_cells()),
        evaluation.judged_hz(),
        evaluation.other_in_words(),
        evaluation.smoothing
    )
}

/// Table of the distances of takes and syntheses from the takes that judged, with their means; none without takes.
pub fn takes(evaluation: &Evaluation) -> Option<String> {
    let rows: Vec<Vec<String>> = evaluation.trials.iter().filter_map(take_cells).collect();
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
        format!(
            "Log-spectral distance from each take that judged\n{}\nmean: fitted take {:.2} dB, synthesis {:.2} dB",
            table_of(&TAKE_COLUMNS, &rows),
            of(|trial| &trial.other),
            of(|trial| &trial.scores)
        )
    })
}

fn table_of(columns: &[(&str, bool)], rows: &[Vec<String>]) -> String {
    let header: Vec<&str> = columns.iter().map(|(heading, _)| *heading).collect();
    table(&header, rows)
}
