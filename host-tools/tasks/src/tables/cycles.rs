//! The table of cycles that a board's own counter measured.

use std::io::ErrorKind;
use std::path::Path;

use stylus_costs::cycles::MeasuredCycles;

use super::markdown::{grouped, range, table};
use super::page::PageError;
use crate::error::{Error, Result};

/// The table's name.
pub const NAME: &str = "cycles";

/// The file that `cargo tasks hil --cycles` writes for a board, from the workspace's folder.
pub const FILE: &str = "firmware/cycles.json";

/// The words in place of the table while there is no board's file.
const NO_BOARD: &str = "**No board has been measured.** Where a page counts two cycles per instruction, that is an \
                        assumption.\n";

/// The table of the file `path`, or the words that no board has been measured: without the file, and with a file of an
/// emulated processor, whose figures are no board's.
///
/// # Errors
/// The file cannot be read, or is none of cycles.
pub fn of_a_board(path: &Path) -> Result<String> {
    let read = |source| PageError::Io {
        path: path.to_owned(),
        source,
    };
    let text = match std::fs::read_to_string(path) {
        Ok(text) => text,
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(NO_BOARD.to_owned()),
        Err(error) => return Err(read(error).into()),
    };
    let measured = serde_json::from_str(&text).map_err(|error| Error::Cycles {
        path: path.to_owned(),
        problem: error.to_string(),
    })?;
    Ok(table_of(&measured))
}

fn table_of(measured: &MeasuredCycles) -> String {
    let MeasuredCycles { device, rows } = measured;
    if device.emulated {
        return NO_BOARD.to_owned();
    }
    let lines = rows.iter().map(|row| {
        [
            row.what.clone(),
            range(row.tick_shortest.into(), row.tick_longest.into()),
            range(row.update_shortest.into(), row.update_longest.into()),
        ]
    });
    let header = ["played", "tick, cycles", "update with its ticks, cycles"];
    format!(
        "{}\nMeasured on {} on board {}, silicon revision {}, at {} Hz, firmware {} ({}).\n",
        table(header, lines),
        device.date,
        device.serial,
        device.revision,
        grouped(device.core_hz.into()),
        device.firmware_version,
        device.build
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use stylus_costs::cycles::{CycleRow, MeasuredDevice};

    fn measured(emulated: bool) -> MeasuredCycles {
        MeasuredCycles {
            device: MeasuredDevice {
                serial: "0011".to_owned(),
                emulated,
                revision: "V".to_owned(),
                core_hz: 400_000_000,
                firmware_version: "0.1.0".to_owned(),
                build: "release, rustc 1.95.0".to_owned(),
                date: "2027-01-02".to_owned(),
            },
            rows: vec![CycleRow {
                what: "idle".to_owned(),
                ticks: 5_000,
                tick_shortest: 411,
                tick_longest: 623,
                updates: 500,
                update_shortest: 900,
                update_longest: 2_100,
            }],
        }
    }

    #[test]
    fn a_board_is_shown_with_its_serial_number_clock_and_build() {
        let text = table_of(&measured(false));
        for part in [
            "| idle | 411",
            "623",
            "0011",
            "400 000 000 Hz",
            "rustc 1.95.0",
            "2027-01-02",
        ] {
            assert!(text.contains(part), "{part}: {text}");
        }
        assert!(!text.contains("No board"));
    }

    #[test]
    fn an_emulated_processor_is_never_shown_as_a_board() {
        assert_eq!(table_of(&measured(true)), NO_BOARD);
    }

    #[test]
    fn without_a_file_the_page_says_that_no_board_was_measured() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let path = folder.path().join("cycles.json");
        assert_eq!(of_a_board(&path).expect("it is no fault"), NO_BOARD);
        std::fs::write(&path, "{}").expect("it is written");
        let error = of_a_board(&path).expect_err("it is no file of cycles");
        assert!(error.to_string().contains("cycles.json"), "{error}");
    }
}
