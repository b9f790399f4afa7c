//! A lost link, and a host whose motion stops.

use model_format::link::{
    KEEP_ALIVE_MS, KeepAliveTopic, MotionSample, MotionSource, MotionTopic, MuteReason,
};
use model_format::{MillimetresPerSecond, Newton};

use crate::device::{Device, MS};
use crate::library;

/// Time within which the output is silent.
const SILENT_NS: u64 = 100 * MS;

#[test]
fn a_lost_link_is_silence_within_100_ms() {
    let mut device = Device::started(library::options());
    device.move_at(120.0);
    device.play_until_heard("lattice", MotionSource::Sensors, 2);
    device.run_for(200 * MS);
    device.keep_alive(false);
    let lost = device.stylus.now_ns();
    device.run_for(300 * MS);
    assert!(!device.is_silent(lost - 50 * MS, lost), "it was heard");
    assert!(device.is_silent(lost + SILENT_NS, lost + 300 * MS));
    // The output comes back with the link.
    device.keep_alive(true);
    device.run_for(400 * MS);
    let now = device.stylus.now_ns();
    assert!(!device.is_silent(now - 100 * MS, now), "it is heard again");
}

#[test]
fn a_motion_of_the_hosts_that_is_not_renewed_is_silence_within_100_ms() {
    let mut device = Device::started(library::options());
    device.play("lattice", MotionSource::Host, 2);
    let motion = MotionSample {
        speed: MillimetresPerSecond(120.0),
        force: Newton(0.8),
        position_mm: None,
        contact: None,
    };
    for _ in 0..200 {
        device.publish::<MotionTopic>(&motion);
        device.run_for(2 * MS);
    }
    let last = device.stylus.now_ns();
    assert!(!device.is_silent(last - 50 * MS, last), "it was heard");
    // The link stays alive.
    for _ in 0..400 / u64::from(KEEP_ALIVE_MS) {
        device.publish::<KeepAliveTopic>(&());
        device.run_for(u64::from(KEEP_ALIVE_MS) * MS);
    }
    assert!(device.is_silent(last + SILENT_NS, last + 400 * MS));
    let mute = device.status().output.mute;
    assert!(mute.contains(MuteReason::Stale), "{mute:?}");
}
