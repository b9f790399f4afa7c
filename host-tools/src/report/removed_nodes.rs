//! Sections on the removed-node test: Table I of the paper, interpolation domains, smoothing, and maps.

use super::html::{Column, Page};
use super::plot::{COST, GridCell, GridMap, grid_map};
use super::sections::{Sections, distance};
use crate::dsp::spectrum::AMPLITUDE_JND_DB;
use crate::evaluation::leave_one_out;
use crate::evaluation::leave_one_out::{
    LeaveOneOut, Options, Prepared, Removed, Row, SMOOTHING_WIDTHS_HZ, paper_row, summarise,
};
use crate::support::error::Result;
use crate::texture::domain::Method;

/// The removed-node test with the set that it was made from.
pub struct RemovedNodeTest<'a> {
    /// The results.
    pub test: &'a LeaveOneOut,
    /// The set.
    pub prepared: &'a Prepared<'a>,
    /// Options of the test.
    pub options: Options,
}

pub(super) fn table_one(page: &mut Page, test: &LeaveOneOut) {
    page.section("Removed nodes: Table I of the paper");
    page.paragraph(&format!(
        "Each of {} inner nodes was removed, predicted from its neighbours, played by the device's kernel and \
         compared with its recording. Models are of order {}. A prediction that cannot be played (an unstable mean) \
         counts with C = 100 %. σ² error is the mean difference of the excitation's variance; the paper names no \
         unit, here it is (m/s²)².",
        test.removed.len(),
        test.order
    ));
    let textures = test.textures();
    let percent = |mean: f64, sd: f64| format!("{:.1} ± {:.1}", 100.0 * mean, 100.0 * sd);
    let mut columns = vec![Column::Text("C, %, mean ± sd")];
    columns.extend(textures.iter().map(|name| Column::Number(name)));
    columns.extend(["all", "σ² error, (m/s²)²", "not playable"].map(Column::Number));
    let mut rows = Vec::new();
    if let Some(papers) = paper_row(test) {
        let mut row = vec!["the paper's figures, real recordings".to_owned()];
        let columns = papers.by_texture.iter().copied().chain([Some(papers.all)]);
        row.extend(columns.map(|column| {
            column.map_or(String::new(), |c| percent(c.mean_cost, c.cost_deviation))
        }));
        row.push(format!("{:.1e}", papers.all.excitation_error));
        rows.push(row);
    }
    for measured in leave_one_out::table_one(test) {
        let all = &measured.all;
        let mut cells = vec![measured.row.name()];
        cells.extend(
            measured
                .by_texture
                .iter()
                .chain([all])
                .map(|summary| percent(summary.mean_cost, summary.cost_deviation)),
        );
        cells.push(format!("{:.1e}", all.excitation_error));
        cells.push(all.unplayable.to_string());
        rows.push(cells);
    }
    page.table("Table I, and the same test here", &columns, &rows);
}

pub(super) fn domains(page: &mut Page, test: &LeaveOneOut) {
    page.section("What to interpolate");
    page.paragraph(
        "The same test in every domain: what of the models is averaged, and how their level is. The last rows are \
         what fitting a denser grid puts there, and the node's own model, which was fitted to what it is compared with \
         (in-sample, not a measure of fidelity) and is as near as its order comes.",
    );
    let within = format!("within {AMPLITUDE_JND_DB} dB");
    let columns = [
        Column::Text("domain, level"),
        Column::Number("C, %, mean ± sd"),
        Column::Number("σ² error, (m/s²)²"),
        Column::Number("|band|, dB"),
        Column::Number(&within),
        Column::Number("LSD, dB"),
        Column::Number("not playable"),
    ];
    let rows: Vec<Vec<String>> = test
        .rows
        .iter()
        .filter_map(|&row| {
            let s = summarise(test, row, None)?;
            Some(vec![
                row.name(),
                format!(
                    "{:.1} ± {:.1}",
                    100.0 * s.mean_cost,
                    100.0 * s.cost_deviation
                ),
                format!("{:.1e}", s.excitation_error),
                format!("{:.2}", s.mean_band_error_db),
                format!("{:.1} %", 100.0 * s.bands_within_jnd),
                format!("{:.2}", s.mean_log_spectral_distance_db),
                s.unplayable.to_string(),
            ])
        })
        .collect();
    page.table("Domains", &columns, &rows);
}

pub(super) fn smoothing(page: &mut Page, test: &LeaveOneOut) {
    page.section("How C depends on its smoothing");
    page.paragraph(&format!(
        "The paper does not say how its spectra are smoothed. Here it is a Hann kernel whose full width is an option \
         (this page: {}); at 0 Hz there is no smoothing and C is the scatter of noise, with a wide kernel it tells of \
         levels only.",
        test.smoothing
    ));
    let widths: Vec<String> = SMOOTHING_WIDTHS_HZ.map(|w| format!("{w} Hz")).to_vec();
    let mut columns = vec![Column::Text("mean C, %")];
    columns.extend(widths.iter().map(|width| Column::Number(width)));
    let rows: Vec<Vec<String>> = Row::TABLE_I
        .into_iter()
        .filter_map(|row| {
            let costs = summarise(test, row, None)?.costs_by_width;
            let costs = costs.iter().map(|cost| format!("{:.1}", 100.0 * cost));
            Some(std::iter::once(row.name()).chain(costs).collect())
        })
        .collect();
    page.table("C by the width of its kernel", &columns, &rows);
}

/// Draws the error of the removed nodes of `texture` over its grid, and an example: the paper's figure 10.
///
/// # Errors
/// A request that the kernel's renderer refuses.
pub(super) fn maps(
    sections: &mut Sections<'_>,
    test: &RemovedNodeTest<'_>,
    texture: &str,
) -> Result<()> {
    let RemovedNodeTest {
        test,
        prepared,
        options,
    } = test;
    let nodes: Vec<&Removed> = test
        .removed
        .iter()
        .filter(|n| n.texture == texture)
        .collect();
    if nodes.is_empty() {
        return Ok(());
    }
    sections.page.subsection("Removed nodes");
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
                    .map(|n| 100.0 * n.outcomes[column].judged.cost),
                flags: model_format::NodeFlags::NONE,
            })
            .collect();
        let title = format!("{texture}: C of removed nodes, {}", row.name());
        let map = GridMap {
            texture,
            speeds_mm_s: &speeds,
            forces_n: &forces,
            cells: &cells,
            quantity: COST,
            scale: sections.cost_scale,
            decimals: 1,
        };
        let picture = grid_map(&sections.caption(&title), &map)?;
        let stem = sections.stems.of(texture).clone();
        let caption = format!(
            "C of every removed node against its recording, in the colours of all maps of C on this page.{}",
            sections.playing_in_words()
        );
        let name = format!("{stem}-removed-nodes-{}", in_a_name(row));
        sections.figure(&picture, &name, &caption)?;
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
            sections
                .page
                .paragraph(&format!("{place}: cannot be played."));
            continue;
        };
        let stem = sections.stems.of(texture).clone();
        let name = format!("{stem}-removed-node-{}", in_a_name(row));
        sections.spectra(
            &place,
            (&recorded, &played),
            &name,
            "A recording, and what is played there when its node is removed (the paper's figure 10).",
        )?;
    }
    Ok(())
}

/// A row in the name of a file.
fn in_a_name(row: Row) -> String {
    let name = row.name();
    let words = name.split(|c: char| !c.is_ascii_alphanumeric());
    let words: Vec<&str> = words.filter(|word| !word.is_empty()).collect();
    words.join("-").to_lowercase()
}
