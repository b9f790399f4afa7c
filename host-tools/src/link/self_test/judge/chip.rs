//! Identity of the silicon.

use model_format::link::{ChipValues, DeviceInfo, SiliconRevision};

use crate::link::self_test::line::Line;

/// `DEV_ID` of the STM32H742, H743, H753 and H750 (RM0433 section 60.5.8).
const DEVICE: u16 = 0x450;

/// Size of the flash of the STM32H743ZI, KB.
const FLASH_KB: u16 = 2048;

/// Judges the silicon of the device that `info` describes.
pub fn chip(values: &ChipValues, info: &DeviceInfo) -> Vec<Line> {
    let revision = SiliconRevision(values.revision);
    let [first, second, third] = values.unique_id.map(u32::swap_bytes);
    let serial = format!("{first:08X}{second:08X}{third:08X}");
    vec![
        Line::exact(
            "chip",
            format!("{:#05x}", values.device),
            format!("{DEVICE:#05x}"),
            values.device == DEVICE,
            "the board has another processor: use a NUCLEO-H743ZI2",
        ),
        Line::exact(
            "silicon revision",
            revision.to_string(),
            SiliconRevision::SUPPORTED,
            revision.is_supported(),
            "on revisions Z and Y the image works round the reads of AXI SRAM (ES0392 2.2.9) and the converter's other \
             clock, and nothing else was tested: use a board with revision V",
        ),
        Line::exact(
            "unique id",
            serial.as_str(),
            info.serial.as_str(),
            serial == info.serial.as_str(),
            "the id differs from the serial number of the same device: test again; if it stays, the chip is damaged",
        ),
        Line::number(
            "flash size",
            f64::from(values.flash_kb),
            (f64::from(FLASH_KB), f64::from(FLASH_KB)),
            ("KB", 0),
            "libraries need both banks of 1 MB: use an STM32H743ZI",
        ),
    ]
}
