//! Tables of figures in the pages. Each is a block that `cargo tasks tables` writes, because figures that a person
//! copies go stale.
//!
//! | table | made from | checked by |
//! |---|---|---|
//! | those of `INSTANT` | constants, `costs.json`, a board's `cycles.json` | `cargo tasks tables --check`, at once |
//! | [`emulated`] | a run of the vectors on QEMU | the test of `qemu-tests` that plays them |
//! | [`memory`] | the sections of the image | `cargo tasks test-virtual-stylus` |
//! | [`TICKS`] | the image's ticks on the virtual stylus | its tests, which include [`page`] by its path |
//!
//! The last three depend on the compiler and name it. Tables of another compiler are not compared.

mod constants;
mod counted;
mod cycles;
pub mod emulated;
mod markdown;
pub mod memory;
pub mod page;
#[cfg(test)]
mod tests;

use stylus_costs::Costs;

use crate::error::{Error, Result};
use crate::guest::Processor;
use crate::toolchain::Toolchain;
use crate::{compare, costs, firmware, workspace};
use page::{OPENING, Page, PageError};

/// The table of ticks on the virtual stylus. The tests of that workspace make its rows.
pub const TICKS: &str = "ticks";

/// A table that is made within a second.
struct Instant {
    name: &'static str,
    make: fn(&Costs) -> Result<String>,
}

/// All tables that are made within a second.
const INSTANT: [Instant; 7] = [
    Instant {
        name: "settings",
        make: |_| Ok(constants::settings()),
    },
    Instant {
        name: "scene-stages",
        make: |_| Ok(constants::scene_stages()),
    },
    Instant {
        name: "scene-limits",
        make: |_| Ok(constants::scene_limits()),
    },
    Instant {
        name: "library-limits",
        make: |_| Ok(constants::library_limits()),
    },
    Instant {
        name: "filters",
        make: |costs| Ok(counted::filters(costs)),
    },
    Instant {
        name: "samples-by-order",
        make: |costs| Ok(counted::samples_by_order(costs)),
    },
    Instant {
        name: cycles::NAME,
        make: |_| cycles::of_a_board(&workspace::root().join(cycles::FILE)),
    },
];

/// The page of each table, as a path from the workspace's folder.
const PAGES: [(&str, &str); 10] = [
    ("settings", "firmware/README.md"),
    (TICKS, "firmware/README.md"),
    (memory::NAME, "firmware/README.md"),
    (cycles::NAME, "firmware/README.md"),
    ("scene-stages", "host-tools/SCENES.md"),
    ("scene-limits", "host-tools/SCENES.md"),
    ("library-limits", "host-tools/FORMATS.md"),
    (emulated::NAME, "host-tools/COSTS.md"),
    ("filters", "host-tools/COSTS.md"),
    ("samples-by-order", "host-tools/COSTS.md"),
];

/// Names of all tables.
pub fn names() -> impl Iterator<Item = &'static str> {
    PAGES.iter().map(|(name, _)| *name)
}

/// The page that has table `name`.
fn page(name: &str) -> Result<Page> {
    let known = PAGES.iter().find(|(known, _)| *known == name);
    let (_, path) = known.ok_or_else(|| no_table(name))?;
    Ok(Page::read(&workspace::root().join(path))?)
}

fn no_table(name: &str) -> Error {
    Error::NoTable {
        name: name.to_owned(),
        known: names().collect::<Vec<_>>().join(", "),
    }
}

/// Checks the tables that are made within a second, and that the pages have every table and no other.
///
/// # Errors
/// The first row that differs from its command's, with its page and table.
pub fn check_instant() -> Result<()> {
    let counted = costs::read()?;
    for table in &INSTANT {
        page(table.name)?.check(table.name, &(table.make)(&counted)?)?;
    }
    for name in names() {
        page(name)?.block(name)?;
    }
    no_unknown_tables()
}

/// Refuses a block in the pages that no command writes.
fn no_unknown_tables() -> Result<()> {
    for (_, path) in PAGES {
        let file = workspace::root().join(path);
        let text = std::fs::read_to_string(&file)
            .map_err(|source| PageError::Io { path: file, source })?;
        for line in text.lines().filter_map(|line| line.strip_prefix(OPENING)) {
            let name = line.split(',').next().unwrap_or(line);
            if !names().any(|known| known == name) {
                return Err(no_table(name));
            }
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
    let counted = costs::read()?;
    let instant = INSTANT.iter().map(|table| table.name.to_owned());
    let asked = if asked.is_empty() {
        instant.collect()
    } else {
        asked.to_vec()
    };
    for name in &asked {
        if page(name)?.write(name, &made(name, &counted)?)? {
            told(name);
        }
    }
    Ok(())
}

/// Makes table `name` again.
fn made(name: &str, counted: &Costs) -> Result<String> {
    if let Some(table) = INSTANT.iter().find(|table| table.name == name) {
        return (table.make)(counted);
    }
    let toolchain = Toolchain::find()?;
    let compiler = costs::compiler(&toolchain)?;
    if name == memory::NAME {
        let image = firmware::build(&toolchain, firmware::Image::Product)?;
        return Ok(memory::table_of(&firmware::memory(&image)?, &compiler));
    }
    if name == emulated::NAME {
        let m4 = &compare::play(Processor::CortexM4)?;
        let m7 = &compare::play(Processor::CortexM7)?;
        let compiler = &compiler;
        return Ok(emulated::table_of(&emulated::Runs { m4, m7, compiler }));
    }
    Err(no_table(name))
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
