//! A lost link, and frames that no host sends.

use model_format::link::{InfoEndpoint, MAX_HOST_FRAME_BYTES, PlayEndpoint, UploadBeginEndpoint};
use postcard_rpc::Endpoint;
use virtual_stylus::Options;
use virtual_stylus::chance::Chance;

use crate::device::{Device, MS, long};

/// Time within which the output must be silent.
const SILENT_NS: u64 = 100 * MS;

#[test]
fn a_lost_link_is_silence_within_100_ms() {
    let mut device = Device::with_library();
    device.move_at(120.0);
    device.play_until_heard("lattice");
    device.run_for(200 * MS);
    device.keep_alive(false);
    let lost = device.stylus.now_ns();
    device.run_for(300 * MS);
    assert!(device.sounds_in(lost - 50 * MS..lost) > 0, "it was heard");
    assert_eq!(device.sounds_in(lost + SILENT_NS..lost + 300 * MS), 0);
    // The output resumes with the link.
    device.keep_alive(true);
    device.run_for(400 * MS);
    let now = device.stylus.now_ns();
    assert!(device.sounds_in(now - 100 * MS..now) > 0, "it is heard again");
}

/// Number of frames to send.
fn count() -> u64 {
    if long() { 1_000_000 } else { 5_000 }
}

fn bytes(random: &mut Chance, count: u64) -> Vec<u8> {
    (0..count).map(|_| random.draw() as u8).collect()
}

/// A frame with one of several errors. Most frames are short, so that many fit into a second.
pub fn wrong(random: &mut Chance) -> Vec<u8> {
    let keys = [
        InfoEndpoint::REQ_KEY,
        PlayEndpoint::REQ_KEY,
        UploadBeginEndpoint::REQ_KEY,
    ];
    let key = keys[random.below(3) as usize].to_bytes();
    let length = random.below(12);
    match random.below(8) {
        // An existing key, followed by a random body or one that is too short.
        0 | 1 => {
            let mut frame = vec![0b1101_0000];
            frame.extend(key);
            frame.extend([1, 0]);
            frame.extend(bytes(random, length));
            frame
        }
        // A key that is incomplete.
        2 => [&[0b1110_0000], &key[..random.below(8) as usize]].concat(),
        // A short key, of a kind that the device does not use.
        3 => vec![random.below(64) as u8, random.draw() as u8],
        // A frame longer than the limit.
        4 if random.below(50) == 0 => bytes(random, MAX_HOST_FRAME_BYTES as u64 + 200),
        _ => bytes(random, length),
    }
}

#[test]
fn malformed_frames_are_errors_or_silence_and_no_tick_is_missed() {
    let mut device = Device::started(Options::default());
    let mut random = Chance(1);
    let mut sent = 0;
    while sent < count() {
        for _ in 0..50 {
            let frame = wrong(&mut random);
            if random.below(10) == 0 {
                // Without COBS, zeros are at random places.
                device.send_bytes(&frame);
                device.send_bytes(&[0]);
            } else {
                device.send_raw(&frame);
            }
            sent += 1;
        }
        device.run_for(6 * MS);
        device.forget_frames();
        assert_eq!(device.broken, 0, "what the device sends is well formed");
        if sent.is_multiple_of(5_000) {
            device.run_for(200 * MS);
            device.forget_frames();
            let status = device.status();
            assert_eq!((status.tick.missed, status.resets), (0, 0), "after {sent} frames");
        }
    }
    device.run_for(500 * MS);
    device.forget_frames();
    let status = device.status();
    assert_eq!(status.tick.missed, 0);
    assert!(
        status.serial.malformed > 0 && status.serial.oversized > 0,
        "{:?}",
        status.serial
    );
    assert!(device.stylus.resets().is_empty());
}
