//! `stylus devices`

use host_tools::link::Route;
use host_tools::link::discovery::{self, Row};
use host_tools::support::error::Result;

use super::connection::sharing;
use crate::cli::output::{note, print, print_json};
use crate::cli::table::table;

#[derive(clap::Args)]
pub struct Arguments {
    /// Print the list as JSON
    #[arg(long)]
    json: bool,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let rows = discovery::rows(&Route::Shared(sharing()?))?;
    if arguments.json {
        return print_json(&rows);
    }
    if rows.is_empty() {
        note(
            "nothing is attached: plug a stylus in, or start a virtual one with `cargo virtual-stylus`",
        );
        return Ok(());
    }
    let header = [
        "--link",
        "kind",
        "serial number",
        "firmware",
        "probe",
        "state",
    ];
    let text = |value: &Option<String>| value.clone().unwrap_or_else(|| "-".to_owned());
    let cells = |row: &Row| {
        vec![
            row.link.clone(),
            row.kind.to_string(),
            text(&row.serial_number),
            text(&row.firmware),
            text(&row.probe),
            row.state.clone(),
        ]
    };
    let rows: Vec<Vec<String>> = rows.iter().map(cells).collect();
    print(&table(&header, &rows))
}
