//! The cases: which models, which motion, how long.

use std::borrow::ToOwned;
use std::format;
use std::string::String;
use std::vec;
use std::vec::Vec;

use model_format::limits::MAX_OUTPUT_POWER;

use crate::models::{NamedModel, falling, fixtures, resonance, resonances};
use crate::player::{FORCES_N, Path, SPEEDS_MM_S};

/// The highest power, at which the output has an RMS of an eighth of full scale.
const LOUDEST: f64 = MAX_OUTPUT_POWER as f64;

/// A case.
#[derive(Clone, Debug)]
pub struct Case {
    /// Models and motion.
    pub name: String,
    /// One node, or four, with their output powers, (m/s²)².
    pub models: Vec<(NamedModel, f64)>,
    /// The motion.
    pub path: Path,
    /// Number of driven samples.
    pub samples: usize,
    /// True if the output is compared with that of a float64 filter.
    pub with_reference: bool,
}

impl Case {
    /// A case of one node at the loudest level.
    fn alone(model: NamedModel, samples: usize) -> Self {
        Self {
            name: model.name.clone(),
            models: vec![(model, LOUDEST)],
            path: Path::Still(SPEEDS_MM_S[0], FORCES_N[0]),
            samples,
            with_reference: true,
        }
    }

    /// Models of the case, by reference, with their output powers, (m/s²)².
    pub fn nodes(&self) -> Vec<(&NamedModel, f64)> {
        self.models.iter().map(|(model, power)| (model, *power)).collect()
    }

    /// Returns whether the case is one node at rest.
    fn is_still(&self) -> bool {
        matches!(self.path, Path::Still(..)) && self.models.len() == 1
    }

    /// Largest pole radius of the case's models.
    pub fn pole_radius(&self) -> f64 {
        self.models
            .iter()
            .map(|(model, _)| model.pole_radius)
            .fold(0.0, f64::max)
    }

    /// Returns the number of samples to wait for silence. It is large for lines that ring for long. A filter that does
    /// not settle in motion would not become silent in a longer wait.
    pub fn rest_limit(&self, settles: bool) -> usize {
        // A line at radius r falls by e in 1/(1 - r) samples, and from full scale to one step in 21.5 times as many:
        // 2.1e6 at radius 0.99999, 21 500 at 0.999.
        let narrow = self.pole_radius() > 0.999;
        match (narrow, settles || self.is_still()) {
            (true, true) => 3_000_000,
            (true, false) => 100_000,
            (false, _) => 60_000,
        }
    }
}

/// Grids of four nodes, each named after what is hard about it.
fn grids() -> Vec<(&'static str, Vec<(NamedModel, f64)>)> {
    let fixtures = fixtures();
    let model = |name: &str| {
        fixtures
            .iter()
            .find(|model| model.name == name)
            .expect("a fixture of this name")
            .clone()
    };
    let loud = |names: [&str; 4]| names.map(|name| (model(name), LOUDEST)).to_vec();
    let resonant = |radius: f64, frequencies_hz: [f64; 4]| {
        frequencies_hz
            .map(|frequency_hz| (resonance(radius, frequency_hz), LOUDEST))
            .to_vec()
    };
    let orders = [400, 37, 1, 0].map(|order| (falling(order), LOUDEST)).to_vec();
    let quiet = [LOUDEST, LOUDEST * 1e-9, LOUDEST * 1e-6, LOUDEST];
    let quiet = ["H1a", "H1b", "H2b", "H3"].map(model).into_iter().zip(quiet).collect();
    vec![
        ("H1a/H1b", loud(["H1a", "H1b", "H1b", "H1a"])),
        ("H2a/H2b", loud(["H2a", "H2b", "H2b", "H2a"])),
        ("H1-H4 mixed", loud(["H4", "H1b", "H2a", "H3"])),
        ("orders 400/37/1/0", orders),
        ("near-silent beside loud", quiet),
        ("r 0.9999, 4 lines", resonant(0.9999, [50.0, 180.0, 700.0, 2200.0])),
        ("r 0.99999, 4 lines", resonant(0.999_99, [60.0, 75.0, 1000.0, 2400.0])),
    ]
}

/// The length of the suite.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Length {
    /// Every model, and every grid but that of pole radius 0.99999, each just long enough to be meaningful. `stylus
    /// frontier` plays this length with every structure and order.
    Short,
    /// Long enough for accurate levels and means.
    Full,
    /// Every model and every grid for longer than in `Full`, and 10⁸ samples of random motion.
    Long,
}

/// The suite.
pub fn suite(length: Length) -> Vec<Case> {
    let (alone, moving) = match length {
        Length::Short => (20_000, 3000),
        Length::Full => (60_000, 20_000),
        Length::Long => (2_000_000, 400_000),
    };
    let mut cases: Vec<Case> = fixtures()
        .into_iter()
        .chain(resonances())
        .map(|model| Case::alone(model, alone))
        .collect();
    let mut loud = vec![(resonance(0.95, 150.0), LOUDEST); 3];
    loud.push((resonance(0.95, 150.0), LOUDEST * 1e-9));
    cases.push(Case {
        name: "node 90 dB below its neighbours".to_owned(),
        models: loud,
        path: Path::Still(SPEEDS_MM_S[1], FORCES_N[1]),
        samples: alone,
        with_reference: true,
    });
    for (name, models) in grids() {
        for (motion, path) in paths(length) {
            cases.push(Case {
                name: format!("{name}, {motion}"),
                models: models.clone(),
                path,
                samples: moving,
                with_reference: true,
            });
        }
    }
    // Models that ring for long take long to fall silent. The short suite therefore has fewer of their motions.
    if length == Length::Short {
        cases.retain(|case| case.pole_radius() < 0.999_95 || case.is_still());
        cases.retain(|case| case.pole_radius() < 0.9995 || !matches!(case.path, Path::Random { .. }));
    }
    if length == Length::Long {
        cases.extend(marathon());
    }
    cases
}

fn paths(length: Length) -> Vec<(&'static str, Path)> {
    let random = Path::Random { every: 1, seed: 5 };
    let mut paths = vec![("saw 1", Path::Saw(1)), ("random 1", random)];
    if length != Length::Short {
        paths.insert(1, ("saw 10", Path::Saw(10)));
    }
    paths
}

/// 10⁸ samples of random motion at the stylus's update interval, in ten parts.
fn marathon() -> Vec<Case> {
    const PARTS: usize = 10;
    let grids = grids();
    let part = |part: usize| {
        let (name, models) = &grids[part % grids.len()];
        Case {
            name: format!("{name}, random 10, part {}", part + 1),
            models: models.clone(),
            path: Path::Random {
                every: stylus_kernel::UPDATE_INTERVAL_SAMPLES,
                seed: 100 + part as u64,
            },
            samples: 100_000_000 / PARTS,
            with_reference: false,
        }
    };
    (0..PARTS).map(part).collect()
}
