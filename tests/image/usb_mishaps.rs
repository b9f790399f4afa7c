//! Cables that are pulled and buses that are reset at any transaction. The device is enumerated again, the next command
//! works, and the active library stays.

use virtual_stylus::Options;
use virtual_stylus::model::usb::host::Mishap;
use virtual_stylus::usb_host::Timing;

use crate::device::{Device, MS, is_drawn};
use crate::library;
use crate::upload::state_of;

const MISHAPS: [Mishap; 2] = [Mishap::Unplug, Mishap::Reset];

/// Times of a host that is too fast for a slow device.
const HURRIED: Timing = Timing {
    settle_ns: 2 * MS,
    reset_ns: 10 * MS,
    recovery_ns: 2 * MS,
};

/// The points of a test that this run includes (see [`is_drawn`]), each with its mishap and the host's times. The host
/// is hurried at two of three points.
fn points(count: u64) -> impl Iterator<Item = (u64, Mishap, Timing)> {
    (0..count).filter(|&point| is_drawn(point)).map(|point| {
        let timing = if point % 3 == 0 { Timing::default() } else { HURRIED };
        (point, MISHAPS[(point % 2) as usize], timing)
    })
}

/// Schedules `mishap` after `transactions` more transactions.
pub fn arm(device: &mut Device, mishap: Mishap, transactions: u64) {
    device.stylus.usb(move |host, _| host.have(mishap, transactions));
}

pub fn has_happened(device: &mut Device) -> bool {
    device.stylus.usb(|host, _| host.has_happened())
}

/// Checks that the device can be enumerated again and answers the first request.
fn comes_back(device: &mut Device, after: &str) {
    assert!(device.enumerate().is_ok(), "it does not enumerate after {after}");
    let status = device.status();
    assert_eq!(status.tick.missed, 0, "after {after}");
    assert_eq!(device.stylus.resets(), [], "after {after}");
}

#[test]
fn a_mishap_anywhere_in_an_enumeration_does_not_keep_the_next_one() {
    let mut device = Device::on_usb(Options::default());
    device.usb().1.timing = HURRIED;
    let mut points = 0;
    for mishap in MISHAPS {
        for transactions in 1.. {
            arm(&mut device, mishap, transactions);
            let _ = device.enumerate();
            if !has_happened(&mut device) {
                break;
            }
            points += 1;
            if !is_drawn(transactions) {
                continue;
            }
            let after = format!("{mishap:?} after {transactions} transactions");
            comes_back(&mut device, &after);
        }
    }
    println!("{points} points");
    assert!(points > 60, "{points} points");
}

#[test]
fn a_mishap_anywhere_in_a_stream_does_not_keep_the_next_one() {
    const POINTS: u64 = 60;
    let mut device = Device::on_usb(library::options());
    device.move_at(120.0);
    let was = state_of(&mut device);
    for (point, mishap, timing) in points(POINTS) {
        device.usb().1.timing = timing;
        device.blocks.clear();
        device.play("lattice", point);
        device.record();
        arm(&mut device, mishap, 1 + point);
        device.run_for(100 * MS);
        assert!(!device.is_open(), "point {point}");
        device.keep_alive(false);
        let what = format!("{mishap:?} at point {point}");
        comes_back(&mut device, &what);
        assert_eq!(state_of(&mut device), was, "after {what}");
        assert!(
            device
                .blocks
                .windows(2)
                .map(|pair| pair[1].sequence - pair[0].sequence)
                .min()
                != Some(0),
            "a block came twice after {what}"
        );
        assert_eq!(device.broken, 0, "after {what}");
        device.stop_recording();
        device.keep_alive(true);
    }
}

#[test]
fn a_reset_of_the_part_is_a_pulled_cable_to_the_host_and_the_device_comes_back() {
    let mut device = Device::on_usb(library::options());
    let was = state_of(&mut device);
    for millis in [1, 7, 50] {
        device.run_for(millis * MS);
        device.stylus.reset_by_pin();
        device.run_for(MS);
        assert!(!device.is_open(), "the pull-up is gone");
        device.enumerate().expect("it enumerates");
        assert_eq!(state_of(&mut device), was);
    }
    assert_eq!(device.stylus.resets().len(), 3);
}
