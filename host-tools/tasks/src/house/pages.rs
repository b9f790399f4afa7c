//! Rules on pages of Markdown: the paths exist that they name, and so do the items that come with a Rust file.

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

/// For each line of `text`, true within a code fence and on its marks.
pub fn fences(text: &str) -> Vec<bool> {
    let mut is_open = false;
    let inside = text.lines().map(|line| {
        let is_mark = line.trim_start().starts_with("```");
        is_open ^= is_mark;
        is_open || is_mark
    });
    inside.collect()
}

/// Checks every link; every code span that is one word with a `/` and begins at a file or folder of the root or of the
/// page's folder; and the items in [`name`](path) and `name` in `path`.
pub fn check(tree: &Tree, sources: &[Source], outcome: &mut Outcome) {
    let (mut paths, mut names) = (0, 0);
    for (page, text) in tree.texts_of("md") {
        for (line, piece) in pieces(text) {
            match piece {
                Piece::Path(path) => {
                    if let Some(exists) = exists(tree, page, &path) {
                        paths += 1;
                        if !exists {
                            outcome.find(
                                page,
                                line,
                                format!("'{}' does not exist", path.trim_start_matches("./")),
                            );
                        }
                    }
                }
                Piece::Name(name, path) if !name.contains(['.', '/', ' ', '-']) => {
                    let candidates = [joined(folder(page), &path), joined("", &path)];
                    let is_it = |source: &&Source| {
                        candidates.iter().flatten().any(|path| *path == source.path)
                    };
                    if let Some(source) = sources.iter().find(is_it) {
                        names += 1;
                        if !source.defines(name.trim_end_matches("()").trim_end_matches('!')) {
                            let problem = format!("'{name}' is not in {}", source.path);
                            outcome.find(page, line, problem);
                        }
                    }
                }
                Piece::Name(..) => {}
            }
        }
    }
    outcome.count("paths in pages", paths);
    outcome.count("names in pages", names);
}

/// A piece of a page that names something.
enum Piece {
    /// A path, of a link or in a code span.
    Path(String),
    /// An item and its file.
    Name(String, String),
}

/// The pieces of the page `text` outside code fences, with their lines.
fn pieces(text: &str) -> Vec<(usize, Piece)> {
    let mut pieces = Vec::new();
    let mut begin = 1;
    let lines = text.lines().zip(fences(text));
    let lines = lines.map(|(line, is_fenced)| if is_fenced { "" } else { line });
    let text = lines.map(str::trim_end).collect::<Vec<_>>().join("\n");
    for paragraph in text.split("\n\n") {
        let line_at = |at: usize| begin + paragraph[..at].matches('\n').count();
        for (at, _) in paragraph.match_indices("](") {
            let target = paragraph[at + 2..].split([')', ' ']).next();
            let target = target.unwrap_or_default().trim_matches(['<', '>']);
            let path = target.split('#').next().unwrap_or_default();
            if !path.is_empty() && !path.contains(':') {
                // A path from the page's folder, whatever it begins with.
                pieces.push((line_at(at), Piece::Path(format!("./{path}"))));
            }
        }
        let spans: Vec<&str> = paragraph.split('`').collect();
        let mut at = 0;
        for (index, span) in spans.iter().enumerate() {
            let line = line_at(at);
            at += span.len() + 1;
            if index % 2 == 0 {
                continue;
            }
            let next = |offset: usize| spans.get(index + offset).copied().unwrap_or_default();
            let name = span.replace('\n', " ");
            if let Some(link) = next(1).strip_prefix("](") {
                let path = link.split([')', '#']).next().unwrap_or_default();
                pieces.push((line, Piece::Name(name, path.to_owned())));
            } else if next(1).trim() == "in" {
                pieces.push((line, Piece::Name(name.clone(), next(2).to_owned())));
                pieces.push((line, Piece::Path(name)));
            } else {
                pieces.push((line, Piece::Path(name)));
            }
        }
        begin += paragraph.matches('\n').count() + 2;
    }
    pieces
}

/// Tells if a path exists, from the root or from the page's folder; `None` for what is no path.
fn exists(tree: &Tree, page: &str, text: &str) -> Option<bool> {
    let is_path = text.contains('/')
        && !text.starts_with('/')
        && !text.contains("://")
        && !text.contains(|char: char| char.is_whitespace() || "<>$()|;=\"'*{".contains(char));
    if !is_path {
        return None;
    }
    // `path:12` is a place in a file.
    let text = text.split(':').next().unwrap_or_default();
    // `../tests/run` begins at `../tests`; a link, at the page's folder.
    let is_link = text.starts_with("./");
    let parts: Vec<&str> = text.split('/').collect();
    let ups = parts.iter().take_while(|part| matches!(**part, "." | ".."));
    let first = parts[..parts.len().min(ups.count() + 1)].join("/");
    let is_output = |path: &str| {
        let mut outputs = OUTPUTS.iter();
        outputs.any(|output| path == *output || path.starts_with(&format!("{output}/")))
    };
    let has = |path: &str| is_output(path) || tree.has(path);
    let bases: &[&str] = if is_link {
        &[folder(page)]
    } else {
        &["", folder(page)]
    };
    let mut begun = bases
        .iter()
        .filter(|base| is_link || joined(base, &first).is_some_and(|first| has(&first)))
        .peekable();
    begun.peek()?;
    Some(begun.any(|base| joined(base, text).is_some_and(|path| has(&path))))
}
