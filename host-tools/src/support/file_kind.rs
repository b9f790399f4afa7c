//! Kinds of files by their first bytes, so that a file of one kind is not replaced by one of another.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use super::error::{Error, Result};

/// A kind of file that the tools read or write.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FileKind {
    /// Texture library.
    Library,
    /// WAV file.
    Wav,
    /// PNG picture.
    Png,
    /// HTML page.
    Html,
    /// SVG picture.
    Svg,
    /// Other XML.
    Xml,
    /// JSON text.
    Json,
    /// TOML text.
    Toml,
    /// Table of values, separated by commas, semicolons or tabs.
    Csv,
}

/// First bytes that are looked at.
const LOOKED_AT: u64 = 4096;

/// First bytes of a library.
const LIBRARY_MAGIC: &[u8] = b"HTXL";

/// First bytes of a PNG picture.
const PNG_MAGIC: &[u8] = b"\x89PNG\r\n\x1a\n";

impl FileKind {
    /// Its name, with its article.
    pub fn name(self) -> &'static str {
        match self {
            Self::Library => "a texture library",
            Self::Wav => "a WAV recording",
            Self::Png => "a PNG picture",
            Self::Html => "an HTML page",
            Self::Svg => "an SVG picture",
            Self::Xml => "an XML file",
            Self::Json => "a JSON file",
            Self::Toml => "a TOML file",
            Self::Csv => "a table (CSV)",
        }
    }

    /// Returns the kind of a file with these first bytes, if it is one of them.
    pub fn of_bytes(bytes: &[u8]) -> Option<Self> {
        if bytes.starts_with(LIBRARY_MAGIC) {
            return Some(Self::Library);
        }
        if bytes.starts_with(b"RIFF") && bytes.get(8..12) == Some(b"WAVE") {
            return Some(Self::Wav);
        }
        if bytes.starts_with(PNG_MAGIC) {
            return Some(Self::Png);
        }
        Self::of_text(beginning_as_text(bytes)?)
    }

    fn of_text(text: &str) -> Option<Self> {
        let text = text.trim_start_matches('\u{feff}').trim_start();
        let lower: String = text.chars().take(512).collect::<String>().to_lowercase();
        if lower.starts_with("<!doctype html") || lower.starts_with("<html") {
            return Some(Self::Html);
        }
        if lower.starts_with('<') {
            let is_picture = lower.contains("<svg");
            return Some(if is_picture { Self::Svg } else { Self::Xml });
        }
        let is_content = |line: &&str| !line.trim().is_empty() && !line.starts_with('#');
        let first = text.lines().find(is_content)?.trim();
        if is_table_header(first) {
            return Some(Self::Toml);
        }
        if first.starts_with(['{', '[']) {
            return Some(Self::Json);
        }
        if first.contains([',', ';', '\t']) && !first.contains(" = ") {
            return Some(Self::Csv);
        }
        first.contains('=').then_some(Self::Toml)
    }

    /// Returns the kind of the regular file at `path`; `None` for content of no known kind.
    ///
    /// # Errors
    /// A file that cannot be read.
    pub fn of_file(path: &Path) -> Result<Content> {
        let mut bytes = Vec::new();
        File::open(path)
            .and_then(|file| file.take(LOOKED_AT).read_to_end(&mut bytes))
            .map_err(Error::io("read", path))?;
        Ok(match (bytes.is_empty(), Self::of_bytes(&bytes)) {
            (true, _) => Content::Empty,
            (false, Some(kind)) => Content::Of(kind),
            (false, None) => Content::Unknown,
        })
    }
}

/// The content of a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Content {
    /// None.
    Empty,
    /// Of a kind that is known.
    Of(FileKind),
    /// Of another.
    Unknown,
}

/// The first bytes of a text, up to a character that the end may have cut; `None` for other bytes.
fn beginning_as_text(bytes: &[u8]) -> Option<&str> {
    let text = match std::str::from_utf8(bytes) {
        Ok(text) => text,
        Err(failure) if failure.error_len().is_none() => {
            std::str::from_utf8(&bytes[..failure.valid_up_to()]).ok()?
        }
        Err(_) => return None,
    };
    (!text.contains('\0')).then_some(text)
}

/// Returns true for the header of a TOML table, such as `[surface]`, which begins as a JSON array does.
fn is_table_header(line: &str) -> bool {
    let line = line.split('#').next().unwrap_or_default().trim();
    let inner = line
        .strip_prefix('[')
        .and_then(|line| line.strip_suffix(']'));
    let inner = inner.map(|inner| inner.trim_start_matches('[').trim_end_matches(']').trim());
    let is_name = |c: char| c.is_alphanumeric() || "_-.".contains(c);
    inner.is_some_and(|name| {
        name.starts_with(|c: char| c.is_alphabetic() || c == '_')
            && name.chars().all(is_name)
            && !["true", "false", "null"].contains(&name)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kinds_are_told_by_their_first_bytes() {
        let cases: [(&[u8], Option<FileKind>); 20] = [
            (b"HTXL\x02\0", Some(FileKind::Library)),
            (b"RIFF\0\0\0\0WAVEfmt ", Some(FileKind::Wav)),
            (b"RIFF\0\0\0\0AVI fmt ", None),
            (b"\x89PNG\r\n\x1a\n\0\0", Some(FileKind::Png)),
            (b"<!DOCTYPE html>\n<html>", Some(FileKind::Html)),
            (b"\xef\xbb\xbf<html lang=en>", Some(FileKind::Html)),
            (b"<svg width=\"3\">", Some(FileKind::Svg)),
            (b"<?xml version=\"1.0\"?>\n<svg>", Some(FileKind::Svg)),
            (b"<?xml version=\"1.0\"?>\n<MODEL>", Some(FileKind::Xml)),
            (b"{\n  \"a\": 1", Some(FileKind::Json)),
            (b"[\n  {", Some(FileKind::Json)),
            (b"[1, 2]", Some(FileKind::Json)),
            (b"[true]", Some(FileKind::Json)),
            (b"# a scene\n[surface.tap] # of it\n", Some(FileKind::Toml)),
            (b"[[surface]]\n", Some(FileKind::Toml)),
            (b"name = \"a, b\"\n", Some(FileKind::Toml)),
            (b"# SIMULATED\nfile,texture\n", Some(FileKind::Csv)),
            (b"time_s;x\n0,1;2\n", Some(FileKind::Csv)),
            (b"a diary\nof mine\n", None),
            (b"\0\0\0\0", None),
        ];
        for (bytes, kind) in cases {
            assert_eq!(FileKind::of_bytes(bytes), kind, "{}", bytes.escape_ascii());
        }
    }

    #[test]
    fn a_character_that_is_cut_at_the_end_is_still_text() {
        assert_eq!(FileKind::of_bytes(b"a,b\n\xc3"), Some(FileKind::Csv));
        assert_eq!(FileKind::of_bytes(b"a,b\n\xc3\n"), None);
    }
}
