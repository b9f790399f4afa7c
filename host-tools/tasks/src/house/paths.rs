//! Paths that pages name exist.

use super::finding::Finding;
use super::pages::{Piece, pieces};
use super::tree::{Tree, folder, joined};

/// Folders of outputs, which exist only after a run.
const OUTPUTS: [&str; 4] = [
    "demo-out",
    "target",
    "tests/fuzz/corpus",
    "tests/fuzz/artifacts",
];

/// The numbers of pages and of paths, and the departures.
pub struct Checked {
    /// The number of pages.
    pub pages: usize,
    /// The number of paths.
    pub count: usize,
    /// The departures.
    pub findings: Vec<Finding>,
}

/// Checks every link, and every code span that is one word with a `/` and begins at a file or folder of the root or of
/// the page's folder.
pub fn check(tree: &Tree) -> Checked {
    let mut checked = Checked {
        pages: 0,
        count: 0,
        findings: Vec::new(),
    };
    for (page, text) in tree.texts().filter(|(path, _)| path.ends_with(".md")) {
        checked.pages += 1;
        for placed in pieces(text) {
            let (path, exists) = match &placed.piece {
                Piece::Code(text) => match named(tree, page, text) {
                    Some(exists) => (text, exists),
                    None => continue,
                },
                Piece::Link { target, .. } => match linked(tree, page, target) {
                    Some(exists) => (target, exists),
                    None => continue,
                },
            };
            checked.count += 1;
            if !exists {
                let problem = format!("'{path}' does not exist");
                checked
                    .findings
                    .push(Finding::new(page, placed.line, problem));
            }
        }
    }
    checked
}

/// Tells if a link's target exists; `None` for an address and for a place in the same page.
fn linked(tree: &Tree, page: &str, target: &str) -> Option<bool> {
    let path = target.split('#').next().unwrap_or_default();
    if path.is_empty() || path.contains("://") || path.starts_with("mailto:") {
        return None;
    }
    let path = joined(folder(page), path);
    Some(path.is_some_and(|path| is_output(&path) || tree.has(&path)))
}

/// Tells if the path in a code span exists, from the root or from the page's folder; `None` for what is no path.
fn named(tree: &Tree, page: &str, text: &str) -> Option<bool> {
    let is_path = text.contains('/')
        && !text.starts_with('/')
        && !text.contains("://")
        && !text.contains(|char: char| char.is_whitespace() || "<>$()|;=\"'".contains(char));
    if !is_path {
        return None;
    }
    // `path:12` is a place in a file.
    let text = text.split(':').next().unwrap_or_default();
    // `../tests/run` begins at `../tests`.
    let parts: Vec<&str> = text.split('/').collect();
    let ups = parts.iter().take_while(|part| matches!(**part, "." | ".."));
    let first = parts[..parts.len().min(ups.count() + 1)].join("/");
    let bases = ["", folder(page)];
    let mut bases = bases.iter().filter(|base| {
        joined(base, &first).is_some_and(|first| tree.has(&first) || first.contains(['*', '{']))
    });
    let mut found = bases.clone().filter_map(|base| joined(base, text));
    bases.next()?;
    Some(found.any(|path| is_output(&path) || matches(tree, &path)))
}

fn is_output(path: &str) -> bool {
    let mut outputs = OUTPUTS.iter();
    outputs.any(|output| path == *output || path.starts_with(&format!("{output}/")))
}

/// True where `path` exists; `{a,b}` asks for both, and `*` and `**` for at least one match.
fn matches(tree: &Tree, path: &str) -> bool {
    if let Some((before, rest)) = path.split_once('{')
        && let Some((choices, after)) = rest.split_once('}')
    {
        let mut choices = choices.split(',');
        return choices.all(|choice| matches(tree, &format!("{before}{choice}{after}")));
    }
    if !path.contains('*') {
        return tree.has(path);
    }
    let pattern: Vec<&str> = path.split('/').collect();
    tree.paths().any(|file| {
        let parts: Vec<&str> = file.split('/').collect();
        (1..=parts.len()).any(|length| is_match(&pattern, &parts[..length]))
    })
}

fn is_match(pattern: &[&str], parts: &[&str]) -> bool {
    match (pattern.split_first(), parts.split_first()) {
        (None, None) => true,
        (Some((&"**", rest)), _) => {
            is_match(rest, parts) || !parts.is_empty() && is_match(pattern, &parts[1..])
        }
        (Some((first, pattern)), Some((part, parts))) => {
            is_word(first, part) && is_match(pattern, parts)
        }
        _ => false,
    }
}

/// Matches one part of a path.
fn is_word(pattern: &str, part: &str) -> bool {
    match pattern.split_once('*') {
        None => pattern == part,
        Some((before, after)) => part.strip_prefix(before).is_some_and(|rest| {
            let mut ends = rest.char_indices().map(|(at, _)| &rest[at..]).chain([""]);
            ends.any(|end| is_word(after, end))
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(page: &str, text: &str) -> Vec<String> {
        let tree = Tree::of(&[
            (page, text),
            ("tests/run", ""),
            ("host-tools/src/fit/mod.rs", ""),
            ("host-tools/src/fit/trial.rs", ""),
            ("host-tools/example.svg", ""),
        ]);
        let findings = check(&tree).findings;
        findings.iter().map(ToString::to_string).collect()
    }

    #[test]
    fn a_path_that_does_not_exist_is_found_with_its_line() {
        for path in [
            "`host-tools/src/attic.rs`",
            "`host-tools/src/attic/`",
            "`tests/run/more`",
            "`host-tools/src/fit/{mod,attic}.rs`",
            "`host-tools/src/*/attic.rs`",
            "`host-tools/src/attic.rs:12`",
            "[page](attic.md)",
            "![picture](host-tools/attic.svg)",
        ] {
            let found = found("README.md", &format!("A page.\n\nSee {path}.\n"));
            assert_eq!(found.len(), 1, "{path}: {found:?}");
            assert!(found[0].starts_with("README.md:3: '"), "{found:?}");
        }
        let found = found("host-tools/README.md", "`src/attic.rs`, `../tests/attic`");
        assert_eq!(found.len(), 2, "{found:?}");
    }

    #[test]
    fn paths_that_exist_commands_outputs_and_addresses_are_not() {
        let text = "`host-tools/src/fit/`, `host-tools/src/fit/{mod,trial}.rs`, `host-tools/src/**/trial.rs`,\n\
                    `host-tools/src/fit/tr*.rs`, `demo-out/report/index.html`, `target/release/stylus`, `tests/run`,\n\
                    `tests/run quick`, `/etc/udev`, `m/s`, `--port N/M`, `f/v`, [a](https://a.b/c), [b](#c),\n\
                    ![c](host-tools/example.svg), [d](host-tools/src/fit/mod.rs#L3)\n";
        assert_eq!(found("README.md", text), [""; 0]);
        assert_eq!(
            found(
                "host-tools/README.md",
                "`src/fit/mod.rs`, [a](example.svg), `../tests/run`"
            ),
            [""; 0]
        );
    }
}
