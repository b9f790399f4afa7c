//! `cargo tasks house`: the rules of the layout that no compiler and no other tool enforces. They read sources and
//! pages, and build nothing. The rule on lengths of lines is here.

mod code;
mod pages;
pub(crate) mod tree;

use std::collections::BTreeSet;
use std::io;
use std::path::Path;

use tree::Tree;

/// Departures from the rules: file relative to the repository's root, line counted from 1, and the violated rule.
#[derive(Debug, Default)]
pub struct Findings(pub BTreeSet<(String, usize, String)>);

impl Findings {
    fn find(&mut self, path: &str, line: usize, problem: String) {
        self.0.insert((path.to_owned(), line, problem));
    }
}

/// Checks the repository below `root`.
pub fn check(root: &Path) -> io::Result<Findings> {
    Ok(check_tree(&Tree::read(root)?))
}

fn check_tree(tree: &Tree) -> Findings {
    let mut findings = Findings::default();
    code::check(tree, &mut findings);
    pages::check(tree, &mut findings);
    check_lengths(tree, &mut findings);
    findings
}

/// Largest number of characters in a line.
const MOST: usize = 120;

/// Endings of the paths of files that are written by hand.
const ENDINGS: [&str; 10] = [
    ".rs", ".toml", ".x", ".py", ".md", "/run", "/check", "/smoke", "/debian", "/fresh",
];

/// Checks the length of every line of these files, also where rustfmt leaves lines alone, such as in comments.
fn check_lengths(tree: &Tree, findings: &mut Findings) {
    for ending in ENDINGS {
        for (path, text) in tree.texts_of(ending) {
            // In a page, a row of a table, a drawing, or a line of one link cannot be broken.
            let is_whole = |line: &str| ending == ".md" && (line.contains(['|', '│']) || line.split(' ').count() <= 4);
            for (index, line) in text.lines().enumerate() {
                if line.chars().count() > MOST && !is_whole(line) {
                    findings.find(path, index + 1, format!("more than {MOST} characters: break the line"));
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Returns the findings in `files`.
    fn found(files: &[(&str, &str)]) -> Vec<String> {
        check_tree(&Tree::of(files))
            .0
            .into_iter()
            .map(|(path, line, problem)| format!("{path}:{line}: {problem}"))
            .collect()
    }

    #[test]
    fn each_departure_is_found_with_its_place() {
        let scene = ("host-tools/scene.rs", "pub struct Scene;");
        let long = format!("\n// {}é", "word ".repeat(24));
        for (path, text, expected) in [
            ("a.md", "\nSee `host-tools/a.rs`.", "2: 'host-tools/a.rs'"),
            ("host-tools/a.md", "\n[a](../b.md)", "2: '../b.md'"),
            ("a.md", "\n[`no`](host-tools/scene.rs)", "2: 'no'"),
            ("a.md", &long, "2: more than 120"),
            ("a.rs", &long, "2: more than 120"),
        ] {
            let found = found(&[scene, (path, text)]);
            let expected = format!("{path}:{expected}");
            let is_found = found.iter().any(|line| line.starts_with(&expected));
            assert!(is_found, "{expected}: {found:?}");
        }
    }

    /// Asserts that the circles in the crate `a` are reported at the places `expected`.
    fn assert_circles(files: &[(&str, &str)], expected: [&str; 2]) {
        let told = found(files);
        assert_eq!(told.len(), expected.len(), "{told:?}");
        for (told, place) in told.iter().zip(expected) {
            let expected = format!("a/src/{place}: in a circle of imports");
            assert!(told.starts_with(&expected), "{told}");
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
        assert_circles(&files, ["b/d.rs:1", "b/e.rs:1"]);
    }

    #[test]
    fn circles_are_found_between_the_files_of_an_inline_module() {
        let files = [
            ("a/src/lib.rs", "mod b { mod d; mod e; pub use d::D; } mod c;"),
            ("a/src/b/d.rs", "use super::e::E;"),
            ("a/src/b/e.rs", "use super::D;"),
            ("a/src/c.rs", "use crate::b::D;"),
        ];
        assert_circles(&files, ["b/d.rs:1", "b/e.rs:1"]);
    }

    #[test]
    fn circles_are_found_through_a_folder_or_a_type_that_a_use_names() {
        for (used, path) in [
            ("super::desk", "desk::join()"),
            ("super::desk as other", "other::join()"),
            ("std::fs", "super::desk::Desk::join()"),
        ] {
            let route = format!("use {used};\npub struct Seat; fn open() {{ {path} }}");
            let desk = "mod join; pub use join::{Desk, join};";
            let files = [
                ("a/src/lib.rs", "mod desk; mod route; mod top;"),
                ("a/src/route.rs", &route),
                ("a/src/desk/mod.rs", desk),
                ("a/src/desk/join.rs", "use crate::route::Seat;"),
                ("a/src/top.rs", "use crate::desk; fn f() { desk::join() }"),
            ];
            assert_circles(&files, ["desk/join.rs:1", "route.rs:2"]);
        }
    }

    #[test]
    fn code_as_drawn_has_no_findings() {
        let page = "`host-tools/src/`, [`Fit`](host-tools/src/fit.rs#L3), `tests/run quick`, `m/s`, [a](#b),\n\
                    [c](https://d.e/f), `target/release/stylus`, `Fit` in\n`host-tools/src/fit.rs`\n\n\
                    ```\n`host-tools/attic`\n```\n";
        let lib = "use stylus_dsp as dsp; pub mod fit; pub mod scene;";
        let fit = "//! Fits.\nuse crate::dsp::{self, Model};\npub struct Fit;\n\
                   #[cfg(test)]\nmod tests { use crate::scene; }\n\
                   // use crate::scene;\nconst TEXT: &str = \"use crate::scene\";\npub(crate) struct S;\n";
        let files = [
            ("host-tools/src/lib.rs", lib),
            ("host-tools/src/fit.rs", fit),
            ("host-tools/src/scene.rs", "use crate::fit::Fit;"),
            ("README.md", page),
            ("tests/run", ""),
        ];
        assert_eq!(found(&files), [""; 0]);
    }
}
