//! A lost link, and a host whose motion stops.

use model_format::link::{
    KEEP_ALIVE_MS, KeepAliveTopic, MotionSample, MotionSource, MotionTopic, MuteReason,
    PlayEndpoint, PlayError, Setting, SettingChange, SettingsChange, SettingsError,
    SettingsGetEndpoint, SettingsProposeEndpoint,
};
use model_format::{MillimetresPerSecond, Newton};
use virtual_stylus::motion::Motion;

use crate::device::{Device, MID_SCALE, MS, play_request};
use crate::library;

/// Time within which the output is silent.
const SILENT_NS: u64 = 100 * MS;

fn is_silent_between(device: &mut Device, from_ns: u64, to_ns: u64) -> bool {
    let outputs = device.dac().iter();
    let mut between = outputs.filter(|output| (from_ns..to_ns).contains(&output.at_ns));
    between.all(|output| output.code == Some(MID_SCALE))
}

#[test]
fn a_lost_link_is_silence_within_100_ms() {
    let mut device = Device::started(library::options());
    device
        .stylus
        .set_motion(Motion::steady(120.0, 0.01))
        .expect("the run goes on");
    device.play_until_heard("lattice", MotionSource::Sensors, 2);
    device.run_for(300 * MS);
    device.keep_alive(false);
    let lost = device.stylus.now_ns();
    device.run_for(400 * MS);
    assert!(
        !is_silent_between(&mut device, lost - 50 * MS, lost),
        "it was heard"
    );
    assert!(is_silent_between(
        &mut device,
        lost + SILENT_NS,
        lost + 400 * MS
    ));
    // The output comes back with the link.
    device.keep_alive(true);
    device.run_for(400 * MS);
    let now = device.stylus.now_ns();
    assert!(
        !is_silent_between(&mut device, now - 100 * MS, now),
        "it is heard again"
    );
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
    for _ in 0..300 {
        device.publish::<MotionTopic>(&motion);
        device.run_for(2 * MS);
    }
    let last = device.stylus.now_ns();
    assert!(
        !is_silent_between(&mut device, last - 50 * MS, last),
        "it was heard"
    );
    // The link stays alive.
    for _ in 0..40 {
        device.publish::<KeepAliveTopic>(&());
        device.run_for(u64::from(KEEP_ALIVE_MS) * MS);
    }
    assert!(is_silent_between(
        &mut device,
        last + SILENT_NS,
        last + 400 * MS
    ));
    let mute = device.status().output.mute;
    assert!(mute.contains(MuteReason::Stale), "{mute:?}");
}

#[test]
fn what_is_asked_wrongly_is_refused_in_words_and_changes_nothing() {
    let mut device = Device::started(library::options());
    let unknown = play_request("no such texture", MotionSource::Sensors, 0);
    let refused = device.request::<PlayEndpoint>(&unknown);
    assert!(
        matches!(refused, Err(PlayError::NoSuchTexture { .. })),
        "{refused:?}"
    );
    let mut loud = play_request("lattice", MotionSource::Sensors, 0);
    loud.gain = f32::NAN;
    assert!(matches!(
        device.request::<PlayEndpoint>(&loud),
        Err(PlayError::Gain { .. })
    ));

    let before = device
        .request::<SettingsGetEndpoint>(&())
        .expect("settings are read");
    let change = SettingChange {
        setting: Setting::HardLimit,
        value: 100.0,
    };
    let proposed = SettingsChange::of(&[change]).expect("there is room for one");
    let refused = device.request::<SettingsProposeEndpoint>(&proposed);
    assert!(
        matches!(refused, Err(SettingsError::OutOfRange { .. })),
        "{refused:?}"
    );
    assert_eq!(
        device
            .request::<SettingsGetEndpoint>(&())
            .expect("settings are read"),
        before
    );
}

#[test]
fn a_setting_is_there_after_a_restart() {
    let mut device = Device::started(library::options());
    let change = SettingChange {
        setting: Setting::SoftStart,
        value: 321.0,
    };
    let set = device.change_settings(&[change]).expect("within its range");
    assert!((set.get(Setting::SoftStart) - 321.0).abs() < f32::EPSILON);
    let options = virtual_stylus::Options {
        flash: device.stylus.flash().expect("the run goes on"),
        ..virtual_stylus::Options::default()
    };
    let mut restarted = Device::started(options);
    let read = restarted
        .request::<SettingsGetEndpoint>(&())
        .expect("settings are read");
    assert_eq!(read, set);
}
