//! Elements of HaTT's XML and the numbers in them, with their positions in the file.

use std::path::Path;

use roxmltree::{Document, Node, ParsingOptions};
use stylus_support::{Error, Result};

/// Largest number of attributes of an element, and most declarations of namespaces in a file, because the parser
/// compares each with all others.
const MOST_ATTRIBUTES: usize = 16;

/// Deepest nesting of elements, because the numbers of each are searched in all elements around them.
const MOST_DEPTH: usize = 32;

/// Largest number of elements, texts and comments.
const MOST_NODES: u32 = 1_000_000;

/// Parses `text`; `path` is only named in errors.
///
/// # Errors
/// Text that is not XML. Text with a structure that no model file has, and that would make the parser slow. The error
/// names the line.
pub fn document<'a>(path: &Path, text: &'a str) -> Result<Document<'a>> {
    // Before the text is parsed, because the parser would take the time that this avoids.
    if let Some(line) = costly_line(text) {
        let problem = format!(
            "more than {MOST_ATTRIBUTES} attributes or namespaces, or {MOST_DEPTH} elements in one another: is it a \
             HaTT model file?"
        );
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

/// Returns the line, from 1, of the first tag that exceeds a bound. Tag signs in comments and quotes count as tags; no
/// model file comes near the bounds.
fn costly_line(text: &str) -> Option<u64> {
    let (mut depth, mut namespaces, mut line) = (0usize, 0, 1);
    for tag in text.split_inclusive('>') {
        let begin = tag.find('<').unwrap_or(tag.len());
        let inner = &tag[begin..];
        namespaces += inner.matches("xmlns").count();
        if inner.starts_with("</") {
            // Text with more closing than opening tags is refused by the parser.
            depth = depth.saturating_sub(1);
        } else if inner.starts_with('<') && !inner.starts_with(['?', '!']) && !inner.ends_with("/>") {
            depth += 1;
        }
        // Every attribute has an equals sign; others in the text only raise the count.
        let attributes = inner.matches('=').count().max(namespaces);
        if attributes > MOST_ATTRIBUTES || depth > MOST_DEPTH {
            return Some(line + tag[..begin].matches('\n').count() as u64);
        }
        line += tag.matches('\n').count() as u64;
    }
    None
}

/// A file's elements.
pub(super) struct File<'a> {
    path: &'a Path,
    document: &'a Document<'a>,
}

impl<'a> File<'a> {
    pub fn new(path: &'a Path, document: &'a Document<'a>) -> Self {
        Self { path, document }
    }

    fn line(&self, node: Node<'_, '_>) -> u64 {
        u64::from(self.document.text_pos_at(node.range().start).row)
    }

    fn wrong(&self, node: Node<'_, '_>, problem: String) -> Error {
        Error::line(self.path, self.line(node), problem)
    }

    /// Returns the error of a file with more than `most` models; `model` is the first one too many.
    pub fn too_many(&self, model: Node<'_, '_>, most: usize) -> Error {
        self.wrong(model, format!("more than {most} models: leave some out"))
    }

    /// Returns the first number of the first element of that name; `None` if there is none.
    pub fn one(&self, name: &str) -> Result<Option<f64>> {
        match self.element(name) {
            Some(node) => Ok(self.numbers(node)?.first().copied()),
            None => Ok(None),
        }
    }

    /// Returns the numbers of the first element of that name; empty if there is no such element.
    pub fn list(&self, name: &str) -> Result<Vec<f64>> {
        self.element(name).map_or(Ok(Vec::new()), |node| self.numbers(node))
    }

    fn element(&self, name: &str) -> Option<Node<'a, 'a>> {
        self.document.descendants().find(|node| is_named(*node, name))
    }

    /// Returns the elements that are models.
    pub fn models(&self) -> impl Iterator<Item = Node<'a, 'a>> {
        let has = |node: Node<'_, '_>, name| child(node, name).is_some();
        self.document
            .descendants()
            .filter(move |node| has(*node, "ARcoeff") || has(*node, "ARlsf"))
    }

    /// Returns the numbers of the child `name` of `model`; empty if there is no such child.
    pub fn list_in(&self, model: Node<'_, '_>, name: &str) -> Result<Vec<f64>> {
        child(model, name).map_or(Ok(Vec::new()), |node| self.numbers(node))
    }

    fn numbers(&self, node: Node<'_, '_>) -> Result<Vec<f64>> {
        let name = node.tag_name().name();
        let mut numbers = Vec::new();
        for text in node.descendants().filter(Node::is_text) {
            let words = text
                .text()
                .unwrap_or("")
                .split(|c: char| c.is_whitespace() || ",;".contains(c));
            for word in words.filter(|word| !word.is_empty()) {
                let number = word
                    .parse::<f64>()
                    .map_err(|_| self.wrong(text, format!("'{word}' in <{name}> is not a number")))?;
                numbers.push(number);
            }
        }
        Ok(numbers)
    }

    /// Returns the triangles as indices from 0; the file counts from 1.
    pub fn triangles(&self, models: usize) -> Result<Vec<[usize; 3]>> {
        let mut triangles = Vec::new();
        let all = self.document.descendants();
        for node in all.filter(|node| is_named(*node, "tri")) {
            let corners = self.numbers(node)?;
            let (whole, rest) = corners.as_chunks::<3>();
            if !rest.is_empty() {
                let count = corners.len();
                let problem = format!("<tri> has {count} corners, not three per triangle");
                return Err(self.wrong(node, problem));
            }
            let index = |corner: f64| {
                // Neither comparison holds for a number that is not finite.
                let index = corner - 1.0;
                if index.fract() == 0.0 && (0.0..models as f64).contains(&index) {
                    return Ok(index as usize);
                }
                let problem = format!("<tri> names model {corner}; there are {models}");
                Err(self.wrong(node, problem))
            };
            for &[a, b, c] in whole {
                // A triangle without an area has no barycentric weights.
                if a == b || b == c || c == a {
                    let problem = format!("<tri> names a model twice: {a}, {b}, {c}");
                    return Err(self.wrong(node, problem));
                }
                triangles.push([index(a)?, index(b)?, index(c)?]);
            }
        }
        Ok(triangles)
    }

    /// Compares a count that the file states with the actual `count`.
    pub fn check_count(&self, name: &str, count: usize, what: &str) -> Result<()> {
        match self.element(name) {
            Some(node) if self.one(name)? != Some(count as f64) => {
                let stated = node.text().unwrap_or("").trim();
                let problem = format!("<{name}> says {stated}, and the file has {count} {what}: is it whole?");
                Err(self.wrong(node, problem))
            }
            _ => Ok(()),
        }
    }

    /// Checks the units that the file states, if any.
    pub fn check_units(&self) -> Result<()> {
        for (name, unit) in [("AccelUnits", "m/s^2"), ("SpeedUnits", "mm/s"), ("ForceUnits", "N")] {
            if let Some(node) = self.element(name) {
                let stated = node.text().unwrap_or("").trim();
                if !stated.eq_ignore_ascii_case(unit) {
                    return Err(self.wrong(node, format!("<{name}> is '{stated}'; only '{unit}' can be read")));
                }
            }
        }
        Ok(())
    }
}

fn is_named(node: Node<'_, '_>, name: &str) -> bool {
    node.is_element() && node.tag_name().name().eq_ignore_ascii_case(name)
}

fn child<'a, 'input>(node: Node<'a, 'input>, name: &str) -> Option<Node<'a, 'input>> {
    node.children().find(|child| is_named(*child, name))
}
