//! Measurements of the self test on a device in memory: what is refused, and what remains afterwards.

use fake_stylus::BoardOf;
use fake_stylus::device::{SteppedStylus, change, play_request};
use fake_stylus::library::{announcement, library};
use model_format::link::{
    FLASH_TEST_BYTES, LinkId, PlayError, SelfTestError, SelfTestRequest, SelfTestValues, Setting, SlotId, SlotState,
};

/// The values of the self test that `request` asks for.
pub fn measure(stylus: &mut SteppedStylus, request: SelfTestRequest) -> Result<SelfTestValues, SelfTestError> {
    stylus.request(async |storage, stage| {
        let mut board = BoardOf::new(stage.clone());
        storage.self_test(stage, &mut board, request).await
    })
}

fn slots(stylus: &mut SteppedStylus) -> [SlotState; 2] {
    stylus.request(async |storage, _| storage.slots().slots)
}

/// A self test of the flash in `slot`.
pub fn flash(slot: SlotId, erases_library: bool) -> SelfTestRequest {
    SelfTestRequest::Flash { slot, erases_library }
}

#[test]
fn a_playing_device_refuses_every_measurement_and_plays_on() {
    let mut stylus = SteppedStylus::ready(&library(1, 20, 1));
    assert!(stylus.play(play_request("texture 0")).is_ok());
    stylus.run(200);
    assert!(stylus.sounds());
    for request in [
        SelfTestRequest::Chip,
        SelfTestRequest::OptionBytes,
        SelfTestRequest::Clocks,
        SelfTestRequest::ErrorCorrection,
        SelfTestRequest::Output { disconnected: true },
        SelfTestRequest::Encoder,
        flash(SlotId::B, true),
    ] {
        let refused = measure(&mut stylus, request);
        assert_eq!(refused, Err(SelfTestError::Playing), "{request:?}");
    }
    stylus.run(10);
    assert!(stylus.sounds());
}

#[test]
fn nothing_can_be_played_until_a_measurement_has_ended() {
    let mut stylus = SteppedStylus::ready(&library(1, 20, 1));
    let mut refusals = 0;
    let measured = stylus.request_meanwhile(
        async |storage, stage| {
            let mut board = BoardOf::new(stage.clone());
            let request = flash(SlotId::B, false);
            storage.self_test(stage, &mut board, request).await
        },
        |control| {
            let answer = control.borrow_mut().play(LinkId::Serial, play_request("texture 0"));
            refusals += usize::from(answer == Err(PlayError::Busy));
            control.millisecond_with_motion();
        },
    );
    assert!(measured.is_ok(), "{measured:?}");
    assert!(refusals > 100, "{refusals}");
    assert!(stylus.play(play_request("texture 0")).is_ok());
}

#[test]
fn the_output_is_moved_only_where_the_amplifier_is_known_to_be_off() {
    let mut stylus = SteppedStylus::ready(&library(1, 20, 1));
    let output = |disconnected| SelfTestRequest::Output { disconnected };
    let unknown = change(Setting::EnableWired, 0.0);
    assert!(stylus.change_settings(&[unknown]).is_ok());
    let refused = measure(&mut stylus, output(false));
    assert_eq!(refused, Err(SelfTestError::AmplifierMayBeOn));
    assert_eq!(stylus.hardware().test_codes, 0);
    assert!(measure(&mut stylus, output(true)).is_ok());
    // `disconnected` holds for one measurement only.
    let refused = measure(&mut stylus, output(false));
    assert_eq!(refused, Err(SelfTestError::AmplifierMayBeOn));
    let known = change(Setting::EnableWired, 1.0);
    assert!(stylus.change_settings(&[known]).is_ok());
    assert!(measure(&mut stylus, output(false)).is_ok());
}

#[test]
fn an_empty_slot_is_empty_again_after_its_flash_was_measured() {
    let mut stylus = SteppedStylus::boot();
    let measured = measure(&mut stylus, flash(SlotId::B, false));
    let Ok(SelfTestValues::Flash(values)) = measured else {
        panic!("{measured:?}");
    };
    assert_eq!((values.not_erased, values.wrong), (0, 0));
    assert_eq!(values.words, FLASH_TEST_BYTES / 32);
    assert_eq!(slots(&mut stylus), [SlotState::Empty, SlotState::Empty]);
    // An upload works as before.
    assert!(stylus.upload(&library(1, 20, 1)).is_ok());
}

#[test]
fn a_library_is_erased_only_on_request_and_never_the_active_one() {
    let mut stylus = SteppedStylus::ready(&library(1, 20, 1));
    let [first, second] = SlotId::ALL;
    assert!(stylus.upload(&library(1, 21, 2)).is_ok());
    let before = slots(&mut stylus);
    let refused = measure(&mut stylus, flash(second, false));
    assert_eq!(refused, Err(SelfTestError::NotEmpty { slot: second }));
    let refused = measure(&mut stylus, flash(first, true));
    assert_eq!(refused, Err(SelfTestError::ActiveSlot { slot: first }));
    assert_eq!(slots(&mut stylus), before);
    assert!(measure(&mut stylus, flash(second, true)).is_ok());
    let after = slots(&mut stylus);
    assert_eq!(after[first.index()], before[first.index()]);
    assert!(matches!(after[second.index()], SlotState::Faulty(_)), "{after:?}");
}

#[test]
fn an_upload_under_way_keeps_its_slot() {
    let mut stylus = SteppedStylus::boot();
    let bytes = library(1, 20, 1);
    stylus.request(async |storage, stage| {
        storage
            .upload_begin(stage, announcement(&bytes))
            .await
            .expect("a slot is free");
    });
    for slot in SlotId::ALL {
        let refused = measure(&mut stylus, flash(slot, true));
        assert_eq!(refused, Err(SelfTestError::Uploading));
    }
}
