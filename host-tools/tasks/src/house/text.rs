//! Rules on texts: the length of lines, and the lints of packages.

use super::Outcome;
use super::tree::{Tree, extension, folder};

/// Largest number of characters of a line.
const MOST: usize = 120;

/// Checks the length of lines, because rustfmt does not shorten comments. In pages, rows of tables and lines with a
/// single link are exempt, because they cannot be broken.
pub fn check_lines(tree: &Tree, outcome: &mut Outcome) {
    let mut count = 0;
    for (path, text) in tree.texts_of(&["rs", "toml", "md", "x", "sh", "py", ""]) {
        let is_page = extension(path) == "md";
        if extension(path).is_empty() && !text.starts_with("#!") {
            continue;
        }
        count += 1;
        for (index, line) in text.lines().enumerate() {
            let length = line.chars().count();
            let is_whole =
                line.contains(['|', '│']) || line.contains("](") && line.matches(' ').count() < 4;
            if length > MOST && !(is_page && is_whole) {
                let problem = format!("{length} characters: a line has at most {MOST}");
                outcome.find(path, index + 1, problem);
            }
        }
    }
    outcome.count("files", count);
}

/// Folders of packages with their own lints: packages with unsafe code, and packages of other workspaces.
const OWN_LINTS: [&str; 9] = [
    "firmware",
    "firmware/boot",
    "firmware/realtime",
    "host-tools/browser",
    "host-tools/c",
    "tests/fuzz",
    "tests/qemu/guest",
    "tests/virtual-stylus",
    "tests/virtual-stylus/probe-image",
];

/// Checks that every other package uses the workspace's lints, which forbid unsafe code. Stable cargo does not check
/// that.
pub fn check_lints(tree: &Tree, outcome: &mut Outcome) {
    let manifests = tree.texts_of(&["toml"]);
    let packages = manifests.filter(|(_, text)| text.contains("[package]\n"));
    let packages: Vec<_> = packages.collect();
    outcome.count("packages", packages.len());
    for (path, text) in packages {
        if !text.contains("[lints]\nworkspace = true") && !OWN_LINTS.contains(&folder(path)) {
            let problem = "does not take the workspace's lints, which forbid unsafe code";
            outcome.find(path, 1, problem.to_owned());
        }
    }
}
