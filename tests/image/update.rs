//! Updates of bootloader and image together: from the signed file to the confirmation, the way back, and power cuts.

use std::path::Path;

use hil::checks::faults::Injected;
use model_format::link::{
    BoardName, DEVELOPMENT_SEED, HEADER_BYTES, ImageVersion, ResetReason, Setting, TRIAL_MS, UNSIGNED, UPLOAD_WINDOW,
    UpdateBegin, UpdateBeginEndpoint, UpdateCommitEndpoint, UpdateConfirmEndpoint, UpdateError, UpdatePhase,
    UpdateReport, UpdateStateEndpoint,
};
use stylus_app::update::sign;
use stylus_board::ALL;
use stylus_boot::map::{ACTIVE, BOOTLOADER_VERSION, RECORDS, WORD_BYTES};
use virtual_stylus::model::dac::{Cause, Output};
use virtual_stylus::model::flash::{BASE, Contents, Kind, Moment};
use virtual_stylus::{Options, PowerCut};

use crate::device::{Device, MS, SECOND, inject, long, product, with_faults};
use crate::flash::state_of;
use crate::library;

/// Time in which the bootloader exchanges two images, with a margin, ns.
pub const EXCHANGE_NS: u64 = 30 * SECOND;

/// Name of the first board.
pub const NAME: BoardName = BoardName::new(ALL[0].name);

/// Steps that a test performs with a device.
type Work<'a> = &'a dyn Fn(&mut Device);

/// Captures power cuts of `work`, which begins with this content of the flash: some spread over its operations, then
/// all three moments of the last operation.
fn cuts(flash: &Contents, work: Work<'_>) -> Vec<PowerCut> {
    const SPREAD: u64 = 8;
    let device = || Device::new(&product(), library::after(flash.clone()));
    let mut counted = device();
    work(&mut counted);
    let last = counted.stylus.flash_operations().len() as u64;
    let moments = [Moment::Before, Moment::During { seed: 5 }, Moment::After];
    let spread = (0..SPREAD).map(|n| 1 + n * (last - 1) / SPREAD);
    let spread = spread.zip(moments.into_iter().cycle());
    let wanted = spread.chain(moments.map(|moment| (last, moment)));
    let mut device = device();
    device.stylus.capture_power_cuts(wanted.collect());
    work(&mut device);
    device.stylus.take_power_cuts()
}

#[test]
fn after_a_power_cut_of_an_update_the_old_or_the_new_image_answers_with_settings_and_library() {
    if !long() {
        return;
    }
    let [old, new] = [product(), with_faults()].map(|path| image(&path));
    let mut before = Device::with_library();
    let settings = before.set(Setting::HardLimit, 0.25);
    let (mut flash, library) = (before.stylus.flash(), state_of(&mut before));
    let start = |device: &mut Device| assert!(device.answers_within(EXCHANGE_NS));
    let stages: [(&str, Work<'_>); 3] = [
        ("receiving and commit", &|device| {
            start(device);
            device.update(&new);
        }),
        ("exchange and confirmation", &|device| {
            start(device);
            device.confirm();
        }),
        ("way back", &start),
    ];
    for (stage, (name, work)) in stages.into_iter().enumerate() {
        let cuts = cuts(&flash, work);
        let [.., on_trial, _, done] = &cuts[..] else {
            panic!("there are more");
        };
        let last = done.operation.number;
        flash = [done, on_trial, done][stage].contents.clone();
        let mut counts = [0; 2];
        for cut in cuts {
            let mut device = Device::new(&product(), library::after(cut.contents));
            let told = (name, cut.operation.number, cut.moment);
            assert!(device.answers_within(EXCHANGE_NS), "{told:?}");
            let is_new = device.runs(&new);
            assert!(is_new || device.runs(&old), "{told:?}");
            // The last word of the exchange begins the trial. A power cut after that ends the trial.
            let expected = match (stage, last - cut.operation.number, cut.moment) {
                (0 | 1, 0, Moment::During { .. }) | (1, 1, _) => is_new,
                (_, 0, Moment::Before) | (2, ..) => false,
                (_, 0, _) | (1, ..) => true,
                _ => false,
            };
            assert_eq!(is_new, expected, "{told:?}");
            counts[usize::from(is_new)] += 1;
            let kept = (device.settings(), state_of(&mut device));
            assert_eq!(kept, (settings, library), "{told:?}");
            let playable = device.status().settings.check_playable();
            assert_eq!((playable, device.sounds_in(..)), (Ok(()), 0), "{told:?}");
        }
        println!("{name}, {last} operations: {counts:?} times the old and the new image");
    }
}

/// The image in the file at `path`, as it is flashed.
pub fn image(path: &Path) -> Vec<u8> {
    let bytes = Device::new(path, Options::default()).stylus.flash().bytes;
    active(&bytes)
}

/// The image in the active part of a flash with these `bytes`, without the erased bytes after it.
pub fn active(bytes: &[u8]) -> Vec<u8> {
    let part = &bytes[ACTIVE.start as usize..ACTIVE.end as usize];
    let length = part.iter().rposition(|byte| *byte != 0xFF);
    part[..length.map_or(0, |last| last + 1)].to_vec()
}

pub fn version() -> ImageVersion {
    ImageVersion::read(env!("CARGO_PKG_VERSION")).expect("it has numbers")
}

impl Device {
    pub fn update_state(&mut self) -> UpdateReport {
        self.request::<UpdateStateEndpoint>(&()).expect("there is a bootloader")
    }

    /// Sends `image`, and commits it.
    pub fn update(&mut self, image: &[u8]) -> UpdateReport {
        let begin = UpdateBegin::new(image, &sign(NAME, image, version(), &DEVELOPMENT_SEED));
        self.request::<UpdateBeginEndpoint>(&begin)
            .expect("it is signed, and nothing is played");
        self.send_ahead(image, UPLOAD_WINDOW);
        self.request::<UpdateCommitEndpoint>(&())
            .expect("all of it has arrived")
    }

    pub fn is_on_trial(&mut self) -> bool {
        matches!(self.update_state().phase, UpdatePhase::Trial { .. })
    }

    pub fn runs(&mut self, image: &[u8]) -> bool {
        active(&self.stylus.flash().bytes) == image
    }

    pub fn confirm(&mut self) {
        let confirmed = self.request::<UpdateConfirmEndpoint>(&()).expect("it is on trial");
        assert_eq!(confirmed.phase, UpdatePhase::Confirmed);
    }

    fn reset(&mut self) {
        self.stylus.reset_by_pin();
        self.run_for(200 * MS);
        self.wait_for_start();
    }

    /// Runs until an image answers after an exchange, and returns the time until it started. Checks that from the reset
    /// on only mid-scale is put out and the amplifier is off.
    fn wait_for_exchange(&mut self) -> u64 {
        let begin = self.stylus.now_ns();
        // After this time the previous image no longer answers.
        self.run_for(SECOND);
        assert!(self.answers_within(EXCHANGE_NS), "{:?}", self.stylus.report());
        assert_eq!(self.sounds_in(begin..), 0, "codes other than mid-scale");
        let reset_ns = self.assert_held_since_reset();
        // The image writes mid-scale to the output after the bootloader has done so.
        let is_of_image = |output: &&Output| output.at_ns > reset_ns && output.cause == Cause::Write;
        self.dac().iter().find(is_of_image).expect("the image starts").at_ns - begin
    }
}

#[test]
fn an_update_keeps_settings_and_active_library_and_survives_resets_once_it_is_confirmed() {
    let new = image(&with_faults());
    let mut device = Device::with_library();
    let settings = device.set(Setting::HardLimit, 0.25);
    let before = state_of(&mut device);
    let begin = device.stylus.now_ns();
    let committed = device.update(&new).phase;
    let version = version();
    assert_eq!(committed, UpdatePhase::Committed { version });
    // Flashing has left the record's sectors erased. The first word is the record, which is written again before the
    // slot is released; the second word is the commit.
    let operations = device.stylus.flash_operations();
    let places = operations.iter().map(|done| match &done.kind {
        Kind::Program { address, .. } => (address - BASE, false),
        Kind::Erase(range) => (range.start - BASE, true),
    });
    let in_record: Vec<_> = places.filter(|(at, _)| RECORDS.contains(at)).collect();
    let second = RECORDS.start + WORD_BYTES as u32;
    assert_eq!(in_record, [(RECORDS.start, false), (second, false)]);
    let sent_ms = (device.stylus.now_ns() - begin) / MS;
    let started_ms = device.wait_for_exchange() / MS;
    println!("sent in {sent_ms} ms, started after {started_ms} ms");
    assert!(device.is_on_trial() && device.runs(&new));
    let state = device.update_state();
    let told = (state.bootloader, state.trusts_development_key);
    assert_eq!(told, (Some(version), true));
    assert_eq!((device.settings(), state_of(&mut device)), (settings, before));
    device.confirm();
    device.reset();
    assert_eq!(device.update_state().phase, UpdatePhase::Confirmed);
    device.move_at(120.0);
    device.play_until_heard("lattice");
    assert!(device.runs(&new) && image(&product()) != new);
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
    assert!(device.runs(&old) && device.status().fault.is_some());
    assert_eq!(state_of(&mut device), before);
    device.update(&new);
    device.wait_for_exchange();
    // Some time before the end of the trial, and then some time after it.
    device.run_for(TRIAL_MS * MS - 5 * SECOND);
    assert!(device.is_on_trial());
    device.run_for(7 * SECOND);
    device.reset();
    assert_eq!(device.update_state().phase, UpdatePhase::Confirmed);
    assert!(device.runs(&new));
    assert_eq!(state_of(&mut device), before);
}

#[test]
fn an_unsigned_image_is_refused_unless_power_came_with_the_button_held() {
    let image = vec![1; 1000];
    let mut unsigned = sign(NAME, &image, version(), &DEVELOPMENT_SEED);
    unsigned[HEADER_BYTES..].copy_from_slice(&UNSIGNED);
    for is_held in [false, true] {
        let mut device = Device::new(&product(), library::options());
        device.stylus.press_button(is_held);
        device.wait_for_start();
        let begun = device.request::<UpdateBeginEndpoint>(&UpdateBegin::new(&image, &unsigned));
        assert_eq!(begun.err(), (!is_held).then_some(UpdateError::Signature));
        device.assert_undisturbed();
        assert_eq!(device.update_state().takes_unsigned, is_held);
        device.reset();
        assert!(!device.update_state().takes_unsigned);
    }
    let mut flash = Device::new(&product(), library::options()).stylus.flash();
    flash.bytes[BOOTLOADER_VERSION as usize] = 0;
    let mut device = Device::started(library::after(flash));
    assert_eq!(device.request::<UpdateStateEndpoint>(&()), None);
}
