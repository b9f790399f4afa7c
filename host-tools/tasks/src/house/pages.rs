//! Rules on pages of Markdown: the paths that they name exist, and so do the items whose names link to a Rust file.

use super::Findings;
use super::tree::{Tree, folder, joined};

/// Folders of outputs, which exist only after a build or a run.
const OUTPUTS: [&str; 4] = ["demo-out", "target", "tests/fuzz/corpus", "tests/fuzz/artifacts"];

/// Checks that every linked path and every path in a code span exists, and that a Rust file that is linked behind an
/// item's name defines this item.
pub fn check(tree: &Tree, findings: &mut Findings) {
    for (page, text) in tree.texts_of(".md") {
        let text = outside_fences(text);
        let (mut line, mut before) = (1, "");
        for (index, piece) in text.split('`').enumerate() {
            // Text and code spans alternate.
            let is_span = index % 2 == 1;
            let found = if is_span {
                let exists = span_exists(tree, page, piece);
                Vec::from_iter(exists.map(|exists| (0, piece, exists)))
            } else {
                links(tree, page, piece)
            };
            for (at, path, exists) in found {
                let line = line + piece[..at].matches('\n').count();
                if !exists {
                    findings.find(page, line, format!("'{path}' does not exist"));
                }
                // In [`item`](path) the link begins right behind the span.
                let item = Some(before).filter(|item| at == 0 && !is_span && is_item(item));
                let target = joined(folder(page), path).unwrap_or_default();
                let mut sources = tree.texts_of(".rs");
                let source = sources.find(|&(path, _)| path == target);
                if let Some((item, (path, text))) = item.zip(source)
                    && !defines(text, item.trim_end_matches("()"))
                {
                    findings.find(page, line, format!("'{item}' is not in {path}"));
                }
            }
            line += piece.matches('\n').count();
            before = piece;
        }
    }
}

/// Returns the page `text` with its code fences blank.
fn outside_fences(text: &str) -> String {
    let mut is_open = false;
    text.split('\n')
        .map(|line| {
            let is_mark = line.trim_start().starts_with("```");
            is_open ^= is_mark;
            if is_open || is_mark { "" } else { line }
        })
        .collect::<Vec<_>>()
        .join("\n")
}

/// Returns the links in `piece` to files: position, path, and whether the file exists.
fn links<'a>(tree: &Tree, page: &str, piece: &'a str) -> Vec<(usize, &'a str, bool)> {
    let targets = piece.match_indices("](").filter_map(|(at, _)| {
        let target = piece[at + 2..].split([')', ' ', '#']).next()?;
        (!target.is_empty() && !target.contains(':')).then_some((at, target))
    });
    let exists = |path: &str| joined(folder(page), path).is_some_and(|path| tree.has(&path));
    targets.map(|(at, path)| (at, path, exists(path))).collect()
}

/// Returns true if a Rust file defines an item of this name. For `A::b`, it is enough that it has `b`.
fn defines(text: &str, item: &str) -> bool {
    const KINDS: &str = "fn ,struct ,enum ,trait ,const ,static ,type ,mod ";
    let (kinds, name) = item.rsplit_once("::").map_or((KINDS, item), |(_, name)| ("", name));
    let is_part = |char: char| char.is_alphanumeric() || char == '_';
    kinds.split(',').any(|kind| {
        let definition = format!("{kind}{name}");
        let mut ends = text.match_indices(&definition).map(|(at, found)| at + found.len());
        ends.any(|end| !text[end..].starts_with(is_part))
    })
}

fn is_item(span: &str) -> bool {
    !span.contains(['.', '/', ' ', '-', '\n'])
}

/// Returns whether the path in a code span exists, relative to the root or to the page's folder. `None` if `span` is
/// not a path: it counts as a path only if it has several parts and the first exists.
fn span_exists(tree: &Tree, page: &str, span: &str) -> Option<bool> {
    let is_in_path = |char: char| char.is_alphanumeric() || "/._-+".contains(char);
    // `path:12` refers to a line of a file.
    let path = span
        .split(':')
        .next()
        .filter(|path| !path.starts_with('/') && path.chars().all(is_in_path))?;
    let ups = path.split('/').take_while(|part| *part == "..").count();
    let first: Vec<&str> = path.split('/').take(ups + 1).collect();
    if first.len() == path.split('/').count() || span.contains("://") {
        return None;
    }
    let has = |base: &str, path: &str| joined(base, path).is_some_and(|path| tree.has(&path) || is_output(&path));
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
