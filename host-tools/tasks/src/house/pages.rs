//! Pages of Markdown: their code spans and links, outside code fences.

/// A piece of a page that names something.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Piece {
    /// `` `text` ``
    Code(String),
    /// `[text](target)`, an image, and `[text]: target`, of which the text is empty.
    Link {
        /// The text between the brackets.
        text: String,
        /// The target, without a title.
        target: String,
    },
}

/// A piece with its place.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Placed {
    /// The piece.
    pub piece: Piece,
    /// The line that it begins in, from 1.
    pub line: usize,
    /// The text between the piece before it in the paragraph and this one.
    pub before: String,
}

/// For each line of `text`, true within a code fence and on its marks.
pub fn fences(text: &str) -> Vec<bool> {
    let mut open: Option<&str> = None;
    let inside = text.lines().map(|line| {
        let line = line.trim_start();
        let mark = ["```", "~~~"]
            .into_iter()
            .find(|mark| line.starts_with(mark));
        match (open, mark) {
            (None, Some(_)) => {
                open = mark;
                true
            }
            (Some(begun), Some(mark)) if begun == mark => {
                open = None;
                true
            }
            (open, _) => open.is_some(),
        }
    });
    inside.collect()
}

/// The pieces of the page `text`.
pub fn pieces(text: &str) -> Vec<Placed> {
    let mut pieces = Vec::new();
    let (mut paragraph, mut begin) = (String::new(), 1);
    let lines = text.lines().zip(fences(text)).chain([("", false)]);
    for (index, (line, is_fenced)) in lines.enumerate() {
        if is_fenced || line.trim().is_empty() {
            take(&paragraph, begin, &mut pieces);
            paragraph.clear();
            begin = index + 2;
        } else {
            paragraph.push_str(line);
            paragraph.push('\n');
        }
    }
    pieces
}

/// Appends the pieces of a paragraph that begins in the line `begin`.
fn take(paragraph: &str, begin: usize, pieces: &mut Vec<Placed>) {
    let line_at = |at: usize| begin + paragraph[..at].matches('\n').count();
    let (mut at, mut after) = (0, 0);
    let mut brackets = Vec::new();
    let push = |piece: Piece, from: usize, after: usize, pieces: &mut Vec<Placed>| {
        pieces.push(Placed {
            piece,
            line: line_at(from),
            before: paragraph.get(after..from).unwrap_or_default().to_owned(),
        });
    };
    while let Some(next) = paragraph[at..].find(['`', '[', ']']) {
        let from = at + next;
        let rest = &paragraph[from..];
        at = from + 1;
        if rest.starts_with('`') {
            let marks = rest.len() - rest.trim_start_matches('`').len();
            if let Some(length) = closing(&rest[marks..], marks) {
                let text = rest[marks..marks + length].trim().replace('\n', " ");
                at = from + length + 2 * marks;
                push(Piece::Code(text), from, after, pieces);
                after = at;
            } else {
                at = from + marks;
            }
        } else if rest.starts_with('[') {
            brackets.push(from);
        } else if let Some(open) = brackets.pop() {
            let text = paragraph[open + 1..from].to_owned();
            let is_first = paragraph[..open].ends_with('\n') || open == 0;
            let (target, length) = if rest.starts_with("](")
                && let Some(end) = rest.find(')')
            {
                (&rest[2..end], end)
            } else if rest.starts_with("]:") && is_first {
                let end = rest.find('\n').unwrap_or(rest.len());
                (&rest[2..end], end - 1)
            } else {
                continue;
            };
            let target = target.split_whitespace().next().unwrap_or_default();
            let target = target.trim_matches(['<', '>']).to_owned();
            let text = if rest.starts_with("]:") {
                String::new()
            } else {
                text
            };
            push(Piece::Link { text, target }, open, after, pieces);
            at = from + length + 1;
            after = at;
        }
    }
}

/// The length of a code span's text, up to a run of exactly `marks` backticks.
fn closing(text: &str, marks: usize) -> Option<usize> {
    let mut at = 0;
    while let Some(next) = text[at..].find('`') {
        let from = at + next;
        let run = text[from..].len() - text[from..].trim_start_matches('`').len();
        if run == marks {
            return Some(from);
        }
        at = from + run;
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn code_and_links_are_read_with_their_lines_and_fences_are_not() {
        let text = "# Head\n\nA `b/c.rs` and\n[`d`](e/f.rs \"title\") `g\nh`.\n\n\
                    ```\n`i`\n```\n\n| ![j](k.svg) |\n\n[l]: m.md\n";
        let code = |text: &str| Piece::Code(text.to_owned());
        let link = |text: &str, target: &str| Piece::Link {
            text: text.to_owned(),
            target: target.to_owned(),
        };
        let found: Vec<(usize, Piece)> = pieces(text)
            .into_iter()
            .map(|placed| (placed.line, placed.piece))
            .collect();
        let expected = [
            (3, code("b/c.rs")),
            (4, code("d")),
            (4, link("`d`", "e/f.rs")),
            (4, code("g h")),
            (11, link("j", "k.svg")),
            (13, link("", "m.md")),
        ];
        assert_eq!(found, expected);
    }

    #[test]
    fn a_piece_knows_the_words_before_it() {
        let pieces = pieces("The `a`\nin `b`, ``c ` d``.\n");
        let before: Vec<&str> = pieces.iter().map(|placed| placed.before.as_str()).collect();
        assert_eq!(before, ["The ", "\nin ", ", "]);
        assert_eq!(pieces[2].piece, Piece::Code("c ` d".to_owned()));
    }
}
