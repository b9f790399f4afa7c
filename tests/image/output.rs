//! The output from the tick to the pin: its latency, late ticks, a core that stops, and the signal that enables the
//! amplifier.

use hil::checks::faults::Injected;
use model_format::SAMPLE_RATE_HZ;
use model_format::link::{MuteReasons, Setting, Status};
use stylus_app::safety;
use stylus_board::ALL;
use stylus_plant::{Parameters, Plant};
use virtual_stylus::Options;
use virtual_stylus::model::dac::Output;
use virtual_stylus::model::pins::{Drive, Driven};
use virtual_stylus::sensors::{ActuatedPins, ConstantPins, MID_SCALE as MID_SCALE_WORD};

use crate::device::{CODE_NS, CODES, Device, MID_SCALE, MS, PERIOD_NS, inject, product};
use crate::expected::BEFORE_FIRST_TICK;
use crate::library;

/// Time from the trigger of a tick to its first code on the pin, and to the end of the codes that the tick has written
/// ahead, ns.
const LATENCY_NS: u64 = 212_500;
const ENDED_NS: u64 = LATENCY_NS + 4 * PERIOD_NS;
/// Tolerance of the phase between the two timers, which software starts one after the other, ns.
const PHASE_NS: u64 = 1_000;
/// Time for which mid-scale must be put out before the amplifier is switched on, ns.
pub const SETTLED_NS: u64 = 9 * MS;

/// A slew limit, V/ms, that a step from the loud texture to mid-scale would exceed many times over.
const SLEW_LIMIT: f32 = 2.0;

/// Returns a device that plays a texture with an amplitude of hundreds of converter steps around mid-scale, and the
/// largest number of steps between two successive codes.
fn playing_loudly() -> (Device, u16) {
    let loud = [
        (Setting::SlewLimit, SLEW_LIMIT),
        (Setting::OutputGain, 0.2),
        (Setting::PowerLimit, 1.0),
    ];
    let mut device = Device::with_faults(library::set_to(&loud));
    let settings = device.settings();
    let config = safety::Config::new(&settings, 1.0);
    device.move_at(120.0);
    device.play_until_heard("lattice");
    device.run_for(301 * MS);
    (device, config.slew_steps() as u16)
}

fn offset(output: &Output) -> u16 {
    output.code.unwrap_or(MID_SCALE).abs_diff(MID_SCALE)
}

/// Largest offset from mid-scale in the last 5 ms, converter steps.
fn loudness(device: &mut Device) -> u16 {
    let now = device.stylus.now_ns();
    device
        .dac()
        .iter()
        .rev()
        .take_while(|output| output.at_ns + 5 * MS > now)
        .map(offset)
        .max()
        .expect("there is an output")
}

#[test]
fn the_first_code_of_a_tick_is_on_the_pin_212_microseconds_after_its_trigger() {
    let mut device = Device::new(&product(), library::options());
    device.run_for(50 * MS);
    let first = device.stylus.take_ticks()[0].at_ns;
    let outputs = device.triggered();
    let latency = outputs[BEFORE_FIRST_TICK].at_ns - first;
    assert!(latency.abs_diff(LATENCY_NS) <= PHASE_NS, "{latency} ns");
    assert_eq!(outputs[1].at_ns - outputs[0].at_ns, CODE_NS);
}

#[test]
fn a_core_that_stops_while_a_texture_plays_leaves_mid_scale_at_the_pin_within_a_millisecond() {
    let (mut device, slew) = playing_loudly();
    assert!(loudness(&mut device) > 4 * slew, "it is loud");
    device.stylus.take_ticks();
    inject(&mut device, Injected::Halt);
    device.keep_alive(false);
    device.run_for(60 * MS);
    assert!(device.stylus.resets().is_empty());
    let ticks = device.stylus.take_ticks();
    let last = ticks.last().expect("it played").at_ns;
    let now = device.stylus.now_ns();
    assert!(now - last > 40 * MS, "the core stands");
    let outputs = device.dac();
    let (mut before, after): (Vec<&Output>, Vec<&Output>) = outputs
        .iter()
        .partition(|output| output.at_ns < last + ENDED_NS + PHASE_NS);
    assert!(after.len() > 1_000, "the converter goes on");
    let left = after.iter().find(|output| output.code != Some(MID_SCALE));
    assert_eq!(left, None, "after {last}");
    // The output reached mid-scale without a click.
    let faded = before.split_off(before.len() - 6 * CODES);
    let steps = faded.windows(2).map(|pair| offset(pair[0]).abs_diff(offset(pair[1])));
    assert!(steps.max() <= Some(slew), "{faded:?}");
}

/// Injects `fault` into a loud texture. After that, no code may differ from the previous code by more than the slew
/// limit. Returns the outputs since the fault, and the status after them.
fn late(fault: Injected) -> (Vec<Output>, Status) {
    let (mut device, slew) = playing_loudly();
    assert!(loudness(&mut device) > 4 * slew, "it is loud");
    let before = device.status();
    assert_eq!(before.tick.late_outputs, 0);
    let from = device.stylus.now_ns();
    inject(&mut device, fault);
    device.run_for(50 * MS);
    let after = device.status();
    assert!(device.stylus.resets().is_empty());
    assert_eq!(after.output.mute, MuteReasons::NONE, "it plays on");
    let outputs: Vec<_> = (device.dac().iter())
        .filter(|output| output.at_ns > from)
        .copied()
        .collect();
    let code = |output: &Output| output.code.expect("driven");
    for pair in outputs.windows(2) {
        assert_eq!(pair[1].at_ns - pair[0].at_ns, CODE_NS);
        let step = code(&pair[1]).abs_diff(code(&pair[0]));
        assert!(step <= slew, "{fault:?}: {pair:?}");
    }
    // The instants and the latency are as before the fault: no later tick is late.
    device.run_for(50 * MS);
    let later = device.status();
    assert_eq!(later.tick.late_outputs, after.tick.late_outputs);
    (outputs, after)
}

/// Length of the longest run of equal codes.
fn longest_hold(outputs: &[Output]) -> usize {
    outputs
        .chunk_by(|one, next| one.code == next.code)
        .map(<[Output]>::len)
        .max()
        .expect("there are outputs")
}

#[test]
fn a_sample_that_comes_150_microseconds_late_is_heard_as_a_held_code() {
    let (outputs, after) = late(Injected::LateTick);
    assert_eq!(after.tick.late_outputs, 1);
    // The code is held for the period without a sample, and it was put out before, too.
    assert!(longest_hold(&outputs) > CODES);
}

#[test]
fn a_tick_that_takes_two_periods_is_heard_as_a_held_code() {
    let (outputs, after) = late(Injected::LongTick);
    assert_eq!(after.tick.late_outputs, 0, "the next one goes on from it");
    assert!(after.tick.missed > 0, "{:?}", after.tick);
    let ticks = &after.tick_histogram;
    assert!(ticks.longest > ticks.core_hz / SAMPLE_RATE_HZ, "{ticks:?}");
    assert!(longest_hold(&outputs) > CODES);
}

#[test]
fn a_tick_that_takes_six_periods_is_heard_as_a_fade_to_mid_scale() {
    let (outputs, after) = late(Injected::VeryLongTick);
    assert_eq!(
        after.tick.late_outputs, 1,
        "unless the last code was at mid-scale by itself"
    );
    assert!(
        outputs
            .chunk_by(|one, next| one.code == next.code)
            .filter(|run| run[0].code == Some(MID_SCALE))
            .map(<[Output]>::len)
            .max()
            > Some(CODES)
    );
}

/// Checks that the amplifier is switched on only after mid-scale has been put out for [`SETTLED_NS`], and is on only
/// while the converter drives its pin. Returns the instants at which it was switched on.
pub fn amplifier_follows_the_output(outputs: &[Output], amplifier: &[Driven]) -> Vec<u64> {
    assert_eq!(amplifier[0].drive, Drive::Low, "{amplifier:?}");
    let driven = |output: &&Output| output.code.is_some();
    assert!(
        amplifier[0].at_ns <= outputs.iter().find(driven).expect("driven").at_ns,
        "it is held off before anything else"
    );
    let mut raised = Vec::new();
    for (index, change) in amplifier.iter().enumerate() {
        if change.drive != Drive::High {
            continue;
        }
        raised.push(change.at_ns);
        let until = amplifier.get(index + 1).map_or(u64::MAX, |next| next.at_ns);
        let settled = (outputs.iter().rev())
            .skip_while(|output| output.at_ns > change.at_ns)
            .take_while(|output| output.at_ns + SETTLED_NS > change.at_ns);
        assert!(settled.clone().count() as u64 >= SETTLED_NS / CODE_NS - 1);
        for output in settled {
            assert_eq!(output.code, Some(MID_SCALE), "before {change:?}");
        }
        let on = outputs
            .iter()
            .filter(|output| (change.at_ns..until).contains(&output.at_ns));
        for output in on {
            assert!(output.code.is_some(), "{output:?} while it is on");
        }
    }
    raised
}

#[test]
fn the_amplifier_is_off_until_the_coil_is_known_and_mid_scale_has_settled() {
    // The flash is blank, and nobody has changed a setting.
    let mut device = Device::new(&product(), Options::default());
    device.wait_for_start();
    device.run_for(300 * MS);
    assert!(!device.status().output.amplifier);
    device.set_coil();
    device.run_for(50 * MS);
    assert!(device.status().output.amplifier);
    let amplifier = device.amplifier();
    let raised = amplifier_follows_the_output(device.dac(), &amplifier);
    assert_eq!(raised.len(), 1, "{amplifier:?}");
    assert_eq!(amplifier.len(), 2, "{amplifier:?}");
}

#[test]
fn a_falling_supply_drops_the_amplifier_before_anything_else_and_its_return_raises_it() {
    let (mut device, _) = playing_loudly();
    let fell = device.stylus.now_ns();
    device.stylus.set_supply(2_700);
    device.run_for(20 * MS);
    let amplifier = device.amplifier();
    let last = *amplifier.last().expect("it was raised");
    assert_eq!(last.drive, Drive::Low, "{amplifier:?}");
    assert!(last.at_ns - fell < 200_000, "{} ns", last.at_ns - fell);
    device.run_for(200 * MS);
    assert_eq!(device.amplifier().len(), amplifier.len(), "it stays off");
    device.stylus.set_supply(3_300);
    device.run_for(400 * MS);
    assert!(device.status().output.amplifier);
    let amplifier = device.amplifier();
    let raised = amplifier_follows_the_output(device.dac(), &amplifier);
    assert_eq!(raised.len(), 2, "{amplifier:?}");
}

#[test]
fn an_amplifier_that_is_switched_off_and_on_while_a_texture_plays_returns_at_mid_scale() {
    let (mut device, slew) = playing_loudly();
    inject(&mut device, Injected::AmplifierOff);
    device.run_for(50 * MS);
    assert!(!device.status().output.amplifier);
    assert!(loudness(&mut device) > 4 * slew, "the texture goes on");
    inject(&mut device, Injected::AmplifierOn);
    device.run_for(400 * MS);
    assert!(device.status().output.amplifier);
    assert!(loudness(&mut device) > 4 * slew, "it is heard again");
    let amplifier = device.amplifier();
    let raised = amplifier_follows_the_output(device.dac(), &amplifier);
    assert_eq!(raised.len(), 2, "{amplifier:?}");
}

#[test]
fn the_clocks_of_the_output_run_and_go_on_while_the_core_sleeps() {
    const SRAM1: u32 = 1 << 29;
    const DMA1: u32 = 1;
    const TIM7_AND_DAC: u32 = 1 << 29 | 1 << 5;
    // AHB2, AHB1 and APB1L: for each, the enable registers for the running and for the sleeping core.
    let clocks = [
        ([0xDC, 0x104], SRAM1),
        ([0xD8, 0x100], DMA1),
        ([0xE8, 0x110], TIM7_AND_DAC),
    ];
    let mut device = Device::with_library();
    for (registers, bits) in clocks {
        for register in registers {
            let enabled = device.stylus.read_register("RCC", register).expect("it is there");
            assert_eq!(enabled & bits, bits, "{register:#x}");
        }
    }
}

/// The accelerometer of a plant at the pin must agree with a second plant that is driven with the record of the run.
#[test]
fn a_plant_at_the_pin_moves_the_accelerometer_as_the_codes_and_the_enable_say() {
    let mut parameters = Parameters::preset("haptuator").expect("it is one");
    parameters.accelerometer.noise_m_s2_per_root_hz = [0.0; 3];
    let (mut device, _) = playing_loudly();
    device.amplifier();
    let from_ns = device.stylus.now_ns();
    let others = Box::new(ConstantPins::default());
    let plant = Plant::new(&parameters, 0);
    (device.stylus).set_pins(ActuatedPins::new(&ALL[0], plant, others));
    device.stylus.record_samples();
    device.run_for(100 * MS);
    let samples = device.stylus.take_samples();
    let outputs: Vec<Output> = device.dac().to_vec();
    let mut expected = Plant::new(&parameters, 0);
    let mut outputs = outputs.iter().filter(|output| output.at_ns > from_ns).peekable();
    // Until the first code, the plant rests and its amplifier is not enabled.
    let mut volts = None;
    let mut largest = 0;
    for sample in samples.iter().filter(|sample| sample.channel == 15) {
        while let Some(output) = outputs.next_if(|output| output.at_ns <= sample.at_ns) {
            if let Some(volts) = volts {
                expected.step(volts, true);
            }
            let code = f64::from(output.code.expect("it is driven"));
            volts = Some((code - 2048.0) / 4096.0 * 3.3);
        }
        let shown = expected.accelerometer_volts()[0] / 3.3 * 65_535.0 + 32_768.0;
        assert!((f64::from(sample.word) - shown).abs() <= 1.0, "{} {shown}", sample.word);
        largest = largest.max(sample.word.abs_diff(MID_SCALE_WORD));
    }
    assert!(largest > 1_000, "{largest} words");
}
