//! `cargo tasks house`: the check that the code keeps to its drawn layout.
//!
//! Each rule has a module of its own, which states it. The rules read sources, manifests and pages, and build nothing.

mod circles;
mod doc_comments;
mod finding;
mod imports;
mod invariants;
mod lines;
mod locked;
mod modules;
mod names;
mod packages;
mod pages;
mod paths;
mod source;
pub(crate) mod tree;
mod wings;

use std::path::Path;

pub use finding::Finding;
use tree::Tree;

use crate::error::{Error, Result};

/// The result of a check: how much was checked of each kind, and the departures.
pub struct Outcome {
    /// The kinds with the number of each.
    pub checked: [(&'static str, usize); 9],
    /// The departures, ordered by file and line.
    pub findings: Vec<Finding>,
}

/// Checks the repository below `root`.
///
/// # Errors
/// A file cannot be read.
pub fn check(root: &Path) -> Result<Outcome> {
    let tree = Tree::read(root).map_err(|source| Error::Read {
        path: root.to_owned(),
        source,
    })?;
    Ok(check_tree(&tree))
}

fn check_tree(tree: &Tree) -> Outcome {
    let (sources, unparsed) = source::parse(tree);
    let crates = modules::crates(&sources);
    let wings = wings::check(&sources, &crates);
    let packages = packages::check(tree);
    let lines = lines::check(tree);
    let locked = locked::check(tree, &sources);
    let comments = doc_comments::check(&sources);
    let paths = paths::check(tree);
    let names = names::check(tree, &sources);
    let mut findings = [
        unparsed,
        wings.findings,
        circles::check(&sources, &crates),
        packages.findings,
        invariants::check(&sources, &crates),
        invariants::check_places(&sources, &crates),
        lines.findings,
        locked.findings,
        comments.findings,
        paths.findings,
        names.findings,
    ]
    .concat();
    let checked = [
        ("files", lines.count),
        ("Rust files", sources.len()),
        ("wings", wings.wings.len()),
        ("packages", packages.count),
        ("commands of cargo", locked.count),
        ("doc comments", comments.count),
        ("pages", paths.pages),
        ("paths in pages", paths.count),
        ("names in pages", names.count),
    ];
    // A rule that looks in the wrong place finds nothing, and would hold for ever.
    let missing = checked.iter().filter(|(_, count)| *count == 0);
    findings.extend(missing.map(|(kind, _)| {
        let problem = format!("there are no {kind} to check: a rule looks in the wrong place");
        Finding::new("host-tools/tasks/src/house", 0, problem)
    }));
    findings.sort();
    Outcome { checked, findings }
}

impl Outcome {
    /// The numbers of what was checked, in one line.
    pub fn summary(&self) -> String {
        let counts = self.checked.iter();
        let counts: Vec<String> = counts
            .map(|(kind, count)| format!("{count} {kind}"))
            .collect();
        counts.join(", ")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_check_of_nothing_fails_for_every_kind() {
        let outcome = check_tree(&Tree::of(&[]));
        for (kind, count) in outcome.checked {
            let problem = format!("there are no {kind} to check");
            let is_it = |finding: &Finding| finding.problem.starts_with(&problem);
            assert!(count == 0 && outcome.findings.iter().any(is_it), "{kind}");
        }
    }

    #[test]
    fn every_rule_adds_its_findings() {
        let long = format!("{}\nmod dsp;\nmod fit;\nmod attic;", "/".repeat(121));
        let outcome = check_tree(&Tree::of(&[
            (
                "host-tools/Cargo.toml",
                "[package]\nname = \"host-tools\"\n[dependencies]\ntasks = \"1\"\n",
            ),
            (
                "host-tools/tasks/Cargo.toml",
                "[package]\nname = \"tasks\"\n",
            ),
            ("host-tools/src/lib.rs", &long),
            ("host-tools/src/attic.rs", "fn {"),
            (
                "host-tools/src/dsp/mod.rs",
                "/// What it is.\nuse crate::fit::F; use std::fs; pub struct D;",
            ),
            ("host-tools/src/fit.rs", "use crate::dsp::D; pub struct F;"),
            (
                "README.md",
                "[`attic`](host-tools/src/fit.rs) and [a](attic.md)\n",
            ),
            ("tests/run", "#!/bin/sh\ncargo test\n"),
        ]));
        let found = outcome.findings.iter().map(ToString::to_string);
        let found: Vec<String> = found.collect();
        for expected in [
            "host-tools/Cargo.toml:4: depends on tasks",
            "host-tools/src/lib.rs:1: 121 characters",
            "host-tools/src/attic.rs:1: no Rust",
            "host-tools/src/dsp/mod.rs:1: a doc comment begins with 'What'",
            "host-tools/src/dsp/mod.rs:2: imports fit::F: dsp may import nothing of fit",
            "host-tools/src/dsp/mod.rs:2: imports std::fs: dsp computes",
            "import circle: host-tools/src/dsp/mod.rs:2 imports host-tools/src/fit.rs",
            "README.md:1: 'attic' is not in host-tools/src/fit.rs",
            "README.md:1: 'attic.md' does not exist",
            "tests/run:2: `cargo test` without --locked",
            "firmware/src/: no Rust file is here",
        ] {
            assert!(
                found.iter().any(|line| line.contains(expected)),
                "{expected} in {found:#?}"
            );
        }
    }
}
