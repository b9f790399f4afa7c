//! Updates: bootloader and image together, from the signed file to the confirmation, the way back, and power cuts.

use std::path::Path;

use hil::injection::Injected;
use model_format::link::{
    DEVELOPMENT_SEED, HEADER_BYTES, ImageVersion, MotionSource, ResetReason, Setting, TRIAL_MS,
    UNSIGNED, UPLOAD_WINDOW, UpdateBegin, UpdateBeginEndpoint, UpdateCommitEndpoint,
    UpdateConfirmEndpoint, UpdateError, UpdatePhase, UpdateReport, UpdateStateEndpoint,
};
use postcard_rpc::Endpoint;
use stylus_app::update::sign;
use stylus_boot::map::{ACTIVE, BOOTLOADER_VERSION};
use virtual_stylus::model::flash::{Contents, Moment};
use virtual_stylus::model::pin::{Drive, Driven};
use virtual_stylus::{Options, PowerCut};

use crate::device::{Device, MS, SECOND, inject, long, product, with_faults};
use crate::library;
use crate::upload::state_of;

/// Time in which the bootloader exchanges two images, with a margin.
const EXCHANGE_NS: u64 = 30 * SECOND;

/// Stages of an update that is put back once, and is done again and confirmed.
const STAGES: [&str; 6] = [
    "receiving, commit",
    "exchange",
    "way back",
    "receiving again",
    "exchange again",
    "confirmation",
];

/// Makes these stages, and returns the number of the last flash operation of each.
fn make_stages(device: &mut Device, new: &[u8]) -> [u64; STAGES.len()] {
    let mut ends = Vec::new();
    let mut end = |device: &mut Device| ends.push(device.stylus.flash_operations().len() as u64);
    for is_last in [false, true] {
        device.update(new);
        end(device);
        device.wait_for_exchange();
        end(device);
        if !is_last {
            device.stylus.reset_by_pin();
            device.wait_for_exchange();
            end(device);
        }
    }
    device.confirm();
    end(device);
    ends.try_into().expect("one of each stage")
}

/// Content of the flash after cuts in these stages, each with the number of its stage, and true for a cut of the
/// stage's last operation.
fn cuts(flash: &Contents, new: &[u8]) -> Vec<(usize, bool, PowerCut)> {
    const PER_STAGE: u64 = 6;
    let mut counted = Device::started(library::of(flash.clone()));
    let ends = make_stages(&mut counted, new);
    println!("the stages end with operations {ends:?}");
    let moments = [Moment::Before, Moment::During { seed: 5 }, Moment::After];
    let mut wanted = Vec::new();
    // What is done again differs in nothing.
    for stage in [0, 1, 2, 5] {
        let (last, end) = (ends[stage], |stage: usize| ends[stage]);
        let first = 1 + stage.checked_sub(1).map_or(0, end);
        let spread = (0..PER_STAGE).map(|n| first + n * (last - first) / PER_STAGE);
        wanted.extend(
            spread
                .filter(|&number| number != last)
                .zip(moments.into_iter().cycle()),
        );
        wanted.extend(moments.map(|moment| (last, moment)));
    }
    let mut device = Device::started(library::of(flash.clone()));
    device.stylus.capture_power_cuts(wanted);
    make_stages(&mut device, new);
    let staged = device.stylus.take_power_cuts().into_iter().map(|cut| {
        let stage = ends.partition_point(|&end| end < cut.operation.number);
        (stage, ends[stage] == cut.operation.number, cut)
    });
    staged.collect()
}

#[test]
fn after_a_power_cut_of_an_update_the_old_or_the_new_image_answers_with_settings_and_library() {
    if !long() {
        return;
    }
    let [old, new] = [product(), with_faults()].map(|path| image(&path));
    let mut before = Device::started(library::options());
    let settings = before.set(Setting::HardLimit, 0.25);
    let (flash, library) = (before.stylus.flash(), state_of(&mut before));
    let mut counts = [[0; 2]; STAGES.len()];
    for (stage, is_last, cut) in cuts(&flash, &new) {
        let mut device = Device::new(
            &product(),
            Options {
                keep_flash: true,
                watch_ticks: false,
                ..library::of(cut.contents)
            },
        );
        let told = (STAGES[stage], cut.operation.number, cut.moment);
        assert!(device.answers_within(EXCHANGE_NS), "{told:?}");
        let active = active(&device.stylus.flash().bytes);
        assert!(active == old || active == new, "{told:?}");
        let is_new = active == new;
        // The last word of an exchange begins the trial, which a cut after it ends.
        let expected = match (stage, is_last, cut.moment) {
            (0 | 5, true, Moment::During { .. }) | (1, true, _) => is_new,
            (0 | 5, true, Moment::After) | (1, ..) => true,
            _ => false,
        };
        assert_eq!(is_new, expected, "{told:?}");
        counts[stage][usize::from(is_new)] += 1;
        let kept = (device.settings(), state_of(&mut device));
        assert_eq!(kept, (settings, library), "{told:?}");
        let playable = device.status().settings.check_playable();
        assert_eq!((playable, device.sounds_from(0)), (Ok(()), 0), "{told:?}");
    }
    for (stage, counts) in STAGES.iter().zip(counts) {
        println!("{stage}: {counts:?} times the old and the new image");
    }
}

/// The image in the file at `path`, as it is flashed.
fn image(path: &Path) -> Vec<u8> {
    let bytes = Device::new(path, Options::default()).stylus.flash().bytes;
    active(&bytes)
}

/// The image in the active part of a flash with these `bytes`, without the ones after it.
fn active(bytes: &[u8]) -> Vec<u8> {
    let part = &bytes[ACTIVE.start as usize..ACTIVE.end as usize];
    let length = part.iter().rposition(|byte| *byte != 0xFF);
    part[..length.map_or(0, |last| last + 1)].to_vec()
}

fn version() -> ImageVersion {
    ImageVersion::read(env!("CARGO_PKG_VERSION")).expect("it has numbers")
}

impl Device {
    fn update_state(&mut self) -> UpdateReport {
        let state = self.request::<UpdateStateEndpoint>(&());
        state.expect("there is a bootloader")
    }

    /// Sends `image` and commits it.
    fn update(&mut self, image: &[u8]) -> UpdateReport {
        let begin = UpdateBegin::new(image, &sign(image, version(), &DEVELOPMENT_SEED));
        let begun = self.request::<UpdateBeginEndpoint>(&begin);
        begun.expect("it is signed, and nothing is played");
        self.send_ahead(image, UPLOAD_WINDOW);
        let committed = self.request::<UpdateCommitEndpoint>(&());
        committed.expect("all of it has arrived")
    }

    fn confirm(&mut self) {
        let confirmed = self.request::<UpdateConfirmEndpoint>(&());
        let confirmed = confirmed.expect("it is on trial");
        assert_eq!(confirmed.phase, UpdatePhase::Confirmed);
    }

    fn reset(&mut self) {
        self.stylus.reset_by_pin();
        self.run_for(200 * MS);
        self.wait_for_start();
    }

    /// Runs until an image answers after an exchange, and returns the time until it started. Nothing but mid-scale goes
    /// out meanwhile, and the amplifier's enable floats, by which the board holds the amplifier off.
    fn wait_for_exchange(&mut self) -> u64 {
        let begin = self.stylus.now_ns();
        // By then the image before answers no more.
        self.run_for(SECOND);
        assert!(
            self.answers_within(EXCHANGE_NS),
            "{:?}",
            self.stylus.report()
        );
        assert_eq!(self.sounds_from(begin), 0, "codes other than mid-scale");
        let is_floating = |driven: &Driven| driven.drive == Drive::Floating;
        let record = self.amplifier().into_iter();
        let mut record = record.skip_while(|driven| driven.at_ns < begin || !is_floating(driven));
        let started = record.find(|driven| !is_floating(driven));
        let started = started.expect("an image drives it at its start");
        assert_eq!(started.drive, Drive::Low);
        started.at_ns - begin
    }
}

#[test]
fn an_update_keeps_settings_and_active_library_and_survives_resets_once_it_is_confirmed() {
    let old = product();
    let new = image(&with_faults());
    let mut device = Device::started(library::options());
    let settings = device.set(Setting::HardLimit, 0.25);
    let before = state_of(&mut device);
    let begin = device.stylus.now_ns();
    let committed = device.update(&new);
    assert!(
        matches!(committed.phase, UpdatePhase::Committed { .. }),
        "{committed:?}"
    );
    let sent = device.stylus.now_ns();
    let exchanged = device.wait_for_exchange();
    let state = device.update_state();
    assert!(
        matches!(state.phase, UpdatePhase::Trial { .. }),
        "{state:?}"
    );
    assert!(
        state.bootloader == Some(version()) && state.trusts_development_key,
        "{state:?}"
    );
    println!(
        "sent in {} ms, started after {} ms",
        (sent - begin) / MS,
        exchanged / MS
    );
    assert!(
        active(&device.stylus.flash().bytes) == new,
        "the new image runs"
    );
    assert_eq!(device.settings(), settings);
    assert_eq!(state_of(&mut device), before);
    device.confirm();
    device.reset();
    assert_eq!(device.update_state().phase, UpdatePhase::Confirmed);
    device.move_at(120.0);
    device.play_until_heard("lattice", MotionSource::Sensors, 7);
    assert!(active(&device.stylus.flash().bytes) == new);
    assert!(image(&old) != new);
}

#[test]
fn a_new_image_that_faults_on_its_trial_is_put_back_and_one_that_lasts_a_minute_confirms_itself() {
    if !long() {
        return;
    }
    let [old, new] = [product(), with_faults()].map(|path| image(&path));
    let mut device = Device::started(Options {
        watch_ticks: false,
        ..library::options()
    });
    let before = state_of(&mut device);
    device.update(&new);
    device.wait_for_exchange();
    inject(&mut device, Injected::Panic);
    device.wait_for_exchange();
    let state = device.update_state();
    let (version, cause) = (version(), ResetReason::Software);
    assert_eq!(state.phase, UpdatePhase::RolledBack { version, cause });
    assert!(
        active(&device.stylus.flash().bytes) == old,
        "the old image runs"
    );
    assert_eq!(state_of(&mut device), before);
    assert!(
        device.status().fault.is_some(),
        "the fault of the new image is told"
    );
    device.update(&new);
    device.wait_for_exchange();
    device.run_for(TRIAL_MS * MS - 5 * SECOND);
    let state = device.update_state();
    assert!(
        matches!(state.phase, UpdatePhase::Trial { .. }),
        "{state:?}"
    );
    device.run_for(7 * SECOND);
    device.reset();
    assert_eq!(device.update_state().phase, UpdatePhase::Confirmed);
    assert!(active(&device.stylus.flash().bytes) == new);
    assert_eq!(state_of(&mut device), before);
}

#[test]
fn an_image_that_is_not_signed_is_refused_before_anything_is_erased_unless_power_came_with_the_button_held()
 {
    let image = vec![1; 1000];
    let mut unsigned = sign(&image, version(), &DEVELOPMENT_SEED);
    unsigned[HEADER_BYTES..].copy_from_slice(&UNSIGNED);
    for is_held in [false, true] {
        let mut device = Device::new(&product(), library::options());
        device.stylus.press_button(is_held);
        device.wait_for_start();
        let operations = device.stylus.flash_operations().len();
        let by_another = sign(&image, version(), &[9; 32]);
        for (signed, is_taken) in [(by_another, false), (unsigned, is_held)] {
            let begun = device.request::<UpdateBeginEndpoint>(&UpdateBegin::new(&image, &signed));
            let expected = if is_taken {
                Ok(())
            } else {
                Err(UpdateError::Signature)
            };
            assert_eq!(begun.map(drop), expected);
            let is_same = device.stylus.flash_operations().len() == operations;
            assert!(is_same != is_taken);
        }
        device.assert_undisturbed();
        assert_eq!(device.update_state().takes_unsigned, is_held);
        device.reset();
        assert!(!device.update_state().takes_unsigned);
    }
    let mut flash = Device::new(&product(), library::options()).stylus.flash();
    flash.bytes[BOOTLOADER_VERSION as usize] = 0;
    let mut device = Device::new(
        &product(),
        Options {
            keep_flash: true,
            flash,
            ..library::options()
        },
    );
    device.wait_for_start();
    assert_eq!(device.request::<UpdateStateEndpoint>(&()), None);
}
