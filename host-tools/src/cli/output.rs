//! Text and JSON on standard output.

use std::io::{self, Write};
use std::path::Path;

use host_tools::support::error::{Error, Result};

/// Prints to standard output. `println!` would panic if the reader has closed it.
pub fn print(text: &str) -> Result<()> {
    let mut output = io::stdout().lock();
    output
        .write_all(text.as_bytes())
        .and_then(|()| output.write_all(b"\n"))
        .map_err(Error::io("write to", Path::new("standard output")))
}

/// Prints a value as JSON.
pub fn print_json(value: &impl serde::Serialize) -> Result<()> {
    print(&to_json(value))
}

/// Formats a value as JSON.
pub fn to_json(value: &impl serde::Serialize) -> String {
    serde_json::to_string_pretty(value).expect("reports have text keys only")
}
