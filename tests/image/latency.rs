//! Latency from the sensors' pins to the output's pin, and to the tip of a plant. The hand makes a step at every tick
//! of a block, just before and just after the converter samples the force.

use model_format::scene::{Scene, SceneName, Surface, Tap};
use model_format::{CodeSpec, DacCode, NodeSpec, TextureSpec, encode_with_scenes};
use stylus_plant::{Parameters, Plant};
use virtual_stylus::motion::Motion;

use crate::device::{CODE_NS, Device, MID_SCALE, MS, PERIOD_NS, long};
use crate::library;
use crate::scenes::force_code;

/// Number of ticks per block.
const BLOCK_TICKS: u64 = 10;

/// Rank of the force in the converter's sequence.
const FORCE_RANK: u8 = 3;

/// Time between two steps of the hand: a whole number of blocks, plus one tick, ns.
const APART_NS: u64 = 60 * MS + PERIOD_NS;

/// Time after which the hand returns to the state before the step, ns.
const HELD_NS: u64 = 30 * MS;

/// Delay above which people feel that a tap is late, ms (Hachisu and Kajimoto, "Vibration Feedback Latency Affects
/// Material Perception During Rod Tapping Interactions", 2017).
const TAP_FELT_MS: f64 = 5.5;

/// Delay above which a texture feels different, ms (Okamoto et al., "Detectability and Perceptual Consequences of
/// Delayed Feedback in a Vibrotactile Texture Display", 2009).
const CHANGE_FELT_MS: f64 = 40.0;

/// A step of the hand.
struct Step {
    what: &'static str,
    /// Force before and after the step, N.
    force: [f64; 2],
    /// Speed before and after the step, mm/s.
    speed: [f64; 2],
    /// Delay above which people feel it, ms.
    felt_ms: f64,
}

const TAP: Step = Step {
    what: "a tool at rest strikes a surface",
    force: [0.0, 1.0],
    speed: [0.0; 2],
    felt_ms: TAP_FELT_MS,
};

/// Steps that change what a texture plays.
const CHANGES: [Step; 3] = [
    Step {
        what: "a tool that moves touches",
        speed: [60.0; 2],
        felt_ms: CHANGE_FELT_MS,
        ..TAP
    },
    Step {
        what: "a tool that moves presses more",
        force: [0.1, 1.0],
        speed: [60.0; 2],
        felt_ms: CHANGE_FELT_MS,
    },
    Step {
        what: "a tool that touches begins to move",
        force: [1.0; 2],
        speed: [0.0, 60.0],
        felt_ms: CHANGE_FELT_MS,
    },
];

/// A texture that is silent at 0.1 N, and a scene of one smooth surface with a tap.
fn bytes() -> Vec<u8> {
    let loud = NodeSpec::new(100.0, CodeSpec::lattice(vec![0]));
    let texture = TextureSpec::new("loud", &[10.0], &[0.1, 1.0], vec![NodeSpec::silent(), loud]);
    let tap = Tap {
        frequency_hz: 250.0,
        decay_s: 0.003,
        gain_m_s2_per_n_s: 0.1,
        limit_m_s2: 20.0,
    };
    let surface = Surface {
        texture: None,
        tap: Some(tap),
        ..Surface::of_texture(0)
    };
    let name = SceneName::try_from("tap").expect("it is short");
    let scene = Scene::of_surface(name, 5_000, surface);
    encode_with_scenes(&[texture], &[scene]).expect("it is valid")
}

/// Latencies at the pin and at the tip, ms.
type Latencies = [Vec<f64>; 2];

/// Returns the latencies of `step`. The hand makes the step ten times, each time at another tick of a block, just after
/// the force is sampled. If `both` is true, it makes the step ten more times, just before the force is sampled.
fn latencies(step: &Step, both: bool) -> Latencies {
    let mut device = Device::started(library::with(&bytes()));
    let [before, after] = step.force.map(force_code);
    device.set_pins(move |channel, _| if channel == 5 { before } else { 0x8000 });
    device.move_at(step.speed[0]);
    if step.speed == TAP.speed {
        device.play_scene("tap", 1);
    } else {
        device.play("loud", 1);
    }
    device.wait_until_heard();
    device.stylus.record_samples();
    device.run_for(2 * MS);
    let sampled = device.stylus.take_samples();
    let last = sampled.iter().rfind(|sample| sample.rank == FORCE_RANK);
    let begin_ns = last.expect("it is sampled").at_ns + 40 * MS;
    let sides: &[u64] = if both { &[0, PERIOD_NS - 1_000] } else { &[0] };
    let steps: Vec<u64> = (0..BLOCK_TICKS * sides.len() as u64)
        .map(|step| begin_ns + step * APART_NS + sides[(step / BLOCK_TICKS) as usize] + 1_000)
        .collect();

    let held = steps.clone();
    device.set_pins(move |channel, at_ns| {
        let holds = held.iter().any(|&step| (step..step + HELD_NS).contains(&at_ns));
        match channel {
            5 => [before, after][usize::from(holds)],
            _ => 0x8000,
        }
    });
    // A motion's instants must rise, so a step of the speed takes 100 ns.
    let [slow, fast] = step.speed;
    let knots = |&at: &u64| {
        let back = at + HELD_NS;
        [(at, slow), (at + 100, fast), (back, fast), (back + 100, slow)]
    };
    let knots: Vec<_> = steps.iter().flat_map(knots).collect();
    device
        .stylus
        .set_motion(Motion::linear(&knots, 0.01).expect("instants that rise"));
    let end_ns = steps.last().expect("there are some") + APART_NS;
    device.run_for(end_ns - device.stylus.now_ns());
    device.assert_undisturbed();
    at_pin_and_tip(&mut device, &steps)
}

/// Returns the latencies at the pin and at the tip, ms. Each is the time from one of `steps`, ns, to the first value
/// above a tenth of the largest value that follows.
fn at_pin_and_tip(device: &mut Device, steps: &[u64]) -> Latencies {
    let parameters = Parameters::preset("haptuator").expect("it is there");
    let mut plant = Plant::new(&parameters, 1);
    let volts_per_code = f64::from(DacCode::STEP.0);
    let mut signals = Vec::new();
    for output in device.triggered() {
        let offset = i32::from(output.code.unwrap_or(MID_SCALE)) - i32::from(MID_SCALE);
        let pin_volts = f64::from(offset) * volts_per_code;
        plant.step(pin_volts, true);
        signals.push((output.at_ns, [pin_volts.abs(), plant.tip_m_s2().abs()]));
    }
    [0, 1].map(|place| {
        let latency = |&step: &u64| {
            let after = signals.iter().filter(|(at, _)| (step..step + HELD_NS).contains(at));
            let most = after.clone().map(|(_, of)| of[place]).fold(0.0, f64::max);
            assert!(most > 0.0, "nothing follows the step at {step} ns");
            let mut beyond = after.filter(|(_, of)| of[place] > most / 10.0);
            let (at, _) = beyond.next().expect("the most is beyond");
            // The plant's step computes the tip's value at the end of the code's interval.
            (at + place as u64 * CODE_NS - step) as f64 / 1e6
        };
        steps.iter().map(latency).collect()
    })
}

#[test]
fn a_tap_is_on_the_pin_before_people_feel_it_late_and_a_texture_long_before() {
    println!("| step | felt late from | at the pin: least, median, most | at the tip |");
    let changes = if long() { &CHANGES[..] } else { &[] };
    for step in std::iter::once(&TAP).chain(changes) {
        let [pin, tip] = latencies(step, long()).map(|mut latencies| {
            latencies.sort_by(f64::total_cmp);
            [0, latencies.len() / 2, latencies.len() - 1].map(|at| latencies[at])
        });
        let Step { what, felt_ms, .. } = step;
        println!("| {what} | {felt_ms} ms | {pin:.2?} ms | {tip:.2?} ms |");
        assert!(pin[2] < *felt_ms, "{what}: {pin:?}");
        // The codes were computed after the step.
        assert!(pin[0] > 1.0, "{what}: {pin:?}");
    }
}
