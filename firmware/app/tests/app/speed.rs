//! Speed from the encoder's counts: its noise and its delay, compared with those of the mean of the last 20 ms.

use std::f64::consts::TAU;

use fake_stylus::device::settings_with;
use model_format::AdcCode;
use model_format::link::Setting;
use proptest::prelude::*;
use stylus_app::inputs::estimator::REST_BLOCKS;
use stylus_app::inputs::{Encoder, Estimator, InputConfig, Sensors};
use stylus_app::{SAMPLE_RATE_HZ, UPDATE_INTERVAL_TICKS};

const RATE: f64 = SAMPLE_RATE_HZ as f64;

/// Path per count of the encoder, mm.
const COUNT_MM: f64 = 0.01;

/// Number of blocks of the mean with which the estimate is compared: 20 ms.
const MEAN_BLOCKS: usize = 10;

/// Speeds at the ends of blocks: the time, s, the estimate and the mean of 20 ms, mm/s.
type Followed = Vec<(f64, [f64; 2])>;

/// Follows a tool that is at `position_mm` at each time, s, but leaves out the updates of the blocks in `late`.
fn follow(position_mm: impl Fn(f64) -> f64, seconds: f64, late: &[usize]) -> Followed {
    let config = InputConfig::new(&settings_with(&[(Setting::PathPerCount, COUNT_MM as f32)]));
    let count = |tick: u64| (position_mm(tick as f64 / RATE) / COUNT_MM).floor() as i64;
    let mut encoder = Encoder::new(count(0) as u16);
    let (mut sensors, mut estimator) = (Sensors::new(), Estimator::new());
    let mut ends = vec![count(0)];
    let mut followed = Vec::new();
    for tick in 1..=(seconds * RATE) as u64 {
        sensors.read(tick, encoder.delta(count(tick) as u16), AdcCode(1000), true);
        if !tick.is_multiple_of(UPDATE_INTERVAL_TICKS.into()) {
            continue;
        }
        sensors.end_block();
        ends.push(count(tick));
        if late.contains(&ends.len()) {
            continue;
        }
        let estimate = f64::from(estimator.motion(&sensors, &config).speed_mm_s);
        let before = ends.len().saturating_sub(1 + MEAN_BLOCKS);
        let counts = (ends[ends.len() - 1] - ends[before]).abs() as f64;
        let mean_s = MEAN_BLOCKS as f64 * f64::from(UPDATE_INTERVAL_TICKS) / RATE;
        followed.push((tick as f64 / RATE, [estimate, counts * COUNT_MM / mean_s]));
    }
    followed
}

/// RMS differences of both speeds from `speed`, after `settled` s.
fn errors(followed: &Followed, settled: f64, speed: impl Fn(f64) -> f64) -> [f64; 2] {
    let after: Vec<_> = followed.iter().filter(|(t, _)| *t > settled).collect();
    [0, 1].map(|of| {
        let squares = after.iter().map(|(t, found)| (found[of] - speed(*t)).powi(2));
        (squares.sum::<f64>() / after.len() as f64).sqrt()
    })
}

/// Noise at a steady `speed`, over places within a count and over speeds within 2 %, mm/s.
fn noise(speed: f64) -> [f64; 2] {
    let mut squares = [0.0; 2];
    for case in 0..32 {
        let share = (f64::from(case) * 0.618_034).fract();
        let speed = speed * (0.98 + 0.04 * share);
        let offset = COUNT_MM * (share * 13.7).fract();
        let followed = follow(|t| offset + speed * t, 0.8, &[]);
        let of = errors(&followed, 0.2, |_| speed);
        squares = [0, 1].map(|at| squares[at] + of[at].powi(2) / 32.0);
    }
    squares.map(f64::sqrt)
}

/// Delay at a constant acceleration of `mm_s2`, mm/s², from `speed` on, ms.
fn delay(speed: f64, mm_s2: f64) -> [f64; 2] {
    let followed = follow(|t| speed * t + mm_s2 / 2.0 * t * t, 0.6, &[]);
    let after: Vec<_> = followed.iter().filter(|(t, _)| *t > 0.1).collect();
    [0, 1].map(|of| {
        after
            .iter()
            .map(|(t, found)| speed + mm_s2 * t - found[of])
            .sum::<f64>()
            / after.len() as f64
            / mm_s2
            * 1e3
    })
}

/// Delay, ms, and gain of a tremor at `hz` whose amplitude is a fifth of `speed`.
fn tremor(speed: f64, hz: f64) -> [[f64; 2]; 2] {
    let turns = TAU * hz;
    let depth = 0.2 * speed;
    let followed = follow(|t| speed * t - depth / turns * (turns * t).cos(), 3.0, &[]);
    let phasors = [0, 1].map(|of| {
        let (mut sine, mut cosine, mut blocks) = (0.0, 0.0, 0.0);
        for (t, found) in followed.iter().filter(|(t, _)| *t >= 1.0) {
            sine += found[of] * (turns * t).sin();
            cosine += found[of] * (turns * t).cos();
            blocks += 0.5;
        }
        (sine / blocks, cosine / blocks)
    });
    let delay = phasors.map(|(sine, cosine)| -cosine.atan2(sine) / turns * 1e3);
    [delay, phasors.map(|(sine, cosine)| sine.hypot(cosine) / depth)]
}

/// Time until an abrupt change from `before` to `after` mm/s is followed within a tenth, ms, and the largest ratio of
/// the shown change to the true one; the worst over all ticks of a block.
fn step(before: f64, after: f64) -> [[f64; 2]; 2] {
    let (mut longest, mut most) = ([0.0; 2], [0.0; 2]);
    for tick in 0..UPDATE_INTERVAL_TICKS {
        let at = 0.4 + f64::from(tick) / RATE;
        let way = |t: f64| before * t + (after - before) * (t - at).max(0.0);
        for (t, found) in follow(way, 0.6, &[]).iter().filter(|(t, _)| *t >= at) {
            for of in [0, 1] {
                let share = (found[of] - before) / (after - before);
                most[of] = f64::max(most[of], share);
                if (share - 1.0).abs() > 0.1 {
                    // The value holds until the next update, 2 ms later.
                    longest[of] = f64::max(longest[of], (t - at) * 1e3 + 2.0);
                }
            }
        }
    }
    [longest, most]
}

/// RMS error of the speed of a stroke that goes back and forth at up to `speed`, `hz` times per second, mm/s.
fn reversals(speed: f64, hz: f64) -> [f64; 2] {
    let turns = TAU * hz;
    let followed = follow(|t| 0.003 - speed / turns * (turns * t).cos(), 2.0, &[]);
    errors(&followed, 0.25, |t| speed * (turns * t).sin().abs())
}

/// The table of `host-tools/manual/COSTS.md`. No noise in it exceeds that of the mean of 20 ms by more than a tenth.
#[test]
fn table_of_the_speed_has_less_delay_than_a_mean_at_no_more_noise() {
    let row = |what: String, [estimate, mean]: [f64; 2], most: f64| {
        println!("| {what} | {mean:.2} | {estimate:.2} |");
        assert!(estimate.abs() < most, "{what}: {estimate}, {mean}");
    };
    for speed in [1.0, 2.0, 5.0, 20.0, 50.0, 100.0, 200.0, 400.0] {
        let found = noise(speed);
        let most = f64::min(1.1 * found[1], 0.3);
        row(format!("noise at {speed} mm/s, RMS, mm/s"), found, most);
    }
    for (speed, mm_s2) in [(2.0, 20.0), (50.0, 1e3)] {
        let what = format!("delay while it accelerates by {mm_s2} mm/s², ms");
        row(what, delay(speed, mm_s2), 1.0);
    }
    for (speed, hz) in [(5.0, 3.0), (60.0, 10.0)] {
        let [delay, gain] = tremor(speed, hz);
        let what = format!("a tremor of {hz} Hz at {speed} mm/s");
        row(format!("delay of {what}, ms"), delay, 0.7 * delay[1]);
        row(format!("gain of {what}"), gain, 1.25);
    }
    for (before, after) in [(5.0, 50.0), (50.0, 0.0)] {
        let [ms, most] = step(before, after);
        let what = format!("from {before} to {after} mm/s at once");
        row(format!("{what}, within a tenth, ms"), ms, 6.0);
        row(format!("{what}, largest share shown"), most, 1.07);
    }
    let start = |t: f64| {
        let since = (t - 0.4).max(0.0);
        let speeds_up = since.min(0.05);
        0.003 + 5.0 * (speeds_up * speeds_up / 0.1 + since - speeds_up)
    };
    let followed = follow(start, 0.8, &[]);
    let most = [0, 1].map(|of| followed.iter().map(|now| now.1[of]).fold(0.0, f64::max));
    row("most of a start to 5 mm/s within 50 ms, mm/s".to_owned(), most, 6.3);
    for (speed, hz) in [(10.0, 1.0), (100.0, 2.0)] {
        let found = reversals(speed, hz);
        let what = format!("error of strokes at {speed} mm/s, {hz} Hz, RMS, mm/s");
        row(what, found, 0.6 * found[1]);
    }
}

proptest! {
    #[test]
    fn a_steady_speed_is_measured_to_a_count_in_two_blocks(
        speed in -20_000.0f64..20_000.0, start in -1e6f64..1e6,
    ) {
        let one_count = COUNT_MM * RATE / f64::from(2 * UPDATE_INTERVAL_TICKS);
        for (t, [found, _]) in follow(|t| start + speed * t, 0.3, &[]).into_iter().skip(2) {
            // The counts of two blocks differ from the path by less than a count, and the estimate is within a count of
            // them.
            prop_assert!((found - speed.abs()).abs() < 2.01 * one_count, "{speed} at {t}: {found}");
        }
    }
}

#[test]
fn a_hand_that_stops_is_exactly_at_rest_after_the_blocks_of_a_rest() {
    for speed in [0.6, 3.0, 80.0, 900.0] {
        let followed = follow(|t| speed * t.min(0.3), 0.4, &[]);
        let rest_s = f64::from((REST_BLOCKS + 1) * UPDATE_INTERVAL_TICKS) / RATE;
        let moves = |(t, found): &&(f64, [f64; 2])| *t > 0.2 && *t < 0.3 && found[0] > 0.0;
        assert!(followed.iter().filter(moves).count() > 40, "{speed} mm/s");
        let last = followed.iter().rfind(|(_, found)| found[0] != 0.0);
        let last_s = last.expect("it moved").0;
        // The last count comes at most the time of a count before the hand stops.
        assert!(last_s < 0.3 + rest_s, "{speed} mm/s: {last_s}");
    }
}

/// Counts that flicker, because the tool rests at the edge of a count, give at most the speed of the slowest stroke.
#[test]
fn a_tool_that_rests_at_the_edge_of_a_count_is_as_good_as_at_rest() {
    let shaken = |t: f64| 0.000_1 * (t * 54_321.7).sin();
    let [estimate, mean] = errors(&follow(shaken, 2.0, &[]), 0.1, |_| 0.0);
    assert!(estimate < 0.5 && mean < 0.5, "{estimate}, {mean}");
}

#[test]
fn an_update_that_was_left_out_is_bridged() {
    let stroke = |t: f64| 60.0 * t + 200.0 * t * t;
    let late = [100, 140, 141, 142, 200];
    let (whole, bridged) = (follow(stroke, 0.6, &[]), follow(stroke, 0.6, &late));
    for (t, [found, _]) in &bridged {
        let (_, [expected, _]) = whole.iter().find(|(at, _)| at == t).expect("it is there");
        assert!(*t < 0.1 || (found - expected).abs() < 1.5, "{t}: {found}, {expected}");
    }
}
