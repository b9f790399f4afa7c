//! A test at rest: the tool is in the air, moved or not, with the noise that the converter has there.

use fake_stylus::device::settings_with;
use model_format::link::{Setting, Settings};
use model_format::{AdcCode, CodeSpec, DacCode, Library, NodeSpec, Texture, TextureSpec, encode};
use stylus_app::inputs::{Estimator, FORCE_NOISE_CODES, Follower, InputConfig, Sensors};
use stylus_app::safety::{Config, State};
use stylus_kernel::UPDATE_INTERVAL_SAMPLES;
use stylus_kernel::excitation::{self, Excitation};
use stylus_kernel::scene::{Plan, ScenePlayer};

/// A texture that has its full level from a force of one code on.
fn library() -> Vec<u8> {
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
    let bytes = library();
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
