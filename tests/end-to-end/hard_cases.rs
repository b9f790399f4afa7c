//! The hard cases by the command: the lattice keeps its promises in all of them.

use host_tools::evaluation::stress::{self, cases};

use crate::support::{Bench, json};

#[test]
fn the_lattice_holds_its_promises_in_every_hard_case() {
    // The command fails if a case breaks a promise.
    let outcomes = json(&Bench::new().succeed("stress --json"));
    let outcomes = outcomes.as_array().unwrap();
    assert_eq!(outcomes.len(), cases::suite(cases::Length::Full).len());
    // The limits hold without exception for the six models of order 400.
    let figure = |outcome: &serde_json::Value, name: &str| outcome[name].as_f64().unwrap();
    for outcome in outcomes {
        let name = outcome["case"].as_str().unwrap();
        if name.starts_with('H') {
            assert!(figure(outcome, "snr_db") >= 108.0, "{name}");
            assert!(figure(outcome, "spectrum_db") <= 0.05, "{name}");
            // They are silent within a second after the loudest state.
            let silent = outcome["glitched"]["silent_after"].as_u64();
            assert!(silent.unwrap() <= 5000, "{name}");
        }
    }
}

/// This test takes a quarter of an hour on two cores: `cargo test --locked --release -p host-tools --test end-to-end
/// hard_cases:: -- --ignored`.
#[test]
#[ignore = "takes a quarter of an hour"]
fn the_lattice_holds_its_promises_over_a_hundred_million_samples() {
    let outcomes = stress::run(&cases::suite(cases::Length::Long), || ()).unwrap();
    assert_eq!(
        outcomes
            .iter()
            .filter(|o| o.case.contains("part"))
            .map(|o| o.samples)
            .sum::<usize>(),
        100_000_000
    );
    for outcome in &outcomes {
        let broken = outcome.broken();
        assert!(broken.is_empty(), "{}: {broken:?}", outcome.case);
    }
}
