//! A page for a report: one file that holds its pictures and its style, and needs no script and no network.

use std::fmt::Write as _;
use std::path::Path;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;

use crate::report::plot::Svg;
use crate::support::atomic_file;
use crate::support::error::Result;
use crate::support::visible::visible;

/// Dark on light, no wider than is read with ease; what is wider scrolls in itself.
const STYLE: &str = "\
:root { color-scheme: light; }
body { margin: 2rem auto; max-width: 62rem; padding: 0 1rem; background: #fff; color: #222;
  font: 16px/1.5 system-ui, sans-serif; overflow-wrap: break-word; }
h1 { font-size: 1.7rem; line-height: 1.2; }
h2 { font-size: 1.3rem; margin-top: 2.5rem; border-bottom: 1px solid #ccc; }
h3 { font-size: 1.05rem; margin-top: 1.8rem; }
p, li { max-width: 45rem; }
.notice { max-width: none; padding: 0.6rem 1rem; border-left: 0.4rem solid #d55e00; background: #fdf1e7; }
.wide { overflow-x: auto; margin: 1rem 0; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; }
caption { text-align: left; font-weight: 600; padding-bottom: 0.3rem; }
th, td { padding: 0.25rem 0.55rem; border-bottom: 1px solid #ddd; text-align: left; vertical-align: top; }
th { border-bottom: 2px solid #888; vertical-align: bottom; overflow-wrap: normal; }
th.number, td.number { text-align: right; }
td.number, td:first-child { white-space: nowrap; }
figure { margin: 1.5rem 0; }
figure svg { display: block; max-width: 100%; height: auto; }
.sound { display: inline-block; margin: 0.3rem 1.5rem 0.3rem 0; font-size: 0.9rem; }
figcaption { font-size: 0.9rem; color: #444; }
@media print { body { margin: 0; max-width: none; } figure, tr { break-inside: avoid; } }
";

/// A page in the making. All text is escaped; what is called is what comes next on it.
#[derive(Clone, Debug)]
pub struct Page {
    title: String,
    body: String,
}

/// A column of a table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Column<'a> {
    /// Text, aligned to the left, under its heading.
    Text(&'a str),
    /// Numbers, aligned to the right, under their heading with its unit.
    Number(&'a str),
}

impl Column<'_> {
    fn heading(&self) -> &str {
        match self {
            Self::Text(heading) | Self::Number(heading) => heading,
        }
    }

    fn class(&self) -> &str {
        match self {
            Self::Text(_) => "",
            Self::Number(_) => " class=\"number\"",
        }
    }
}

impl Page {
    /// A page that begins with its title.
    pub fn new(title: &str) -> Self {
        let title = escaped(title);
        let body = format!("<h1>{title}</h1>\n");
        Self { title, body }
    }

    /// The heading of a section.
    pub fn section(&mut self, heading: &str) -> &mut Self {
        self.element("h2", heading)
    }

    /// The heading of a part of a section.
    pub fn subsection(&mut self, heading: &str) -> &mut Self {
        self.element("h3", heading)
    }

    /// A paragraph.
    pub fn paragraph(&mut self, text: &str) -> &mut Self {
        self.element("p", text)
    }

    /// A paragraph that must not be overlooked.
    pub fn notice(&mut self, text: &str) -> &mut Self {
        self.push(&format!("<p class=\"notice\">{}</p>", escaped(text)))
    }

    /// A list of points.
    pub fn list<T: AsRef<str>>(&mut self, points: &[T]) -> &mut Self {
        self.push("<ul>");
        for point in points {
            self.element("li", point.as_ref());
        }
        self.push("</ul>")
    }

    /// A table with a caption above it. Cells that a row lacks stay empty, and cells past the last column show too.
    pub fn table<R: AsRef<[String]>>(
        &mut self,
        caption: &str,
        columns: &[Column<'_>],
        rows: &[R],
    ) -> &mut Self {
        self.push("<div class=\"wide\"><table>")
            .element("caption", caption)
            .push("<thead><tr>");
        for column in columns {
            let heading = escaped(column.heading());
            self.push(&format!(
                "<th scope=\"col\"{}>{heading}</th>",
                column.class()
            ));
        }
        self.push("</tr></thead>").push("<tbody>");
        for row in rows {
            self.push("<tr>");
            let cells = row.as_ref();
            for index in 0..cells.len().max(columns.len()) {
                let class = columns.get(index).map_or("", Column::class);
                let cell = cells.get(index).map_or(String::new(), |cell| escaped(cell));
                self.push(&format!("<td{class}>{cell}</td>"));
            }
            self.push("</tr>");
        }
        self.push("</tbody></table></div>")
    }

    /// A picture, with what it shows below it, which also stands for it where it cannot be seen.
    pub fn figure(&mut self, picture: &Svg, caption: &str) -> &mut Self {
        let caption = escaped(caption);
        self.push(&format!(
            "<figure role=\"group\" aria-label=\"{caption}\">\n{}<figcaption>{caption}</figcaption></figure>",
            picture.as_str()
        ))
    }

    /// A player for a sound, with what it is before it; `wav` are the bytes of a WAV file, which the page then holds.
    pub fn sound(&mut self, label: &str, wav: &[u8]) -> &mut Self {
        let label = escaped(label);
        let data = STANDARD.encode(wav);
        self.push(&format!(
            "<p class=\"sound\">{label}<br><audio controls preload=\"none\" aria-label=\"{label}\" \
             src=\"data:audio/wav;base64,{data}\"></audio></p>"
        ))
    }

    /// The page's text.
    pub fn finish(&self) -> String {
        let Self { title, body } = self;
        let mut page = String::new();
        // Writing into a string does not fail.
        let _ = write!(
            page,
            "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
             <title>{title}</title>\n<style>\n{STYLE}</style>\n</head>\n<body>\n{body}</body>\n</html>\n"
        );
        page
    }

    /// Writes the page into a file, whole or not at all.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn write(&self, path: &Path) -> Result<()> {
        atomic_file::write(path, self.finish().as_bytes())
    }

    fn element(&mut self, tag: &str, text: &str) -> &mut Self {
        self.push(&format!("<{tag}>{}</{tag}>", escaped(text)))
    }

    fn push(&mut self, html: &str) -> &mut Self {
        self.body.push_str(html);
        self.body.push('\n');
        self
    }
}

/// `text` as it stands in an element or in a quoted attribute of a page. Characters that turn the text around or that
/// no page may hold are shown by their numbers.
pub fn escaped(text: &str) -> String {
    let mut html = String::with_capacity(text.len());
    for character in visible(text).chars() {
        match character {
            '&' => html.push_str("&amp;"),
            '<' => html.push_str("&lt;"),
            '>' => html.push_str("&gt;"),
            '"' => html.push_str("&quot;"),
            '\'' => html.push_str("&#39;"),
            other => html.push(other),
        }
    }
    html
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::plot::{Caption, order_against_cost};
    use proptest::prelude::*;

    fn picture() -> Svg {
        order_against_cost(
            &Caption {
                title: "picture",
                simulated: false,
            },
            &[],
        )
        .unwrap()
    }

    /// A page with everything, made of `text`.
    fn page_of(text: &str) -> String {
        let mut page = Page::new(text);
        page.section(text)
            .subsection(text)
            .paragraph(text)
            .notice(text)
            .list(&[text]);
        page.table(
            text,
            &[Column::Text(text), Column::Number(text)],
            &[vec![text.to_owned(); 2]],
        );
        page.figure(&picture(), text).finish()
    }

    /// The tags of a page, without what is between them.
    fn tags(page: &str) -> Vec<&str> {
        page.split('<')
            .skip(1)
            .map(|piece| piece.split([' ', '>']).next().unwrap())
            .collect()
    }

    proptest! {
        #[test]
        fn no_text_becomes_markup(text in "[<>&\"'/a-z =!-]{0,40}") {
            let (page, plain) = (page_of(&text), page_of("plain"));
            prop_assert_eq!(tags(&page), tags(&plain));
            prop_assert_eq!(page.matches('"').count(), plain.matches('"').count());
        }

        #[test]
        fn escaping_is_undone_by_a_reader(text: String) {
            let read = escaped(&text)
                .replace("&lt;", "<")
                .replace("&gt;", ">")
                .replace("&quot;", "\"")
                .replace("&#39;", "'")
                .replace("&amp;", "&");
            prop_assert_eq!(read, visible(&text));
        }
    }

    #[test]
    fn every_tag_that_opens_is_closed() {
        let page = page_of("text");
        let mut open = Vec::new();
        for piece in page.split('<').skip(1) {
            let (tag, _) = piece.split_once('>').unwrap();
            let name = tag.split_whitespace().next().unwrap();
            if let Some(closed) = name.strip_prefix('/') {
                assert_eq!(open.pop(), Some(closed));
            } else if !tag.ends_with('/') && !["!DOCTYPE", "meta"].contains(&name) {
                open.push(name);
            }
        }
        assert!(open.is_empty(), "{open:?}");
    }

    #[test]
    fn a_page_needs_nothing_but_itself() {
        let page = page_of("text");
        assert!(page.contains(picture().as_str()));
        // The name of a namespace is not fetched.
        let page = page.replace("http://www.w3.org/2000/svg", "");
        for reference in ["http", "src=", "href=", "url(", "@import", "<script"] {
            assert!(!page.contains(reference), "{reference}");
        }
    }

    #[test]
    fn a_table_shows_every_cell_under_its_column() {
        let columns = [Column::Text("name"), Column::Number("C, %")];
        let rows = [
            vec!["a".to_owned()],
            vec!["b".to_owned(), "2".to_owned(), "more".to_owned()],
        ];
        let mut page = Page::new("title");
        let text = page.table("caption", &columns, &rows).finish();
        assert_eq!(
            text.matches("<td>a</td>\n<td class=\"number\"></td>")
                .count(),
            1
        );
        assert_eq!(
            text.matches("<td>b</td>\n<td class=\"number\">2</td>\n<td>more</td>")
                .count(),
            1
        );
    }
}
