//! The silicon's identity, its clocks, flash, memories and option bytes.

use model_format::SAMPLE_RATE_HZ;
use model_format::link::{
    BoardName, ChipValues, ClockCount, ClockValues, DeviceInfo, ErrorCorrectionValues, FlashValues,
    LEAST_BROWN_OUT_LEVEL, OptionByteValues, RAM_MONITORS, SiliconRevision,
};

use crate::procedures::self_test::line::Line;

/// `DEV_ID` of the STM32H742, H743, H753 and H750 (RM0433 section 60.5.8).
const DEVICE: u16 = 0x450;

/// Size of the flash, KB.
const FLASH_KB: u16 = 2048;

/// Judges the silicon of the device that `info` describes.
pub fn chip(values: &ChipValues, info: &DeviceInfo) -> Vec<Line> {
    let revision = SiliconRevision(values.revision);
    // The serial number has the bytes in the order of memory, which is little-endian.
    let [first, second, third] = values.unique_id.map(u32::swap_bytes);
    let serial = format!("{first:08X}{second:08X}{third:08X}");
    vec![
        Line::exact(
            "chip",
            format!("{:#05x}", values.device),
            format!("{DEVICE:#05x}"),
            "the board has another processor: use a board with an STM32H743",
        ),
        Line::judged(
            "silicon revision",
            revision.to_string(),
            SiliconRevision::SUPPORTED,
            revision.is_supported(),
            "for revisions Z and Y the image works around two faults (reads of AXI SRAM, ES0392 2.2.9, and the \
             converter's clock), and nothing else was tested: use a board with revision V",
        ),
        Line::exact(
            "unique id",
            serial.as_str(),
            info.serial.as_str(),
            "the id differs from the serial number of the same device: test again; if it stays, the chip is damaged",
        ),
        Line::number(
            "flash size",
            f64::from(values.flash_kb),
            (f64::from(FLASH_KB), f64::from(FLASH_KB)),
            ("KB", 0),
            "libraries need both banks of 1 MB: use a part whose name ends in I, such as the STM32H743ZI",
        ),
    ]
}

/// Rate of LSI over the whole range of temperature and supply, Hz (DS12110 table 136).
const LOW_SPEED_HZ: (f64, f64) = (29_400.0, 33_600.0);

/// Deviation of the core's clock from the host's frames, ppm: 500 for the host (USB 2.0, section 7.1.12), 50 for the
/// board's crystal, and 200 for the reading.
const USB_PPM: f64 = 750.0;

/// Deviation of a tick from its period, ppm: both come from the same clock, so only the reading deviates.
const TICK_PPM: f64 = 50.0;

/// Returns the frequency of `count`, whose cycles are those of a clock with frequency `hz`.
fn hertz(count: ClockCount, hz: u32) -> f64 {
    f64::from(count.periods) * f64::from(hz) / count.cycles as f64
}

/// Deviation of `value` from `expected`, ppm.
fn ppm(value: f64, expected: f64) -> f64 {
    (value / expected - 1.0) * 1e6
}

/// Judges the clocks of this board.
pub fn clocks(values: &ClockValues, board: BoardName) -> Vec<Line> {
    let [clock, socket] = words(board);
    let low_speed = match values.low_speed {
        Some(count) => Line::number(
            "LSI",
            hertz(count, values.timer_hz),
            LOW_SPEED_HZ,
            ("Hz", 0),
            "LSI or the core's clock is wrong: look at the line of USB; if that one passes, the chip is damaged",
        ),
        None => Line::judged(
            "LSI",
            "no edge",
            format!("{} to {} Hz", LOW_SPEED_HZ.0, LOW_SPEED_HZ.1),
            false,
            "LSI does not run, so neither does the watchdog: restart the device; if it stays, the chip is damaged",
        ),
    };
    let usb = match values.usb_frames {
        Some(count) => Line::number(
            "core against USB",
            // A core that is too fast counts fewer frames per cycle.
            -ppm(hertz(count, values.core_hz), 1_000.0),
            (-USB_PPM, USB_PPM),
            ("ppm", 0),
            &format!("the core does not run from the board's clock: {clock}, and see the clock in `status`"),
        ),
        None => Line::not_measured(
            "core against USB",
            &format!("connect the stylus's own USB ({socket}) to measure it"),
        ),
    };
    let tick = ppm(hertz(values.ticks, values.core_hz), f64::from(SAMPLE_RATE_HZ));
    vec![
        low_speed,
        usb,
        Line::number(
            "ticks against core",
            tick,
            (-TICK_PPM, TICK_PPM),
            ("ppm", 0),
            "the timer and the core have other clocks than the image assumes: flash the image again",
        ),
    ]
}

/// Longest erasure of a sector of 128 KB, ms (DS12110, flash memory programming, parallelism of 8 bits).
const ERASE_MS: f64 = 4_000.0;

/// Longest time to write a word, µs. It is 1 ms, which tasks may take between two checks of the flash, in addition to
/// what DS12110 gives for a parallelism of 8 bits.
const WRITE_US: f64 = 2_000.0;

const WORN: &str = "the flash is slow or worn: check the 3.3 V and test again; if it stays, replace the board";

/// Judges a sector's erasure and writing.
pub fn flash(values: &FlashValues) -> Vec<Line> {
    let slot = values.slot;
    let mean = f64::from(values.write_us) / f64::from(values.words.max(1));
    vec![
        Line::number(
            format!("slot {slot} sector erase"),
            f64::from(values.erase_us) / 1e3,
            (f64::NEG_INFINITY, ERASE_MS),
            ("ms", 1),
            WORN,
        ),
        Line::none(format!("slot {slot} bytes not erased"), values.not_erased, WORN),
        Line::number(
            format!("slot {slot} word write, mean"),
            mean,
            (f64::NEG_INFINITY, WRITE_US),
            ("µs", 0),
            WORN,
        ),
        Line::none(format!("slot {slot} bytes wrong"), values.wrong, WORN),
    ]
}

/// Memory of each RAMECC monitor (RM0433 section 3.3).
const MEMORIES: [&str; RAM_MONITORS] = [
    "AXI SRAM", "ITCM", "DTCM", "DTCM", "trace", "SRAM1", "SRAM1", "SRAM2", "SRAM2", "SRAM3", "SRAM4", "backup",
];

/// Names of the memories whose monitor has a bit of `bits`.
fn with(ram: &[u8; RAM_MONITORS], bits: u8) -> String {
    let mut names: Vec<&str> = (ram.iter().zip(MEMORIES))
        .filter(|(status, _)| **status & bits != 0)
        .map(|(_, name)| name)
        .collect();
    // Memories of two monitors are neighbours in the list.
    names.dedup();
    if names.is_empty() {
        "none".to_owned()
    } else {
        names.join(", ")
    }
}

/// Judges the memories.
pub fn memory(values: &ErrorCorrectionValues) -> Vec<Line> {
    // Bit 0: a corrected error; bits 1 and 2: errors that could not be corrected.
    let (corrected, failed) = (with(&values.ram, 0b001), with(&values.ram, 0b110));
    let mut lines = vec![
        Line::exact(
            "RAM errors corrected",
            corrected.as_str(),
            "none",
            "restart and test again; if it comes back in the same memory, the chip ages or its supply is disturbed: \
             replace the board",
        ),
        Line::exact(
            "RAM errors not corrected",
            failed.as_str(),
            "none",
            "do not use the device: check its supply, restart and test again; if it comes back, replace the board",
        ),
    ];
    for (bank, (corrected, failed)) in (values.flash_corrected.iter()).zip(values.flash_failed).enumerate() {
        let bank = bank + 1;
        let remedy = match bank {
            1 => "flash the image again; if it comes back, the flash is worn: replace the board",
            _ => "upload the libraries again; if it comes back, the flash is worn: replace the board",
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

const SET_THEM: &str = "set the option bytes to the factory's values with STM32CubeProgrammer";

/// Upper half of the flash's address, where the bootloader begins.
const BOOT_ADDRESS: u32 = 0x0800;

/// Returns true if `register`, such as `FLASH_PRAR` or `FLASH_SCAR`, defines an area. It does not if the area's start
/// lies above its end.
fn is_area(register: u32) -> bool {
    let (start, end) = (register & 0xfff, register >> 16 & 0xfff);
    start <= end
}

/// Number of areas of the flash that are protected from reading, or secure.
fn protected_areas(values: &OptionByteValues) -> u64 {
    values
        .read_protected
        .iter()
        .chain(&values.secure)
        .filter(|&&area| is_area(area))
        .count() as u64
}

/// Level of the read protection in `FLASH_OPTSR`.
fn read_protection(status: u32) -> &'static str {
    match status >> 8 & 0xff {
        0xaa => "level 0",
        0xcc => "level 2",
        _ => "level 1",
    }
}

/// Judges the option bytes.
pub fn option_bytes(values: &OptionByteValues) -> Vec<Line> {
    let status = values.status;
    let bit = |number: u32| status >> number & 1 != 0;
    let [first, second] = values.writable_sectors;
    let swapped = values.banks_swapped || bit(31);
    let boot = values.boot & 0xffff;
    let brown_out_level = status >> 2 & 0b11;
    let yes = |yes: bool| if yes { "yes" } else { "no" };
    vec![
        Line::exact(
            "read protection",
            read_protection(status),
            "level 0",
            "the probe cannot read a fault's cause; setting level 0 erases the flash: flash the image again afterwards",
        ),
        Line::number(
            "brown-out level",
            f64::from(brown_out_level),
            (f64::from(LEAST_BROWN_OUT_LEVEL), 3.0),
            ("", 0),
            "the chip would run on with less supply than flash and core need: set BOR_LEV to 3 with \
             STM32CubeProgrammer",
        ),
        Line::exact(
            "watchdog by",
            if bit(4) { "software" } else { "hardware" },
            "software",
            "the hardware starts a watchdog, which resets the device during its start: set IWDG1_SW with \
             STM32CubeProgrammer",
        ),
        Line::exact(
            "banks swapped",
            yes(swapped),
            "no",
            "the image would run from the bank of the libraries: clear SWAP_BANK with STM32CubeProgrammer",
        ),
        Line::exact(
            "writable sectors",
            format!("{first:02x} {second:02x}"),
            "ff ff",
            "settings or libraries cannot be written: remove the write protection with STM32CubeProgrammer",
        ),
        Line::none("protected areas", protected_areas(values), SET_THEM),
        Line::exact(
            "boot address",
            format!("{boot:04x}0000"),
            format!("{BOOT_ADDRESS:04x}0000"),
            SET_THEM,
        ),
        Line::exact(
            "pins for low voltage",
            yes(bit(29)),
            "no",
            "IO_HSLV at 3.3 V damages the chip (RM0433, IO_HSLV): clear it with STM32CubeProgrammer at once",
        ),
    ]
}

/// Returns what helps if the clock of this board does not come, and the socket of its own USB.
pub(super) fn words(board: BoardName) -> [&'static str; 2] {
    let board = stylus_board::named(board.as_str());
    board.map_or(["look at its oscillator", "its socket"], |board| {
        [board.clock.remedy, board.usb]
    })
}
