//! Lines that are tied to position, from the encoder's counts and the host's motions to the samples.

use std::f64::consts::TAU;

use fake_stylus::device::settings_with;
use model_format::link::{MotionSample, MotionSource, Setting};
use model_format::{AdcCode, MillimetresPerSecond, Newton};
use stylus_app::SAMPLE_RATE_HZ;
use stylus_app::inputs::estimator::LEAD_TICKS;
use stylus_app::inputs::{Encoder, Estimator, Follower, InputConfig, Sensors, Timed, choose};
use stylus_kernel::UPDATE_INTERVAL_SAMPLES;
use stylus_kernel::position::Position;
use stylus_kernel::scene::Interaction;

const RATE: f64 = SAMPLE_RATE_HZ as f64;

/// Path per count of the encoder, mm.
const COUNT_MM: f64 = 0.01;

/// A force of about 1 N.
const PRESSED: AdcCode = AdcCode(20_000);

fn config(path_per_count: f64) -> InputConfig {
    let path = (Setting::PathPerCount, path_per_count as f32);
    InputConfig::new(&settings_with(&[path]))
}

/// The parts of a stylus with a moving tool that an update uses: the sensors are read at each tick.
struct Moved<P> {
    config: InputConfig,
    encoder: Encoder,
    sensors: Sensors,
    estimator: Estimator,
    follower: Follower,
    tick: u64,
    position_mm: P,
    count_mm: f64,
    start: i64,
}

impl<P: Fn(f64) -> f64> Moved<P> {
    /// A tool that is at `position_mm` at each time, s. Its counter is at `start` at the origin.
    fn new(count_mm: f64, start: i64, position_mm: P) -> Self {
        Self {
            config: config(count_mm),
            encoder: Encoder::new(start as u16),
            sensors: Sensors::new(),
            estimator: Estimator::new(),
            follower: Follower::new(false).tracking(true),
            tick: 0,
            position_mm,
            count_mm,
            start,
        }
    }

    /// Reads the ticks of a block, and returns the time of the last tick, s.
    fn read_block(&mut self) -> f64 {
        for _ in 0..UPDATE_INTERVAL_SAMPLES {
            self.tick += 1;
            let mm = (self.position_mm)(self.tick as f64 / RATE);
            let count = (mm / self.count_mm).floor() as i64 + self.start;
            let delta = self.encoder.delta(count as u16);
            self.sensors.read(self.tick, delta, PRESSED, true);
        }
        self.sensors.end_block();
        self.tick as f64 / RATE
    }

    /// Returns the interaction of the next block by the sensors, and the time at which the block's last sample is felt,
    /// s.
    fn block(&mut self) -> (Interaction, f64) {
        let now_s = self.read_block();
        let chosen = self.estimator.motion(&self.sensors, &self.config);
        let interaction = (self.follower).follow(chosen, &self.estimator, &self.config, self.tick);
        (interaction, now_s + f64::from(LEAD_TICKS) / RATE)
    }
}

fn mm(position: Position) -> f64 {
    position.steps() as f64 / 4_294_967_296.0
}

/// Returns the differences between the position that is felt and the tool's, mm, once per block after `settled` s, with
/// their times, s.
///
/// The origin is the beginning of the count at the first block.
fn errors(moved: &mut Moved<impl Fn(f64) -> f64>, seconds: f64, settled: f64) -> Vec<(f64, f64)> {
    let first = (moved.position_mm)(f64::from(UPDATE_INTERVAL_SAMPLES) / RATE);
    let origin = (first / moved.count_mm).floor() * moved.count_mm;
    let mut errors = Vec::new();
    for _ in 0..(seconds * 500.0) as usize {
        let (interaction, felt_s) = moved.block();
        let position = interaction.position().expect("it is tracked");
        if felt_s > settled {
            errors.push((felt_s, mm(position) + origin - (moved.position_mm)(felt_s)));
        }
    }
    errors
}

fn rms(errors: &[(f64, f64)]) -> f64 {
    let count = errors.len() as f64;
    let mean = errors.iter().map(|(_, error)| error).sum::<f64>() / count;
    let square = errors.iter().map(|(_, error)| (error - mean).powi(2));
    (square.sum::<f64>() / count).sqrt()
}

fn worst(errors: &[(f64, f64)]) -> f64 {
    errors.iter().map(|(_, error)| error.abs()).fold(0.0, f64::max)
}

/// The remaining noise of the position within a count is less than half a count RMS, and at most a count.
#[test]
fn a_steady_hand_is_felt_within_a_count_without_a_lag() {
    for speed in [
        20.0, 20.37, 33.3, 50.1, 99.3, 100.0, 151.7, 299.1, 300.0, -20.0, -100.7, -300.0,
    ] {
        // The tool is not at the edge of a count, where the encoder's own noise would dominate.
        for (start, offset) in [(0, 0.0071), (12_345, 0.0033)] {
            let mut moved = Moved::new(COUNT_MM, start, |t| speed * t + offset);
            let errors = errors(&mut moved, 4.0, 0.3);
            let (rms, worst) = (rms(&errors), worst(&errors));
            assert!(rms < 0.5 * COUNT_MM, "{speed} mm/s: {rms}");
            assert!(worst < 1.05 * COUNT_MM, "{speed} mm/s: {worst}");
        }
    }
}

#[test]
fn a_hand_that_accelerates_is_felt_within_a_count() {
    let mut moved = Moved::new(COUNT_MM, 7, |t| 20.0 * t + 70.0 * t * t);
    let errors = errors(&mut moved, 2.0, 0.3);
    assert!(worst(&errors) < COUNT_MM, "{}", worst(&errors));
}

/// A stroke of 100 mm/s forwards and back that reverses within `turn` s. It begins within a count.
fn stroke(turn: f64) -> impl Fn(f64) -> f64 {
    const SPEED: f64 = 100.0;
    const BEGIN_MM: f64 = 0.0033;
    move |t: f64| {
        let begin = 1.0 - turn / 2.0;
        if t < begin {
            BEGIN_MM + SPEED * t
        } else if t < begin + turn {
            let share = (t - begin) / turn;
            BEGIN_MM + SPEED * begin + SPEED * turn / (TAU / 2.0) * (TAU / 2.0 * share).sin()
        } else {
            BEGIN_MM + SPEED * begin - SPEED * (t - begin - turn)
        }
    }
}

/// A place has the same position forwards and backwards, during the reversal and after it.
#[test]
fn a_hand_that_turns_retraces_within_a_count() {
    let mut moved = Moved::new(COUNT_MM, 60_000, stroke(0.9));
    let all = errors(&mut moved, 1.9, 0.3);
    assert!(worst(&all) < COUNT_MM, "{}", worst(&all));
    // If the hand reverses faster than the filter follows, the position is off by some counts, but only during the
    // reversal.
    let mut moved = Moved::new(COUNT_MM, 60_000, stroke(0.3));
    let all = errors(&mut moved, 1.9, 0.3);
    assert!(worst(&all) < 3.0 * COUNT_MM, "{}", worst(&all));
    let after: Vec<_> = all.iter().copied().filter(|(t, _)| *t > 1.25).collect();
    assert!(worst(&after) < COUNT_MM, "{}", worst(&after));
}

/// The counter of 16 bits and the sum of 32 bits wrap while the tool moves.
#[test]
fn a_counter_that_wraps_does_not_move_the_tool() {
    // 2000 counts per tick are 10 million per second; the sum wraps after 215 s.
    const FINE_MM: f64 = 0.000_1;
    let mut moved = Moved::new(FINE_MM, 65_000, |t| 1000.0 * t);
    let errors = errors(&mut moved, 230.0, 0.3);
    assert!(moved.estimator.counts() < 0, "the sum went past 2³¹");
    // A count is rounded to a whole number of steps of 2⁻³² mm, which is a relative error of up to 3·10⁻⁶ here.
    let path_mm = 230.0 * 1000.0;
    assert!(worst(&errors) < 0.01 + path_mm * 3e-6, "{}", worst(&errors));
    let steps: Vec<_> = errors.windows(2).map(|pair| (0.0, pair[1].1 - pair[0].1)).collect();
    assert!(worst(&steps) < 0.002, "{}", worst(&steps));
}

#[test]
fn an_encoder_that_counts_backwards_or_not_at_all_is_followed() {
    let mut backwards = Moved::new(-COUNT_MM, 5, |t| 80.0 * t);
    let errors = errors(&mut backwards, 1.0, 0.3);
    assert!(worst(&errors) < 1.05 * COUNT_MM, "{}", worst(&errors));
    let mut none = Moved::new(COUNT_MM, 5, |_| 0.0);
    for _ in 0..100 {
        let position = none.block().0.position().expect("it is tracked");
        assert!(mm(position).abs() < COUNT_MM, "{position:?}");
    }
}

fn told(speed: f64, position_mm: Option<f64>) -> MotionSample {
    MotionSample {
        speed: MillimetresPerSecond(speed as f32),
        force: Newton(1.0),
        position_mm: position_mm.map(|mm| mm as f32),
        contact: Some(true),
    }
}

/// A host sends positions each millisecond, up to half a millisecond early or late, and a speed without a sign.
#[test]
fn a_hosts_positions_are_followed_without_their_jitter() {
    let position_mm = |t: f64| 50.0 + 30.0 * (TAU * 0.7 * t).sin();
    let speed = |t: f64| 30.0 * TAU * 0.7 * (TAU * 0.7 * t).cos();
    let config = config(COUNT_MM);
    let mut follower = Follower::new(false).tracking(true);
    let mut host = Timed::NEVER;
    let mut errors = Vec::new();
    for tick in 1..15_000u64 {
        if tick.is_multiple_of(5) {
            let sent = (tick as f64 + (tick as f64 * 0.37).sin() * 2.5) / RATE;
            let sample = told(speed(sent).abs(), Some(position_mm(sent)));
            host = Timed::from_host(sample, tick).expect("finite");
        }
        if tick.is_multiple_of(10) {
            let chosen = choose(MotionSource::Host, Timed::NEVER, host);
            let interaction = follower.follow(chosen, &Estimator::new(), &config, tick);
            let felt_s = (tick + u64::from(LEAD_TICKS)) as f64 / RATE;
            let position = interaction.position().expect("tracked");
            if tick > 500 {
                errors.push((felt_s, mm(position) - position_mm(felt_s)));
            }
        }
    }
    // Half a millisecond at 132 mm/s is 66 µm.
    assert!(rms(&errors) < 0.04, "{}", rms(&errors));
    assert!(worst(&errors) < 0.1, "{}", worst(&errors));
}

#[test]
fn without_positions_of_the_host_its_signed_speed_is_summed_and_the_encoder_does_not_matter() {
    let mut moved = Moved::new(COUNT_MM, 0, |t| 5.0 * t);
    let mut positions = Vec::new();
    for block in 0..1000u64 {
        moved.read_block();
        let speed = if block < 500 { 100.0 } else { -100.0 };
        let host = Timed::from_host(told(speed, None), moved.tick).expect("finite");
        moved.estimator.motion(&moved.sensors, &moved.config);
        let interaction = (moved.follower).follow(host, &moved.estimator, &moved.config, moved.tick);
        positions.push(mm(interaction.position().expect("tracked")));
    }
    for (block, pair) in positions.windows(2).enumerate() {
        let step = pair[1] - pair[0];
        let expected = if block < 499 { 0.2 } else { -0.2 };
        let turns = block == 0 || (498..502).contains(&block);
        assert!(turns || (step - expected).abs() < 1e-5, "block {block}: {step}");
    }
}

/// If the host sets a new place, the position jumps there at once, however far it is.
#[test]
fn a_place_that_the_host_sets_anew_is_taken_up_at_once() {
    let config = config(COUNT_MM);
    let mut follower = Follower::new(false).tracking(true);
    for (tick, place) in [(10, 5.0), (20, 5000.0), (30, -1.0e30), (40, 12.5)] {
        let host = Timed::from_host(told(0.0, Some(place)), tick).expect("finite");
        let interaction = follower.follow(host, &Estimator::new(), &config, tick);
        let expected = Position::from_mm(place as f32);
        assert_eq!(interaction.position(), Some(expected), "{place}");
    }
}

#[test]
fn a_plan_without_lines_tells_no_position() {
    let mut moved = Moved::new(COUNT_MM, 0, |t| 80.0 * t);
    moved.follower = Follower::new(false).tracking(false);
    let (interaction, _) = moved.block();
    let without = Interaction::new(interaction.motion, 0.0, interaction.contact).expect("finite");
    assert_eq!(interaction, without.reaching(None));
}
