//! Summary of an evaluation on standard output.

use host_tools::dsp::spectrum::AMPLITUDE_JND_DB;
use host_tools::evaluation::evaluate::Evaluation;

use crate::cli::table::table;

/// Table with one line per texture, and an explanation of its columns.
pub fn summary(evaluation: &Evaluation) -> String {
    let bands = format!("within {AMPLITUDE_JND_DB} dB");
    let header = [
        "texture",
        "trials",
        "silent",
        "C",
        "± sd",
        "C floor",
        "|band| dB",
        &bands,
        "LSD dB",
    ];
    let rows: Vec<Vec<String>> = evaluation
        .textures
        .iter()
        .map(|texture| texture.cells().to_vec())
        .collect();
    let origin = if evaluation.simulated {
        "\nThe recordings are SIMULATED."
    } else {
        ""
    };
    format!(
        "{}\n\nC: equation (6), amplitudes smoothed by a {}; floor: what a perfect model of broadband noise scores\n\
         |band|: mean error of third-octave bands, 20 to 1000 Hz; LSD: log-spectral distance, 30 to 1000 Hz{origin}",
        table(&header, &rows),
        evaluation.smoothing
    )
}
