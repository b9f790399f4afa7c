//! The text of the table of costs, `host-tools/costs/costs.json`: one line for each entry and peer, so that a diff
//! shows the changed ones.

use serde::Serialize;
use stylus_costs::Costs;

use crate::error::Result;

/// Reads the file.
///
/// # Errors
/// The text is not that of a table.
pub fn parse(text: &str) -> Result<Costs> {
    Ok(serde_json::from_str(text)?)
}

/// The text of the file.
///
/// # Panics
/// Never, because numbers and text always have a form in JSON.
pub fn to_text(costs: &Costs) -> String {
    fn lines<T: Serialize>(values: &[T]) -> String {
        let line = |value| format!("    {}", json(value));
        values.iter().map(line).collect::<Vec<_>>().join(",\n")
    }
    format!(
        "{{\n  \"rustc\": {},\n  \"qemu\": {},\n  \"llvm_mca\": {},\n  \"entries\": [\n{}\n  ],\n  \
         \"peers\": [\n{}\n  ]\n}}\n",
        json(&costs.rustc),
        json(&costs.qemu),
        json(&costs.llvm_mca),
        lines(&costs.entries),
        lines(&costs.peers),
    )
}

fn json(value: &impl Serialize) -> String {
    serde_json::to_string(value).expect("numbers and text have a form in JSON")
}

#[cfg(test)]
mod tests {
    use stylus_costs::{Core, Entry, Origin, Peer, SampleCost, Structure, UpdateCost};

    use super::*;

    fn costs() -> Costs {
        let sample = SampleCost {
            instructions: 1000,
            best_cycles: 1100,
            worst_cycles: 1500,
        };
        let update = UpdateCost {
            instructions_least: 10,
            instructions_most: 20,
            best_cycles: 12,
            worst_cycles: 40,
        };
        let entry = |order| Entry {
            structure: Structure::TwoMultiplierLattice32,
            nodes: 4,
            core: Core::M7,
            order,
            sample,
            update,
            modelled_cycles: Some(900),
        };
        let peer = Peer {
            name: "a \"peer\"".to_owned(),
            origin: Origin::Reference,
            includes: "nothing".to_owned(),
            order: 400,
            instructions: 1,
            best_cycles: 2,
            worst_cycles: 3,
            cortex_m7_cycles: None,
        };
        Costs {
            rustc: "1.95.0".to_owned(),
            qemu: "7.2".to_owned(),
            llvm_mca: Some("14.0.6".to_owned()),
            entries: vec![entry(10), entry(400)],
            peers: vec![peer],
        }
    }

    #[test]
    fn a_table_is_read_as_it_was_written_one_entry_a_line() {
        let text = to_text(&costs());
        assert_eq!(parse(&text).unwrap(), costs());
        let line = text.lines().nth(5).unwrap();
        assert!(
            line.contains(
                r#""structure":"two_multiplier_lattice_32","nodes":4,"core":"m7","order":10,"#
            ),
            "{line}"
        );
        assert!(
            parse(&text[1..])
                .unwrap_err()
                .to_string()
                .contains("cargo tasks costs")
        );
    }
}
