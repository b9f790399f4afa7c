//! The time from each kind of reset to the first tick: the pins of the output, and stores to RAM; and faults on
//! request, and how each one ends. The table of faults is shared with the tests for a real board, which can see only
//! the status.

use hil::checks::faults::{ENDING, Ending, Injected};
use model_format::link::{ResetReason, Setting};
use stylus_boot::map::{ACTIVE, FLASH};
use virtual_stylus::model::dac::{Cause, Output};
use virtual_stylus::model::pins::Drive;
use virtual_stylus::{Options, ResetCause};

use crate::device::{Device, MID_SCALE, MS, inject, long, product, with_faults};
use crate::library;
use crate::output::amplifier_follows_the_output;

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

/// Time for the request on the line, for filling a stack, and until either the handler runs or the output has no more
/// codes.
const CAUGHT_NS: u64 = 5 * MS;
/// Longest time until the watchdog's reset: its period with the tolerance of its clock, and the 20 ms between two
/// feeds.
const WATCHDOG_NS: u64 = 130 * MS;

/// A device that plays a texture.
fn playing() -> Device {
    let mut device = Device::with_faults(library::options());
    device.move_at(120.0);
    device.play_until_heard("lattice");
    device.run_for(100 * MS);
    device
}

/// Injects a fault. It must end in one reset with the wanted reason. The output must reach mid-scale in time, and stay
/// there until and after the reset.
fn ends(wanted: &Ending) {
    let Ending { name, fault, .. } = wanted;
    let (cause, silent_ns) = match (wanted.reason, fault) {
        // Without the tick, the output's timer and DMA reach codes of mid-scale by themselves. An endless task is the
        // only fault here that leaves the tick running.
        (ResetReason::Watchdog, Injected::EndlessTask) => (ResetCause::Watchdog, WATCHDOG_NS),
        (ResetReason::Watchdog, _) => (ResetCause::Watchdog, CAUGHT_NS),
        _ => (ResetCause::Software, CAUGHT_NS),
    };
    let mut device = playing();
    let injected = device.stylus.now_ns();
    inject(&mut device, *fault);
    device.keep_alive(false);
    device.run_for(if cause == ResetCause::Watchdog { 700 } else { 200 } * MS);
    assert_eq!(device.resets(), [cause], "{name}");
    device.wait_for_start();
    let status = device.status();
    assert_eq!(status.reset, wanted.reason, "{name}");
    let told = status.fault.expect("it has a kind");
    assert!(wanted.explains(&told), "{name}: {told:x?}");
    let late = device.sounds_in(injected + silent_ns..);
    assert_eq!(late, 0, "{name}: codes other than mid-scale");
    assert!(device.sounds_in(..) > 100, "it was heard before");
    // The amplifier is switched off before the output is moved, at the latest by the reset. It is switched on again
    // only after the reset.
    let amplifier = device.amplifier();
    let outputs = device.dac();
    let raised = amplifier_follows_the_output(outputs, &amplifier);
    assert_eq!(raised.len(), 2, "{name}");
    let untimed = || (outputs.iter()).filter(|output| output.at_ns > injected && output.cause != Cause::Trigger);
    let moved = untimed().next().expect("the reset moves it");
    // Nor does a code that DMA had fetched come out before its time.
    let is_silent = |output: &Output| output.code.is_none_or(|code| code == MID_SCALE);
    assert!(untimed().all(is_silent), "{name}: {:?}", untimed().collect::<Vec<_>>());
    let off = amplifier
        .iter()
        .find(|change| change.at_ns > injected && change.drive != Drive::High);
    assert!(off.expect("it goes off").at_ns <= moved.at_ns, "{name}");
}

/// Injects, of the faults that end by the given reason, the first of each kind, and those of the DMA streams that move
/// codes to the DAC. A long run injects all of them.
fn each_kind(reason: ResetReason) {
    for (at, ending) in ENDING.iter().enumerate() {
        let is_first = ENDING[..at].iter().all(|other| other.kind != ending.kind);
        let is_of_stream = matches!(ending.fault, Injected::NoTransfers | Injected::NoEraser);
        if ending.reason == reason && (is_first || is_of_stream || long()) {
            ends(ending);
        }
    }
}

#[test]
fn a_fault_that_a_handler_catches_ends_at_mid_scale_in_a_reset_with_its_reason() {
    each_kind(ResetReason::Fault);
}

#[test]
fn a_fault_that_the_watchdog_ends_leaves_mid_scale_and_its_reason() {
    each_kind(ResetReason::Watchdog);
}

#[test]
fn the_coil_is_as_warm_after_a_reset_as_before_and_nothing_is_known_after_power_on() {
    let mut device = Device::with_faults(library::options());
    let load = |device: &mut Device| device.status().output.thermal_load_permille;
    let first = load(&mut device);
    assert!((700..=750).contains(&first), "{first} after power-on");
    device.set(Setting::ThermalTimeConstant, 1.0);
    device.run_for(1_200 * MS);
    let before = load(&mut device);
    assert!((1..300).contains(&before), "{before} before the reset");
    inject(&mut device, Injected::Panic);
    device.run_for(300 * MS);
    device.wait_for_start();
    let status = device.status();
    assert_eq!(status.reset, ResetReason::Fault);
    // The load has cooled a little since, but by no more than the elapsed time allows.
    let after = status.output.thermal_load_permille;
    assert!(
        after <= before && after > before / 2,
        "{before} before and {after} after"
    );
}
