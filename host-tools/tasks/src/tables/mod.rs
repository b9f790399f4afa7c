//! Tables of figures in the pages. Each is a block that `cargo tasks tables` writes, because figures that a person
//! copies become outdated.
//!
//! | table | made from | checked by |
//! |---|---|---|
//! | the tables of `INSTANT` | constants | `cargo tasks tables --check`, at once |
//! | [`MEMORY`] | the sections of the image | `cargo tasks test-virtual-stylus` |
//! | [`TICKS`] | the image's ticks on the virtual stylus | its tests, which include [`page`] by its path |
//!
//! The last two depend on the compiler, whose version they name. Tables of another compiler are not compared.

pub mod page;
mod rows;

use anyhow::{Context, Result, bail};
use page::{OPENING, Page};
pub use rows::memory;
use stylus_board::ALL;

use crate::toolchain::Toolchain;
use crate::{firmware, workspace};

/// The table of the image's memories.
pub const MEMORY: &str = "memory";

/// The table of ticks on the virtual stylus. The tests in that workspace compute its rows.
pub const TICKS: &str = "ticks";

/// A function that computes a table's content.
type Make = fn() -> String;

/// Names of all tables that are computed within a second, each with its function.
const INSTANT: [(&str, Make); 5] = [
    ("boards", rows::boards),
    ("settings", rows::settings),
    ("scene-stages", rows::scene_stages),
    ("scene-limits", rows::scene_limits),
    ("library-limits", rows::library_limits),
];

/// The page of each table, as a path from the workspace's folder.
const PAGES: [(&str, &str); 7] = [
    ("boards", "firmware/BOARDS.md"),
    ("settings", "firmware/README.md"),
    (TICKS, "firmware/README.md"),
    (MEMORY, "firmware/README.md"),
    ("scene-stages", "host-tools/manual/SCENES.md"),
    ("scene-limits", "host-tools/manual/SCENES.md"),
    ("library-limits", "host-tools/manual/FORMATS.md"),
];

/// Names of all tables.
pub fn names() -> impl Iterator<Item = &'static str> {
    PAGES.iter().map(|(name, _)| *name)
}

/// Reads the page that contains table `name`.
fn page(name: &str) -> Result<Page> {
    let known = PAGES.iter().find(|(known, _)| *known == name);
    let no_table = || {
        let known = names().collect::<Vec<_>>().join(", ");
        format!("no command writes a table '{name}'; there are {known}")
    };
    let (_, path) = known.with_context(no_table)?;
    Page::read(&workspace::root().join(path))
}

/// Checks the tables that are computed within a second, and that the pages have every table and no other.
///
/// # Errors
/// The first row that differs from its command's, with its page and table.
pub fn check_instant() -> Result<()> {
    for (name, make) in INSTANT {
        page(name)?.check(name, &make())?;
    }
    for name in names() {
        page(name)?.block(name)?;
    }
    // Every block in the pages must be one that a command writes.
    for (_, path) in PAGES {
        for line in std::fs::read_to_string(workspace::root().join(path))
            .context(path)?
            .lines()
            .filter_map(|line| line.strip_prefix(OPENING))
        {
            page(line.split(',').next().unwrap_or(line))?;
        }
    }
    Ok(())
}

/// Writes the tables called `asked`, or without names the tables that are computed within a second. Calls `told` with
/// the name of each table that changes. [`TICKS`] is written by the tests on the virtual stylus, not by this function.
///
/// # Errors
/// A name belongs to no table, a page lacks the block, or the source of a table is missing.
pub fn write(asked: &[String], mut told: impl FnMut(&str)) -> Result<()> {
    let instant = INSTANT.iter().map(|(name, _)| (*name).to_owned());
    let asked = if asked.is_empty() {
        instant.collect()
    } else {
        asked.to_vec()
    };
    for name in &asked {
        if page(name)?.write(name, &made(name)?)? {
            told(name);
        }
    }
    Ok(())
}

/// Computes the content of table `name`.
fn made(name: &str) -> Result<String> {
    if let Some((_, make)) = INSTANT.iter().find(|(table, _)| *table == name) {
        return Ok(make());
    }
    let toolchain = Toolchain::find()?;
    let compiler = toolchain.compiler()?;
    match name {
        MEMORY => {
            let image = firmware::build(&toolchain, &ALL[0], firmware::Image::Product)?;
            Ok(memory(&firmware::memory(&image)?, &compiler))
        }
        _ => bail!("'{name}' is not written by this"),
    }
}

/// Compares a table that depends on the compiler with `made`, if the page names the same compiler. Returns true if they
/// were compared.
pub fn check_made(name: &str, made: &str, compiler: &str) -> Result<bool> {
    let page = page(name)?;
    let is_same = page.block(name)?.contains(&format!("rustc {compiler}"));
    if is_same {
        page.check(name, made)?;
    }
    Ok(is_same)
}

/// Tests of blocks of pages, and of the pages themselves.
#[cfg(test)]
mod tests {
    use super::page::Page;
    use super::{check_instant, write};

    const TEXT: &str = "# Page\n\n<!-- table: a, made by `cargo tasks tables a` -->\n| x |\n|---|\n| 1 |\n\
                        <!-- end -->\nbetween\n<!-- table: b, made by `cargo tasks tables b` -->\n<!-- end -->\n\
                        after\n";

    fn page_of(text: &str) -> (tempfile::TempDir, Page) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("page.md");
        std::fs::write(&path, text).unwrap();
        let page = Page::read(&path).unwrap();
        (folder, page)
    }

    #[test]
    fn a_changed_figure_is_refused_with_page_table_row_and_command() {
        let (_folder, page) = page_of(TEXT);
        assert!(page.check("a", "| x |\n|---|\n| 1 |\n").is_ok());
        for (expected, row) in [
            ("| x |\n|---|\n| 2 |\n", "row 3"),
            ("| x |\n|---|\n", "row 3"),
            ("| x |\n|---|\n| 1 |\n| 2 |\n", "row 4"),
            ("", "row 1"),
        ] {
            let error = page.check("a", expected).unwrap_err().to_string();
            for part in ["page.md", "table 'a'", row, "`cargo tasks tables a`"] {
                assert!(error.contains(part), "{part}: {error}");
            }
        }
    }

    #[test]
    fn writing_changes_one_block_alone_and_then_holds() {
        let (folder, mut page) = page_of(TEXT);
        assert!(page.write("b", "| y |\n").unwrap());
        assert!(!page.write("b", "| y |\n").unwrap());
        let again = Page::read(&folder.path().join("page.md")).unwrap();
        assert_eq!(again.block("b").unwrap(), "| y |\n");
        assert_eq!(again.block("a").unwrap(), page.block("a").unwrap());
        let text = std::fs::read_to_string(folder.path().join("page.md")).unwrap();
        assert_eq!(text.replace("| y |\n", ""), TEXT);
    }

    #[test]
    fn a_block_that_is_missing_or_left_open_is_refused() {
        let left_open = TEXT.replacen("<!-- end -->\n", "", 1);
        for (text, name) in [(TEXT, "c"), (left_open.as_str(), "a")] {
            let (_folder, page) = page_of(text);
            let error = page.block(name).unwrap_err();
            assert!(error.to_string().contains("no table"), "{error}");
        }
    }

    #[test]
    fn every_table_that_is_made_within_a_second_has_a_page_and_holds() {
        check_instant().unwrap_or_else(|error| panic!("{error}"));
    }

    #[test]
    fn a_name_of_no_table_is_refused_with_those_that_there_are() {
        let error = write(&["nothing".to_owned()], |_| ()).unwrap_err().to_string();
        assert!(error.contains("nothing"), "{error}");
        assert!(error.contains("settings"), "{error}");
    }
}
