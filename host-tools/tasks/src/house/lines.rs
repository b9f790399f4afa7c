//! Lines of at most 120 characters.

use super::finding::Finding;
use super::pages;
use super::tree::Tree;

/// Characters that a line may have.
const MOST: usize = 120;

/// The number of files and the lines that are too long.
pub struct Checked {
    /// The number of files.
    pub count: usize,
    /// The lines.
    pub findings: Vec<Finding>,
}

/// Checks Rust, TOML, linker scripts, scripts and pages.
pub fn check(tree: &Tree) -> Checked {
    let mut checked = Checked {
        count: 0,
        findings: Vec::new(),
    };
    for (path, text) in tree.texts().filter(|&(path, text)| is_checked(path, text)) {
        checked.count += 1;
        let is_page = path.ends_with(".md");
        let fences = pages::fences(text);
        for (index, line) in text.lines().enumerate() {
            let length = line.chars().count();
            let is_free = is_page && (is_table(line, fences[index]) || is_link(line));
            if length > MOST && !is_free {
                let problem = format!("{length} characters: a line has at most {MOST}");
                checked
                    .findings
                    .push(Finding::new(path, index + 1, problem));
            }
        }
    }
    checked
}

fn is_checked(path: &str, text: &str) -> bool {
    let is_named = [".rs", ".toml", ".x", ".md", ".sh", ".py"].iter();
    is_named.clone().any(|end| path.ends_with(end)) || text.starts_with("#!")
}

/// True for a row of a table; within a code fence, for a line with columns.
fn is_table(line: &str, is_fenced: bool) -> bool {
    line.trim_start().starts_with('|') || is_fenced && line.contains(['|', '│'])
}

/// True for a line of one link or address, which cannot be broken.
fn is_link(line: &str) -> bool {
    let line = line
        .trim_start_matches([' ', '-', '*', '>', '!'])
        .trim_end();
    let is_address = line.contains("://") && !line.contains(' ');
    let is_definition = line.starts_with('[') && line.contains("]: ");
    let is_link = line.starts_with('[') && line.ends_with(')') && line.matches("](").count() == 1;
    is_address || is_definition || is_link
}

#[cfg(test)]
mod tests {
    use super::*;

    fn found(path: &str, text: &str) -> Vec<String> {
        let findings = check(&Tree::of(&[(path, text)])).findings;
        findings.iter().map(ToString::to_string).collect()
    }

    #[test]
    fn a_line_of_121_characters_is_found_in_every_kind_of_file() {
        for path in ["a.rs", "Cargo.toml", "memory.x", "README.md", "tests/run"] {
            let fits = format!("#!\n{}\n", "ä".repeat(120));
            assert_eq!(found(path, &fits), [""; 0], "{path}");
            let long = format!("#!\n{}\n", "ä".repeat(121));
            assert_eq!(
                found(path, &long),
                [format!("{path}:2: 121 characters: a line has at most 120")]
            );
        }
        assert_eq!(found("LICENSE", &"a".repeat(200)), [""; 0]);
    }

    #[test]
    fn tables_and_links_of_pages_may_be_longer() {
        let x = "x".repeat(120);
        for line in [
            format!("| a | {x} |"),
            format!("```\na | {x}\n```"),
            format!("- [{x}](https://a.b)"),
            format!("https://a.b/{x}"),
            format!("[a]: https://a.b/{x}"),
        ] {
            assert_eq!(found("a.md", &line), [""; 0], "{line}");
        }
        assert_eq!(found("a.md", &format!("```\n{x}x\n```")).len(), 1);
        assert_eq!(found("a.rs", &format!("// | {x} |")).len(), 1);
    }
}
