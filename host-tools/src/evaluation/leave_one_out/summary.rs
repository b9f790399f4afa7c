//! The test in a few numbers: the paper's Table I, and the table of domains.

use serde::Serialize;

use super::results::{LeaveOneOut, Outcome, Row};
use crate::dsp::spectrum::AMPLITUDE_JND_DB;

/// A column of the paper's Table I.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct PaperColumn {
    /// The texture.
    pub texture: &'static str,
    /// Mean of C.
    pub mean_cost: f64,
    /// Standard deviation of C.
    pub cost_deviation: f64,
    /// Mean difference of the excitations' variances, in the paper's unit, which it does not name.
    pub excitation_error: f64,
}

/// The paper's Table I (Romano, Yoshioka, Kuchenbecker, ICRA 2010).
pub const PAPER_TABLE_I: [PaperColumn; 4] = [
    paper("paper", 0.31, 0.12, 1.7e-4),
    paper("organza", 0.29, 0.13, 1.5e-4),
    paper("vinyl", 0.42, 0.20, 2.4e-4),
    paper("denim", 0.36, 0.09, 2.2e-4),
];

const fn paper(
    texture: &'static str,
    mean_cost: f64,
    cost_deviation: f64,
    excitation_error: f64,
) -> PaperColumn {
    PaperColumn {
        texture,
        mean_cost,
        cost_deviation,
        excitation_error,
    }
}

/// The paper's own figures beside those of a test.
#[derive(Clone, Debug, PartialEq)]
pub struct PaperRow {
    /// The paper's column for each texture of the test, in the order of [`LeaveOneOut::textures`]; none for textures
    /// that only share a name with the paper's, or not even that.
    pub by_texture: Vec<Option<PaperColumn>>,
    /// Mean over the columns that are there: of C, of its standard deviation and of the excitations' difference.
    pub all: PaperColumn,
}

/// Returns the paper's figures for the textures that were simulated after its protocol; `None` if there are none.
pub fn paper_row(test: &LeaveOneOut) -> Option<PaperRow> {
    let column = |name: &str| {
        let is_papers = test.papers_textures.iter().any(|papers| papers == name);
        let known = PAPER_TABLE_I.iter().find(|column| column.texture == name);
        known.copied().filter(|_| is_papers)
    };
    let by_texture: Vec<Option<PaperColumn>> = test.textures().into_iter().map(column).collect();
    let shown: Vec<PaperColumn> = by_texture.iter().flatten().copied().collect();
    if shown.is_empty() {
        return None;
    }
    let mean_of = |of: fn(&PaperColumn) -> f64| mean(&shown.iter().map(of).collect::<Vec<_>>());
    Some(PaperRow {
        by_texture,
        all: PaperColumn {
            texture: "all",
            mean_cost: mean_of(|c| c.mean_cost),
            cost_deviation: mean_of(|c| c.cost_deviation),
            excitation_error: mean_of(|c| c.excitation_error),
        },
    })
}

/// A row of the test over some of its nodes.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Summary {
    /// Nodes removed.
    pub nodes: usize,
    /// Predictions that the device could not play; they count with C = 1.
    pub unplayable: usize,
    /// Mean of C.
    pub mean_cost: f64,
    /// Standard deviation of C.
    pub cost_deviation: f64,
    /// Mean magnitude of the excitation's variance error, (m/s²)², of what could be played.
    pub excitation_error: f64,
    /// Mean magnitude of the bands' errors, dB, of what could be played.
    pub mean_band_error_db: f64,
    /// Share of all bands within the amplitude JND of 2.2 dB; those of what could not be played are not.
    pub bands_within_jnd: f64,
    /// Mean log-spectral distance from 30 to 1000 Hz, dB, of what could be played.
    pub mean_log_spectral_distance_db: f64,
    /// Mean of C for each width of the smoothing, where it was computed.
    pub costs_by_width: Vec<f64>,
}

/// `row` over the nodes of `texture`, or over all; `None` if the test does not have it.
pub fn summarise(test: &LeaveOneOut, row: Row, texture: Option<&str>) -> Option<Summary> {
    let column = test.rows.iter().position(|&r| r == row)?;
    let outcomes: Vec<&Outcome> = test
        .removed
        .iter()
        .filter(|node| texture.is_none_or(|name| node.texture == name))
        .map(|node| &node.outcomes[column])
        .collect();
    let played = || outcomes.iter().filter(|outcome| outcome.is_playable);
    let costs: Vec<f64> = outcomes.iter().map(|outcome| outcome.judged.cost).collect();
    let mean_cost = mean(&costs);
    let squares: Vec<f64> = costs.iter().map(|c| (c - mean_cost).powi(2)).collect();
    let errors: Vec<f64> = played()
        .flat_map(|outcome| outcome.judged.band_errors_db)
        .flatten()
        .map(f64::abs)
        .collect();
    let within = errors.iter().filter(|e| **e <= AMPLITUDE_JND_DB).count();
    let bands: usize = outcomes
        .iter()
        .map(|outcome| outcome.judged.band_errors_db.len())
        .sum();
    let excitation: Vec<f64> = played()
        .filter_map(|outcome| outcome.excitation_error)
        .map(f64::abs)
        .collect();
    let distances: Vec<f64> = played()
        .filter_map(|outcome| outcome.judged.log_spectral_distance_db)
        .collect();
    let widths = outcomes
        .first()
        .map_or(0, |outcome| outcome.judged.costs_by_width.len());
    let costs_by_width = (0..widths)
        .map(|width| {
            let at = outcomes
                .iter()
                .filter_map(|o| o.judged.costs_by_width.get(width));
            mean(&at.copied().collect::<Vec<_>>())
        })
        .collect();
    Some(Summary {
        nodes: outcomes.len(),
        unplayable: outcomes.len() - played().count(),
        mean_cost,
        cost_deviation: mean(&squares).sqrt(),
        excitation_error: mean(&excitation),
        mean_band_error_db: mean(&errors),
        bands_within_jnd: within as f64 / bands.max(1) as f64,
        mean_log_spectral_distance_db: mean(&distances),
        costs_by_width,
    })
}

/// A row of Table I, as measured by this test.
#[derive(Clone, Debug, PartialEq)]
pub struct TableOneRow {
    /// Way of predicting a node.
    pub row: Row,
    /// Summary of each texture, in the order of [`LeaveOneOut::textures`].
    pub by_texture: Vec<Summary>,
    /// Summary of all textures.
    pub all: Summary,
}

/// Rows of Table I that the test has.
pub fn table_one(test: &LeaveOneOut) -> Vec<TableOneRow> {
    let textures = test.textures();
    Row::TABLE_I
        .into_iter()
        .filter_map(|row| {
            let by_texture = textures
                .iter()
                .map(|name| summarise(test, row, Some(name)))
                .collect::<Option<_>>()?;
            let all = summarise(test, row, None)?;
            Some(TableOneRow {
                row,
                by_texture,
                all,
            })
        })
        .collect()
}

/// The mean, or zero of nothing.
fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluation::leave_one_out::{Around, Removed};

    fn test_of(textures: &[&str], papers: &[&str]) -> LeaveOneOut {
        let removed = |texture: &&str| Removed {
            file: String::new(),
            texture: (*texture).to_owned(),
            speed_mm_s: 100.0,
            force_n: 1.0,
            outcomes: Vec::new(),
        };
        LeaveOneOut {
            smoothing: String::new(),
            order: String::new(),
            around: Around::Both,
            simulated: true,
            papers_textures: papers.iter().map(|&name| name.to_owned()).collect(),
            rows: Vec::new(),
            smoothing_widths_hz: Vec::new(),
            removed: textures.iter().map(removed).collect(),
        }
    }

    #[test]
    fn the_papers_row_is_for_textures_of_its_protocol_and_averages_what_it_shows() {
        assert_eq!(paper_row(&test_of(&["paper", "denim"], &[])), None);
        assert_eq!(paper_row(&test_of(&["felt"], &["felt"])), None);
        let row = paper_row(&test_of(&["paper", "felt", "denim"], &["denim", "felt"])).unwrap();
        assert_eq!(row.by_texture, [None, None, Some(PAPER_TABLE_I[3])]);
        assert!((row.all.mean_cost - 0.36).abs() < 1e-12);
        let names = PAPER_TABLE_I.map(|column| column.texture);
        let row = paper_row(&test_of(&names, &names)).unwrap();
        assert!((row.all.mean_cost - 0.345).abs() < 1e-12);
        assert!((row.all.cost_deviation - 0.135).abs() < 1e-12);
    }
}
