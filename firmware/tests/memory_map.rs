//! `memory.x` against the processor's manual and the constants of the code.

use std::collections::BTreeMap;
use std::fs;
use std::ops::Range;
use std::path::Path;

use model_format::limits::{MAX_LIBRARY_BYTES, SLOT_BYTES};
use stylus_app::settings::SETTINGS_RANGE;
use stylus_boot::map;

/// The regions of the MPU, as the image sets them.
#[path = "../realtime/src/boot/protection.rs"]
mod protection;

use protection::{Access, Memory, REGIONS, Region};

const BANK_1: Range<u64> = 0x0800_0000..0x0810_0000;
const BANK_2: Range<u64> = 0x0810_0000..0x0820_0000;

/// The regions of `memory.x` by name, as ranges of addresses.
fn regions() -> BTreeMap<String, Range<u64>> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../memory.x");
    let text = fs::read_to_string(path).expect("memory.x is there");
    let regions: BTreeMap<_, _> = text.lines().filter_map(region).collect();
    assert_eq!(
        regions.len(),
        text.matches("ORIGIN = ").count(),
        "each region is on a line of its own, with a name of its own"
    );
    regions
}

/// Name and range of a line `NAME (attributes) : ORIGIN = number, LENGTH = number`.
fn region(line: &str) -> Option<(String, Range<u64>)> {
    let (head, rest) = line.split_once(": ORIGIN = ")?;
    let (origin, rest) = rest.split_once(", LENGTH = ")?;
    let name = head.split_whitespace().next()?;
    let (origin, length) = (number(origin)?, number(rest.split_whitespace().next()?)?);
    Some((name.to_owned(), origin..origin + length))
}

fn number(text: &str) -> Option<u64> {
    if let Some(digits) = text.strip_prefix("0x") {
        u64::from_str_radix(digits, 16).ok()
    } else if let Some(kilobytes) = text.strip_suffix('K') {
        Some(kilobytes.parse::<u64>().ok()? * 1024)
    } else {
        text.parse().ok()
    }
}

fn contains(outer: &Range<u64>, inner: &Range<u64>) -> bool {
    outer.start <= inner.start && inner.end <= outer.end
}

#[test]
fn regions_do_not_overlap() {
    let mut regions: Vec<_> = regions().into_iter().collect();
    regions.sort_by_key(|(_, range)| range.start);
    for pair in regions.windows(2) {
        assert!(pair[0].1.end <= pair[1].1.start, "{pair:x?}");
    }
}

#[test]
fn each_region_is_memory_that_the_part_of_every_board_has() {
    for board in stylus_board::ALL {
        // Both lines are one die; I stands for 2 MB of flash (DS12110 and DS12117, ordering information).
        let is_known = ["stm32h743", "stm32h753"]
            .iter()
            .any(|line| board.part.starts_with(line));
        assert!(is_known && board.part.ends_with('i'), "{}", board.name);
    }
    let memories = [
        0x0000_0000..0x0001_0000,
        BANK_1,
        BANK_2,
        0x2000_0000..0x2002_0000,
        0x2400_0000..0x2408_0000,
        0x3000_0000..0x3004_8000,
        0x3800_0000..0x3801_0000,
        0x3880_0000..0x3880_1000,
    ];
    for (name, region) in regions() {
        let inside = memories.iter().any(|memory| contains(memory, &region));
        assert!(inside && !region.is_empty(), "{name}: {region:x?}");
    }
}

#[test]
fn what_the_flash_holds_lies_where_image_and_bootloader_look_for_it() {
    let regions = regions();
    let first_end = map::RECORDS.start + map::SECTOR_BYTES as u32;
    let expected = [
        ("BOOTLOADER", map::BOOTLOADER),
        ("FLASH", map::ACTIVE),
        ("RECORDS_1", map::RECORDS.start..first_end),
        ("RECORDS_2", first_end..map::RECORDS.end),
        ("SETTINGS", SETTINGS_RANGE),
        ("SLOT_A", map::SLOTS[0].clone()),
        ("SLOT_B", map::SLOTS[1].clone()),
    ];
    for (name, offsets) in expected {
        let expected = [offsets.start, offsets.end].map(|offset| u64::from(map::FLASH + offset));
        let region = &regions[name];
        assert_eq!([region.start, region.end], expected, "{name}");
    }
    // The exchange of images takes a sector more than an image.
    let lengths = [map::ACTIVE, map::SLOTS[0].clone()].map(|range| range.len());
    assert!(lengths[0] + map::SECTOR_BYTES <= lengths[1] && lengths[1] == SLOT_BYTES);
}

#[test]
fn nothing_lies_below_the_stack() {
    const DTCM_START: u64 = 0x2000_0000;
    let regions = regions();
    assert_eq!(regions["STACK"].start, DTCM_START);
    assert_eq!(regions["STACK"].end, regions["KEPT"].start);
    assert_eq!(regions["KEPT"].end, regions["RAM"].start);
}

#[test]
fn a_library_that_is_played_fits_the_axi_sram() {
    let memory = &regions()["AXISRAM"];
    assert!(memory.end - memory.start >= MAX_LIBRARY_BYTES as u64);
}

/// The region of the MPU that holds for `address`: the last one around it.
fn protecting(address: u64) -> Region {
    let around = |region: &&Region| {
        let start = u64::from(region.start);
        (start..start + (1 << region.length_log2)).contains(&address)
    };
    *REGIONS
        .iter()
        .rev()
        .find(around)
        .expect("the first region is everywhere")
}

/// Access, execution and memory of all of `range`.
fn protection_of(range: &Range<u64>) -> (Access, bool, Memory) {
    let of = |address| {
        let Region {
            access,
            executable,
            memory,
            ..
        } = protecting(address);
        (access, executable, memory)
    };
    let first = of(range.start);
    assert!(
        range.clone().step_by(1024).all(|address| of(address) == first),
        "{range:x?}"
    );
    first
}

#[test]
fn regions_of_the_mpu_are_such_as_it_has() {
    assert!(REGIONS.len() <= 16);
    for region in REGIONS {
        assert!((5..=32).contains(&region.length_log2), "{region:x?}");
        let length = 1u64 << region.length_log2;
        assert!(u64::from(region.start).is_multiple_of(length), "{region:x?}");
        // SIZE is the binary logarithm less one (ARM DDI 0403E, B3.5.9).
        assert_eq!(region.attributes() >> 1 & 0x1F, region.length_log2 - 1);
    }
}

#[test]
fn attributes_are_those_of_the_architecture() {
    let attributes = |access, executable, memory| {
        let region = Region {
            start: 0,
            length_log2: 5,
            access,
            executable,
            memory,
        };
        region.attributes() & !0x3F
    };
    // Fields of RASR: XN 28, AP 26:24, TEX 21:19, S 18, C 17, B 16 (ARM DDI 0403E, B3.5.9, tables B3-13 and B3-15).
    assert_eq!(attributes(Access::Nothing, false, Memory::StronglyOrdered), 0x1000_0000);
    assert_eq!(attributes(Access::ReadWrite, false, Memory::Device), 0x1305_0000);
    assert_eq!(attributes(Access::ReadWrite, false, Memory::NotCached), 0x1308_0000);
    assert_eq!(
        attributes(Access::ReadWrite, false, Memory::NotCachedShareable),
        0x130C_0000
    );
    assert_eq!(attributes(Access::Read, true, Memory::WriteBack), 0x060B_0000);
}

#[test]
fn nothing_can_be_both_written_and_executed() {
    for region in REGIONS {
        assert!(
            !(region.executable && region.access == Access::ReadWrite),
            "{region:x?}"
        );
    }
}

#[test]
fn each_memory_is_protected_as_its_use_wants() {
    use Access::{Nothing, Read, ReadWrite};
    use Memory::{Device, NotCached, NotCachedShareable, StronglyOrdered, WriteBack};
    let map = regions();
    let expected = [
        ("FLASH", (Read, true, WriteBack)),
        ("BOOTLOADER", (Read, true, WriteBack)),
        ("RECORDS_1", (ReadWrite, false, NotCached)),
        ("RECORDS_2", (ReadWrite, false, NotCached)),
        ("SETTINGS", (ReadWrite, false, NotCached)),
        ("SLOT_A", (ReadWrite, false, NotCached)),
        ("SLOT_B", (ReadWrite, false, NotCached)),
        ("STACK", (ReadWrite, false, NotCached)),
        ("KEPT", (ReadWrite, false, NotCached)),
        ("RAM", (ReadWrite, false, NotCached)),
        ("AXISRAM", (ReadWrite, false, WriteBack)),
        ("SRAM4", (ReadWrite, false, WriteBack)),
        ("BKPSRAM", (Nothing, false, StronglyOrdered)),
    ];
    for (name, protection) in expected {
        assert_eq!(protection_of(&map[name]), protection, "{name}");
    }
    let ranges = [
        // The part of ITCM that `tick.x` leaves free, and the code.
        (0x0000_0000..0x0000_0400, (Nothing, false, StronglyOrdered)),
        (0x0000_0400..0x0001_0000, (Read, true, NotCached)),
        // The megabyte below the stack, except the device's identity.
        (0x1FF2_0000..0x2000_0000, (Nothing, false, StronglyOrdered)),
        (0x1FF1_E800..0x1FF1_F000, (Read, false, NotCached)),
        // SRAM 1, for DMA.
        (0x3000_0000..0x3002_0000, (ReadWrite, false, NotCachedShareable)),
        (0x4000_0000..0x6000_0000, (ReadWrite, false, Device)),
        // External memory.
        (0x6000_0000..0xA000_0000, (Nothing, false, StronglyOrdered)),
    ];
    for (range, protection) in ranges {
        assert_eq!(protection_of(&range), protection, "{range:x?}");
    }
}
