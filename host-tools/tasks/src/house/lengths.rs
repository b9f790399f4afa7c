//! Lengths of lines, also where rustfmt leaves them alone, such as in comments.

use super::Findings;
use super::tree::Tree;

/// Largest number of characters in a line.
const MOST: usize = 120;

/// Endings of the paths of files that are written by hand.
const ENDINGS: [&str; 10] = [
    ".rs", ".toml", ".x", ".py", ".md", "/run", "/check", "/smoke", "/debian", "/fresh",
];

/// Checks every line of these files.
pub fn check(tree: &Tree, findings: &mut Findings) {
    for ending in ENDINGS {
        for (path, text) in tree.texts_of(ending) {
            // In a page, a row of a table, a drawing, or a line of one link cannot be broken.
            let is_whole = |line: &str| ending == ".md" && (line.contains(['|', '│']) || line.split(' ').count() <= 4);
            for (index, line) in text.lines().enumerate() {
                if line.chars().count() > MOST && !is_whole(line) {
                    findings.find(path, index + 1, format!("more than {MOST} characters: break the line"));
                }
            }
        }
    }
}
