//! The link over USB: its traffic, and the states of the bus after which it must still work.

use model_format::link::{ActivateEndpoint, RecordSample, SlotId, StatusEndpoint};
use postcard_rpc::Endpoint;
use virtual_stylus::model::usb::host::Host;
use virtual_stylus::usb_host::{Request, Timing};

use crate::device::{BULK_IN, BULK_OUT, Device, MS, SECOND, long};
use crate::library;
use crate::requests::announced;

#[test]
fn a_device_that_is_busy_with_a_large_library_sleeps_through_no_reset_of_the_bus() {
    let mut device = Device::on_usb(library::with(&library::large()));
    let slot = device.slots().active.expect("a library");
    sleeps_through_nothing(&mut device, slot);
}

/// Suspends the bus, resets it and lets it run again while the tasks of the device are busy with a large library.
fn sleeps_through_nothing(device: &mut Device, slot: SlotId) {
    device.usb().1.timing = Timing {
        settle_ns: 0,
        ..Timing::default()
    };
    // Some 50 ms after the request, the library is checked without a pause.
    for micros in (18..34)
        .filter(|point| long() || point % 4 == 0)
        .map(|point| point * 2_000)
    {
        device.send_frame(ActivateEndpoint::REQ_KEY, &slot);
        device.run_for(MS / 2 + micros * 1_000);
        (device.stylus.usb(Host::suspend));
        // Longer than the 3 ms of silence that suspend the device.
        device.run_for(7 * MS / 2);
        let read = device.enumerate();
        assert!(read.is_ok(), "{read:?}, {micros} us later");
        device.status();
    }
}

#[test]
fn on_a_bus_that_breaks_packets_every_frame_arrives_once_and_whole() {
    // Three broken attempts in succession end a transfer. With one packet broken in 200 and three packets to a
    // transaction, that happens to three transactions in a million.
    const PER_MILLION: u64 = 5_000;
    let mut device = Device::on_usb(library::options());
    device.stylus.usb(|host, _| host.break_packets(PER_MILLION, 7));
    device.record();
    let other = library::other();
    let committed = device.upload(&other);
    device.run_for(2 * SECOND);
    let stopped = device.stop_recording();
    device.run_for(20 * MS);
    let traffic = device.stylus.usb(|host, _| host.traffic());
    println!("{traffic:?}");
    assert!(traffic.broken > 30 && traffic.repeated > 5, "{traffic:?}");
    assert_eq!(device.blocks.len(), stopped.blocks as usize);
    device.assert_whole();
    let status = device.status();
    assert_eq!((status.usb.malformed, status.usb.oversized), (0, 0));
    assert_eq!(device.activate(committed.slot).library.crc32, announced(&other).crc32);
}

#[test]
fn a_suspended_bus_that_resumes_goes_on_where_it_was() {
    let mut device = Device::on_usb(library::options());
    // The device is suspended after 3 ms.
    for millis in [1, 3, 4, 10, 200] {
        device.stylus.usb(Host::suspend);
        device.run_for(millis * MS);
        device.stylus.usb(|host, now_ns| host.resume(now_ns, 20 * MS));
        device.run_for(30 * MS);
        device.status();
    }
    // This happens during a recording: blocks sent meanwhile are lost and counted, and those that arrive are intact.
    device.record();
    device.run_for(100 * MS);
    device.stylus.usb(Host::suspend);
    device.run_for(SECOND);
    device.stylus.usb(|host, now_ns| host.resume(now_ns, 20 * MS));
    device.run_for(200 * MS);
    device.stop_recording();
    // The frame that was under way is incomplete.
    assert!(device.broken <= 1, "{} frames are broken", device.broken);
    assert!(
        device
            .blocks
            .windows(2)
            .map(|pair| pair[1].sequence - pair[0].sequence - 1)
            .sum::<u32>()
            > 0,
        "the host was away"
    );
    assert!(device.status().usb.unsent > 0);
}

#[test]
fn after_a_halt_is_cleared_the_next_command_works() {
    let mut device = Device::on_usb(library::options());
    for halted in [&[BULK_OUT][..], &[BULK_IN], &[BULK_OUT, BULK_IN]] {
        for round in 0..2 {
            // This is done once after an odd number of packets, and once after an even number.
            for _ in 0..round {
                device.status();
            }
            for &endpoint in halted {
                let (stylus, usb) = device.usb();
                usb.control(stylus, Request::set_halt(endpoint), &[])
                    .expect("it can be halted");
                let status = Request::new(0x82, 0, 0, endpoint.into(), 2);
                let told = usb.control(stylus, status, &[]);
                assert_eq!(told, Ok(vec![1, 0]));
            }
            // Transfers that were waiting end with a stall.
            let answer = device.try_request::<StatusEndpoint>(&());
            assert!(answer.is_none(), "{answer:?}");
            device.clear_halts();
            device.reopen();
            device.status();
        }
    }
}

#[test]
fn a_program_that_ends_in_the_middle_of_a_frame_leaves_nothing_to_the_next_one() {
    let mut device = Device::on_usb(library::options());
    device.record();
    for point in (0..24).filter(|&point| long() || point % 6 == 1) {
        // A frame of almost the largest length is cancelled on its way.
        device.send_raw(&[0x55; 900]);
        // In steps shorter than a transaction of 64 bytes, which takes some 59 µs.
        device.stylus.run_for(point * 47_000);
        device.reopen();
        device.clear_halts();
        let broken = device.broken;
        device.status();
        assert_eq!(device.broken, broken, "point {point}");
    }
}

#[test]
fn a_setting_or_configuration_that_is_chosen_again_begins_anew() {
    let mut device = Device::on_usb(library::options());
    let interface = Request::new(0x01, 11, 0, 0, 0);
    for request in [Request::set_configuration(1), interface] {
        for round in 0..2 {
            for _ in 0..round {
                device.status();
            }
            device.record();
            device.run_for(3 * MS);
            device.reopen();
            let (stylus, usb) = device.usb();
            usb.control(stylus, request, &[]).expect("it can be chosen");
            stylus.usb(|host, _| [BULK_OUT, BULK_IN].map(|endpoint| host.reset_toggle(endpoint)));
            device.stop_recording();
            assert_eq!(device.broken, 0);
        }
    }
    // Without a configuration there are no endpoints. With the configuration they are back.
    let (stylus, usb) = device.usb();
    for value in [0, 1] {
        usb.control(stylus, Request::set_configuration(value), &[])
            .expect("it can be chosen");
    }
    stylus.usb(|host, _| [BULK_OUT, BULK_IN].map(|endpoint| host.reset_toggle(endpoint)));
    device.reopen();
    device.status();
    device.assert_models_sufficed();
}

#[test]
fn frames_that_nobody_fetches_are_dropped_whole_and_the_next_ones_arrive() {
    let mut device = Device::on_usb(library::options());
    device.record();
    for millis in [20, 90, 110, 350] {
        device.run_for(50 * MS);
        device.close();
        device.run_for(millis * MS);
        device.reopen();
        let broken = device.broken;
        device.run_for(50 * MS);
        // The frame that was under way is incomplete.
        assert!(device.broken <= broken + 1, "after {millis} ms");
        device.status();
    }
    let sequences = (device.blocks.windows(2)).map(|pair| pair[1].sequence - pair[0].sequence);
    assert!(sequences.clone().all(|apart| apart > 0), "in order, none twice");
    assert!(sequences.max() > Some(10), "the host was away");
    // A frame that begins with a part of another one would be noticed, because the levels on the pins are constant.
    let mut samples = (device.blocks.iter()).flat_map(|block| block.samples.map(RecordSample::from));
    let first = samples.next().expect("there are blocks");
    assert!(samples.all(|sample| sample == first), "samples of two frames in one");
    let status = device.status();
    assert!(status.usb.unsent > 0);
    assert_eq!((status.usb.malformed, status.usb.oversized), (0, 0));
}
