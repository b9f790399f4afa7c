//! Speed, force, position and contact, with their age; and the noise of the force at rest, through inputs, kernel and
//! safety.

use fake_stylus::device::settings_with as settings;
use model_format::link::{MotionRefused, MotionSample, MotionSource, STALE_AFTER_MS, Setting, Settings};
use model_format::{
    AdcCode, CodeSpec, DacCode, Library, MillimetresPerSecond, Newton, NodeSpec, Texture, TextureSpec, encode,
};
use proptest::prelude::*;
use stylus_app::TICKS_PER_MS;
use stylus_app::inputs::{
    Estimator, FORCE_NOISE_CODES, Follower, InputConfig, RAIL_CODES, STALE_TICKS, Sensors, Timed, choose,
};
use stylus_app::safety::{Config, State};
use stylus_kernel::excitation::{self, Excitation};
use stylus_kernel::scene::{Plan, ScenePlayer};
use stylus_kernel::{Motion, UPDATE_INTERVAL_SAMPLES};

fn motion(speed: f32, force: f32) -> Motion {
    Motion::new(MillimetresPerSecond(speed), Newton(force)).expect("finite")
}

/// Motion that a host sends at `tick`: speed, mm/s, and force, N, with a position and a contact.
fn told(
    [speed, force]: [f32; 2],
    position_mm: Option<f32>,
    contact: Option<bool>,
    tick: u64,
) -> Result<Timed, MotionRefused> {
    let sample = MotionSample {
        speed: MillimetresPerSecond(speed),
        force: Newton(force),
        position_mm,
        contact,
    };
    Timed::from_host(sample, tick)
}

/// Motion that a new estimator finds in `sensors`.
fn motion_of(sensors: &Sensors, config: &InputConfig) -> Timed {
    Estimator::new().motion(sensors, config)
}

proptest! {
    #[test]
    fn force_is_linear_in_the_code(
        code: u16, zero: u16, per_volt in prop_oneof![-100.0f32..-0.001, 0.001f32..100.0],
    ) {
        let settings = settings(&[(Setting::ForceZero, f32::from(zero)), (Setting::ForcePerVolt, per_volt)]);
        let force = InputConfig::new(&settings).force(AdcCode(code));
        let volt = f64::from(AdcCode(code).volt().0) - f64::from(AdcCode(zero).volt().0);
        prop_assert!((f64::from(force.0) - volt * f64::from(per_volt)).abs() < 1e-3);
    }
}

#[test]
fn the_largest_counts_overflow_nothing() {
    let config = InputConfig::new(&settings(&[(Setting::PathPerCount, 10.0)]));
    let (mut sensors, mut estimator) = (Sensors::new(), Estimator::new());
    for tick in 0..100_000 {
        sensors.read(tick, i16::MIN, AdcCode(u16::MAX - RAIL_CODES), true);
        if tick % 1000 == 0 {
            sensors.end_block();
            let motion = estimator.motion(&sensors, &config);
            assert!(motion.speed_mm_s.is_finite());
        }
    }
    assert!(!estimator.motion(&sensors, &config).is_stale(99_999));
}

#[test]
fn an_input_is_stale_after_its_time_and_not_before() {
    assert_eq!(STALE_TICKS, u64::from(STALE_AFTER_MS * TICKS_PER_MS));
    let host = told([-5.0, -1.0], None, None, 1_000).expect("finite");
    assert_eq!(host.motion, motion(5.0, 0.0));
    for (tick, stale) in [
        (990, false),
        (1_000, false),
        (1_000 + STALE_TICKS, false),
        (1_001 + STALE_TICKS, true),
    ] {
        for chosen in [
            choose(MotionSource::Host, Timed::NEVER, host),
            choose(MotionSource::Sensors, host, Timed::NEVER),
        ] {
            assert_eq!(chosen, host);
            assert_eq!(chosen.is_stale(tick), stale);
        }
    }
    let never = choose(MotionSource::Host, host, Timed::NEVER);
    assert_eq!((never.motion, never.is_stale(1_000)), (Motion::REST, true));
}

#[test]
fn conversions_that_do_not_come_make_the_sensors_stale() {
    let config = InputConfig::new(&Settings::default());
    let mut sensors = Sensors::new();
    assert!(motion_of(&sensors, &config).is_stale(0), "nothing was read so far");
    sensors.read(10, 0, AdcCode(5_007), true);
    for tick in 11..1_000 {
        sensors.read(tick, 0, AdcCode(5_009), false);
    }
    let timed = motion_of(&sensors, &config);
    assert_eq!(timed.at, Some(10));
    assert_eq!(
        timed.motion,
        Motion::new(MillimetresPerSecond(0.0), config.force(AdcCode(5_007))).expect("finite")
    );
    assert!(timed.is_stale(11 + STALE_TICKS));
}

#[test]
fn a_force_at_a_rail_is_no_contact_at_once_and_stale_in_its_time() {
    let config = InputConfig::new(&settings(&[(Setting::ForceZero, 300.0)]));
    let inside = [RAIL_CODES, 300, 20_000, u16::MAX - RAIL_CODES];
    let rails = [0, RAIL_CODES - 1, u16::MAX - RAIL_CODES + 1, u16::MAX];
    for (code, railed) in (inside.map(|code| (code, false)).into_iter()).chain(rails.map(|code| (code, true))) {
        let mut sensors = Sensors::new();
        sensors.read(1, 0, AdcCode(20_000), true);
        for tick in 2..=2 + STALE_TICKS {
            sensors.read(tick, 0, AdcCode(code), true);
        }
        let now = 2 + STALE_TICKS;
        let timed = motion_of(&sensors, &config);
        assert_eq!(
            (sensors.is_railed(), timed.is_stale(now)),
            (railed, railed),
            "code {code}"
        );
        let mut follower = Follower::new(false);
        let touches = follower.follow(timed, &Estimator::new(), &config, now).contact;
        assert_eq!(touches, !railed && code > 300, "code {code}");
        // While the force is at a rail, the time of the motion stays that of the last good force.
        let at = if railed { 1 } else { now };
        assert_eq!(timed.at, Some(at), "code {code}");
        // A conversion that does not belong to its tick says nothing about the rail, and a good conversion ends that
        // state.
        sensors.read(now + 1, 0, AdcCode(0), false);
        assert_eq!(sensors.is_railed(), railed);
        sensors.read(now + 2, 0, AdcCode(20_000), true);
        assert!(!sensors.is_railed() && !motion_of(&sensors, &config).is_stale(now + 2));
    }
}

#[test]
fn a_motion_that_is_not_finite_is_refused() {
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        for (motion, position_mm, refused) in [
            ([bad, 1.0], 1.0, MotionRefused::Speed),
            ([1.0, bad], 1.0, MotionRefused::Force),
            ([1.0, 1.0], bad, MotionRefused::Position),
        ] {
            assert_eq!(told(motion, Some(position_mm), None, 0), Err(refused));
        }
    }
}

/// Sensors after one block with `counts`, at a force of `code`.
fn moved(mut sensors: Sensors, counts: i16, code: u16) -> Sensors {
    sensors.read(1, counts, AdcCode(code), true);
    sensors.end_block();
    sensors
}

#[test]
fn a_scene_is_followed_from_where_playing_began_and_from_the_first_touch() {
    let config = InputConfig::new(&settings(&[(Setting::PathPerCount, 0.01)]));
    let before = moved(Sensors::new(), 12_345, 4_096);
    let mut follower = Follower::new(true);
    let mut estimator = Estimator::new();
    let mut follow = |sensors: &Sensors, host: Option<Timed>| {
        let by_sensors = estimator.motion(sensors, &config);
        follower.follow(host.unwrap_or(by_sensors), &estimator, &config, 1)
    };
    let begun = follow(&before, None);
    assert_eq!((begun.position_mm(), begun.contact), (0.0, false));
    let on = moved(before, -250, 20_000);
    let gone = follow(&on, None);
    assert_eq!((gone.position_mm(), gone.contact), (-2.5, true));
    // Position and contact of the host take precedence.
    for (position, contact, expected) in [
        (Some(70.0), Some(false), (70.0, false)),
        (None, Some(false), (-2.5, false)),
        (Some(-1.0), None, (-1.0, true)),
    ] {
        let host = told([50.0, 1.0], position, contact, 1).expect("finite");
        let followed = follow(&on, Some(host));
        assert_eq!((followed.position_mm(), followed.contact), expected);
        assert_eq!(followed.motion, host.motion);
    }
}

#[test]
fn a_texture_is_everywhere_and_is_touched_above_the_threshold() {
    let config = InputConfig::new(&Settings::default());
    let mut follower = Follower::new(false);
    // 0.1 mN per code: contact begins above 0.02 N and ends at 0.01 N.
    for (counts, code, touches) in [
        (0, 0, false),
        (900, 190, false),
        (900, 210, true),
        (-500, 110, true),
        (0, 90, false),
    ] {
        let sensors = moved(Sensors::new(), counts, 4_096 + code);
        let chosen = motion_of(&sensors, &config);
        let followed = follower.follow(chosen, &Estimator::new(), &config, 1);
        let found = (followed.position_mm(), followed.contact);
        assert_eq!(found, (0.0, touches), "code {code}");
    }
    // The host's contact takes precedence.
    for contact in [true, false] {
        let force = if contact { 0.0 } else { 1.0 };
        let host = told([50.0, force], Some(30.0), Some(contact), 1).expect("finite");
        let followed = follower.follow(host, &Estimator::new(), &config, 1);
        assert_eq!((followed.position_mm(), followed.contact), (0.0, contact));
    }
}

#[test]
fn the_threshold_of_contact_is_set_or_follows_from_the_noise_of_the_force() {
    let per_code = |per_volt: f32| f64::from(per_volt.abs()) * f64::from(AdcCode::STEP.0);
    for per_volt in [-100.0, -2.0, 0.1, 2.0, 5.0, 100.0] {
        let derived = InputConfig::new(&settings(&[(Setting::ForcePerVolt, per_volt)])).contact();
        let noise = 6.0 * f64::from(FORCE_NOISE_CODES) * per_code(per_volt);
        let expected = noise.max(0.02);
        let begins = f64::from(derived.begins_n());
        assert!((begins / expected - 1.0).abs() < 1e-5, "{per_volt} N/V: {begins}");
        assert_eq!(derived.ends_n(), derived.begins_n() / 2.0);
        for set in [0.001, 0.3, 10.0] {
            let changes = [(Setting::ForcePerVolt, per_volt), (Setting::ContactThreshold, set)];
            let config = InputConfig::new(&settings(&changes));
            assert_eq!(config.contact().begins_n(), set);
        }
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
        let settings = settings(&[
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
