//! Rules on pages of Markdown: the paths exist that they name, and so do the items that link to a Rust file.

use super::Outcome;
use super::code::Source;
use super::tree::{Tree, folder, joined};

/// Folders of outputs, which exist only after a run.
const OUTPUTS: [&str; 4] = [
    "demo-out",
    "target",
    "tests/fuzz/corpus",
    "tests/fuzz/artifacts",
];

/// Checks every link within the repository; every code span that is a path; and the item in [`item`](path).
pub fn check(tree: &Tree, sources: &[Source], outcome: &mut Outcome) {
    let (mut paths, mut names) = (0, 0);
    for (page, text) in tree.texts_of(&["md"]) {
        let text = outside_fences(text);
        let mut line = 1;
        let mut span = "";
        for (index, piece) in text.split('`').enumerate() {
            let is_span = index % 2 == 1;
            let mut found = Vec::new();
            if is_span {
                found.extend(span_exists(tree, page, piece).map(|exists| (0, piece, exists)));
            } else {
                for (at, _) in piece.match_indices("](") {
                    let target = piece[at + 2..].split([')', ' ', '#']).next();
                    let target = target.unwrap_or_default();
                    let path = joined(folder(page), target);
                    let exists = path.as_ref().is_some_and(|path| tree.has(path));
                    if !target.is_empty() && !target.contains(':') {
                        found.push((at, target, exists));
                    }
                    let mut sources = sources.iter();
                    let source =
                        sources.find(|source| at == 0 && path.as_ref() == Some(&source.path));
                    if let Some(source) = source.filter(|_| is_item(span)) {
                        names += 1;
                        if !source.defines(span.trim_end_matches("()")) {
                            let problem = format!("'{span}' is not in {}", source.path);
                            outcome.find(page, line, problem);
                        }
                    }
                }
            }
            paths += found.len();
            for (at, path, _) in found.into_iter().filter(|(.., exists)| !exists) {
                let line = line + piece[..at].matches('\n').count();
                outcome.find(page, line, format!("'{path}' does not exist"));
            }
            line += piece.matches('\n').count();
            span = piece;
        }
    }
    outcome.count("paths in pages", paths);
    outcome.count("names in pages", names);
}

/// The page `text` with its code fences blank.
fn outside_fences(text: &str) -> String {
    let mut is_open = false;
    let lines = text.split('\n').map(|line| {
        let is_mark = line.trim_start().starts_with("```");
        is_open ^= is_mark;
        if is_open || is_mark { "" } else { line }
    });
    lines.collect::<Vec<_>>().join("\n")
}

fn is_item(span: &str) -> bool {
    !span.contains(['.', '/', ' ', '-', '\n'])
}

/// Tells if the path in a code span exists, from the root or from the page's folder; none if `span` is no path: its
/// first part must be there.
fn span_exists(tree: &Tree, page: &str, span: &str) -> Option<bool> {
    let is_in_path = |char: char| char.is_alphanumeric() || "/._-+".contains(char);
    // `path:12` is a place in a file.
    let path = span
        .split(':')
        .next()
        .filter(|path| !path.starts_with('/') && path.chars().all(is_in_path))?;
    let ups = path.split('/').take_while(|part| *part == "..").count();
    let first: Vec<&str> = path.split('/').take(ups + 1).collect();
    if first.len() == path.split('/').count() || span.contains("://") {
        return None;
    }
    let has = |base: &str, path: &str| {
        joined(base, path).is_some_and(|path| tree.has(&path) || is_output(&path))
    };
    let bases = ["", folder(page)]
        .into_iter()
        .filter(|base| has(base, &first.join("/")));
    let mut exist = bases.map(|base| has(base, path)).peekable();
    exist.peek()?;
    Some(exist.any(|exists| exists))
}

fn is_output(path: &str) -> bool {
    let mut outputs = OUTPUTS.iter();
    outputs.any(|output| path == *output || path.starts_with(&format!("{output}/")))
}
