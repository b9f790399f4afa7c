//! Measurements of the self test on a device in memory: what is refused, what remains afterwards, and the test at rest:
//! the tool is in the air, moved or not, with the noise that the converter has there.

use fake_stylus::BoardOf;
use fake_stylus::device::{SteppedStylus, change, play_request, settings_with};
use fake_stylus::library::{announcement, library};
use model_format::link::{
    FLASH_TEST_BYTES, LinkId, PlayError, SelfTestError, SelfTestRequest, SelfTestValues, Setting, Settings, SlotId,
    SlotState,
};
use model_format::{AdcCode, CodeSpec, DacCode, Library, NodeSpec, Texture, TextureSpec, encode};
use stylus_app::inputs::{Estimator, FORCE_NOISE_CODES, Follower, InputConfig, Sensors};
use stylus_app::safety::{Config, State};
use stylus_kernel::UPDATE_INTERVAL_SAMPLES;
use stylus_kernel::excitation::{self, Excitation};
use stylus_kernel::scene::{Plan, ScenePlayer};

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

/// A texture that has its full level from a force of one code on.
fn loud_library() -> Vec<u8> {
    let node = NodeSpec::new(400.0, CodeSpec::lattice(vec![-20_000, 9_000]));
    let spec = TextureSpec::new("loud", &[1.0], &[0.000_1], vec![node]);
    encode(&[spec]).expect("a valid library")
}

fn texture(bytes: &[u8]) -> Texture<'_> {
    Library::decode(bytes)
        .expect("it was just written")
        .textures()
        .next()
        .expect("it has one")
}

/// The path from the converter's code to the DAC's code, as in the image.
struct Stylus<'a> {
    input: InputConfig,
    sensors: Sensors,
    estimator: Estimator,
    follower: Follower,
    player: ScenePlayer<'a>,
    safety: (Config, State),
    tick: u64,
}

impl<'a> Stylus<'a> {
    fn new(settings: &Settings, texture: Texture<'a>) -> Self {
        let config = Config::new(settings, 1.0);
        Self {
            input: InputConfig::new(settings),
            sensors: Sensors::new(),
            estimator: Estimator::new(),
            follower: Follower::new(false),
            player: ScenePlayer::new(Plan::of_texture(texture), 3),
            safety: (config, State::new(&config)),
            tick: 0,
        }
    }

    /// Reads `counts` and `code` in the ticks of a block, plays the block, and returns the codes at the DAC.
    fn block(&mut self, counts: i16, mut code: impl FnMut() -> AdcCode) -> Vec<DacCode> {
        for _ in 0..UPDATE_INTERVAL_SAMPLES {
            self.tick += 1;
            self.sensors.read(self.tick, counts, code(), true);
        }
        self.sensors.end_block();
        let chosen = self.estimator.motion(&self.sensors, &self.input);
        let interaction = self.follower.follow(chosen, &self.estimator, &self.input, self.tick);
        self.player.follow(interaction, UPDATE_INTERVAL_SAMPLES);
        let (config, state) = &mut self.safety;
        (0..UPDATE_INTERVAL_SAMPLES)
            .flat_map(|_| state.process(config, self.player.next_sample(), false))
            .collect()
    }
}

/// A minute of Gaussian noise around the zero of the force, for a sensor of 2 N/V, and for a coarse sensor whose noise
/// is above the least threshold.
#[test]
fn noise_at_rest_is_exact_silence_and_costs_what_silence_costs() {
    const ZERO: i32 = 3000;
    let unit = (1u32 << excitation::FRACTION_BITS) as f32;
    let bytes = loud_library();
    for (force_per_volt, counts) in [(2.0, 0), (2.0, 3), (50.0, 3)] {
        let settings = settings_with(&[
            (Setting::ForceZero, ZERO as f32),
            (Setting::ForcePerVolt, force_per_volt),
        ]);
        let mut stylus = Stylus::new(&settings, texture(&bytes));
        let mut noise = Excitation::new(1);
        let mut at_rest = || {
            let codes = noise.next_sample() as f32 / unit * FORCE_NOISE_CODES;
            AdcCode((ZERO + codes.round() as i32) as u16)
        };
        for block in 0..60 * 500 {
            let codes = stylus.block(counts, &mut at_rest);
            assert!(
                codes.iter().all(|&code| code == DacCode::MID_SCALE),
                "{force_per_volt} N/V, block {block}"
            );
            assert!(stylus.player.block().stages().is_empty());
        }
        // Once the hand presses, it is heard, so the silence was not that of a stylus that plays nothing.
        assert!(
            (0..100)
                .flat_map(|_| stylus.block(3, || AdcCode(20_000)))
                .collect::<Vec<_>>()
                .iter()
                .any(|&code| code != DacCode::MID_SCALE)
        );
    }
}
