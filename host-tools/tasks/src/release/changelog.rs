//! The heading of a release in CHANGELOG.md, as a patch for a person to commit.

use anyhow::{Context, Result, bail};

const UNRELEASED: &str = "## [Unreleased]";

/// Lines of context before and after a change, as `git apply` expects them.
const CONTEXT: usize = 3;

/// Returns the patch that turns the unreleased entries in `text` into those of `version`, released at `date`.
///
/// # Errors
/// There are no unreleased entries, or the version was released before.
pub fn cut(text: &str, version: &str, date: &str) -> Result<String> {
    let lines: Vec<&str> = text.lines().collect();
    let heading = format!("## [{version}]");
    if lines.iter().any(|line| line.starts_with(&heading)) {
        bail!("CHANGELOG.md has version {version} already: raise `version` in Cargo.toml");
    }
    let at = lines
        .iter()
        .position(|line| *line == UNRELEASED)
        .with_context(|| format!("CHANGELOG.md has no line \"{UNRELEASED}\""))?;
    if lines[at + 1..]
        .iter()
        .take_while(|line| !line.starts_with("## "))
        .clone()
        .all(|line| line.is_empty())
    {
        bail!("CHANGELOG.md has nothing under \"{UNRELEASED}\"");
    }
    // The line `at` is the last one before the change.
    let (first, last) = (at.saturating_sub(CONTEXT - 1), (at + 1 + CONTEXT).min(lines.len()));
    let count = last - first;
    let mut patch = format!(
        "--- a/CHANGELOG.md\n+++ b/CHANGELOG.md\n@@ -{0},{count} +{0},{1} @@\n",
        first + 1,
        count + 2
    );
    for line in &lines[first..=at] {
        patch += &format!(" {line}\n");
    }
    patch += &format!("+\n+{heading} - {date}\n");
    for line in &lines[at + 1..last] {
        patch += &format!(" {line}\n");
    }
    Ok(patch)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::process::Command;

    const TEXT: &str = "# Changelog\n\nThe form.\n\n## [Unreleased]\n\n### Added\n\n- This.\n\n\
                        ## [0.1.0] - 2025-01-02\n\n- That.\n";

    #[test]
    fn the_patch_applies_and_gives_the_release_its_heading() {
        let folder = tempfile::tempdir().expect("a folder");
        std::fs::write(folder.path().join("CHANGELOG.md"), TEXT).expect("it can be written");
        let patch = cut(TEXT, "0.2.0", "2026-11-25").expect("it can be cut");
        std::fs::write(folder.path().join("patch"), patch).expect("it can be written");
        let mut git = Command::new("git");
        let applied = git.args(["apply", "patch"]).current_dir(folder.path()).status();
        assert!(applied.expect("git runs").success());
        let now = std::fs::read_to_string(folder.path().join("CHANGELOG.md")).expect("it is there");
        let wanted = TEXT.replace(UNRELEASED, "## [Unreleased]\n\n## [0.2.0] - 2026-11-25");
        assert_eq!(now, wanted);
    }

    #[test]
    fn a_version_that_was_released_and_an_empty_one_are_refused() {
        assert!(cut(TEXT, "0.1.0", "2026-11-25").is_err());
        let empty = TEXT.replace("### Added\n\n- This.\n\n", "");
        assert!(cut(&empty, "0.2.0", "2026-11-25").is_err());
    }
}
