//! Checks every register that the image touches against two descriptions: stm32-data (crate stm32-metapac), and ST's
//! own SVD file, from which the crate rigless and so the models have their names, offsets and bits.

use std::collections::BTreeMap;

use model_format::link::{SelfTestEndpoint, SelfTestRequest, Setting};
use rigless::mcu::{Mcu, Operate};
use rigless::soc::Width;
use rigless::time::VirtualNanos;
use stm32_metapac::metadata::ir::{Array, BitOffset, BlockItemInner, IR};
use stm32_metapac::metadata::{METADATA, Peripheral};
use virtual_stylus::Options;
use virtual_stylus::model::usb;

use crate::device::{Device, MS, product};
use crate::library;

/// Peripherals on the buses. Neither description contains the core's own registers.
const PERIPHERALS: std::ops::Range<u64> = 0x4000_0000..0x6000_0000;

const USB: std::ops::Range<u64> = usb::BASE..usb::BASE + usb::BYTES;

/// The USB core that the SVD file describes. The core that the image uses has the same registers (RM0433 section
/// 57.14).
const OTHER_USB: u64 = 0x4004_0000;

/// A register as one of the sources describes it.
#[derive(Clone, Debug, Default, PartialEq)]
struct Described {
    name: String,
    /// Bits of the register's fields.
    fields: u64,
    /// Value after a reset; 0 if the source does not state one.
    reset: u64,
    /// Value in the emulator as the power comes on.
    emulated: u64,
}

/// A name without capitals and underscores, which differ between the sources.
fn plain(name: &str) -> String {
    name.replace('_', "").to_lowercase()
}

/// Collects the registers of a block and of the blocks within it, by offset.
fn block(ir: &IR, name: &str, at: u64, found: &mut BTreeMap<u64, Described>) {
    let block_of = (ir.blocks.iter()).find(|block| plain(block.name) == plain(name));
    let described = block_of.expect("a block of this name");
    if let Some(parent) = described.extends {
        block(ir, parent, at, found);
    }
    for item in described.items {
        for start in places(item.array.as_ref()) {
            let at = at + u64::from(item.byte_offset) + start;
            match &item.inner {
                BlockItemInner::Block(inner) => block(ir, inner.block, at, found),
                BlockItemInner::Register(register) => {
                    let all = u64::MAX >> (64 - register.bit_size);
                    let fields = register.fieldset.map_or(all, |name| fields(ir, name));
                    let shift = 8 * (at & 3);
                    let entry = found.entry(at & !3).or_default();
                    item.name.clone_into(&mut entry.name);
                    entry.fields |= fields << shift;
                }
            }
        }
    }
}

fn places(array: Option<&Array>) -> Vec<u64> {
    match array {
        None => vec![0],
        Some(Array::Regular(array)) => (0..array.len).map(|n| u64::from(n * array.stride)).collect(),
        Some(Array::Cursed(array)) => array.offsets.iter().map(|&offset| offset.into()).collect(),
    }
}

fn fields(ir: &IR, name: &str) -> u64 {
    let set = (ir.fieldsets.iter()).find(|set| plain(set.name) == plain(name));
    let set = set.unwrap_or_else(|| panic!("a field set {name}"));
    let mut bits = set.extends.map_or(0, |parent| fields(ir, parent));
    for field in set.fields {
        for start in places(field.array.as_ref()) {
            match &field.bit_offset {
                BitOffset::Regular(at) => {
                    bits |= (u64::MAX >> (64 - field.bit_size)) << (u64::from(at.offset) + start);
                }
                BitOffset::Cursed(at) => {
                    for bit in at.ranges.iter().cloned().flatten() {
                        bits |= 1 << (u64::from(bit) + start);
                    }
                }
            }
        }
    }
    bits
}

/// Registers by address, from stm32-data. Several peripherals at one address, such as the kinds of a timer, are merged.
fn stm32_data() -> BTreeMap<u64, Described> {
    let mut all = BTreeMap::new();
    for Peripheral {
        name,
        address,
        registers,
        ..
    } in METADATA.peripherals
    {
        let Some(registers) = registers else { continue };
        let mut found = BTreeMap::new();
        block(registers.ir, registers.block, 0, &mut found);
        for (offset, register) in found {
            let name = format!("{name} {}", register.name);
            all.insert(address + offset, Described { name, ..register });
        }
    }
    all
}

/// The register at `address` in the SVD file. The file describes only one of the two USB cores, so the addresses of the
/// image's core are translated.
fn svd(part: &impl Mcu, address: u64) -> Option<Described> {
    let address = if USB.contains(&address) {
        address - usb::BASE + OTHER_USB
    } else {
        address
    };
    let slot = &part.bus().slots()[part.bus().slot_at(address)?];
    let peripheral = slot.peripheral();
    let offset = (address - peripheral.base) as u32;
    let words = peripheral.registers.iter();
    let mut described: Option<Described> = None;
    for register in words.filter(|register| register.offset & !3 == offset) {
        let shift = 8 * (register.offset & 3);
        let entry = described.get_or_insert_with(Described::default);
        entry.name = format!("{} {}", peripheral.name, register.name);
        let fields = register.fields.iter().map(rigless::soc::FieldSpec::mask);
        entry.fields |= fields.fold(0, |all, mask| all | mask) << shift;
        entry.reset |= register.reset << shift;
    }
    described
}

/// Registers that the image touches when it does everything that it can (a start, both links, settings, a library, a
/// recording, a texture and the self test), and the SVD file's description of these registers.
fn touched() -> (BTreeMap<u64, u64>, BTreeMap<u64, Described>) {
    let mut device = Device::on_usb(Options {
        note_registers: true,
        ..library::options()
    });
    device.set(Setting::SoftStart, 100.0);
    device.upload(&library::other());
    for request in [
        SelfTestRequest::Chip,
        SelfTestRequest::OptionBytes,
        SelfTestRequest::Clocks,
        SelfTestRequest::ErrorCorrection,
        SelfTestRequest::Output { disconnected: true },
        SelfTestRequest::Encoder,
    ] {
        device.request::<SelfTestEndpoint>(&request).expect("nothing is played");
    }
    device.record();
    device.move_at(120.0);
    device.play_until_heard("lattice");
    device.run_for(100 * MS);
    let noted = device.stylus.board(|board| board.touched.noted());
    let addresses: Vec<u64> = noted.range(PERIPHERALS).map(|(&at, _)| at).collect();
    let described = Device::new(&product(), Options::default()).stylus.board(move |board| {
        let mut described = BTreeMap::new();
        for at in addresses {
            if let Some(register) = svd(&board.part, at) {
                let window = USB.contains(&at).then(|| at - usb::BASE + usb::WINDOW_BASE);
                let value = board.part.peek(VirtualNanos(0), window.unwrap_or(at), Width::W32);
                let emulated = value.unwrap_or(register.reset);
                described.insert(at, Described { emulated, ..register });
            }
        }
        described
    });
    (noted, described)
}

/// Known differences: how the text of each begins, and why it is no error of the image or the models.
const KNOWN: [(&str, &str); 11] = [
    (
        "TIM2 sr: bits",
        "embassy clears a flag with ones in all other bits, which change nothing",
    ),
    (
        "ADC1 cr: bits 0x200",
        "BOOST has two bits since revision X, and one in the SVD",
    ),
    ("USB_OTG_FS gintsts: bits", "embassy clears all flags with ones"),
    (
        "USB_OTG_FS hwcfg4: not in SVD",
        "embassy reads what only the core's vendor describes",
    ),
    (
        "USB_OTG_FS dieptsiz: bits",
        "embassy sets the packets per frame of endpoint 0, which has none",
    ),
    (
        "USB_OTG_FS fifo: not in SVD",
        "the windows of the FIFOs are no registers there",
    ),
    ("RAMECC", "only the SVD has these monitors"),
    (
        "RCC rsr: bits",
        "a flag of parts with two cores, written back as it was read",
    ),
    ("RCC ahb1lpenr: bits", "the same, a clock"),
    ("RCC apb1llpenr: bits", "the same, a clock"),
    (
        "PWR cr3: bits",
        "written back as it was read: 0x46 after power-on (RM0433 section 6.8.4)",
    ),
];

/// Registers whose value at power-on agrees with the manual in the emulator, but not in the SVD file. The file has
/// zeros for many, and the values of another port or core for others.
const KNOWN_STARTS: [(&str, &str); 8] = [
    ("TIM", "arr"),
    ("ADC", "cr cfgr"),
    (
        "USB_OTG_FS",
        "gotgctl gusbcfg grstctl gintsts hnptxfsiz cid dieptxf dctl dsts diepctl dtxfsts diepint doepint",
    ),
    ("FLASH", "cr optcr optsr_cur prar_cur scar_cur wpsn_curr boot_curr"),
    ("GPIO", "moder ospeedr pupdr idr"),
    ("RCC", "cr rsr apb4enr ahb1lpenr ahb2lpenr apb1llpenr"),
    ("PWR", "cr3 d3cr"),
    ("DBGMCU", "idc"),
];

fn is_known_start(name: &str) -> bool {
    let (peripheral, register) = name.split_once(' ').unwrap_or((name, ""));
    (KNOWN_STARTS.iter())
        .any(|(prefix, names)| peripheral.starts_with(prefix) && names.split(' ').any(|known| known == register))
}

#[test]
fn every_register_and_bit_that_the_image_writes_is_in_both_descriptions() {
    let first = stm32_data();
    let (touched, second) = touched();
    let mut differences = Vec::new();
    let mut compared = 0;
    for (&address, &ones) in touched.range(PERIPHERALS) {
        let (data, svd) = (first.get(&address), second.get(&address));
        let name = data.or(svd).map_or("none", |register| &register.name);
        let reset = svd.map_or(0, |register| register.reset);
        compared += 1;
        for (source, register) in [("stm32-data", data), ("SVD", svd)] {
            let Some(register) = register else {
                differences.push(format!("{name}: not in {source}"));
                continue;
            };
            let undeclared = ones & !reset & !register.fields;
            if undeclared != 0 {
                differences.push(format!("{name}: bits {undeclared:#x} not in {source}"));
            }
        }
        if let Some(svd) = svd {
            let differs = svd.emulated != svd.reset;
            let (emulated, reset) = (svd.emulated, svd.reset);
            assert!(
                !differs || is_known_start(name),
                "{name} starts as {emulated:#x}, in the SVD as {reset:#x}"
            );
        }
    }
    for (known, why) in KNOWN {
        let before = differences.len();
        differences.retain(|difference| !difference.starts_with(known));
        assert!(differences.len() < before, "{known} is no difference any more: {why}");
    }
    assert!(compared > 200, "{compared}");
    assert_eq!(differences, [""; 0]);
}
