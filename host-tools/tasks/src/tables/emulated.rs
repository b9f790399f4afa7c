//! The table of instructions on emulated processors, from a run of the test vectors.

use kernel_vectors::MEASURED;

use super::markdown::{grouped, range, table};
use crate::report::{Cost, EmulatorReport};

/// The table's name.
pub const NAME: &str = "emulated-processors";

/// Runs of the vectors on both processors.
pub struct Runs<'a> {
    /// Cortex-M4.
    pub m4: &'a EmulatorReport,
    /// Cortex-M7.
    pub m7: &'a EmulatorReport,
    /// The compiler that built the image, without its name.
    pub compiler: &'a str,
}

/// Instructions per sample and per update of each measured texture, and the number of played words.
pub fn table_of(runs: &Runs<'_>) -> String {
    let cost = |costs: &[Cost], texture: &str| {
        let found = costs.iter().find(|cost| cost.texture == texture);
        found.map_or("-".to_owned(), |cost| {
            range(cost.fewest.into(), cost.most.into())
        })
    };
    let rows = MEASURED.iter().map(|measured| {
        let texture = measured.texture;
        [
            texture.to_owned(),
            cost(&runs.m4.samples, texture),
            cost(&runs.m7.samples, texture),
            grouped(measured.budget_instructions.into()),
            cost(&runs.m4.follows, texture),
            cost(&runs.m7.follows, texture),
            grouped(measured.update_budget_instructions.into()),
        ]
    });
    let header = [
        "texture, order 400",
        "per sample, Cortex-M4",
        "per sample, Cortex-M7",
        "budget per sample",
        "per update, Cortex-M4",
        "per update, Cortex-M7",
        "budget per update",
    ];
    let words: usize = runs.m4.played.iter().map(|played| played.words.len()).sum();
    format!(
        "{}\nEvery processor played {} words, bit for bit those of the host. Built by rustc {}.\n",
        table(header, rows),
        grouped(words as u64),
        runs.compiler
    )
}
