//! Bounds on the shape of an XML file, checked in one pass over its text before it is parsed.
//!
//! The parser compares every attribute of an element with those before it, and every namespace with all of the file;
//! what is read from the elements visits them once for each element around them. With these bounds all of it takes time
//! in proportion to the file.

use std::path::Path;

use roxmltree::{Document, ParsingOptions};

use crate::support::bounded_file::{Limit, MIB};
use crate::support::error::{Error, Result};

/// A model file. The published ones take some hundred kilobytes.
pub const MODEL_FILE: Limit = Limit {
    of: "a HaTT model file",
    bytes: 16 * MIB,
};

/// Most attributes of an element, those of namespaces included.
const MOST_ATTRIBUTES: usize = 16;

/// Most declarations of namespaces in a file.
const MOST_NAMESPACES: usize = 16;

/// Most elements in one another.
const MOST_DEPTH: usize = 32;

/// Most elements, texts and comments.
const MOST_NODES: u32 = 1_000_000;

/// Parses `text`; `path` is only named in errors.
///
/// # Errors
/// Text that is not XML, or beyond one of the bounds, with the line.
pub fn document<'a>(path: &Path, text: &'a str) -> Result<Document<'a>> {
    if let Err((at, problem)) = check(text.as_bytes()) {
        let line = text.as_bytes()[..at].split(|&byte| byte == b'\n').count() as u64;
        let problem = format!("{problem}: is it a HaTT model file?");
        return Err(Error::line(path, line, problem));
    }
    let options = ParsingOptions {
        nodes_limit: MOST_NODES,
        ..ParsingOptions::default()
    };
    Document::parse_with_options(text, options).map_err(|failure| {
        let problem = format!("is not well-formed XML: {failure}");
        Error::line(path, u64::from(failure.pos().row), problem)
    })
}

/// Checks the bounds; a fault comes with its byte. Text that is not XML passes wherever it does not break one of them,
/// because the parser refuses it.
fn check(text: &[u8]) -> std::result::Result<(), (usize, String)> {
    let (mut at, mut depth, mut namespaces) = (0, 0usize, 0);
    while let Some(begin) = find(text, at, b"<") {
        let rest = &text[begin..];
        let skipped = [
            (&b"<!--"[..], &b"-->"[..]),
            (b"<![CDATA[", b"]]>"),
            (b"<?", b"?>"),
        ];
        if let Some((open, close)) = skipped.iter().find(|(open, _)| rest.starts_with(open)) {
            let Some(end) = find(text, begin + open.len(), close) else {
                return Ok(());
            };
            at = end + close.len();
            continue;
        }
        let tag = Tag::at(text, begin);
        at = tag.end;
        if tag.attributes > MOST_ATTRIBUTES {
            let problem = format!("an element has more than {MOST_ATTRIBUTES} attributes");
            return Err((begin, problem));
        }
        namespaces += tag.namespaces;
        if namespaces > MOST_NAMESPACES {
            let problem = format!("more than {MOST_NAMESPACES} namespaces are declared");
            return Err((begin, problem));
        }
        if rest.starts_with(b"</") {
            depth = depth.saturating_sub(1);
        } else if !tag.is_empty_element {
            depth += 1;
        }
        if depth > MOST_DEPTH {
            let problem = format!("more than {MOST_DEPTH} elements stand in one another");
            return Err((begin, problem));
        }
    }
    Ok(())
}

/// The parts of a tag that are bounded.
struct Tag {
    /// Byte after it.
    end: usize,
    attributes: usize,
    namespaces: usize,
    is_empty_element: bool,
}

impl Tag {
    /// The tag that begins at byte `begin`. A value between quotes may hold any character.
    fn at(text: &[u8], begin: usize) -> Self {
        let mut tag = Self {
            end: text.len(),
            attributes: 0,
            namespaces: 0,
            is_empty_element: false,
        };
        let mut quote = None;
        for (index, &byte) in text.iter().enumerate().skip(begin + 1) {
            match (quote, byte) {
                (Some(mark), _) if byte == mark => quote = None,
                (None, b'"' | b'\'') => quote = Some(byte),
                (None, b'=') => tag.attributes += 1,
                (None, b'>') => {
                    tag.is_empty_element = text[index - 1] == b'/';
                    tag.end = index + 1;
                    break;
                }
                (None, _) if byte.is_ascii_whitespace() => {
                    tag.namespaces += usize::from(text[index + 1..].starts_with(b"xmlns"));
                }
                _ => {}
            }
        }
        tag
    }
}

/// Byte at which `part` begins in `text`, from `from` on.
fn find(text: &[u8], from: usize, part: &[u8]) -> Option<usize> {
    let rest = text.get(from..)?;
    let found = rest.windows(part.len()).position(|window| window == part);
    found.map(|index| from + index)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refused(text: &str) -> String {
        document(Path::new("felt.xml"), text)
            .unwrap_err()
            .to_string()
    }

    #[test]
    fn shapes_that_cost_more_than_their_length_are_refused_with_their_line() {
        let many = |one: fn(usize) -> String| (0..60_000).map(one).collect::<String>();
        let attributes = format!("<a>\n<b{}/></a>", many(|i| format!(" c{i}=\"\"")));
        let message = refused(&attributes);
        assert!(
            message.contains("line 2") && message.contains("attributes"),
            "{message}"
        );
        let quoted = attributes.replace("\"\"", "'<>\"'");
        assert!(refused(&quoted).contains("attributes"));
        let deep = many(|_| "<a>".to_owned());
        assert!(refused(&deep).contains("in one another"));
        let namespaces = format!("<a>{}</a>", many(|i| format!("<b xmlns:n{i}=\"{i}\"/>")));
        assert!(refused(&namespaces).contains("namespaces"));
        let wide = format!("<a>{}</a>", "<b/>".repeat(MOST_NODES as usize));
        assert!(refused(&wide).contains("well-formed"));
    }

    #[test]
    fn what_stands_in_comments_values_and_data_counts_nothing() {
        let deep = "<a>".repeat(100);
        let text = format!(
            "<?xml version=\"1.0\"?><r a=\"{deep}\" b='>'><!--{deep}--><![CDATA[{deep}]]></r>"
        );
        // A value must not hold the sign that begins a tag, which is for the parser to say.
        assert!(refused(&text).contains("well-formed"));
        assert!(
            document(
                Path::new("x"),
                &text
                    .replace("a=\"<a>", "a=\"")
                    .replace(&"<a>".repeat(99), "")
            )
            .is_ok()
        );
        for (cut, _) in text.char_indices() {
            let _ = check(&text.as_bytes()[..cut]);
        }
    }

    #[test]
    fn siblings_do_not_add_up_to_a_depth() {
        let text = format!("<a>{}</a>", "<b><c/></b>".repeat(1000));
        assert!(document(Path::new("x"), &text).is_ok());
    }
}
