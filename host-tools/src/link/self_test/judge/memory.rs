//! Errors that memories have corrected or found.

use model_format::link::{ErrorCorrectionValues, RAM_MONITORS};

use crate::link::self_test::line::Line;

/// Memory of each RAMECC monitor (RM0433 section 3.3).
const MEMORIES: [&str; RAM_MONITORS] = [
    "AXI SRAM", "ITCM", "DTCM", "DTCM", "trace", "SRAM1", "SRAM1", "SRAM2", "SRAM2", "SRAM3",
    "SRAM4", "backup",
];

/// Names of the memories whose monitor has a bit of `bits`.
fn with(ram: &[u8; RAM_MONITORS], bits: u8) -> String {
    let mut names: Vec<&str> = (ram.iter().zip(MEMORIES))
        .filter(|(status, _)| **status & bits != 0)
        .map(|(_, name)| name)
        .collect();
    names.dedup();
    if names.is_empty() {
        "none".to_owned()
    } else {
        names.join(", ")
    }
}

/// Judges the memories.
pub fn memory(values: &ErrorCorrectionValues) -> Vec<Line> {
    let (corrected, failed) = (with(&values.ram, 0b001), with(&values.ram, 0b110));
    let mut lines = vec![
        Line::exact(
            "RAM errors corrected",
            corrected.as_str(),
            "none",
            corrected == "none",
            "restart and test again; if it comes back in the same memory, the chip ages or its supply is disturbed: \
             replace the board",
        ),
        Line::exact(
            "RAM errors not corrected",
            failed.as_str(),
            "none",
            failed == "none",
            "do not use the device: check its supply, restart and test again; if it comes back, replace the board",
        ),
    ];
    for (bank, (corrected, failed)) in (values.flash_corrected.iter())
        .zip(values.flash_failed)
        .enumerate()
    {
        let bank = bank + 1;
        let remedy = match bank {
            1 => "flash the image again; if it comes back, the flash is worn: replace the board",
            _ => {
                "upload the libraries again; if it comes back, the flash is worn: replace the board"
            }
        };
        lines.push(Line::none(
            format!("flash bank {bank} errors corrected"),
            *corrected,
            remedy,
        ));
        lines.push(Line::none(
            format!("flash bank {bank} errors not corrected"),
            failed,
            remedy,
        ));
    }
    lines
}
