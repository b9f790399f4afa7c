//! The table of what the image takes of each memory.

use super::markdown::{grouped, table};
use crate::firmware::Memory;

/// The table's name.
pub const NAME: &str = "memory";

/// Bytes of each memory that `memory` takes, as built by `compiler`, without the name of it.
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
