//! The repository keeps to its drawn layout.

use tasks::{house, workspace};

#[test]
fn the_house_is_as_drawn() {
    let outcome = house::check(workspace::root()).unwrap_or_else(|error| panic!("{error}"));
    let findings: Vec<String> = outcome.findings.iter().map(ToString::to_string).collect();
    assert!(
        findings.is_empty(),
        "{} findings:\n{}",
        findings.len(),
        findings.join("\n")
    );
}
