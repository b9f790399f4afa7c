//! `cargo tasks house`: the rules of the layout that no compiler holds.
//!
//! Each module has the rules on one kind of text. They read sources, manifests and pages, and build nothing.

mod code;
mod pages;
mod text;
pub(crate) mod tree;

use std::fmt;
use std::path::Path;

use anyhow::Result;
use tree::Tree;

/// A departure from the layout.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Finding {
    /// The file, from the repository's root.
    pub path: String,
    /// The line, from 1; 0 for the file as a whole.
    pub line: usize,
    /// The rule that does not hold.
    pub problem: String,
}

impl fmt::Display for Finding {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}:{}: {}", self.path, self.line, self.problem)
    }
}

/// The result of a check: how much was checked of each kind, and the departures.
#[derive(Debug, Default)]
pub struct Outcome {
    /// The kinds with the number of each.
    pub checked: Vec<(&'static str, usize)>,
    /// The departures, ordered by file and line.
    pub findings: Vec<Finding>,
}

impl Outcome {
    fn find(&mut self, path: &str, line: usize, problem: impl Into<String>) {
        let (path, problem) = (path.to_owned(), problem.into());
        self.findings.push(Finding {
            path,
            line,
            problem,
        });
    }

    /// Notes how many things of a kind were checked. A rule that looks in the wrong place finds nothing, and would hold
    /// for ever, so none at all is a finding.
    fn count(&mut self, kind: &'static str, count: usize) {
        self.checked.push((kind, count));
        if count == 0 {
            self.find(
                "host-tools/tasks/src/house",
                0,
                format!("no {kind} to check"),
            );
        }
    }
}

/// Checks the repository below `root`.
///
/// # Errors
/// A file cannot be read.
pub fn check(root: &Path) -> Result<Outcome> {
    Ok(check_tree(&Tree::read(root)?))
}

fn check_tree(tree: &Tree) -> Outcome {
    let mut outcome = Outcome::default();
    let sources = code::read(tree, &mut outcome);
    code::check(&sources, &mut outcome);
    text::check_lines(tree, &mut outcome);
    text::check_doc_comments(tree, &mut outcome);
    text::check_lints(tree, &mut outcome);
    pages::check(tree, &sources, &mut outcome);
    outcome.findings.sort();
    outcome.findings.dedup();
    outcome
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The findings in `files`, without those of rules that have nothing to check.
    fn found(files: &[(&str, &str)]) -> Vec<String> {
        let findings = check_tree(&Tree::of(files)).findings.into_iter();
        let told = findings.filter(|finding| !finding.problem.starts_with("no "));
        told.map(|finding| finding.to_string()).collect()
    }

    #[test]
    fn a_check_of_nothing_fails_for_every_kind() {
        let outcome = check_tree(&Tree::of(&[]));
        assert_eq!(outcome.findings.len(), outcome.checked.len());
        assert!(outcome.checked.iter().all(|(_, count)| *count == 0));
    }

    #[test]
    fn each_departure_is_found_with_its_place() {
        let long = format!("\n// {}", "ä".repeat(118));
        for (path, text, expected) in [
            ("a.rs", long.as_str(), ":2: 121 characters"),
            ("tests/run", &format!("#!{long}"), ":2: 121 characters"),
            (
                "a.rs",
                "\n/// **Whether** it is.\nfn f() {}",
                ":2: a doc comment",
            ),
            ("a.rs", "//! What it is.\n", ":1: a doc comment"),
            (
                "a.md",
                "\nSee `host-tools/attic.rs`.",
                ":2: 'host-tools/attic.rs'",
            ),
            (
                "host-tools/a.md",
                "\nSee [a](../attic.md).",
                ":2: '../attic.md'",
            ),
            (
                "a.md",
                "\n[`missing`](host-tools/fit/src/scene.rs)",
                ":2: 'missing'",
            ),
            (
                "a.md",
                "\n`missing` in `host-tools/fit/src/scene.rs`",
                ":2: 'missing'",
            ),
            (
                "model-format/Cargo.toml",
                "[package]\nname = \"model-format\"",
                ":0: does not inherit the workspace's lints",
            ),
        ] {
            let scene = ("host-tools/fit/src/scene.rs", "pub struct Scene;");
            let found = found(&[scene, (path, text)]);
            let expected = format!("{path}{expected}");
            assert!(
                found.iter().any(|line| line.starts_with(&expected)),
                "{expected}: {found:?}"
            );
        }
    }

    #[test]
    fn circles_are_found_between_files_and_through_a_folders_reexports() {
        let files = [
            ("a/src/lib.rs", "mod b; mod c;"),
            ("a/src/b/mod.rs", "mod d; mod e; pub use d::D;"),
            ("a/src/b/d.rs", "use super::e::E;"),
            ("a/src/b/e.rs", "use super::D;"),
            ("a/src/c.rs", "use crate::b::D;"),
        ];
        let told = found(&files);
        assert_eq!(told.len(), 2, "{told:?}");
        assert!(told[0].starts_with("a/src/b/d.rs:1: in a circle of imports"));
        assert!(told[1].starts_with("a/src/b/e.rs:1: in a circle of imports"));
    }

    #[test]
    fn circles_are_found_through_a_folder_or_a_type_that_a_use_names() {
        for (used, path) in [
            ("super::broker", "broker::join()"),
            ("super::broker as other", "other::join()"),
            ("std::fs", "super::broker::Broker::join()"),
        ] {
            let route = format!("use {used};\npub struct Sharing; fn open() {{ {path} }}");
            let files = [
                ("a/src/lib.rs", "mod broker; mod route; mod top;"),
                ("a/src/route.rs", &route),
                (
                    "a/src/broker/mod.rs",
                    "mod join; pub use join::{Broker, join};",
                ),
                ("a/src/broker/join.rs", "use crate::route::Sharing;"),
                (
                    "a/src/top.rs",
                    "use crate::broker; fn f() { broker::join() }",
                ),
            ];
            let told = found(&files);
            assert_eq!(told.len(), 2, "{used}: {told:?}");
            assert!(told[0].starts_with("a/src/broker/join.rs:1: in a circle of imports"));
            assert!(told[1].starts_with("a/src/route.rs:2: in a circle of imports"));
        }
    }

    #[test]
    fn code_as_drawn_has_no_findings() {
        let pages = "`host-tools/fit/src/`, [`Fit`](host-tools/fit/src/fit.rs#L3), `tests/run quick`, `m/s`, [a](#b),\n\
                     [c](https://d.e/f), `target/release/stylus`, `Fit` in\n`host-tools/fit/src/fit.rs`\n\n\
                     ```\n`host-tools/attic`\n```\n";
        let fit = "//! Fits.\nuse crate::dsp::{self, Model};\npub struct Fit;\n\
                   #[cfg(test)]\nmod tests { use crate::scene; }\n\
                   // use crate::scene;\nconst TEXT: &str = \"use crate::scene\";\npub(crate) struct S;\n";
        let files = [
            (
                "host-tools/fit/src/lib.rs",
                "use stylus_dsp as dsp; pub mod fit; pub mod scene;",
            ),
            ("host-tools/fit/src/fit.rs", fit),
            ("host-tools/fit/src/scene.rs", "use crate::fit::Fit;"),
            ("README.md", pages),
            ("tests/run", "#!\ncargo fmt\n"),
            (
                "a/Cargo.toml",
                "[package]\nname = \"a\"\n[lints]\nworkspace = true\n",
            ),
        ];
        assert_eq!(found(&files), [""; 0]);
    }
}
