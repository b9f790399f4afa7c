//! Requests end to end on a device in memory: what a host sees, and what the tick receives.

use std::iter;

use fake_stylus::device::{COIL, SteppedStylus, change, play_request};
use fake_stylus::flash::{Memory, SECTOR_BYTES, SimulatedFlash};
use fake_stylus::hardware::Hardware;
use fake_stylus::library::{announcement, chunks, library, texture};
use model_format::limits::{self, MAX_ORDER};
use model_format::link::{
    ActivateError, Activity, LINK_LOST_AFTER_MS, LinkId, MAX_PIN_MEAN_SQUARE, MotionSource, MuteReason, PlayError,
    PlayRequest, RecordError, STALE_AFTER_MS, Selection, Setting, SettingSet, SettingsError, SlotId, StopError,
    UploadChunk, UploadError,
};
use model_format::scene::{Biquad, Region, Scene, StickSlip, Surface, Tap};
use model_format::{DacCode, Library, PlayRate, encode, encode_with_scenes};
use stylus_kernel::scene::Plan;

/// A device with a library of one texture, "texture 0", that plays it.
fn playing() -> SteppedStylus {
    let stylus = SteppedStylus::ready(&library(1, 20, 1));
    plays(&stylus, &play_request("texture 0"));
    stylus
}

/// Plays `request` until it sounds.
fn plays(stylus: &SteppedStylus, request: &PlayRequest) {
    let played = stylus.play(request.clone());
    assert!(played.is_ok(), "{request:?}: {played:?}");
    stylus.run(400);
    assert!(stylus.sounds(), "{request:?}");
}

fn refusal(stylus: &SteppedStylus, request: PlayRequest) -> PlayError {
    stylus.play(request).expect_err("it is refused")
}

fn stop(stylus: &SteppedStylus) {
    stylus.control.borrow_mut().stop().expect("it plays");
    stylus.run(100);
    assert!(!stylus.sounds());
}

fn mute(stylus: &SteppedStylus) -> Vec<MuteReason> {
    stylus.status().output.mute.iter().collect()
}

/// Number of starts from silence, and of changes without silence.
fn starts_and_switches(stylus: &SteppedStylus) -> (usize, usize) {
    let hardware = stylus.hardware();
    (hardware.starts, hardware.switches)
}

fn scene(name: &str, texture: u8, sample_rate_hz: u32) -> Scene {
    let name = name.try_into().expect("short");
    Scene::of_surface(name, sample_rate_hz, Surface::of_texture(texture))
}

fn scene_request(name: &str) -> PlayRequest {
    PlayRequest {
        selection: Selection::Scene(name.try_into().expect("short")),
        ..play_request("")
    }
}

/// A library with two textures and a scene of each; one texture has a rate that no stylus plays.
fn library_with_scenes() -> Vec<u8> {
    let textures = [texture("right", 40, 1, 5_000), texture("fast", 4, 1, 8_000)];
    let scenes = [scene("bench", 0, 5_000), scene("fast", 1, 8_000)];
    encode_with_scenes(&textures, &scenes).expect("valid")
}

#[test]
fn a_request_that_is_refused_says_why_and_leaves_what_was_played() {
    let bytes = library_with_scenes();
    let stylus = SteppedStylus::ready(&bytes);
    plays(&stylus, &play_request("right"));
    let named = |name: &str| name.try_into().expect("short");
    let texture_hz = 8_000;
    for (request, error) in [
        (play_request("wrong"), PlayError::NoSuchTexture { name: named("wrong") }),
        (play_request("fast"), PlayError::SampleRate { texture_hz }),
        (scene_request("right"), PlayError::NoSuchScene { name: named("right") }),
        (scene_request("fast"), PlayError::SampleRate { texture_hz }),
    ] {
        assert_eq!(refusal(&stylus, request), error);
    }
    for gain in [f32::NAN, f32::INFINITY, -0.1, 4.1] {
        let request = play_request("right");
        let error = refusal(&stylus, PlayRequest { gain, ..request });
        assert!(matches!(error, PlayError::Gain { .. }), "{error:?}");
    }
    // A scene that costs too much is refused, and the error shows the arithmetic of its cost.
    let library = Library::decode(&bytes).expect("valid");
    let plan = Plan::new(&library.scene("bench").expect("it is there"), &library);
    let cost = plan.expect("valid").worst_case();
    let budget = cost.instructions() - 1;
    stylus.hardware().budget = budget;
    let PlayError::OverBudget {
        instructions,
        budget: told,
        arithmetic,
    } = refusal(&stylus, scene_request("bench"))
    else {
        panic!("it is within the budget");
    };
    assert_eq!((instructions, told), (cost.instructions(), budget));
    assert_eq!(arithmetic.as_str(), cost.to_string());
    stylus.run(5);
    assert!(stylus.sounds() && mute(&stylus).is_empty());
    assert_eq!(stylus.hardware().playing, Some(play_request("right")));
    assert_eq!(starts_and_switches(&stylus), (1, 0));
    stylus.hardware().budget = cost.instructions();
    assert!(stylus.play(scene_request("bench")).is_ok());
}

#[test]
fn what_is_played_changes_without_a_mute_where_gain_and_rate_stay_and_in_silence_elsewhere() {
    let textures = [
        texture("slow", 4, 1, 5_000),
        texture("fast", 4, 1, 10_000),
        texture("also fast", 4, 1, 10_000),
    ];
    let scenes = [scene("bench", 0, 5_000), scene("fast bench", 1, 10_000)];
    let stylus = SteppedStylus::ready(&encode_with_scenes(&textures, &scenes).expect("valid"));
    let louder = PlayRequest {
        gain: 2.0,
        ..scene_request("bench")
    };
    for (request, rate, counts) in [
        (play_request("slow"), PlayRate::Hz5000, (1, 0)),
        (scene_request("bench"), PlayRate::Hz5000, (1, 1)),
        (louder, PlayRate::Hz5000, (2, 1)),
        (play_request("fast"), PlayRate::Hz10000, (3, 1)),
        (play_request("also fast"), PlayRate::Hz10000, (3, 2)),
        (scene_request("fast bench"), PlayRate::Hz10000, (3, 3)),
        (play_request("slow"), PlayRate::Hz5000, (4, 3)),
    ] {
        let before = starts_and_switches(&stylus).0;
        let mutes = stylus.status().output.mute_counts;
        let playing = stylus.play(request.clone()).expect("it is there");
        let changes = playing.mute.contains(MuteReason::Changing);
        assert_eq!(changes, counts.0 > before, "{request:?}");
        stylus.run(10);
        assert_eq!(changes, !stylus.sounds() || stylus.status().output.mute_counts != mutes);
        stylus.run(400);
        assert!(stylus.sounds(), "{request:?}");
        assert_eq!(stylus.hardware().config.rate(), rate, "{request:?}");
        assert_eq!(starts_and_switches(&stylus), counts, "{request:?}");
        let activity = stylus.status().output.activity;
        assert!(matches!(activity, Activity::Playing { selection, .. } if selection == request.selection));
    }
    // After two requests during a fade-out, the last one begins.
    for gain in [0.5, 0.25] {
        let request = play_request("slow");
        let played = stylus.play(PlayRequest { gain, ..request });
        assert!(played.is_ok(), "{played:?}");
        assert_eq!(stylus.status().output.activity, Activity::FadingOut);
    }
    stylus.run(400);
    let playing = stylus.hardware().playing.clone();
    assert_eq!(playing.map(|request| request.gain), Some(0.25));
    assert_eq!(starts_and_switches(&stylus), (5, 3));
}

#[test]
fn the_status_tells_the_limits_of_the_pin_and_the_coil_that_are_in_force() {
    let mut stylus = SteppedStylus::ready(&library(1, 4, 1));
    let most = MAX_PIN_MEAN_SQUARE;
    // The coil's three settings and the hard limit, then the limits that follow: the peak in V, the mean square in V²,
    // the power in W, and whether the image's cap is tighter.
    for (values, (peak_volt, mean_square, coil_watt, is_capped)) in [
        ([8.0, 1.0, 0.1, 0.5], (0.5, most, 0.01, true)),
        ([8.0, 10.0, 0.25, 0.5], (0.5, 0.02, 0.25, false)),
        ([8.0, 10.0, 0.25, 1.45], (4.0 * 0.02f32.sqrt(), 0.02, 0.25, false)),
        ([4.0, 2.0, 0.01, 0.2], (0.2, 0.01, 0.01, false)),
        ([4.0, 2.0, 1.0, 1.45], (4.0 * most.sqrt(), most, 0.08, true)),
    ] {
        let settings = [
            Setting::CoilResistance,
            Setting::AmplifierGain,
            Setting::PowerLimit,
            Setting::HardLimit,
        ];
        let changes: Vec<_> = iter::zip(settings, values)
            .map(|(setting, value)| change(setting, value))
            .collect();
        stylus.change_settings(&changes).expect("nothing plays");
        let limits = stylus.status().limits;
        // The peak is a whole number of the converter's steps.
        let below = peak_volt - limits.peak_volt;
        assert!((-1e-6..DacCode::STEP.0).contains(&below), "{values:?}: {limits:?}");
        let off = (limits.mean_square - mean_square)
            .abs()
            .max((limits.coil_watt - coil_watt).abs());
        assert!(off < 1e-6, "{values:?}: {limits:?}");
        assert_eq!(limits.is_capped, is_capped, "{values:?}");
        // The reported limits are those of the tick, and stay the same while something plays at any gain.
        let quiet = PlayRequest {
            gain: 0.25,
            ..play_request("texture 0")
        };
        plays(&stylus, &quiet);
        assert_eq!(stylus.status().limits, limits);
        let steps = stylus.hardware().config.limit_steps();
        assert_eq!(limits.peak_volt, steps as f32 * DacCode::STEP.0);
        stop(&stylus);
    }
}

#[test]
fn a_texture_at_ten_kilohertz_may_take_half_of_the_budget_per_sample() {
    let textures = [texture("slow", 40, 1, 5_000), texture("fast", 40, 1, 10_000)];
    let bytes = encode(&textures).expect("valid");
    let stylus = SteppedStylus::ready(&bytes);
    let library = Library::decode(&bytes).expect("valid");
    let slow = library.texture("slow").expect("it is there");
    let cost = Plan::of_texture(slow).worst_case().instructions();
    let play = |budget: u32, name| {
        stylus.hardware().budget = budget;
        stylus.play(play_request(name)).map(drop)
    };
    assert_eq!(play(2 * cost, "fast"), Ok(()));
    assert_eq!(play(2 * cost - 1, "slow"), Ok(()));
    let over = play(2 * cost - 1, "fast");
    assert!(
        matches!(over, Err(PlayError::OverBudget { instructions, budget, .. })
            if (instructions, budget) == (cost, cost - 1)),
        "{over:?}"
    );
}

#[test]
fn the_longest_arithmetic_fits_its_answer() {
    let mut textures = Vec::new();
    let mut longest = scene("longest", 0, 5_000);
    for index in 0..16 {
        let mut texture = texture(&format!("texture {index}"), MAX_ORDER, 1, 5_000);
        texture.speed_axis_mm_s.truncate(1);
        texture.force_axis_n.truncate(1);
        texture.nodes.truncate(1);
        textures.push(texture);
    }
    let surface = |texture| Surface {
        tap: Some(Tap {
            frequency_hz: 200.0,
            decay_s: 0.01,
            gain_m_s2_per_n_s: 0.1,
            limit_m_s2: 1.0,
        }),
        stick_slip: Some(StickSlip {
            period_mm: 1.0,
            duty: 0.5,
            depth: 0.5,
            below_mm_s: 10.0,
            above_n: 0.5,
        }),
        ..Surface::of_texture(texture)
    };
    longest.surfaces = (0..16).map(surface).collect();
    // The path only reaches the last two surfaces.
    let region = |(start_mm, surface)| Region {
        start_mm,
        end_mm: start_mm + 10.0,
        surface,
    };
    longest.regions = [(0.0, 14), (10.0, 15)].into_iter().map(region).collect();
    while longest.equaliser.push(Biquad::IDENTITY).is_ok() {}
    let bytes = encode_with_scenes(&textures, &[longest]).expect("valid");
    let stylus = SteppedStylus::ready(&bytes);
    stylus.hardware().budget = 0;
    let refused = refusal(&stylus, scene_request("longest"));
    let PlayError::OverBudget { arithmetic, .. } = refused else {
        panic!("{refused:?}");
    };
    let is_whole = arithmetic.contains("surface 15, stick-slip") && arithmetic.ends_with(" instructions");
    assert!(is_whole, "{arithmetic}");
}

#[test]
fn another_library_takes_over_in_silence_and_one_that_is_not_there_or_fails_does_not() {
    let mut stylus = playing();
    let slot = SlotId::B;
    let missing = Err(ActivateError::NoLibrary { slot });
    assert_eq!(stylus.activate(slot), missing);
    assert!(stylus.sounds());
    let committed = stylus.upload(&library(2, 30, 2)).expect("it is valid");
    assert_eq!(committed.slot, slot, "what is played is not overwritten");
    assert!(stylus.sounds());
    assert!(stylus.activate(slot).is_ok());
    assert!(!stylus.sounds());
    plays(&stylus, &play_request("texture 1"));
    assert_eq!(stylus.hardware().exchanges, 2);
    // If the copy to RAM fails, no library is active, and the next activation works.
    stylus.hardware().bad_loads = 1;
    let slot = SlotId::A;
    let failed = Err(ActivateError::NotCopied { slot });
    assert_eq!(stylus.activate(slot), failed);
    let refused = refusal(&stylus, play_request("texture 0"));
    assert_eq!(refused, PlayError::NoLibrary);
    assert_eq!(stylus.storage.slots().active, None);
    assert!(stylus.activate(slot).is_ok());
    plays(&stylus, &play_request("texture 0"));
}

#[test]
fn motion_that_stops_and_a_host_that_goes_are_silent_within_100_ms() {
    for host_is_heard in [true, false] {
        let stylus = playing();
        let counts = stylus.status().output.mute_counts;
        let mut silent_after = 0;
        while stylus.sounds() {
            if host_is_heard {
                stylus.control.borrow_mut().keep_alive(LinkId::Serial);
            }
            stylus.control.millisecond();
            silent_after += 1;
            assert!(silent_after <= 100, "it sounds after 100 ms");
        }
        assert!(silent_after > LINK_LOST_AFTER_MS, "not before its time");
        let mute = mute(&stylus);
        assert!(mute.contains(&MuteReason::Stale));
        assert_eq!(mute.contains(&MuteReason::LinkLost), !host_is_heard);
        let stale = MuteReason::Stale as usize;
        let began = stylus.status().output.mute_counts[stale];
        assert_eq!(began, counts[stale] + 1, "it began once");
        // The sound returns.
        stylus.run(300);
        assert!(stylus.sounds());
    }
}

/// At each wait other tasks have their turn: the watchdog's feeder, the links, the poll that mutes.
#[test]
fn a_commit_waits_between_the_steps_of_its_decoding_and_a_stop_is_served_meanwhile() {
    let mut stylus = playing();
    let bytes = library(2, MAX_ORDER, 60);
    assert!(bytes.len() > 60_000, "{} bytes", bytes.len());
    let commits = std::cell::Cell::new(false);
    let (mut waits, mut stopped_at, mut quiet_at) = (0, None, None);
    let committed = stylus.request_meanwhile(
        async |storage, stage| {
            let begin = announcement(&bytes);
            storage.upload_begin(stage, begin).await.expect("it may");
            for chunk in chunks(&bytes, 0, 512) {
                storage.upload_chunk(stage, chunk).await.expect("in turn");
            }
            commits.set(true);
            storage.upload_commit(stage).await
        },
        |control| {
            if commits.get() {
                waits += 1;
                if stopped_at.is_none() {
                    control.borrow_mut().stop().expect("it plays");
                    stopped_at = Some(waits);
                }
                if quiet_at.is_none() && !control.borrow_mut().device().sounds() {
                    quiet_at = Some(waits);
                }
            }
            control.millisecond_with_motion();
        },
    );
    committed.expect("it is valid");
    // One wait per 4096 bytes read, one per step of the checksum, and one per step of nodes. A step of nodes may exceed
    // the bytes of a step by up to as many again.
    let steps = bytes.len() / limits::STEP_BYTES;
    let fewest = bytes.len() / 4096 + steps + steps / 2;
    assert!(waits >= fewest, "{waits} waits, {fewest} are due");
    let (stopped, quiet) = (stopped_at.expect("it stopped"), quiet_at.expect("it rests"));
    assert!(quiet - stopped <= 100, "{quiet} ms");
    assert!(quiet < waits, "the commit was still under way");
}

/// A plan must not use a library in RAM that is not yet completely decoded.
#[test]
fn a_request_in_the_middle_of_an_activation_is_refused_and_does_not_disturb_it() {
    let mut stylus = playing();
    let first = stylus.status().library_crc32;
    let second = library(2, MAX_ORDER, 60);
    let slot = stylus.upload(&second).expect("it is valid").slot;
    let mut waits = 0;
    let activated = stylus.request_meanwhile(
        async |storage, stage| storage.activate(stage, slot).await,
        |control| {
            waits += 1;
            let mut requests = control.borrow_mut();
            let played = requests.play(LinkId::Serial, play_request("texture 0"));
            assert_eq!(played, Err(PlayError::Busy));
            assert_eq!(requests.stop(), Err(StopError::NotPlaying));
            assert_eq!(requests.begin_activation(), Err(ActivateError::Busy));
            assert!(requests.begin_configuration().is_err());
            assert_eq!(requests.status().library_crc32, first);
            drop(requests);
            control.millisecond_with_motion();
        },
    );
    assert_eq!(activated.expect("it is valid").slot, slot);
    // In addition to the waits of the check of the bytes, there are those of the copy in steps of 8 KB.
    let fewest = second.len() / 4096 + second.len() / 8192;
    assert!(waits >= fewest, "{waits} waits, {fewest} are due");
    plays(&stylus, &play_request("texture 1"));
}

#[test]
fn nothing_plays_until_each_setting_of_the_coil_was_set_by_someone() {
    let mut stylus = SteppedStylus::boot();
    stylus.upload(&library(1, 20, 1)).expect("it is valid");
    stylus.activate(SlotId::A).expect("it is valid");
    let mut missing = SettingSet::REQUIRED;
    for coil in COIL {
        let refused = refusal(&stylus, play_request("texture 0"));
        assert_eq!(refused, PlayError::SettingsNotSet { missing });
        let status = stylus.status();
        assert!(!status.output.amplifier && !status.settings.set.contains(coil.setting));
        // A default value counts as set as soon as somebody has set it.
        let default = change(coil.setting, coil.setting.spec().default);
        stylus.change_settings(&[default]).expect("in range");
        missing = missing.with(coil.setting, false);
        stylus.run(50);
        assert!(!stylus.sounds());
    }
    assert!(missing.is_empty() && stylus.status().output.amplifier);
    plays(&stylus, &play_request("texture 0"));
}

#[test]
fn lost_settings_refuse_a_play_by_their_names_until_they_are_set_again_or_reset() {
    for begins_anew in [true, false] {
        let slots = SimulatedFlash::two_slots();
        let garbage = SimulatedFlash::new(Memory::garbage(2 * SECTOR_BYTES));
        let mut stylus = SteppedStylus::boot_as(slots, garbage, Hardware::new());
        stylus.upload(&library(1, 20, 1)).expect("it is valid");
        stylus.activate(SlotId::A).expect("it is valid");
        let lost = SettingSet::ALL;
        let refused = refusal(&stylus, play_request("texture 0"));
        assert_eq!(refused, PlayError::SettingsLost { lost });
        assert_eq!(stylus.status().settings.lost, lost);
        if begins_anew {
            stylus.reset_settings().expect("the flash can be erased");
            stylus.set_coil();
        } else {
            for setting in Setting::ALL {
                let refused = refusal(&stylus, play_request("texture 0"));
                assert!(matches!(refused, PlayError::SettingsLost { .. }));
                let default = change(setting, setting.spec().default);
                stylus.change_settings(&[default]).expect("in range");
            }
        }
        plays(&stylus, &play_request("texture 0"));
    }
}

#[test]
fn an_open_force_sensor_is_silence_with_its_name_and_a_host_plays_on() {
    let stylus = SteppedStylus::ready(&library(1, 20, 1));
    let by_sensors = PlayRequest {
        motion: MotionSource::Sensors,
        ..play_request("texture 0")
    };
    plays(&stylus, &by_sensors);
    stylus.hardware().hand.is_open = true;
    stylus.run(STALE_AFTER_MS + 50);
    assert!(!stylus.sounds());
    assert_eq!(mute(&stylus), [MuteReason::Stale, MuteReason::ForceRail]);
    stylus.hardware().hand.is_open = false;
    stylus.run(300);
    assert!(stylus.sounds());
    // Motion of the host needs no sensor.
    stylus.hardware().hand.is_open = true;
    plays(&stylus, &play_request("texture 0"));
    assert_eq!(mute(&stylus), []);
}

#[test]
fn a_device_that_has_nothing_to_start_is_muted_by_a_fault_and_does_not_say_that_it_plays() {
    let stylus = SteppedStylus::ready(&library(1, 20, 1));
    stylus.play(play_request("texture 0")).expect("it is there");
    stylus.hardware().prepared = None;
    stylus.run(300);
    assert_eq!(stylus.status().output.activity, Activity::Idle);
    assert!(mute(&stylus).contains(&MuteReason::Fault));
    assert!(!stylus.sounds());
    let refused = refusal(&stylus, play_request("texture 0"));
    assert_eq!(refused, PlayError::Fault);
}

#[test]
fn in_safe_mode_nothing_plays_the_reason_is_told_and_the_rest_is_served() {
    let mut hardware = Hardware::new();
    hardware.start.safe_mode = true;
    hardware.start.quick_faults = 4;
    let mut stylus = SteppedStylus::boot_from_on(SimulatedFlash::two_slots(), hardware);
    let slot = stylus.upload(&library(1, 4, 1)).expect("it is valid").slot;
    stylus.activate(slot).expect("it is valid");
    let refused = refusal(&stylus, play_request("texture 0"));
    assert_eq!(refused, PlayError::SafeMode { quick_faults: 4 });
    stylus.run(100);
    assert!(mute(&stylus).contains(&MuteReason::SafeMode));
    assert!(stylus.status().start.safe_mode && !stylus.sounds());
    assert_eq!(starts_and_switches(&stylus), (0, 0));
}

#[test]
fn while_the_supply_is_low_no_flash_is_written_and_what_was_begun_goes_on_after() {
    let mut stylus = SteppedStylus::boot();
    stylus.set_coil();
    let bytes = library(1, 4, 1);
    let tighter = [change(Setting::HardLimit, 0.25)];
    stylus.hardware().start.supply_low = true;
    assert_eq!(stylus.upload(&bytes), Err(UploadError::SupplyLow));
    let changed = stylus.change_settings(&tighter);
    assert_eq!(changed, Err(SettingsError::SupplyLow));
    assert_eq!(stylus.reset_settings(), Err(SettingsError::SupplyLow));
    stylus.hardware().start.supply_low = false;
    let begin = announcement(&bytes);
    let begun = stylus.request(async |storage, stage| storage.upload_begin(stage, begin).await);
    assert!(begun.is_ok(), "{begun:?}");
    stylus.hardware().start.supply_low = true;
    let data = &bytes[..512];
    let chunk = UploadChunk { offset: 0, data };
    let refused = stylus.request(async |storage, stage| {
        let written = storage.upload_chunk(stage, chunk).await.err();
        [written, storage.upload_commit(stage).await.err()]
    });
    assert_eq!(refused, [const { Some(UploadError::SupplyLow) }; 2]);
    stylus.hardware().start.supply_low = false;
    assert!(stylus.upload(&bytes).is_ok());
    assert!(stylus.change_settings(&tighter).is_ok());
}

#[test]
fn recordings_are_started_and_stopped_once() {
    let stylus = SteppedStylus::boot();
    let mut control = stylus.control.borrow_mut();
    assert_eq!(control.record_stop(), Err(RecordError::NotRecording));
    assert!(control.record_start(LinkId::Usb).is_ok());
    assert!(control.status().record.recording);
    let again = control.record_start(LinkId::Serial);
    assert_eq!(again, Err(RecordError::Recording));
    drop(control);
    // The blocks go to the link that began the recording, and not to the link that was refused.
    let block = iter::repeat_with(|| {
        stylus.hardware().tick();
        stylus.control.borrow_mut().next_block()
    });
    let (link, _) = block.take(100).flatten().next().expect("one in 32 ticks");
    assert_eq!(link, LinkId::Usb);
    assert!(stylus.control.borrow_mut().record_stop().is_ok());
}
