//! Operations of the hosts, and mishaps of the stylus.

use fake_stylus::device::{MOTION, change};
use hil::checks::faults::ENDING;
use hil::checks::faults::Injected;
use model_format::link::{
    ActivateEndpoint, Activity, FaultKind, InfoEndpoint, MotionSample, MotionSource, MotionTopic, ResetReason, Setting,
    SettingChange, Settings, SettingsChange, SettingsError, SlotId, UpdateBegin, UpdateBeginEndpoint, UpdateError,
    UpdatePhase, UploadAbortEndpoint, UploadBeginEndpoint, UploadError,
};
use model_format::{MillimetresPerSecond, Newton};
use stylus_app::update::sign;
use stylus_link::procedures::calibrate::AtRest;
use virtual_stylus::model::flash::Moment;
use virtual_stylus::model::usb::host::{Host, Mishap};

use super::world::World;
use crate::device::{MS, inject};
use crate::link::wrong;
use crate::requests::announced;
use crate::scenes::force_code;
use crate::self_test::quiet;
use crate::update::{NAME, version};
use crate::usb_mishaps::{arm, has_happened};

/// Longest time from a fault to the reset by the watchdog, and to the reset by a handler.
const BITTEN_NS: u64 = 700 * MS;
const CAUGHT_NS: u64 = 200 * MS;

/// An operation: its name, its relative frequency, and its function.
pub type Operation = (&'static str, u64, fn(&mut World));

/// Name of the count of broken links during uploads.
pub const LINKS_BROKEN: &str = "links broken in uploads";
/// Name of the count of power cuts at an operation of the flash.
pub const CUT_AT_OPERATION: &str = "power cuts at an operation of the flash";

/// Name of the count of updates that a reset rolled back.
pub const ROLLED_BACK: &str = "updates rolled back";

pub const OPERATIONS: [Operation; 22] = [
    ("plays from the sensors", 16, play_from_sensors),
    ("plays from the host's motion", 8, play_from_host),
    ("switches while it plays", 8, switch),
    ("stops", 4, World::stop),
    ("motions of the tool", 8, move_tool),
    ("recordings", 8, record),
    ("uploads", 6, upload),
    ("uploads broken off", 3, break_off),
    ("activations", 5, activate),
    ("changes of settings", 8, change_settings),
    ("calibrations at rest", 3, calibrate),
    ("USB pulled or reset in an upload", 3, mishap),
    ("USB suspended", 3, suspend),
    ("bad frames, 50 each", 6, bad_frames),
    ("drifts of clocks", 3, drift),
    ("late debuggers", 3, debugger),
    ("dips of the supply", 2, dip),
    ("resets by the pin", 2, reset_pin),
    ("faults", 2, fault),
    ("power cuts", 3, cut),
    ("updates", 1, update),
    ("counts of ticks past 32 bits", 4, wrap),
];

fn play_from_sensors(world: &mut World) {
    if world.play(MotionSource::Sensors) {
        world.pass(800);
    }
}

fn play_from_host(world: &mut World) {
    if !world.play(MotionSource::Host) {
        return;
    }
    let mut motion = MotionSample {
        speed: MillimetresPerSecond(120.0),
        force: Newton(0.8),
        ..MOTION
    };
    for _ in 0..world.below(200) {
        motion.speed.0 += world.below(21) as f32 - 10.0;
        world.device.publish::<MotionTopic>(&motion);
        world.device.run_for(2 * MS);
    }
}

/// Plays one texture or scene after another, each before the previous one has settled.
fn switch(world: &mut World) {
    for _ in 0..=world.below(4) {
        world.play(MotionSource::Sensors);
        world.pass(120);
    }
}

fn move_tool(world: &mut World) {
    let speeds: Vec<(u64, f64)> = (0..4)
        .map(|knot| (knot * 300, world.below(700) as f64 - 350.0))
        .collect();
    world.device.move_along(&speeds);
    let (most, hertz) = (world.below(3) as f64, world.below(9) as f64);
    world.device.set_pins(move |channel, at_ns| match channel {
        5 => force_code(most * (at_ns as f64 / 1e9 * hertz).sin().max(0.0)) + quiet(channel, at_ns) % 16,
        _ => quiet(channel, at_ns),
    });
    world.pass(300);
}

fn record(world: &mut World) {
    world.device.blocks.clear();
    world.device.record();
    world.pass(1_500);
    let stopped = world.device.stop_recording();
    assert_eq!(stopped.lost_blocks, 0);
    assert_eq!(world.device.blocks.len(), stopped.blocks as usize);
    if stopped.blocks > 0 {
        world.device.assert_whole();
    }
}

/// One of the libraries, chosen at random.
fn library(world: &mut World) -> Vec<u8> {
    let index = world.below(world.libraries.len() as u64) as usize;
    world.libraries[index].bytes.clone()
}

fn upload(world: &mut World) {
    let library = library(world);
    let committed = world.device.upload(&library);
    if world.once_in(2) {
        world.device.activate(committed.slot);
        world.has_stopped();
        assert_eq!(world.slots().0, Some(announced(&library).crc32));
    }
}

fn break_off(world: &mut World) {
    let library = library(world);
    let active = world.slots().0;
    let progress = world.device.begin_upload(&library);
    let end = world.below(library.len() as u64) as usize;
    world.device.send_chunks(&library, progress, end);
    if world.once_in(2) {
        world
            .device
            .request::<UploadAbortEndpoint>(&())
            .expect("one is under way");
    }
    assert_eq!(world.slots().0, active);
}

fn activate(world: &mut World) {
    let slot = SlotId::ALL[world.below(2) as usize];
    let valid = world.slots().1;
    if let Ok(activated) = world.device.request::<ActivateEndpoint>(&slot) {
        assert!(valid.contains(&activated.library.crc32));
        world.has_stopped();
    } else {
        assert_eq!(valid.len(), 1, "both slots are valid");
    }
}

/// Some random new values, each anywhere in its range.
fn new_values(world: &mut World) -> Vec<SettingChange> {
    let count = 1 + world.below(3);
    let mut changes: Vec<SettingChange> = Vec::new();
    while (changes.len() as u64) < count {
        let setting = Setting::ALL[world.below(Setting::ALL.len() as u64) as usize];
        let spec = setting.spec();
        let value = spec.lowest + world.chance.fraction() as f32 * (spec.highest - spec.lowest);
        let value = if spec.whole { value.round() } else { value };
        let is_new = changes.iter().all(|change| change.setting != setting);
        if is_new && setting.check(value).is_ok() {
            changes.push(change(setting, value));
        }
    }
    changes
}

fn change_settings(world: &mut World) {
    let changes = new_values(world);
    let is_idle = world.device.status().output.activity == Activity::Idle;
    match world.device.change_settings(&changes) {
        Ok(settings) => {
            assert!(is_idle, "while it plays");
            let change = SettingsChange::of(&changes).expect("three at most");
            world.settings = change.applied_to(world.settings).expect("in range");
            assert_eq!(settings, world.settings);
        }
        Err(SettingsError::Playing) if !is_idle => {}
        Err(refused) => panic!("{changes:?}: {refused}"),
    }
    if is_idle && world.once_in(2) {
        reset_settings(world);
    }
}

fn reset_settings(world: &mut World) {
    world.device.reset_settings().expect("nothing is played");
    world.device.set_coil();
    world.settings = world.device.settings();
    assert_eq!(world.settings, Settings::default());
}

fn calibrate(world: &mut World) {
    world.stop();
    world.device.move_at(0.0);
    let zero = 2_000 + world.below(4_000) as u16;
    world.device.set_pins(move |channel, at_ns| match channel {
        5 => zero + quiet(channel, at_ns) % 16,
        _ => quiet(channel, at_ns),
    });
    world.device.run_for(50 * MS);
    let at_rest = measured(world);
    assert_eq!(at_rest.faults(&(0..4)), Vec::<String>::new());
    let change = at_rest.force_zero();
    world.settings = world.device.set(change.setting, change.value);
    // With the new zero, the force at rest must read zero.
    let off = measured(world).mean[3] - f64::from(world.settings.force_zero().0);
    assert!(off.abs() < 16.0, "{off} codes");
}

fn measured(world: &mut World) -> AtRest {
    world.device.blocks.clear();
    world.device.record();
    world.device.run_for(300 * MS);
    world.device.stop_recording();
    AtRest::of(&world.device.samples())
}

/// Pulls the cable or resets the bus while a library is uploaded over USB, until the upload succeeds or three attempts
/// are over.
fn mishap(world: &mut World) {
    world.turn_to(true);
    if world.player == Some(true) {
        world.stop();
    }
    let library = library(world);
    for _ in 0..3 {
        let mishap = if world.once_in(2) {
            Mishap::Unplug
        } else {
            Mishap::Reset
        };
        let transactions = 1 + world.below(400);
        arm(&mut world.device, mishap, transactions);
        let committed = world.device.try_upload(&library);
        if has_happened(&mut world.device) {
            world.pass(100);
            world.device.enumerate().expect("it enumerates");
            world.count(LINKS_BROKEN);
        }
        world.sends_noise();
        if committed.is_some() {
            break;
        }
    }
    // A mishap that has not happened is replaced by one that never will, or it would meet a later step.
    (world.device.stylus).usb(|host, _| host.have(Mishap::Reset, u64::MAX / 2));
}

fn suspend(world: &mut World) {
    if world.player == Some(true) {
        world.stop();
    }
    world.turn_to(true);
    world.device.stylus.usb(Host::suspend);
    world.turn_to(false);
    world.pass(300);
    (world.device.stylus).usb(|host, now_ns| host.resume(now_ns, 20 * MS));
    world.device.run_for(30 * MS);
}

fn bad_frames(world: &mut World) {
    for _ in 0..50 {
        let frame = wrong(&mut world.chance);
        if world.once_in(10) && !world.device.is_usb() {
            world.device.send_bytes(&frame);
            world.device.send_bytes(&[0]);
        } else if !frame.is_empty() {
            world.device.send_raw(&frame);
        }
    }
    world.sends_noise();
    world.device.run_for(60 * MS);
    world.device.forget_frames();
    world.device.request::<InfoEndpoint>(&());
    world.device.forget_frames();
}

fn drift(world: &mut World) {
    let [hsi_ppm, hsi48_ppm] = [10_000, 40_000].map(|most| world.below(2 * most + 1) as i64 - most as i64);
    (world.device.stylus).board(move |board| board.part.drift(hsi_ppm, hsi48_ppm));
    world.pass(100);
}

fn debugger(world: &mut World) {
    (world.device.stylus).board(|board| board.part.freeze_in_halt());
    world.device.run_for(50 * MS);
    let is_frozen = (world.device.stylus).board(|board| board.part.is_frozen_in_halt());
    assert!(!is_frozen, "something waits while the core is halted");
}

fn dip(world: &mut World) {
    world.device.stylus.set_supply(2_700);
    world.pass(200);
    assert!(!world.device.status().output.amplifier);
    let library = library(world);
    let before = world.device.stylus.flash_operations().len();
    let announced = announced(&library);
    let begun = world.device.request::<UploadBeginEndpoint>(&announced);
    assert_eq!(begun, Err(UploadError::SupplyLow));
    let changes = new_values(world);
    assert!(world.device.change_settings(&changes).is_err());
    let after = world.device.stylus.flash_operations().len();
    assert_eq!(after, before, "flash was written");
    world.device.stylus.set_supply(3_300);
    world.device.run_for(50 * MS);
}

fn reset_pin(world: &mut World) {
    world.device.stylus.reset_by_pin();
    world.device.run_for(300 * MS);
    world.was_reset(false);
    assert_eq!(world.device.status().reset, ResetReason::Pin);
}

/// Causes a fault while something plays: an injected fault if the image accepts them, otherwise a failure of the
/// external clock.
fn fault(world: &mut World) {
    if !world.bears_fault() {
        return world.skip();
    }
    if world.play(MotionSource::Sensors) {
        world.pass(200);
    }
    let (name, kind, reason, within_ns) = if world.takes_faults() {
        let ending = &ENDING[world.below(ENDING.len() as u64) as usize];
        // While all codes are mid-scale, a missing eraser has no effect, and the coil receives nothing.
        if ending.fault == Injected::NoEraser && !world.is_heard(20) {
            return world.skip();
        }
        inject(&mut world.device, ending.fault);
        let is_bite = ending.reason == ResetReason::Watchdog;
        let within_ns = if is_bite { BITTEN_NS } else { CAUGHT_NS };
        (ending.name, ending.kind, ending.reason, within_ns)
    } else {
        world.device.stylus.fail_external_clock();
        let (kind, reason) = (FaultKind::ClockFailed, ResetReason::Fault);
        ("no external clock", kind, reason, CAUGHT_NS)
    };
    world.silence();
    world.device.run_for(within_ns + 300 * MS);
    assert!(!world.device.stylus.resets().is_empty(), "no reset: {name}");
    world.was_reset(true);
    let status = world.device.status();
    assert_eq!(status.reset, reason, "{name}");
    let told = status.fault.expect("it has a kind");
    assert_eq!(told.kind, kind, "{name}: {told:x?}, {:?}", world.device.stylus.resets());
}

/// Cuts the power at once, or at an operation of the flash in an upload or a change of settings.
fn cut(world: &mut World) {
    let (active, mut allowed) = world.slots();
    let settings = [world.settings; 2];
    match world.below(3) {
        0 => {
            world.pass(50);
            let contents = world.device.stylus.flash();
            world.cut_power(contents, active, &allowed, settings);
        }
        1 => {
            let library = library(world);
            allowed.push(announced(&library).crc32);
            // Two operations erase; most program a word.
            let number =
                (world.device.stylus.flash_operations().len() as u64) + 1 + world.below(library.len() as u64 / 32);
            cut_at(world, number, (active, &allowed), settings, |world| {
                world.device.upload(&library);
            });
        }
        _ => {
            world.stop();
            let changes = new_values(world);
            let change = SettingsChange::of(&changes).expect("three at most");
            let after = change.applied_to(world.settings).expect("in range");
            let number = world.device.stylus.flash_operations().len() as u64 + 1 + world.below(9);
            let settings = [world.settings, after];
            cut_at(world, number, (active, &allowed), settings, |world| {
                let changed = world.device.change_settings(&changes);
                world.settings = changed.expect("nothing is played");
            });
        }
    }
}

/// Does `work`, and cuts the power at the flash operation `number`. If `work` ends earlier, the power is cut after
/// `work`.
fn cut_at(
    world: &mut World,
    number: u64,
    (active, allowed): (Option<u32>, &[u32]),
    settings: [Settings; 2],
    work: impl FnOnce(&mut World),
) {
    let seed = world.chance.draw();
    let moment = [Moment::Before, Moment::During { seed }, Moment::After][world.below(3) as usize];
    let stylus = &mut world.device.stylus;
    stylus.capture_power_cuts(vec![(number, moment)]);
    work(world);
    let contents = match world.device.stylus.take_power_cuts().pop() {
        Some(cut) => {
            world.count(CUT_AT_OPERATION);
            cut.contents
        }
        None => world.device.stylus.flash(),
    };
    world.cut_power(contents, active, allowed, settings);
}

/// Installs the other image and then confirms it or resets, or cuts the power at a random operation of the flash.
fn update(world: &mut World) {
    world.stop();
    let (active, _) = world.slots();
    let image = world.other_image();
    if world.once_in(2) {
        let before = world.device.stylus.flash_operations().len();
        let forged = UpdateBegin::new(&image, &sign(NAME, &image, version(), &[9; 32]));
        let refused = world.device.request::<UpdateBeginEndpoint>(&forged);
        assert_eq!(refused, Err(UpdateError::Signature));
        assert_eq!(world.device.stylus.flash_operations().len(), before);
    }
    if world.once_in(3) {
        let allowed: Vec<u32> = active.into_iter().collect();
        // Two words are programmed for each word of the new image and of the previous one.
        let number =
            (world.device.stylus.flash_operations().len() as u64) + 1 + world.below(image.len() as u64 / 32 * 5 / 2);
        let settings = [world.settings; 2];
        return cut_at(world, number, (active, &allowed), settings, |world| {
            world.device.update(&image);
            world.wait_for_exchange();
        });
    }
    world.device.update(&image);
    world.is_exchanged();
    if world.once_in(3) {
        world.device.stylus.reset_by_pin();
        world.is_exchanged();
        world.count(ROLLED_BACK);
        let state = world.device.update_state();
        assert!(matches!(state.phase, UpdatePhase::RolledBack { .. }), "{state:?}");
    } else {
        world.device.confirm();
    }
    assert_eq!(world.slots().0, active);
}

/// Makes the counts of ticks overflow their 32 bits while something plays and is recorded.
fn wrap(world: &mut World) {
    if !world.takes_faults() || !world.age() {
        return world.skip();
    }
    world.stop();
    inject(&mut world.device, Injected::Age);
    world.device.run_for(20 * MS);
    let before = world.device.status().tick.ticks;
    assert!(before < 1 << 32 && before + 5_000 > 1 << 32, "{before}");
    world.forget_last();
    world.play(MotionSource::Sensors);
    world.device.blocks.clear();
    world.device.record();
    world.device.run_for(1_200 * MS);
    let stopped = world.device.stop_recording();
    assert_eq!(stopped.lost_blocks, 0);
    world.device.assert_whole();
    let first = world.device.blocks.first().map(|block| block.first_tick);
    let last = world.device.blocks.last().map(|block| block.first_tick);
    assert!(first < Some(1 << 32) && last > Some(1 << 32), "{first:?} to {last:?}");
}
