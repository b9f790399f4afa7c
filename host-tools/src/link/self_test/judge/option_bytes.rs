//! Option bytes (RM0433 section 4.4).

use model_format::link::{LEAST_BROWN_OUT_LEVEL, OptionByteValues};

use crate::link::self_test::line::Line;

const SET_THEM: &str = "set the option bytes to the factory's values with STM32CubeProgrammer";

/// Upper half of the flash's address, where the image begins.
const BOOT_ADDRESS: u32 = 0x0800;

/// An area from its start to its end, as `FLASH_PRAR` and `FLASH_SCAR` hold it: none if the start lies above the end.
fn is_area(register: u32) -> bool {
    let (start, end) = (register & 0xfff, register >> 16 & 0xfff);
    start <= end
}

/// Judges the option bytes.
pub fn option_bytes(values: &OptionByteValues) -> Vec<Line> {
    let status = values.status;
    let bit = |number: u32| status >> number & 1 != 0;
    let protection = status >> 8 & 0xff;
    let level = match protection {
        0xaa => "level 0",
        0xcc => "level 2",
        _ => "level 1",
    };
    let sectors = values.writable_sectors;
    let areas = (values.read_protected.iter())
        .chain(&values.secure)
        .filter(|&&area| is_area(area))
        .count();
    let swapped = values.banks_swapped || bit(31);
    let boot = values.boot & 0xffff;
    let brown_out_level = status >> 2 & 0b11;
    let hexadecimal = |[first, second]: [u8; 2]| format!("{first:02x} {second:02x}");
    let yes = |yes: bool| if yes { "yes" } else { "no" };
    vec![
        Line::exact(
            "read protection",
            level,
            "level 0",
            protection == 0xaa,
            "the probe cannot read a fault's cause; setting level 0 erases the flash: flash the image again afterwards",
        ),
        Line::number(
            "brown-out level",
            f64::from(brown_out_level),
            (f64::from(LEAST_BROWN_OUT_LEVEL), 3.0),
            ("", 0),
            "the part runs on below the supply that flash and core need: set BOR_LEV to 3 with STM32CubeProgrammer",
        ),
        Line::exact(
            "watchdog by",
            if bit(4) { "software" } else { "hardware" },
            "software",
            bit(4),
            "a watchdog by hardware resets the device in its start: set IWDG1_SW with STM32CubeProgrammer",
        ),
        Line::exact(
            "banks swapped",
            yes(swapped),
            "no",
            !swapped,
            "the image would run from the bank of the libraries: clear SWAP_BANK with STM32CubeProgrammer",
        ),
        Line::exact(
            "writable sectors",
            hexadecimal(sectors),
            "ff ff",
            sectors == [0xff; 2],
            "settings or libraries cannot be written: remove the write protection with STM32CubeProgrammer",
        ),
        Line::none("protected areas", areas as u64, SET_THEM),
        Line::exact(
            "boot address",
            format!("{boot:04x}0000"),
            format!("{BOOT_ADDRESS:04x}0000"),
            boot == BOOT_ADDRESS,
            SET_THEM,
        ),
        Line::exact(
            "pins for low voltage",
            yes(bit(29)),
            "no",
            !bit(29),
            "IO_HSLV at 3.3 V damages the chip (RM0433, IO_HSLV): clear it with STM32CubeProgrammer at once",
        ),
    ]
}
