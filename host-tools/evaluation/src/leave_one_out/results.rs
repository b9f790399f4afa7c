//! Results of the removed-node test: a row per prediction method, and an outcome per removed node and row. Their
//! summary is the paper's Table I.

use model_format::LevelLaw;
use serde::Serialize;
use stylus_dsp::linear_prediction::{error_share, step_down, step_up};
use stylus_dsp::model::Model;
use stylus_dsp::spectrum::{AMPLITUDE_JND_DB, BAND_COUNT};

use crate::summary;
use crate::table::Table;

/// The comparison of a synthesis with a recording.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Judged {
    /// The paper's cost C, equation (6).
    pub cost: f64,
    /// Level of the synthesis relative to the recording in each third-octave band from 20 to 1000 Hz, dB.
    pub band_errors_db: [Option<f64>; BAND_COUNT],
    /// Log-spectral distance from 30 to 1000 Hz in sliding third octaves, dB.
    pub log_spectral_distance_db: Option<f64>,
}

impl Judged {
    /// Returns the score of silence, which lacks everything of the recording.
    pub fn silence() -> Self {
        Self {
            cost: 1.0,
            band_errors_db: [None; BAND_COUNT],
            log_spectral_distance_db: None,
        }
    }
}

/// A row of the table: how the removed node was predicted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Row {
    /// By the mean of the neighbours' predictor coefficients h and of their excitations' variances σ².
    Paper,
    /// As the device interpolates with this law of the level. Grids that `fit` makes have the logarithm.
    Device(LevelLaw),
    /// Not predicted: the node's own model, which is the best that the structure and the order can reach.
    Own,
}

impl Row {
    /// The rows of the removed-node test, in the table's order.
    pub fn all() -> Vec<Self> {
        [&[Self::Paper][..], &LevelLaw::ALL.map(Self::Device), &[Self::Own]].concat()
    }

    /// Returns a name for tables.
    pub fn name(self) -> &'static str {
        match self {
            Self::Paper => "h, σ² (the paper)",
            Self::Device(LevelLaw::Power) => "θ = arcsin k, power",
            Self::Device(LevelLaw::Amplitude) => "θ = arcsin k, amplitude",
            Self::Device(LevelLaw::Logarithm) => "θ = arcsin k, log power (the device)",
            Self::Own => "(not removed: its own model; in-sample)",
        }
    }

    /// Returns the model that is played in place of `own`, which is between `neighbours`. Their weights add up to one,
    /// and none is silent. `None` if the mean is not stable.
    pub fn model(self, own: &Model, neighbours: &[(f64, &Model)]) -> Option<Model> {
        match self {
            Self::Paper => mean_of_predictors(neighbours),
            Self::Device(law) => Some(Model::mean(neighbours, law)),
            Self::Own => Some(own.clone()),
        }
    }
}

/// Returns the paper's mean of `neighbours`. `None` if it is not stable, and so has no reflection coefficients.
fn mean_of_predictors(neighbours: &[(f64, &Model)]) -> Option<Model> {
    let orders = neighbours.iter().map(|(_, model)| model.reflection.len());
    // Shorter predictors are padded with zeros.
    let mut predictor = vec![0.0; orders.max().unwrap_or(0)];
    for (weight, model) in neighbours {
        for (sum, h) in predictor.iter_mut().zip(step_up(&model.reflection)) {
            *sum += weight * h;
        }
    }
    let reflection = step_down(&predictor)?;
    let variance: f64 = neighbours
        .iter()
        .map(|(weight, model)| weight * model.error_power())
        .sum();
    let output_power = variance / error_share(&reflection);
    Some(Model::new(reflection, output_power))
}

impl Serialize for Row {
    fn serialize<S: serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.serialize_str(self.name())
    }
}

/// One removed node, with its outcome in every row.
#[derive(Clone, Debug, Serialize)]
pub struct Removed {
    /// The recording that the node is compared with.
    pub file: String,
    /// Texture of the node.
    pub texture: String,
    /// Tangential speed, mm/s.
    pub speed_mm_s: f64,
    /// Normal force, N.
    pub force_n: f64,
    /// Number of third-octave bands at which the recording can be judged.
    #[serde(skip)]
    pub bands: usize,
    /// The outcome of each row of [`LeaveOneOut::rows`].
    pub outcomes: Vec<Outcome>,
}

/// The comparison of a prediction with the recording.
#[derive(Clone, Debug, Serialize)]
pub struct Outcome {
    /// Figures of the synthesis compared with the recording.
    #[serde(flatten)]
    pub judged: Judged,
    /// True if the device could play the prediction.
    pub is_playable: bool,
    /// Order of the predicted model; 0 if no model is played.
    pub order: usize,
    /// Variance of the predicted excitation minus the variance that was fitted to the recording, (m/s²)²; none if the
    /// prediction is not playable or is no model.
    pub excitation_error: Option<f64>,
}

/// The outcome of the test.
#[derive(Clone, Debug, Serialize)]
pub struct LeaveOneOut {
    /// The kernel that smooths amplitudes for C.
    pub smoothing: String,
    /// Order of the interpolated models.
    pub order: String,
    /// True if any recording of the test is simulated.
    pub simulated: bool,
    /// Methods of predicting a node.
    pub rows: Vec<Row>,
    /// Every removed node, in the order of the set.
    pub removed: Vec<Removed>,
}

impl LeaveOneOut {
    /// Names of the textures with a removed node, in the order of the set.
    pub fn textures(&self) -> Vec<&str> {
        let mut textures: Vec<&str> = Vec::new();
        for node in &self.removed {
            if !textures.contains(&node.texture.as_str()) {
                textures.push(&node.texture);
            }
        }
        textures
    }

    /// Returns what the paper's Table I has, and more.
    pub fn table(&self) -> Table {
        let textures = self.textures();
        let cell = |mean: f64, deviation: f64| format!("{:.1} ± {:.1}", 100.0 * mean, 100.0 * deviation);
        let mut rows = Vec::new();
        for row in &self.rows {
            let Some(all) = summarise(self, *row, None) else {
                continue;
            };
            let own = textures.iter().filter_map(|name| summarise(self, *row, Some(name)));
            let of_textures = own.chain([all.clone()]);
            let mut cells = vec![row.name().to_owned()];
            cells.extend(of_textures.map(|own| cell(own.mean_cost, own.cost_deviation)));
            cells.extend([
                format!("{:.1e}", all.excitation_error),
                all.unplayable.to_string(),
                format!("{:.2}", all.mean_band_error_db),
                format!("{:.1}", 100.0 * all.bands_within_jnd),
                format!("{:.2}", all.mean_log_spectral_distance_db),
            ]);
            rows.push(cells);
        }
        let mut headings = vec!["C, %, mean ± sd"];
        headings.extend(textures);
        let within = format!("within {AMPLITUDE_JND_DB} dB, %");
        headings.extend(["all", "σ² error, (m/s²)²", "not playable"]);
        headings.extend(["|band|, dB", &within, "LSD, dB"]);
        Table::new("The test of the paper's Table I", headings, rows)
    }
}

/// A row of the test over some of its nodes.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Summary {
    /// Number of removed nodes.
    pub nodes: usize,
    /// Number of predictions that the device could not play. They count with C = 1.
    pub unplayable: usize,
    /// Mean of C.
    pub mean_cost: f64,
    /// Standard deviation of C.
    pub cost_deviation: f64,
    /// Mean magnitude of the excitation's variance error, (m/s²)², over the playable predictions.
    pub excitation_error: f64,
    /// Mean magnitude of the bands' errors, dB, over the playable predictions.
    pub mean_band_error_db: f64,
    /// Fraction of the bands at which recordings can be judged that are within the amplitude JND of 2.2 dB. Bands of
    /// predictions that could not be played count as outside.
    pub bands_within_jnd: f64,
    /// Mean log-spectral distance from 30 to 1000 Hz, dB, over the playable predictions.
    pub mean_log_spectral_distance_db: f64,
}

/// Summarises `row` over the nodes of `texture`, or over all nodes. Returns `None` if the test does not have this row.
pub fn summarise(test: &LeaveOneOut, row: Row, texture: Option<&str>) -> Option<Summary> {
    let column = test.rows.iter().position(|own| *own == row)?;
    let nodes: Vec<&Removed> = test
        .removed
        .iter()
        .filter(|node| texture.is_none_or(|name| node.texture == name))
        .collect();
    let outcomes: Vec<&Outcome> = nodes.iter().map(|node| &node.outcomes[column]).collect();
    let played = || outcomes.iter().filter(|outcome| outcome.is_playable);
    let costs = || outcomes.iter().map(|outcome| outcome.judged.cost);
    let mean_cost = mean(costs());
    let errors: Vec<f64> = played()
        .flat_map(|outcome| outcome.judged.band_errors_db)
        .flatten()
        .map(f64::abs)
        .collect();
    let within = errors.iter().filter(|e| **e <= AMPLITUDE_JND_DB).count();
    // Those of all predictions: otherwise a method whose predictions cannot be played would gain by that.
    let bands: usize = nodes.iter().map(|node| node.bands).sum();
    let mean_of = |of: fn(&Outcome) -> Option<f64>| mean(played().filter_map(|outcome| of(outcome)));
    Some(Summary {
        nodes: outcomes.len(),
        unplayable: outcomes.len() - played().count(),
        mean_cost,
        cost_deviation: mean(costs().map(|c| (c - mean_cost).powi(2))).sqrt(),
        excitation_error: mean_of(|outcome| outcome.excitation_error.map(f64::abs)),
        mean_band_error_db: mean(errors.iter().copied()),
        bands_within_jnd: within as f64 / bands.max(1) as f64,
        mean_log_spectral_distance_db: mean_of(|o| o.judged.log_spectral_distance_db),
    })
}

/// Returns the mean, or zero without values.
fn mean(values: impl Iterator<Item = f64>) -> f64 {
    summary::mean(values).unwrap_or(0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(24))]

        #[test]
        fn between_equal_neighbours_every_row_gives_them_back(
            reflection in prop::collection::vec(-0.4f64..0.4, 1..10), power in 0.01f64..10.0,
        ) {
            let same = Model::new(reflection, power);
            for row in Row::all() {
                let mean = row.model(&same, &[(0.25, &same), (0.75, &same)]).unwrap();
                prop_assert!((mean.output_power / power - 1.0).abs() < 1e-9, "{}", row.name());
                for (a, b) in mean.reflection.iter().zip(&same.reflection) {
                    prop_assert!((a - b).abs() < 1e-9, "{}", row.name());
                }
            }
        }
    }

    /// (1 - 0.9 z⁻¹)³ and (1 + 0.9 z⁻¹)³ average to 1 + 2.43 z⁻², whose poles have a radius of 1.5588.
    #[test]
    fn the_mean_of_stable_predictors_that_is_not_stable_is_told() {
        let ends = [[-2.7, 2.43, -0.729], [2.7, 2.43, 0.729]];
        let [a, b] = ends.map(|a| Model::new(step_down(&a).unwrap(), 1.0));
        let neighbours = [(0.5, &a), (0.5, &b)];
        assert!(Row::Paper.model(&a, &neighbours).is_none());
        let device = Row::Device(LevelLaw::Logarithm).model(&a, &neighbours).unwrap();
        assert!(device.reflection.iter().all(|k| k.abs() < 1.0));
    }

    fn test_of(textures: &[&str], simulated: bool) -> LeaveOneOut {
        let removed = |texture: &&str| Removed {
            file: String::new(),
            texture: (*texture).to_owned(),
            speed_mm_s: 100.0,
            force_n: 1.0,
            bands: 18,
            outcomes: Vec::new(),
        };
        LeaveOneOut {
            smoothing: String::new(),
            order: String::new(),
            simulated,
            rows: Vec::new(),
            removed: textures.iter().map(removed).collect(),
        }
    }

    #[test]
    fn bands_that_cannot_be_judged_do_not_count_and_those_of_what_cannot_be_played_do() {
        let outcome = |is_playable, within: usize| {
            let mut judged = Judged::silence();
            judged.band_errors_db[2..2 + within].fill(Some(0.0));
            Outcome {
                judged,
                is_playable,
                order: 0,
                excitation_error: None,
            }
        };
        let mut test = test_of(&["felt", "felt"], true);
        test.rows = vec![Row::Own, Row::Paper];
        for node in &mut test.removed {
            node.bands = 8;
            node.outcomes = vec![outcome(true, 8), outcome(true, 8)];
        }
        test.removed[1].outcomes[1] = outcome(false, 0);
        let within = [Row::Own, Row::Paper].map(|row| summarise(&test, row, None).unwrap().bands_within_jnd);
        assert_eq!(within, [1.0, 0.5]);
    }
}
