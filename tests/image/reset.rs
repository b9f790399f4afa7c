//! The time from each kind of reset to the first tick: the pins of the output, and stores to RAM.

use hil::checks::faults::Injected;
use stylus_boot::map::{ACTIVE, FLASH};
use virtual_stylus::model::dac::{Cause, Output};
use virtual_stylus::model::pin::Drive;
use virtual_stylus::{Options, ResetCause};

use crate::device::{Device, MID_SCALE, MS, inject, product, with_faults};
use crate::library;

/// Longest time for which the pins of the output float after a reset, ns: a hundred instructions, before RAM is filled.
const FLOATING_NS: u64 = 500;

/// An action that resets the device.
type Reset<'a> = &'a dyn Fn(&mut Device);

impl Device {
    /// Checks both pins of the output from the last reset until now, if nothing was played since. They float for a
    /// moment. Then the amplifier's enable is low until it is raised, and the output is at mid-scale. Returns the
    /// instant of the reset.
    pub fn assert_held_since_reset(&mut self) -> u64 {
        let reset_ns = self.stylus.resets().last().map_or(0, |reset| reset.at_ns);
        let outputs: Vec<Output> = (self.dac().iter())
            .filter(|output| output.at_ns >= reset_ns)
            .skip_while(|output| output.cause != Cause::Enabled)
            .copied()
            .collect();
        let driven = outputs.first().expect("the output is driven");
        assert!(driven.at_ns <= reset_ns + FLOATING_NS, "{driven:?}");
        let other = (outputs.iter()).find(|output| output.code != Some(MID_SCALE));
        assert_eq!(other, None, "after the reset at {reset_ns}");
        let mut changes = self
            .amplifier()
            .into_iter()
            .filter(|change| change.at_ns >= reset_ns)
            .skip_while(|change| change.drive == Drive::Floating);
        let off = changes.next().expect("the amplifier is held off");
        assert_eq!(off.drive, Drive::Low);
        assert!(off.at_ns <= reset_ns + FLOATING_NS, "{off:?}");
        let next = changes.next();
        assert!(next.is_none_or(|next| next.drive == Drive::High), "{next:?}");
        reset_ns
    }
}

#[test]
fn after_each_kind_of_reset_both_pins_of_the_output_are_driven_before_ram_is_written() {
    let mut device = Device::new(&with_faults(), Options::default());
    let resets: [(&str, Reset<'_>); 4] = [
        ("power on", &|_| {}),
        ("software", &|device| inject(device, Injected::Panic)),
        ("watchdog", &|device| inject(device, Injected::EndlessTask)),
        ("pin", &|device| device.stylus.reset_by_pin()),
    ];
    for (name, reset) in resets {
        reset(&mut device);
        device.run_for(500 * MS);
        let refused = device.stylus.refused_stores();
        assert_eq!(refused.first(), None, "{name}: {} stores", refused.len());
        device.forget_frames();
        device.wait_for_start();
        let reset_ns = device.assert_held_since_reset();
        let ticks = device.stylus.take_ticks();
        assert!(ticks.iter().any(|tick| tick.at_ns > reset_ns), "{name}");
    }
    let causes = [ResetCause::Software, ResetCause::Watchdog, ResetCause::Other];
    assert_eq!(device.resets(), causes);
}

#[test]
fn an_image_that_a_probe_starts_without_its_bootloader_drives_both_pins_before_it_writes_ram() {
    let mut flash = Device::new(&product(), Options::default()).stylus.flash();
    // The part loads its stack pointer and the address of its first instruction from here.
    let vectors = flash.bytes[ACTIVE.start as usize..][..8].to_vec();
    flash.place(u64::from(FLASH), &vectors).expect("it is in the flash");
    let mut device = Device::new(&product(), library::after(flash));
    device.wait_for_start();
    assert_eq!(device.stylus.refused_stores(), [0; 0]);
    device.assert_held_since_reset();
}
