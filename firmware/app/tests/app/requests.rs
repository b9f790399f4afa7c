//! Requests end to end on a device in memory: what a host sees, and what the tick is told.

use std::iter;
use std::ops::{Deref, DerefMut};

use embassy_futures::block_on;
use fake_stylus::device::{COIL, SteppedStylus};
use fake_stylus::flash::{Memory, SECTOR_BYTES, SimulatedFlash};
use fake_stylus::hardware::Hardware;
use fake_stylus::library::{announcement, library, texture};
use model_format::limits::{self, MAX_ORDER, SLOT_BYTES};
use model_format::link::{
    ActivateError, Activity, LINK_LOST_AFTER_MS, LinkId, ListError, ListRequest,
    MAX_PIN_MEAN_SQUARE, MotionSample, MotionSource, MuteReason, PlayError, PlayRequest,
    RecordError, STALE_AFTER_MS, Selection, Setting, SettingChange, SettingSet, Settings,
    SettingsChange, SettingsError, SettingsState, SlotId, SlotState, StopError, UploadChunk,
    UploadError, UploadState,
};
use model_format::scene::{Biquad, Region, Scene, StickSlip, Surface, Tap};
use model_format::{
    DacCode, Library, MillimetresPerSecond, Newton, PlayRate, encode, encode_with_scenes,
};
use stylus_app::safety::Config;
use stylus_app::slots::SlotStore;
use stylus_kernel::scene::Plan;

/// A device, and what a host often asks of it.
struct Stylus(SteppedStylus);

impl Deref for Stylus {
    type Target = SteppedStylus;

    fn deref(&self) -> &SteppedStylus {
        &self.0
    }
}

impl DerefMut for Stylus {
    fn deref_mut(&mut self) -> &mut SteppedStylus {
        &mut self.0
    }
}

impl Stylus {
    /// Boots on blank flash, and sets what nothing plays without.
    fn new() -> Self {
        let mut stylus = Self::unset();
        stylus.set_coil();
        stylus
    }

    /// Boots on blank flash.
    fn unset() -> Self {
        let stylus = Self(SteppedStylus::boot());
        assert_eq!(stylus.storage.slots().active, None);
        stylus
    }

    fn with_library(bytes: &[u8]) -> Self {
        let mut stylus = Self::new();
        let slot = stylus.upload(bytes);
        assert!(stylus.activate(slot).is_ok());
        stylus
    }

    fn upload(&mut self, bytes: &[u8]) -> SlotId {
        let control = self.control.clone();
        self.request(async |storage, stage| {
            storage
                .upload_begin(stage, announcement(bytes))
                .await
                .expect("it may begin");
            for (index, data) in bytes.chunks(512).enumerate() {
                let offset = index as u32 * 512;
                storage
                    .upload_chunk(stage, UploadChunk { offset, data })
                    .await
                    .expect("in turn");
            }
            assert!(matches!(
                control.borrow().status().upload,
                UploadState::Receiving(_)
            ));
            storage
                .upload_commit(stage)
                .await
                .expect("it is valid")
                .slot
        })
    }

    fn activate(&mut self, slot: SlotId) -> Result<SlotId, ActivateError> {
        let activated = self.request(async |storage, stage| storage.activate(stage, slot).await);
        activated.map(|activated| activated.slot)
    }

    fn play(&self, name: &str) -> Result<(), PlayError> {
        self.control
            .borrow_mut()
            .play(LinkId::Serial, request(name))
            .map(|_| ())
    }

    fn change_setting(&mut self, change: SettingChange) -> Result<Settings, SettingsError> {
        self.change_settings(&[change])
    }
}

fn request(name: &str) -> PlayRequest {
    PlayRequest {
        selection: Selection::Texture(name.try_into().expect("short")),
        gain: 1.0,
        motion: MotionSource::Host,
        seed: 7,
    }
}

#[test]
fn without_a_library_nothing_is_played() {
    let stylus = Stylus::new();
    assert_eq!(stylus.play("denim"), Err(PlayError::NoLibrary));
    stylus.run(10);
    assert!(!stylus.sounds());
    let status = stylus.control.borrow().status();
    assert_eq!((status.active, status.library_crc32), (None, 0));
    assert_eq!(
        status.output.mute.iter().collect::<Vec<_>>(),
        [MuteReason::NotPlaying]
    );
}

#[test]
fn a_library_that_was_uploaded_and_activated_is_played_and_stopped() {
    let bytes = library(2, 20, 1);
    let stylus = Stylus::with_library(&bytes);
    let status = stylus.control.borrow().status();
    assert_eq!(
        (status.active, status.library_crc32),
        (Some(SlotId::A), announcement(&bytes).crc32)
    );
    stylus.play("texture 1").expect("it is there");
    stylus.run(300);
    assert!(stylus.sounds());
    let status = stylus.control.borrow().status();
    let Activity::Playing { selection, .. } = status.output.activity else {
        panic!("it plays");
    };
    assert!(matches!(selection, Selection::Texture(texture) if texture == "texture 1"));
    assert!(status.output.mute.is_empty());
    stylus.control.borrow_mut().stop().expect("it plays");
    stylus.run(50);
    assert!(!stylus.sounds());
    assert_eq!(
        stylus.control.borrow_mut().stop(),
        Err(StopError::NotPlaying)
    );
    assert_eq!(
        stylus.control.borrow().status().output.activity,
        Activity::Idle
    );
}

#[test]
fn a_request_that_is_refused_leaves_what_was_played() {
    let textures = [texture("right", 4, 1, 5_000), texture("fast", 4, 1, 8_000)];
    let stylus = Stylus::with_library(&encode(&textures).expect("valid"));
    stylus.play("right").expect("it is there");
    stylus.run(300);
    let missing = PlayError::NoSuchTexture {
        name: "wrong".try_into().expect("short"),
    };
    assert_eq!(stylus.play("wrong"), Err(missing));
    let texture_hz = 8_000;
    assert_eq!(
        stylus.play("fast"),
        Err(PlayError::SampleRate { texture_hz })
    );
    for gain in [f32::NAN, f32::INFINITY, -0.1, 4.1] {
        let error = stylus.control.borrow_mut().play(
            LinkId::Serial,
            PlayRequest {
                gain,
                ..request("right")
            },
        );
        assert!(matches!(error, Err(PlayError::Gain { .. })), "{error:?}");
    }
    assert_eq!(stylus.storage.slots().active, Some(SlotId::A));
    stylus.run(5);
    assert!(stylus.sounds());
    assert!(stylus.control.borrow().mute().is_empty());
}

fn scene(name: &str, texture: u8, sample_rate_hz: u32) -> Scene {
    let name = name.try_into().expect("short");
    Scene::of_surface(name, sample_rate_hz, Surface::of_texture(texture))
}

fn scene_request(name: &str) -> PlayRequest {
    PlayRequest {
        selection: Selection::Scene(name.try_into().expect("short")),
        ..request("")
    }
}

/// A library with a scene of each of two textures, one of them for a rate that no stylus plays.
fn library_with_scenes() -> Vec<u8> {
    let textures = [texture("right", 40, 1, 5_000), texture("fast", 4, 1, 8_000)];
    let scenes = [scene("bench", 0, 5_000), scene("fast", 1, 8_000)];
    encode_with_scenes(&textures, &scenes).expect("valid")
}

#[test]
fn a_scene_is_played_by_its_name_and_switched_without_a_mute_where_the_gain_stays() {
    let stylus = Stylus::with_library(&library_with_scenes());
    let play = |request| stylus.control.borrow_mut().play(LinkId::Serial, request);
    let playing = play(scene_request("bench")).expect("it is there");
    assert_eq!(playing.request, scene_request("bench"));
    stylus.run(300);
    assert!(stylus.sounds());
    let counts = stylus.control.borrow().status().output.mute_counts;
    let switched = play(request("right")).expect("it is there");
    assert!(switched.mute.is_empty());
    play(scene_request("bench")).expect("it is there");
    stylus.run(10);
    assert!(stylus.sounds());
    let output = stylus.control.borrow().status().output;
    assert_eq!(output.mute_counts, counts);
    assert!(
        matches!(output.activity, Activity::Playing { selection, .. } if selection == scene_request("bench").selection)
    );
    let louder = PlayRequest {
        gain: 2.0,
        ..scene_request("bench")
    };
    assert!(
        play(louder)
            .expect("it is there")
            .mute
            .contains(MuteReason::Changing)
    );
    stylus.run(300);
    let mut control = stylus.control.borrow_mut();
    let bench = control.device();
    assert_eq!((bench.starts, bench.switches), (2, 2));
}

#[test]
fn the_status_tells_the_limits_of_the_pin_and_the_coil_that_are_in_force() {
    let mut stylus = Stylus::with_library(&library(1, 4, 1));
    let told = |stylus: &Stylus| stylus.control.borrow().status().limits;
    // The coil's three, the hard limit, and what follows: the peak in V, the mean square in V², the power in W, and if
    // the image's cap is tighter.
    let cases = [
        ([8.0, 1.0, 0.1, 0.5], (0.5, MAX_PIN_MEAN_SQUARE, 0.01, true)),
        ([8.0, 10.0, 0.25, 0.5], (0.5, 0.02, 0.25, false)),
        (
            [8.0, 10.0, 0.25, 1.45],
            (4.0 * 0.02f32.sqrt(), 0.02, 0.25, false),
        ),
        ([4.0, 2.0, 0.01, 0.2], (0.2, 0.01, 0.01, false)),
        (
            [4.0, 2.0, 1.0, 1.45],
            (
                4.0 * MAX_PIN_MEAN_SQUARE.sqrt(),
                MAX_PIN_MEAN_SQUARE,
                0.08,
                true,
            ),
        ),
    ];
    for (values, (peak_volt, mean_square, coil_watt, is_capped)) in cases {
        let settings = [
            Setting::CoilResistance,
            Setting::AmplifierGain,
            Setting::PowerLimit,
            Setting::HardLimit,
        ];
        let changes: Vec<_> = iter::zip(settings, values)
            .map(|(setting, value)| SettingChange { setting, value })
            .collect();
        stylus.change_settings(&changes).expect("nothing plays");
        let limits = told(&stylus);
        // The peak is of whole steps of the converter.
        let below = peak_volt - limits.peak_volt;
        assert!(
            (-1e-6..DacCode::STEP.0).contains(&below),
            "{values:?}: {limits:?}"
        );
        assert!(
            (limits.mean_square - mean_square).abs() < 1e-6,
            "{values:?}: {limits:?}"
        );
        assert!(
            (limits.coil_watt - coil_watt).abs() < 1e-6,
            "{values:?}: {limits:?}"
        );
        assert_eq!(limits.is_capped, is_capped, "{values:?}");
        // They are those of the tick, and the same while something plays, at whatever gain.
        let quiet = PlayRequest {
            gain: 0.25,
            ..request("texture 0")
        };
        let played = stylus.control.borrow_mut().play(LinkId::Serial, quiet);
        assert!(played.is_ok());
        stylus.run(100);
        assert!(stylus.sounds());
        assert_eq!(told(&stylus), limits);
        let steps = stylus.control.borrow_mut().device().config.limit_steps();
        assert_eq!(limits.peak_volt, steps as f32 * DacCode::STEP.0);
        stylus.control.borrow_mut().stop().expect("it plays");
        stylus.run(300);
    }
}

#[test]
fn a_change_of_rate_goes_through_silence_and_back_and_a_change_within_it_does_not() {
    let textures = [
        texture("slow", 4, 1, 5_000),
        texture("fast", 4, 1, 10_000),
        texture("also fast", 4, 1, 10_000),
    ];
    let scenes = [scene("fast scene", 1, 10_000)];
    let stylus = Stylus::with_library(&encode_with_scenes(&textures, &scenes).expect("valid"));
    // Counts of beginnings from silence, and of changes without one, after each request.
    let steps = [
        ("slow", PlayRate::Hz5000, (1, 0)),
        ("fast", PlayRate::Hz10000, (2, 0)),
        ("also fast", PlayRate::Hz10000, (2, 1)),
        ("slow", PlayRate::Hz5000, (3, 1)),
        ("fast", PlayRate::Hz10000, (4, 1)),
    ];
    for (name, rate, counts) in steps {
        stylus.play(name).expect("it is there");
        stylus.run(400);
        assert!(stylus.sounds(), "{name}");
        let mut control = stylus.control.borrow_mut();
        let hardware = control.device();
        assert_eq!(hardware.config.rate(), rate, "{name}");
        assert_eq!((hardware.starts, hardware.switches), counts, "{name}");
    }
    let playing = (stylus.control.borrow_mut()).play(LinkId::Serial, scene_request("fast scene"));
    assert!(playing.expect("it is there").mute.is_empty());
}

#[test]
fn a_scene_at_ten_kilohertz_may_take_half_of_the_budget_per_sample() {
    let textures = [
        texture("slow", 40, 1, 5_000),
        texture("fast", 40, 1, 10_000),
    ];
    let bytes = encode(&textures).expect("valid");
    let stylus = Stylus::with_library(&bytes);
    let library = Library::decode(&bytes).expect("valid");
    let slow = library.texture("slow").expect("it is there");
    let cost = Plan::of_texture(slow).worst_case().instructions();
    let play = |budget: u32, name| {
        stylus.control.borrow_mut().device().budget = budget;
        stylus.play(name)
    };
    assert_eq!(play(2 * cost, "fast"), Ok(()));
    assert_eq!(play(2 * cost - 1, "slow"), Ok(()));
    match play(2 * cost - 1, "fast") {
        Err(PlayError::OverBudget {
            instructions,
            budget,
            ..
        }) => assert_eq!((instructions, budget), (cost, cost - 1)),
        other => panic!("{other:?}"),
    }
}

#[test]
fn a_scene_that_cannot_be_played_is_refused_with_the_reason_and_what_was_played_goes_on() {
    let stylus = Stylus::with_library(&library_with_scenes());
    stylus.play("right").expect("it is there");
    stylus.run(300);
    let play = |name| {
        stylus
            .control
            .borrow_mut()
            .play(LinkId::Serial, scene_request(name))
    };
    let missing = PlayError::NoSuchScene {
        name: "right".try_into().expect("short"),
    };
    assert_eq!(play("right"), Err(missing), "a texture is no scene");
    let texture_hz = 8_000;
    assert_eq!(play("fast"), Err(PlayError::SampleRate { texture_hz }));
    let bytes = library_with_scenes();
    let library = Library::decode(&bytes).expect("valid");
    let plan = Plan::new(&library.scene("bench").expect("it is there"), &library);
    let cost = plan.expect("valid").worst_case();
    let budget = cost.instructions() - 1;
    stylus.control.borrow_mut().device().budget = budget;
    match play("bench") {
        Err(PlayError::OverBudget {
            instructions,
            budget: told,
            arithmetic,
        }) => {
            assert_eq!((instructions, told), (cost.instructions(), budget));
            assert_eq!(arithmetic.as_str(), cost.to_string());
        }
        other => panic!("{other:?}"),
    }
    stylus.run(5);
    assert!(stylus.sounds());
    let mut control = stylus.control.borrow_mut();
    let bench = control.device();
    assert_eq!(bench.playing, Some(request("right")));
    assert_eq!((bench.starts, bench.switches), (1, 0));
    bench.budget = cost.instructions();
    assert!(control.play(LinkId::Serial, scene_request("bench")).is_ok());
}

#[test]
fn the_longest_arithmetic_fits_its_answer() {
    let mut textures = Vec::new();
    let mut longest = scene("longest", 0, 5_000);
    longest.surfaces.clear();
    for index in 0..16 {
        textures.push(texture(&format!("texture {index}"), MAX_ORDER, 1, 5_000));
        textures[usize::from(index)].speed_axis_mm_s.truncate(1);
        textures[usize::from(index)].force_axis_n.truncate(1);
        textures[usize::from(index)].nodes.truncate(1);
        let mut surface = Surface::of_texture(index);
        surface.tap = Some(Tap {
            frequency_hz: 200.0,
            decay_s: 0.01,
            gain_m_s2_per_n_s: 0.1,
            limit_m_s2: 1.0,
        });
        surface.stick_slip = Some(StickSlip {
            period_mm: 1.0,
            duty: 0.5,
            depth: 0.5,
            below_mm_s: 10.0,
            above_n: 0.5,
        });
        longest.surfaces.push(surface).expect("there is room");
    }
    // The last two alone can be come upon.
    for (place, surface) in [(0.0, 14), (10.0, 15)] {
        let region = Region {
            start_mm: place,
            end_mm: place + 10.0,
            surface,
        };
        longest.regions.push(region).expect("there is room");
    }
    while longest.equaliser.push(Biquad::IDENTITY).is_ok() {}
    let bytes = encode_with_scenes(&textures, &[longest]).expect("valid");
    let stylus = Stylus::with_library(&bytes);
    stylus.control.borrow_mut().device().budget = 0;
    let refused = stylus
        .control
        .borrow_mut()
        .play(LinkId::Serial, scene_request("longest"));
    match refused {
        Err(PlayError::OverBudget { arithmetic, .. }) => {
            assert!(arithmetic.ends_with(" instructions"), "{arithmetic}");
            assert!(
                arithmetic.contains("surface 15, stick-slip"),
                "{arithmetic}"
            );
        }
        other => panic!("{other:?}"),
    }
}

#[test]
fn the_scenes_of_a_slot_are_listed_one_by_one() {
    let mut stylus = Stylus::with_library(&library_with_scenes());
    let slot = SlotId::A;
    let mut list = |index| block_on(stylus.storage.list_scene(ListRequest { slot, index }));
    let first = list(0).expect("there are two");
    assert_eq!((first.name.as_str(), first.surfaces), ("bench", 1));
    assert_eq!(list(1).expect("there are two").name.as_str(), "fast");
    let (index, scenes) = (2, 2);
    let past = ListError::SceneIndex {
        slot,
        index,
        scenes,
    };
    assert_eq!(list(2), Err(past));
    let slot = SlotId::B;
    let none = block_on(stylus.storage.list_scene(ListRequest { slot, index: 0 }));
    assert_eq!(none, Err(ListError::NoLibrary { slot }));
    let valid = stylus.storage.slots().slots;
    assert!(matches!(&valid[0], SlotState::Valid(library) if library.scenes == 2));
}

#[test]
fn another_library_takes_over_in_silence_and_one_that_is_not_there_does_not() {
    let mut stylus = Stylus::with_library(&library(1, 20, 1));
    stylus.play("texture 0").expect("it is there");
    stylus.run(300);
    assert!(stylus.sounds());
    assert_eq!(
        stylus.activate(SlotId::B),
        Err(ActivateError::NoLibrary { slot: SlotId::B })
    );
    assert!(stylus.sounds());
    let slot = stylus.upload(&library(2, 30, 2));
    assert_eq!(slot, SlotId::B, "what is played is not overwritten");
    assert!(stylus.sounds());
    assert_eq!(stylus.activate(slot), Ok(SlotId::B));
    assert!(!stylus.sounds());
    stylus.play("texture 1").expect("the new one has it");
    stylus.run(300);
    assert!(stylus.sounds());
    assert_eq!(stylus.control.borrow_mut().device().exchanges, 2);
}

#[test]
fn a_copy_that_fails_leaves_no_library_active_and_the_next_activation_works() {
    let mut stylus = Stylus::with_library(&library(1, 20, 1));
    stylus.control.borrow_mut().device().bad_loads = 1;
    let slot = SlotId::A;
    assert_eq!(
        stylus.activate(slot),
        Err(ActivateError::NotCopied { slot })
    );
    assert_eq!(stylus.play("texture 0"), Err(PlayError::NoLibrary));
    assert_eq!(stylus.storage.slots().active, None);
    stylus.control.borrow_mut().device().bad_loads = 0;
    assert_eq!(stylus.activate(slot), Ok(slot));
    assert_eq!(stylus.play("texture 0"), Ok(()));
}

#[test]
fn motion_that_stops_and_a_host_that_goes_are_silent_within_100_ms() {
    for host_is_heard in [true, false] {
        let stylus = Stylus::with_library(&library(1, 20, 1));
        stylus.play("texture 0").expect("it is there");
        stylus.run(500);
        assert!(stylus.sounds());
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
        let mute = stylus.control.borrow().mute();
        assert!(mute.contains(MuteReason::Stale));
        assert_eq!(mute.contains(MuteReason::LinkLost), !host_is_heard);
        // And it comes back.
        stylus.run(300);
        assert!(stylus.sounds());
    }
}

#[test]
fn motion_that_is_not_finite_is_refused_and_the_one_before_holds() {
    let stylus = Stylus::with_library(&library(1, 20, 1));
    stylus.run(1);
    let before = stylus.control.borrow_mut().device().host;
    let bad = MotionSample {
        speed: MillimetresPerSecond(f32::NAN),
        force: Newton(1.0),
        position_mm: None,
        contact: None,
    };
    assert!(
        stylus
            .control
            .borrow_mut()
            .motion(LinkId::Serial, bad)
            .is_err()
    );
    assert_eq!(stylus.control.borrow_mut().device().host, before);
}

#[test]
fn settings_change_at_rest_alone_and_reach_the_device() {
    let mut stylus = Stylus::with_library(&library(1, 20, 1));
    stylus.play("texture 0").expect("it is there");
    stylus.run(50);
    let change = SettingChange {
        setting: Setting::HardLimit,
        value: 0.25,
    };
    assert_eq!(stylus.change_setting(change), Err(SettingsError::Playing));
    assert_eq!(stylus.reset_settings(), Err(SettingsError::Playing));
    stylus.control.borrow_mut().stop().expect("it plays");
    stylus.run(50);
    let set = stylus.change_setting(change).expect("nothing is played");
    assert_eq!(set.hard_limit().0, 0.25);
    assert_eq!(stylus.control.borrow().settings(), set);
    assert_eq!(stylus.control.borrow_mut().device().settings, set);
    let out = SettingChange {
        setting: Setting::HardLimit,
        value: 99.0,
    };
    let error = stylus.change_setting(out);
    assert!(matches!(error, Err(SettingsError::OutOfRange { .. })));
    assert_eq!(stylus.control.borrow().settings(), set);
    assert_eq!(stylus.reset_settings(), Ok(Settings::default()));
    assert_eq!(stylus.control.borrow().settings(), Settings::default());
}

/// A stylus that nobody has set, with a library.
fn unset_with_library() -> Stylus {
    let mut stylus = Stylus::unset();
    let slot = stylus.upload(&library(1, 20, 1));
    assert!(stylus.activate(slot).is_ok());
    stylus
}

/// Each wait is a turn of the other tasks: of the watchdog's feeder, of the links, of the poll that mutes.
#[test]
fn a_commit_waits_between_the_steps_of_its_decoding_and_a_stop_is_served_meanwhile() {
    let mut stylus = Stylus::with_library(&library(1, 20, 1));
    stylus.play("texture 0").expect("it is there");
    stylus.run(300);
    assert!(stylus.sounds());
    let bytes = library(2, MAX_ORDER, 60);
    assert!(bytes.len() > 60_000, "{} bytes", bytes.len());
    let commits = std::cell::Cell::new(false);
    let (mut waits, mut stopped_at) = (0, None);
    let mut quiet_at = None;
    let committed = stylus.request_meanwhile(
        async |storage, stage| {
            let begin = announcement(&bytes);
            storage.upload_begin(stage, begin).await.expect("it may");
            for (index, data) in bytes.chunks(512).enumerate() {
                let offset = index as u32 * 512;
                let chunk = UploadChunk { offset, data };
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
    // Once per 4096 bytes read, once per step of the checksum, and once per step of nodes, which ends beyond the bytes
    // of a step by less than as many.
    let steps = bytes.len() / limits::STEP_BYTES;
    let fewest = bytes.len() / 4096 + steps + steps / 2;
    assert!(waits >= fewest, "{waits} waits, {fewest} are due");
    let (stopped, quiet) = (stopped_at.expect("it stopped"), quiet_at.expect("it rests"));
    assert!(quiet - stopped <= 100, "{quiet} ms");
    assert!(quiet < waits, "the commit was still under way");
}

/// A library in RAM that was not decoded to its end must not be seen by a plan.
#[test]
fn a_request_in_the_middle_of_an_activation_is_refused_and_does_not_disturb_it() {
    let first = library(1, 20, 1);
    let mut stylus = Stylus::with_library(&first);
    let second = library(2, MAX_ORDER, 60);
    let slot = stylus.upload(&second);
    stylus.play("texture 0").expect("it is there");
    stylus.run(300);
    let mut waits = 0;
    let activated = stylus.request_meanwhile(
        async |storage, stage| storage.activate(stage, slot).await,
        |control| {
            waits += 1;
            let mut requests = control.borrow_mut();
            assert_eq!(
                requests
                    .play(LinkId::Serial, request("texture 0"))
                    .map(|_| ()),
                Err(PlayError::Busy)
            );
            assert!(matches!(requests.stop(), Err(StopError::NotPlaying)));
            assert!(matches!(
                requests.begin_activation(),
                Err(ActivateError::Busy)
            ));
            assert!(requests.begin_configuration().is_err());
            let active = requests.status().library_crc32;
            assert_eq!(active, announcement(&first).crc32);
            drop(requests);
            control.millisecond_with_motion();
        },
    );
    assert_eq!(activated.expect("it is valid").slot, slot);
    // Beside those of the check of the bytes, those of the copy in pieces of 8 KB.
    let fewest = second.len() / 4096 + second.len() / 8192;
    assert!(waits >= fewest, "{waits} waits, {fewest} are due");
    stylus.play("texture 1").expect("it is in the new one");
    stylus.run(300);
    assert!(stylus.sounds());
}

#[test]
fn nothing_plays_until_each_setting_of_the_coil_was_set_by_someone() {
    let mut stylus = unset_with_library();
    let mut missing = SettingSet::REQUIRED;
    for change in COIL {
        let refused = stylus.play("texture 0");
        assert_eq!(refused, Err(PlayError::SettingsNotSet { missing }));
        assert!(!stylus.control.borrow().status().output.amplifier);
        assert!(
            !stylus
                .control
                .borrow()
                .status()
                .settings
                .set
                .contains(change.setting)
        );
        // The value of the default counts as soon as somebody has set it.
        let default = change.setting.spec().default;
        stylus
            .change_setting(SettingChange {
                value: default,
                ..change
            })
            .expect("in range");
        missing = missing.with(change.setting, false);
        stylus.run(50);
        assert!(!stylus.sounds());
    }
    assert!(missing.is_empty());
    assert!(stylus.control.borrow().status().output.amplifier);
    stylus.play("texture 0").expect("all are set");
    stylus.run(300);
    assert!(stylus.sounds());
}

#[test]
fn after_a_reset_nothing_plays_and_the_output_stays_at_rest() {
    let mut stylus = Stylus::with_library(&library(1, 20, 1));
    assert_eq!(stylus.reset_settings(), Ok(Settings::default()));
    let refused = stylus.play("texture 0");
    assert_eq!(
        refused,
        Err(PlayError::SettingsNotSet {
            missing: SettingSet::REQUIRED
        })
    );
    stylus.run(300);
    assert!(!stylus.sounds());
    assert_eq!(
        stylus.control.borrow().status().settings,
        SettingsState::default()
    );
}

#[test]
fn lost_settings_refuse_a_play_by_their_names_until_they_are_set_again_or_reset() {
    for begins_anew in [true, false] {
        let mut stylus = Stylus(SteppedStylus::boot_with(
            SimulatedFlash::two_slots(),
            SimulatedFlash::new(Memory::garbage(2 * SECTOR_BYTES)),
        ));
        let slot = stylus.upload(&library(1, 20, 1));
        assert!(stylus.activate(slot).is_ok());
        let lost = SettingSet::ALL;
        assert_eq!(
            stylus.play("texture 0"),
            Err(PlayError::SettingsLost { lost })
        );
        assert_eq!(stylus.control.borrow().status().settings.lost, lost);
        if begins_anew {
            stylus.reset_settings().expect("the flash can be erased");
            stylus.set_coil();
        } else {
            for setting in Setting::ALL {
                assert!(matches!(
                    stylus.play("texture 0"),
                    Err(PlayError::SettingsLost { .. })
                ));
                let value = setting.spec().default;
                stylus
                    .change_setting(SettingChange { setting, value })
                    .expect("in range");
            }
        }
        stylus.play("texture 0").expect("everything is known again");
        stylus.run(300);
        assert!(stylus.sounds());
    }
}

#[test]
fn an_open_force_sensor_is_silence_with_its_name_and_a_host_plays_on() {
    let stylus = Stylus::with_library(&library(1, 20, 1));
    let by_sensors = PlayRequest {
        motion: MotionSource::Sensors,
        ..request("texture 0")
    };
    stylus
        .control
        .borrow_mut()
        .play(LinkId::Serial, by_sensors)
        .expect("it is there");
    stylus.run(300);
    assert!(stylus.sounds());
    stylus.control.borrow_mut().device().hand.is_open = true;
    stylus.run(STALE_AFTER_MS + 50);
    assert!(!stylus.sounds());
    let mute = stylus.control.borrow().status().output.mute;
    assert_eq!(
        mute.iter().collect::<Vec<_>>(),
        [MuteReason::Stale, MuteReason::ForceRail]
    );
    stylus.control.borrow_mut().device().hand.is_open = false;
    stylus.run(300);
    assert!(stylus.sounds());
    // Motion of the host needs no sensor.
    stylus.control.borrow_mut().device().hand.is_open = true;
    stylus.play("texture 0").expect("it is there");
    stylus.run(300);
    assert!(stylus.sounds() && stylus.control.borrow().mute().is_empty());
}

#[test]
fn nothing_begins_to_play_while_settings_are_stored_and_what_begins_after_has_its_gain() {
    let mut stylus = Stylus::with_library(&library(1, 20, 1));
    let change = SettingChange {
        setting: Setting::HardLimit,
        value: 0.25,
    };
    let quiet = PlayRequest {
        gain: 0.25,
        ..request("texture 0")
    };
    let mut asked = Vec::new();
    let (link, proposed) = (LinkId::Serial, SettingsChange::of(&[change]));
    let proposed = proposed.and_then(|change| stylus.control.borrow_mut().propose(link, change));
    let token = proposed.expect("nothing is played").token;
    let set = stylus.request_meanwhile(
        async |storage, stage| storage.settings_apply(stage, link, token).await,
        |control| {
            asked.push(control.borrow_mut().play(LinkId::Serial, quiet.clone()));
            control.millisecond_with_motion();
        },
    );
    assert!(set.is_ok() && !asked.is_empty(), "{set:?} {asked:?}");
    assert!(
        asked.iter().all(|asked| *asked == Err(PlayError::Busy)),
        "{asked:?}"
    );
    stylus.run(50);
    assert!(stylus.control.borrow_mut().device().playing.is_none());

    let begun = stylus
        .control
        .borrow_mut()
        .play(LinkId::Serial, quiet.clone());
    assert!(begun.is_ok(), "{begun:?}");
    stylus.run(50);
    let settings = stylus.control.borrow().settings();
    let mut control = stylus.control.borrow_mut();
    let device = control.device();
    assert!(device.playing.is_some());
    assert_eq!(device.config, Config::new(&settings, quiet.gain));
}

#[test]
fn a_fault_silences_until_a_restart() {
    let stylus = Stylus::with_library(&library(1, 20, 1));
    stylus.play("texture 0").expect("it is there");
    stylus.run(300);
    stylus.control.borrow_mut().fault();
    stylus.run(50);
    assert!(!stylus.sounds());
    assert_eq!(stylus.play("texture 0"), Err(PlayError::Fault));
}

#[test]
fn a_device_that_has_nothing_to_start_is_muted_by_a_fault_and_does_not_say_that_it_plays() {
    let stylus = Stylus::with_library(&library(1, 20, 1));
    stylus.play("texture 0").expect("it is there");
    stylus.control.borrow_mut().device().prepared = None;
    stylus.run(300);
    let status = stylus.control.borrow().status();
    assert_eq!(status.output.activity, Activity::Idle);
    assert!(status.output.mute.contains(MuteReason::Fault));
    assert!(!stylus.sounds());
    assert_eq!(stylus.play("texture 0"), Err(PlayError::Fault));
}

#[test]
fn a_boot_takes_the_newest_library_that_can_be_read() {
    let (first, second) = (library(1, 4, 1), library(2, 4, 2));
    let mut flash = SimulatedFlash::two_slots();
    block_on(async {
        let mut store = SlotStore::open(&mut flash).await;
        for bytes in [&first, &second] {
            let mut uploader = stylus_app::upload::Uploader::new();
            fake_stylus::library::upload(&mut uploader, &mut store, bytes, 512)
                .await
                .expect("it is taken");
        }
    });
    let boot = |flash| {
        let mut stylus = SteppedStylus::boot_from(flash);
        let listed = ListRequest {
            slot: SlotId::B,
            index: 1,
        };
        (
            stylus.control.borrow().status().active,
            block_on(stylus.storage.list(listed)).is_ok(),
        )
    };
    assert_eq!(
        boot(SimulatedFlash::new(flash.memory.clone())),
        (Some(SlotId::B), true)
    );
    // A word that is good when the slots are opened and bad when the library is copied.
    let mut wearing = SimulatedFlash::new(flash.memory.clone());
    wearing.wears_out = Some((SLOT_BYTES + 64, 1));
    assert_eq!(boot(wearing), (Some(SlotId::A), false));
}

#[test]
fn recordings_are_started_and_stopped_once() {
    let stylus = Stylus::new();
    let mut control = stylus.control.borrow_mut();
    assert_eq!(control.record_stop(), Err(RecordError::NotRecording));
    assert!(control.record_start(LinkId::Usb).is_ok());
    assert!(control.status().record.recording);
    assert_eq!(
        control.record_start(LinkId::Usb),
        Err(RecordError::Recording)
    );
    assert!(control.record_stop().is_ok());
}

#[test]
fn in_safe_mode_nothing_plays_the_reason_is_told_and_the_rest_is_served() {
    let mut hardware = Hardware::new();
    hardware.start.safe_mode = true;
    hardware.start.quick_faults = 4;
    let mut stylus = Stylus(SteppedStylus::boot_on(hardware));
    let slot = stylus.upload(&library(1, 4, 1));
    stylus.activate(slot).expect("it is valid");
    let refused = stylus.play("texture 0");
    assert_eq!(refused, Err(PlayError::SafeMode { quick_faults: 4 }));
    let words = refused.expect_err("as above").to_string();
    assert!(
        words.contains("safe mode after 4 faults") && words.contains("power off"),
        "{words}"
    );
    stylus.run(100);
    let status = stylus.control.borrow().status();
    assert!(status.output.mute.contains(MuteReason::SafeMode));
    assert!(status.start.safe_mode && !stylus.sounds());
    assert_eq!(stylus.control.borrow_mut().device().starts, 0);
}

#[test]
fn while_the_supply_is_low_no_flash_is_written_and_what_was_begun_goes_on_after() {
    let mut stylus = Stylus::new();
    let bytes = library(1, 4, 1);
    let begin = announcement(&bytes);
    let low = |stylus: &mut Stylus, low| {
        stylus.control.borrow_mut().device().start.supply_low = low;
    };
    low(&mut stylus, true);
    let begun = stylus.request(async |storage, stage| storage.upload_begin(stage, begin).await);
    assert_eq!(begun, Err(UploadError::SupplyLow));
    let change = SettingChange {
        setting: Setting::HardLimit,
        value: 0.25,
    };
    assert_eq!(stylus.change_setting(change), Err(SettingsError::SupplyLow));
    assert_eq!(stylus.reset_settings(), Err(SettingsError::SupplyLow));
    low(&mut stylus, false);
    let begun = stylus.request(async |storage, stage| storage.upload_begin(stage, begin).await);
    assert!(begun.is_ok(), "{begun:?}");
    low(&mut stylus, true);
    let chunk = UploadChunk {
        offset: 0,
        data: &bytes[..512],
    };
    let written = stylus.request(async |storage, stage| storage.upload_chunk(stage, chunk).await);
    assert_eq!(written, Err(UploadError::SupplyLow));
    let sealed = stylus.request(async |storage, stage| storage.upload_commit(stage).await);
    assert_eq!(sealed, Err(UploadError::SupplyLow));
    low(&mut stylus, false);
    let written = stylus.request(async |storage, stage| storage.upload_chunk(stage, chunk).await);
    assert_eq!(written.map(|progress| progress.next_offset), Ok(512));
    assert!(stylus.change_setting(change).is_ok());
}
