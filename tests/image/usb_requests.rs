//! Control requests that no host should make, and hosts that do not finish a transfer that they began.

use virtual_stylus::Options;
use virtual_stylus::chance::Chance;
use virtual_stylus::model::usb::host::{Transfer, TransferError};
use virtual_stylus::usb_host::{Request, descriptor};

use crate::device::{BULK_OUT, Device, MS, long};

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
