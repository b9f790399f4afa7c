//! The table of the image's use of each memory.

use super::markdown::{grouped, table};
use crate::firmware::Memory;

/// The table's name.
pub const NAME: &str = "memory";

/// The taken bytes of each memory. `compiler` is the version of the compiler, without its name.
pub fn table_of(memory: &Memory, compiler: &str) -> String {
    let rows = memory.uses().iter().map(|memory| {
        [
            memory.name.to_owned(),
            grouped(memory.used),
            grouped(memory.size),
        ]
    });
    format!(
        "{}\nBuilt by rustc {compiler}.\n",
        table(["memory", "used, bytes", "of"], rows)
    )
}
