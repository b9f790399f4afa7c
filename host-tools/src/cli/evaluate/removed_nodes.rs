//! `stylus evaluate --leave-one-out`

use std::path::Path;

use host_tools::dsp::spectrum::AMPLITUDE_JND_DB;
use host_tools::evaluation::leave_one_out;
use host_tools::evaluation::leave_one_out::{
    LeaveOneOut, Options, Prepared, Row, SMOOTHING_WIDTHS_HZ, paper_row, summarise,
};
use host_tools::recording::RecordingSet;
use host_tools::support::error::Result;
use host_tools::support::{atomic_file, progress};

use crate::cli::output::{print, to_json};
use crate::cli::table::{folded_table, folded_text};

/// Runs the test, prints the tables, and writes the numbers to `json` if given.
pub fn run(set: &RecordingSet, options: &Options, json: Option<&Path>) -> Result<()> {
    let prepared = Prepared::new(set, options)?;
    let test = removed_node_test(&prepared, &Row::all(), options)?;
    if let Some(path) = json {
        atomic_file::write(path, to_json(&test).as_bytes())?;
    }
    print(&tables(&test))
}

/// Runs the test with a progress bar.
pub fn removed_node_test(
    prepared: &Prepared<'_>,
    rows: &[Row],
    options: &Options,
) -> Result<LeaveOneOut> {
    let bar = progress::bar(prepared.count(options.around) as u64, "removing nodes");
    let test = prepared.run(rows, options, || bar.inc(1))?;
    bar.finish_and_clear();
    Ok(test)
}

/// All tables of the test, and an explanation of their columns.
fn tables(test: &LeaveOneOut) -> String {
    let origin = if test.simulated {
        "The recordings are SIMULATED; the paper's own figures are from real ones.\n"
    } else {
        ""
    };
    let widths: Vec<String> = SMOOTHING_WIDTHS_HZ.map(|w| format!("{w} Hz")).to_vec();
    let widths: Vec<&str> = widths.iter().map(String::as_str).collect();
    folded_text(&format!(
        "{origin}{} nodes removed, each predicted from its neighbours; models of order {}; C with amplitudes smoothed \
         by a {}\n\n\
         Table I of the paper, and the same test here\n{}\n\n\
         Domain of the average, and interpolation of the level\n{}\n\n\
         C by the width of its smoothing\n{}\n\n\
         C: equation (6), mean ± standard deviation; not playable: means that are unstable or too loud, which count as \
         C = 100 %; in-sample: fitted to what it is compared with, not a measure of fidelity\n\
         σ² error: mean magnitude, (m/s²)² (the paper names no unit); |band|: mean error of third-octave \
         bands, 20 to 1000 Hz; LSD: 30 to 1000 Hz",
        test.removed.len(),
        test.order,
        test.smoothing,
        table_one(test),
        domains(test),
        folded_table(&[&["C, %"], &widths[..]].concat(), &smoothing(test), 1),
    ))
}

fn table_one(test: &LeaveOneOut) -> String {
    let textures = test.textures();
    let mut header = vec!["C, %"];
    header.extend(&textures);
    header.extend(["all", "σ² error", "not playable"]);
    let percent =
        |mean: f64, deviation: f64| format!("{:.1} ± {:.1}", 100.0 * mean, 100.0 * deviation);
    let mut rows = Vec::new();
    if let Some(papers) = paper_row(test) {
        let mut row = vec!["the paper's own figures (real)".to_owned()];
        let columns = papers.by_texture.iter().copied().chain([Some(papers.all)]);
        row.extend(
            columns.map(|column| {
                column.map_or("-".into(), |c| percent(c.mean_cost, c.cost_deviation))
            }),
        );
        row.push(format!("{:.1e}", papers.all.excitation_error));
        row.push("?".into());
        rows.push(row);
    }
    for measured in leave_one_out::table_one(test) {
        let all = &measured.all;
        let mut row = vec![measured.row.name()];
        row.extend(
            measured
                .by_texture
                .iter()
                .chain([all])
                .map(|summary| percent(summary.mean_cost, summary.cost_deviation)),
        );
        row.push(format!("{:.1e}", all.excitation_error));
        row.push(all.unplayable.to_string());
        rows.push(row);
    }
    folded_table(&header, &rows, 1)
}

fn domains(test: &LeaveOneOut) -> String {
    let within = format!("within {AMPLITUDE_JND_DB} dB");
    let header = [
        "domain, level",
        "C, %",
        "± sd",
        "σ² error",
        "|band| dB",
        &within,
        "LSD dB",
        "not playable",
    ];
    let rows: Vec<Vec<String>> = test
        .rows
        .iter()
        .filter_map(|&row| {
            let summary = summarise(test, row, None)?;
            Some(vec![
                row.name(),
                format!("{:.1}", 100.0 * summary.mean_cost),
                format!("{:.1}", 100.0 * summary.cost_deviation),
                format!("{:.2e}", summary.excitation_error),
                format!("{:.2}", summary.mean_band_error_db),
                format!("{:.1} %", 100.0 * summary.bands_within_jnd),
                format!("{:.2}", summary.mean_log_spectral_distance_db),
                summary.unplayable.to_string(),
            ])
        })
        .collect();
    folded_table(&header, &rows, 1)
}

fn smoothing(test: &LeaveOneOut) -> Vec<Vec<String>> {
    let followed = Row::TABLE_I.into_iter().filter_map(|row| {
        let summary = summarise(test, row, None)?;
        let costs = summary
            .costs_by_width
            .iter()
            .map(|c| format!("{:.1}", 100.0 * c));
        Some(std::iter::once(row.name()).chain(costs).collect())
    });
    followed.collect()
}
