//! Hosts and cables on USB that do what none should: control requests that no host should make, transfers that a host
//! began and does not finish, and cables that are pulled and buses that are reset at any transaction. A reset of the
//! part is a pulled cable to the host. The device is enumerated again, the next command works, and the active library
//! stays.

use virtual_stylus::Options;
use virtual_stylus::chance::Chance;
use virtual_stylus::model::usb::host::{Mishap, Transfer, TransferError};
use virtual_stylus::usb_host::{Request, Timing, descriptor};

use crate::device::{BULK_OUT, Device, MS, is_drawn, long};
use crate::flash::state_of;
use crate::library;

/// Time within which a request must be answered or fail, ns.
const ANSWERED_NS: u64 = 100 * MS;

/// Makes one control request, and returns its result.
fn ask(device: &mut Device, request: Request, data: &[u8]) -> Result<Vec<u8>, TransferError> {
    let (stylus, usb) = device.usb();
    usb.control_within(stylus, request, data, ANSWERED_NS)
}

/// Checks that the device still answers a standard request as before.
fn lives(device: &mut Device, after: &str) {
    let request = Request::descriptor(descriptor::DEVICE, 0, 0, 18);
    let read = ask(device, request, &[]);
    assert_eq!(read.as_ref().map(Vec::len), Ok(18), "after {after}");
    assert_eq!(device.stylus.resets(), []);
}

#[test]
fn any_request_is_answered_or_stalled_and_the_device_lives_on() {
    const NEAR: [(u8, u8); 11] = [
        (0x80, 0),
        (0x80, 6),
        (0x80, 8),
        (0x81, 0),
        (0x81, 10),
        (0x82, 0),
        (0xC0, 0),
        (0x00, 1),
        (0x00, 3),
        (0x02, 1),
        (0x02, 3),
    ];
    const VALUES: [u16; 9] = [0, 1, 0x0100, 0x0200, 0x0300, 0x0301, 0x0302, 0x0600, 0x0F00];
    const INDICES: [u16; 8] = [0, 1, 7, 0x01, 0x81, 0x09, 0x89, 0x0409];
    let requests = if long() { 3_000 } else { 300 };
    let mut device = Device::on_usb(Options::default());
    let mut chance = Chance(0x5EED);
    let mut next = move || chance.draw() as u32 >> 1;
    let (mut answered, mut stalled) = (0, 0);
    for number in 0..requests {
        // Half of the requests are similar to specified ones.
        let near = next() % 2 == 0;
        let (kind, asked) = if near {
            NEAR[next() as usize % NEAR.len()]
        } else {
            (next() as u8, next() as u8)
        };
        let [value, index] = [&VALUES[..], &INDICES].map(|specified| match next() {
            drawn if near => specified[drawn as usize % specified.len()],
            drawn => drawn as u16,
        });
        let length = [0, 1, 2, 8, 18, 63, 64, 65, 255, 1024][next() as usize % 10];
        let request = Request::new(kind, asked, value, index, length);
        // These requests would disconnect the device or end the test.
        if matches!(kind, 0x00 | 0x80) && matches!(asked, 5 | 9) || kind == 1 && asked == 11 {
            continue;
        }
        let bytes = if kind & 0x80 == 0 { length.into() } else { 0 };
        let data: Vec<u8> = (0..bytes).map(|_| next() as u8).collect();
        match ask(&mut device, request, &data) {
            Ok(read) => {
                answered += 1;
                assert!(read.len() <= length.into(), "{request:x?}");
            }
            Err(TransferError::Stall) => stalled += 1,
            Err(error) => panic!("number {number}, {request:x?}: {error}"),
        }
        if number % 50 == 0 {
            lives(&mut device, &format!("number {number}, {request:x?}"));
        }
    }
    assert!(answered > requests / 10 && stalled > requests / 3);
    // Some of the requests set halts. They are cleared as a program would do it.
    device.clear_halts();
    device.enumerate().expect("it enumerates");
    device.status();
    assert_eq!(device.stylus.resets(), []);
}

#[test]
fn a_control_transfer_that_is_given_up_anywhere_does_not_keep_the_next_one() {
    let mut device = Device::on_usb(Options::default());
    let read = Request::descriptor(descriptor::CONFIGURATION, 0, 0, 255);
    let set = Request::new(0xC0, 0, 0, 7, 512);
    let written = Request::new(0x40, 1, 0, 0, 64);
    let status = Request::clear_halt(BULK_OUT);
    for (request, data) in [(read, 0), (set, 0), (written, 64), (status, 0)] {
        for point in (0..24).filter(|&point| long() || point % 6 == 1) {
            let transfer = Transfer::Control {
                setup: request.bytes(),
                data: vec![1; data],
            };
            let (stylus, _) = device.usb();
            let id = stylus.usb(move |host, _| host.submit(transfer));
            device.stylus.run_for(point * 17_000);
            device.stylus.usb(move |host, now_ns| host.cancel(id, now_ns));
            lives(&mut device, &format!("{request:x?} given up after {} us", point * 17));
        }
    }
    // The device may have reset its toggles without the host's knowledge.
    device.clear_halts();
    device.status();
}

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
