//! A page for a report: one file that holds its pictures, sounds, style and script, and needs no network.
//!
//! All statements can be read without the script. The script shows values where a reader points, and plays nodes of
//! maps. Colours follow the reader's scheme, light or dark, and text is no wider than can be read with ease. Tables may
//! fill the window. Wider tables, and pictures in a narrow window, scroll by themselves, so that the page as a whole
//! never does.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::Path;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;
use serde::Serialize;
use stylus_evaluation::table::Table;
use stylus_support::Result;
use stylus_support::atomic_file;
use stylus_support::visible::page_json;

use crate::plot::Svg;
pub use stylus_support::visible::escaped;

/// The page's content security policy: nothing is fetched from anywhere, and all scripts and pictures are in the page.
pub const POLICY: &str = "default-src 'none'; img-src data:; media-src data:; style-src 'unsafe-inline'; \
     script-src 'unsafe-inline'; base-uri 'none'; form-action 'none'";

/// Number of headings from which on a page has a table of contents.
const CONTENTS_FROM: usize = 3;

/// A page that is being built. Each call appends to it. All text is escaped.
#[derive(Clone, Debug)]
pub struct Page {
    title: String,
    body: String,
    /// Headings with their anchors. The texts are escaped.
    headings: Vec<Heading>,
    /// Number of tables so far, from which their captions' names are made.
    tables: usize,
    /// Sounds of the nodes of maps.
    nodes: Nodes,
}

/// Sounds of nodes, as the script reads them.
#[derive(Clone, Debug, Default, Serialize)]
struct Nodes {
    /// Samples per second of every clip.
    rate_hz: u32,
    /// Duration of the longest clip, s.
    seconds: f64,
    textures: BTreeMap<String, NodesOfTexture>,
}

/// Sounds of a texture's nodes.
#[derive(Clone, Debug, Default, Serialize)]
struct NodesOfTexture {
    /// Speed, mm/s, and force, N, of each node.
    nodes: Vec<(f64, f64)>,
    /// Recording and synthesis of each node: 16 bits per sample, low byte first, in base64.
    clips: Vec<[String; 2]>,
}

/// A heading to which the table of contents links.
#[derive(Clone, Debug)]
struct Heading {
    anchor: String,
    text: String,
}

impl Page {
    /// Creates a page that begins with its title.
    pub fn new(title: &str) -> Self {
        Self {
            title: escaped(title),
            body: String::new(),
            headings: Vec::new(),
            tables: 0,
            nodes: Nodes::default(),
        }
    }

    /// Adds the heading of a section.
    pub fn section(&mut self, heading: &str) -> &mut Self {
        let anchor = format!("s{}-{}", self.headings.len() + 1, slug(heading));
        let text = escaped(heading);
        self.push(&format!("<h2 id=\"{anchor}\">{text}</h2>"));
        self.headings.push(Heading { anchor, text });
        self
    }

    /// Adds a paragraph.
    pub fn paragraph(&mut self, text: &str) -> &mut Self {
        self.element("p", text)
    }

    /// Adds a paragraph that must not be overlooked.
    pub fn notice(&mut self, text: &str) -> &mut Self {
        self.push(&format!("<p class=\"notice\">{}</p>", escaped(text)))
    }

    /// Adds the verdict on the content above.
    pub fn verdict(&mut self, text: &str) -> &mut Self {
        self.push(&format!("<p class=\"verdict\">{}</p>", escaped(text)))
    }

    /// Adds a list of points.
    pub fn list<T: AsRef<str>>(&mut self, points: &[T]) -> &mut Self {
        self.push("<ul>");
        for point in points {
            self.element("li", point.as_ref());
        }
        self.push("</ul>")
    }

    /// Adds a table with its title above it. Columns of numbers are right-aligned, and cells that a row lacks stay
    /// empty.
    pub fn table(&mut self, table: &Table) -> &mut Self {
        self.tables += 1;
        // A scrollable element must be reachable by keyboard, and so needs a name (WCAG 2.1, 2.1.1 and 4.1.2).
        let name = format!("table-{}", self.tables);
        // The title is outside the table, because a caption inside would be as wide as the table and scroll with it.
        self.push(&format!(
            "<p class=\"caption\" id=\"{name}\">{}</p>\n\
             <div class=\"wide\" role=\"region\" tabindex=\"0\" aria-labelledby=\"{name}\">\
             <table aria-labelledby=\"{name}\">",
            escaped(&table.title)
        ));
        let class = |column: usize| {
            if table.is_of_numbers(column) {
                " class=\"number\""
            } else {
                ""
            }
        };
        let classes: Vec<&str> = (0..table.headings.len()).map(class).collect();
        let cell = |tag: &str, end: &str, column: usize, text: &str| {
            format!("<{tag}{}>{}</{end}>", classes[column], escaped(text))
        };
        let headings: String = table
            .headings
            .iter()
            .enumerate()
            .map(|(column, heading)| cell("th scope=\"col\"", "th", column, heading))
            .collect();
        self.push(&format!("<thead><tr>{headings}</tr></thead>\n<tbody>"));
        for row in &table.rows {
            let cells = (0..classes.len()).map(|column| {
                let text = row.get(column).map_or("", String::as_str);
                cell("td", "td", column, text)
            });
            self.push(&format!("<tr>{}</tr>", cells.collect::<String>()));
        }
        self.push("</tbody></table></div>")
    }

    /// Adds a picture with its caption and players. The caption also describes the picture to readers who cannot see
    /// it. Each player belongs to the panel of its name.
    pub fn figure(&mut self, picture: &Svg, caption: &str, sounds: &[Sound]) -> &mut Self {
        let caption = escaped(caption);
        let players = players(sounds);
        self.push(&format!(
            "<figure role=\"group\" aria-label=\"{caption}\">\n\
             <div class=\"wide\" role=\"region\" tabindex=\"0\" aria-label=\"{caption}\">\n{}</div>\
             <figcaption>{caption}</figcaption>{players}</figure>",
            picture.as_str()
        ))
    }

    /// Keeps the recording and the synthesis of a node of a texture's maps, which a click on the node plays.
    pub fn node(&mut self, texture: &str, place: (f64, f64), rate_hz: u32, clips: [&[i16]; 2]) {
        let longest = clips[0].len().max(clips[1].len());
        self.nodes.rate_hz = rate_hz;
        let seconds = longest as f64 / f64::from(rate_hz);
        self.nodes.seconds = self.nodes.seconds.max(seconds);
        let own = self.nodes.textures.entry(texture.to_owned()).or_default();
        own.nodes.push(place);
        own.clips.push(clips.map(|clip| {
            let bytes: Vec<u8> = clip.iter().flat_map(|value| value.to_le_bytes()).collect();
            STANDARD.encode(bytes)
        }));
    }

    /// Adds a part that `fill` writes, folded under `summary` until the reader opens it.
    pub fn folded(&mut self, summary: &str, fill: impl FnOnce(&mut Self)) -> &mut Self {
        self.push(&format!("<details><summary>{}</summary>", escaped(summary)));
        fill(self);
        self.push("</details>")
    }

    /// Returns the page's text.
    pub fn finish(&self) -> String {
        let Self { title, body, .. } = self;
        let contents = self.contents();
        // The scripts come last, because they read the page's content when they start.
        let content = format!(
            "<main>\n<h1>{title}</h1>\n{contents}{body}</main>\n{nodes}<script>\n{plots}</script>\n\
             <script>\n{players}</script>\n",
            nodes = self.nodes(),
            plots = stylus_pages::plots_script(),
            players = stylus_pages::players_script(),
        );
        stylus_pages::document(POLICY, title, "", &content)
    }

    /// Writes the page into a file. The file is written completely or not at all.
    pub fn write(&self, path: &Path) -> Result<()> {
        atomic_file::write(path, self.finish().as_bytes())
    }

    /// The sounds of nodes as a script element of JSON. No texture's name can end the element.
    fn nodes(&self) -> String {
        if self.nodes.textures.is_empty() {
            return String::new();
        }
        let text = page_json(&self.nodes);
        format!("<script type=\"application/json\" id=\"nodes\">{text}</script>\n")
    }

    /// The table of contents; empty if the page has few headings.
    fn contents(&self) -> String {
        if self.headings.len() < CONTENTS_FROM {
            return String::new();
        }
        let mut list = String::new();
        for Heading { anchor, text } in &self.headings {
            // Writing into a string cannot fail.
            let _ = writeln!(list, "<li><a href=\"#{anchor}\">{text}</a></li>");
        }
        format!(
            "<nav aria-label=\"Contents\"><details open><summary>Contents</summary>\n<ul>\n{list}</ul></details>\
             </nav>\n"
        )
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

/// A sound of a page.
#[derive(Clone, Debug)]
pub struct Sound {
    /// Name of the picture's panel that shows the sound; empty if no panel does.
    pub panel: String,
    /// Label of the sound.
    pub label: String,
    /// The bytes of a WAV file, which is embedded in the page.
    pub wav: Vec<u8>,
}

/// Returns players, each after its label; an empty text without sounds.
fn players(sounds: &[Sound]) -> String {
    if sounds.is_empty() {
        return String::new();
    }
    // The metadata is loaded at once, so that a player shows its sound's length. It costs nothing, because it is in the
    // page.
    let player = |sound: &Sound| {
        let (label, panel) = (escaped(&sound.label), escaped(&sound.panel));
        let data = STANDARD.encode(&sound.wav);
        format!(
            "<p class=\"sound\">{label}<audio controls preload=\"metadata\" aria-label=\"{label}\" \
             data-panel=\"{panel}\" src=\"data:audio/wav;base64,{data}\"></audio></p>\n"
        )
    };
    let players: String = sounds.iter().map(player).collect();
    format!("<div class=\"sounds\">\n{players}</div>")
}

/// ASCII letters, in lower case, and digits of `text`, with one hyphen for all characters between them.
fn slug(text: &str) -> String {
    let words: Vec<&str> = text
        .split(|c: char| !c.is_ascii_alphanumeric())
        .filter(|word| !word.is_empty())
        .collect();
    words.join("-").to_lowercase()
}

/// Asserts that a page fetches nothing.
#[cfg(test)]
pub(super) fn assert_fetches_nothing(page: &str) {
    assert!(page.contains("default-src 'none'"));
    // The names of XML namespaces look like addresses but are not fetched.
    let page = page
        .replace("http://www.w3.org/2000/svg", "")
        .replace("http://www.w3.org/1999/xlink", "");
    for outside in ["http:", "https:", " src=", "url(", "@import", "import("] {
        assert!(!page.contains(outside), "{outside}");
    }
    for call in ["fetch(", "XMLHttpRequest"] {
        assert!(!page.contains(call), "{call}");
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::plot::{Caption, waveforms};
    use proptest::prelude::*;

    fn picture() -> Svg {
        waveforms(&Caption::new("picture", false), &[], 5000.0).unwrap()
    }

    /// A page with every kind of element, all with `text`.
    fn page_of(text: &str) -> String {
        let mut page = Page::new(text);
        page.section(text)
            .paragraph(text)
            .notice(text)
            .list(&[text])
            .table(&Table::new(text, [text, text], [vec![text.to_owned(); 2]]))
            .folded(text, |page| {
                page.figure(&picture(), text, &[]);
            })
            .verdict(text)
            .finish()
    }

    /// The tags of a page, without the text between them.
    fn tags(page: &str) -> Vec<&str> {
        page.split('<')
            .skip(1)
            .map(|piece| piece.split([' ', '>']).next().unwrap())
            .collect()
    }

    proptest! {
        #[test]
        fn no_text_becomes_markup(text in "[<>&\"'/a-z =!-]{0,40}") {
            // A text that begins with a letter is not a number; cells of numbers have a class.
            let (page, plain) = (page_of(&format!("a{text}")), page_of("plain"));
            prop_assert_eq!(tags(&page), tags(&plain));
            prop_assert_eq!(page.matches('"').count(), plain.matches('"').count());
        }
    }

    #[test]
    fn every_tag_that_opens_is_closed() {
        // The content of a script is not markup.
        let page: String = page_of("text")
            .split("<script>")
            .map(|piece| match piece.split_once("</script>") {
                Some((_, rest)) => format!("<script></script>{rest}"),
                None => piece.to_owned(),
            })
            .collect();
        let mut open = Vec::new();
        for piece in page.split('<').skip(1) {
            let (tag, _) = piece.split_once('>').unwrap();
            let name = tag.split_whitespace().next().unwrap();
            if let Some(closed) = name.strip_prefix('/') {
                assert_eq!(open.pop(), Some(closed));
            } else if !tag.ends_with('/') && !["!DOCTYPE", "meta", "link"].contains(&name) {
                open.push(name);
            }
        }
        assert!(open.is_empty(), "{open:?}");
    }

    #[test]
    fn a_page_needs_nothing_but_itself() {
        let page = page_of("text");
        assert!(page.contains(picture().as_str()));
        // Only the page's own scripts, whatever its text.
        assert_eq!(page.matches("<script").count(), 2);
        super::assert_fetches_nothing(&page);
        let page = page.replace("href=\"data:,\"", "");
        assert_eq!(page.matches("href=").count(), page.matches("href=\"#").count());
    }

    #[test]
    fn the_contents_lead_to_every_heading_by_an_anchor_of_its_own() {
        let mut page = Page::new("title");
        for text in ["one", "one", "ⅱ & <b>", "", "one"] {
            page.section(text);
        }
        let page = page.finish();
        let after = |mark: &str| -> Vec<String> {
            page.split(mark)
                .skip(1)
                .map(|rest| rest.split('"').next().unwrap().to_owned())
                .collect()
        };
        let (links, anchors) = (after("href=\"#"), after("<h2 id=\""));
        assert_eq!(links.len(), 5);
        let distinct: std::collections::BTreeSet<&String> = anchors.iter().collect();
        assert_eq!(distinct, links.iter().collect());
        assert_eq!(distinct.len(), 5);
        for anchor in anchors {
            assert!(anchor.chars().all(|c| c.is_ascii_alphanumeric() || c == '-'));
        }
        assert!(!Page::new("title").section("one").finish().contains("<nav"));
    }

    #[test]
    fn a_table_shows_every_cell_under_its_column_and_numbers_to_the_right() {
        let cells = |row: &[&str]| row.iter().map(ToString::to_string).collect();
        let rows = [cells(&["a"]), cells(&["b", "2"])];
        let text = Page::new("title")
            .table(&Table::new("caption", ["name", "C, %"], rows))
            .finish();
        for row in [
            "<td>a</td><td class=\"number\"></td>",
            "<td>b</td><td class=\"number\">2</td>",
        ] {
            assert_eq!(text.matches(row).count(), 1, "{row}");
        }
    }
}
