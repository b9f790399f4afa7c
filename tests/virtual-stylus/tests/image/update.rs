//! Updates: bootloader and image together, from the signed file to the confirmation, the way back, and power cuts.

use std::path::Path;

use hil::injection::Injected;
use model_format::link::{
    DEVELOPMENT_SEED, ImageVersion, InfoEndpoint, LIBRARY_CRC, MotionSource, ResetReason,
    SIGNED_BYTES, Setting, UPLOAD_WINDOW, UpdateBegin, UpdateBeginEndpoint, UpdateCommitEndpoint,
    UpdateConfirmEndpoint, UpdateError, UpdatePhase, UpdateReport, UpdateStateEndpoint,
};
use postcard_rpc::Endpoint;
use stylus_app::update::sign;
use stylus_boot::map::ACTIVE;
use virtual_stylus::model::flash::{Contents, Moment};
use virtual_stylus::model::pin::{Drive, Driven};
use virtual_stylus::{Options, PowerCut};

use crate::device::{Device, MS, SECOND, inject, long, product, with_faults};
use crate::library;
use crate::upload::state_of;

/// Time in which the bootloader exchanges two images, with a margin.
pub const EXCHANGE_NS: u64 = 30 * SECOND;

/// The content of the flash after cuts of an update to `new` and its exchange: at both ends of each of them, and spread
/// between.
fn cuts(flash: &Contents, new: &[u8]) -> Vec<PowerCut> {
    const BETWEEN: u64 = 8;
    let options = || library::of(flash.clone());
    let mut counted = Device::started(options());
    let count = |device: &mut Device| device.stylus.flash_operations().len() as u64;
    counted.update(new);
    let sent = count(&mut counted);
    counted.wait_for_exchange();
    let all = count(&mut counted);
    let spread = |n: u64| n * all / BETWEEN;
    let ends = [
        1,
        2,
        sent - 1,
        sent,
        sent + 1,
        sent + 2,
        sent + 3,
        all - 1,
        all,
    ];
    let numbers = (1..BETWEEN).map(spread).chain(ends);
    let moments = [Moment::Before, Moment::During { seed: 5 }, Moment::After];
    let wanted = numbers
        .zip(0..)
        .map(|(number, case)| (number, moments[case % 3]));
    let torn = [
        (sent, moments[1]),
        (sent + 2, moments[1]),
        (all, moments[1]),
    ];
    let mut device = Device::started(options());
    device
        .stylus
        .capture_power_cuts(wanted.chain(torn).collect());
    device.update(new);
    device.wait_for_exchange();
    println!("{sent} operations until the commit, {all} until the new image starts");
    device.stylus.take_power_cuts()
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
    let mut counts = [0; 2];
    for cut in cuts(&flash, &new) {
        let mut device = Device::new(
            &product(),
            Options {
                keep_flash: true,
                watch_ticks: false,
                ..library::of(cut.contents)
            },
        );
        let told = (cut.operation.number, cut.moment);
        assert!(device.answers_within(EXCHANGE_NS), "{told:?}");
        let active = active(&device.stylus.flash().bytes);
        assert!(active == old || active == new, "{told:?}");
        counts[usize::from(active == new)] += 1;
        assert_eq!(device.settings(), settings, "{told:?}");
        assert_eq!(
            device.status().settings.check_playable(),
            Ok(()),
            "{told:?}"
        );
        assert_eq!(state_of(&mut device), library, "{told:?}");
        assert_eq!(device.sounds_from(0), 0, "{told:?}");
    }
    println!("{counts:?} times the old and the new image");
    assert!(counts[0] > 0 && counts[1] > 0);
}

/// The image in the file at `path`, as it is flashed.
pub fn image(path: &Path) -> Vec<u8> {
    let bytes = Device::new(path, Options::default()).stylus.flash().bytes;
    active(&bytes)
}

/// The image in the active part of a flash with these `bytes`, without the ones after it.
pub fn active(bytes: &[u8]) -> Vec<u8> {
    let part = &bytes[ACTIVE.start as usize..ACTIVE.end as usize];
    let length = part.iter().rposition(|byte| *byte != 0xFF);
    part[..length.map_or(0, |last| last + 1)].to_vec()
}

pub fn version() -> ImageVersion {
    ImageVersion::read(env!("CARGO_PKG_VERSION")).expect("it has numbers")
}

pub fn announced(image: &[u8], signed: [u8; SIGNED_BYTES]) -> UpdateBegin {
    UpdateBegin {
        signed: signed.iter().copied().collect(),
        crc32: LIBRARY_CRC.checksum(image),
        allow_downgrade: false,
    }
}

impl Device {
    pub fn update_state(&mut self) -> UpdateReport {
        let state = self.request::<UpdateStateEndpoint>(&());
        state.expect("there is a bootloader")
    }

    /// Sends `image` and commits it.
    pub fn update(&mut self, image: &[u8]) -> UpdateReport {
        let begin = announced(image, sign(image, version(), &DEVELOPMENT_SEED));
        let begun = self.request::<UpdateBeginEndpoint>(&begin);
        begun.expect("it is signed, and nothing is played");
        self.send_ahead(image, UPLOAD_WINDOW);
        let committed = self.request::<UpdateCommitEndpoint>(&());
        committed.expect("all of it has arrived")
    }

    /// Runs until an image answers; false if none does in time.
    pub fn answers_within(&mut self, nanos: u64) -> bool {
        let end = self.stylus.now_ns() + nanos;
        while self.stylus.now_ns() < end {
            let sequence = self.send_frame(InfoEndpoint::REQ_KEY, &());
            self.run_for(100 * MS);
            if self.take_answer(InfoEndpoint::RESP_KEY, sequence).is_some() {
                return true;
            }
        }
        false
    }

    /// Instant at which an image started after a reset at `begin` or later: its first instructions drive the
    /// amplifier's enable low. Until then the pin floats, by which the board holds the amplifier off.
    fn started_after(&mut self, begin: u64) -> Option<u64> {
        let record = self.amplifier();
        let is_reset = |driven: &Driven| driven.drive == Drive::Floating && driven.at_ns >= begin;
        let reset = record.iter().position(is_reset)?;
        let started = record[reset..]
            .iter()
            .find(|driven| driven.drive != Drive::Floating)?;
        assert_eq!(started.drive, Drive::Low);
        Some(started.at_ns)
    }

    /// Runs until an image answers after an exchange, and returns the time until it started. Nothing but mid-scale goes
    /// out meanwhile.
    fn wait_for_exchange(&mut self) -> u64 {
        let begin = self.stylus.now_ns();
        let end = begin + EXCHANGE_NS;
        let started = loop {
            self.run_for(100 * MS);
            if let Some(started) = self.started_after(begin) {
                break started;
            }
            assert!(self.stylus.now_ns() < end, "{:?}", self.stylus.report());
        };
        self.wait_for_start();
        assert_eq!(self.sounds_from(begin), 0, "codes other than mid-scale");
        started - begin
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
    let confirmed = device.request::<UpdateConfirmEndpoint>(&());
    assert_eq!(
        confirmed.expect("it is on trial").phase,
        UpdatePhase::Confirmed
    );
    device.stylus.reset_by_pin();
    device.run_for(200 * MS);
    device.wait_for_start();
    assert_eq!(device.update_state().phase, UpdatePhase::Confirmed);
    device.move_at(120.0);
    device.play_until_heard("lattice", MotionSource::Sensors, 7);
    assert!(active(&device.stylus.flash().bytes) == new);
    assert!(image(&old) != new);
}

#[test]
fn a_new_image_that_faults_on_its_trial_is_put_back_and_the_cause_is_told() {
    let old = image(&product());
    let mut device = Device::started(library::options());
    let before = state_of(&mut device);
    device.update(&image(&with_faults()));
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
}

#[test]
fn an_image_by_another_key_is_refused_before_anything_is_erased() {
    let mut device = Device::started(library::options());
    let operations = device.stylus.flash_operations().len();
    let image = vec![1; 1000];
    let begin = announced(&image, sign(&image, version(), &[9; 32]));
    let refused = device.request::<UpdateBeginEndpoint>(&begin);
    assert_eq!(refused, Err(UpdateError::Signature));
    assert_eq!(device.stylus.flash_operations().len(), operations);
    device.assert_undisturbed();
}
