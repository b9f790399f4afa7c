//! Tables of figures in the pages. Each is a block that `cargo tasks tables` writes, because figures that a person
//! copies go stale.
//!
//! | table | made from | checked by |
//! |---|---|---|
//! | those of `INSTANT` | constants | `cargo tasks tables --check`, at once |
//! | [`MEMORY`] | the sections of the image | `cargo tasks test-virtual-stylus` |
//! | [`TICKS`] | the image's ticks on the virtual stylus | its tests, which include [`page`] by its path |
//!
//! The last two depend on the compiler and name it. Tables of another compiler are not compared.

pub mod page;
mod rows;
#[cfg(test)]
mod tests;

use anyhow::{Context, Result, bail};
use page::{OPENING, Page};
pub use rows::memory;

use crate::toolchain::Toolchain;
use crate::{firmware, workspace};

/// The table of the image's memories.
pub const MEMORY: &str = "memory";

/// The table of ticks on the virtual stylus. The tests of that workspace make its rows.
pub const TICKS: &str = "ticks";

/// The making of a table's content.
type Make = fn() -> String;

/// All tables that are made within a second, by their names.
const INSTANT: [(&str, Make); 4] = [
    ("settings", rows::settings),
    ("scene-stages", rows::scene_stages),
    ("scene-limits", rows::scene_limits),
    ("library-limits", rows::library_limits),
];

/// The page of each table, as a path from the workspace's folder.
const PAGES: [(&str, &str); 6] = [
    ("settings", "firmware/README.md"),
    (TICKS, "firmware/README.md"),
    (MEMORY, "firmware/README.md"),
    ("scene-stages", "host-tools/SCENES.md"),
    ("scene-limits", "host-tools/SCENES.md"),
    ("library-limits", "host-tools/FORMATS.md"),
];

/// Names of all tables.
pub fn names() -> impl Iterator<Item = &'static str> {
    PAGES.iter().map(|(name, _)| *name)
}

/// The page that has table `name`.
fn page(name: &str) -> Result<Page> {
    let known = PAGES.iter().find(|(known, _)| *known == name);
    let no_table = || {
        let known = names().collect::<Vec<_>>().join(", ");
        format!("no command writes a table '{name}'; there are {known}")
    };
    let (_, path) = known.with_context(no_table)?;
    Page::read(&workspace::root().join(path))
}

/// Checks the tables that are made within a second, and that the pages have every table and no other.
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
    // A block in the pages that no command writes.
    for (_, path) in PAGES {
        let text = std::fs::read_to_string(workspace::root().join(path)).context(path)?;
        for line in text.lines().filter_map(|line| line.strip_prefix(OPENING)) {
            page(line.split(',').next().unwrap_or(line))?;
        }
    }
    Ok(())
}

/// Writes the tables called `asked`; without names, those that are made within a second. Calls `told` with the name of
/// each changed table. The tests on the virtual stylus write [`TICKS`], not this function.
///
/// # Errors
/// A name is that of no table, a page lacks the block, or the source of a table is missing.
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

/// Makes table `name` again.
fn made(name: &str) -> Result<String> {
    if let Some((_, make)) = INSTANT.iter().find(|(table, _)| *table == name) {
        return Ok(make());
    }
    let toolchain = Toolchain::find()?;
    let compiler = toolchain.compiler()?;
    match name {
        MEMORY => {
            let image = firmware::build(&toolchain, firmware::Image::Product)?;
            Ok(memory(&firmware::memory(&image)?, &compiler))
        }
        _ => bail!("'{name}' is not written by this"),
    }
}

/// Compares a table that depends on the compiler with `made`, if the page names the same compiler. Returns true if it
/// does.
///
/// # Errors
/// The first row that differs.
pub fn check_made(name: &str, made: &str, compiler: &str) -> Result<bool> {
    let page = page(name)?;
    let is_same = page.block(name)?.contains(&format!("rustc {compiler}"));
    if is_same {
        page.check(name, made)?;
    }
    Ok(is_same)
}
