//! The played output, compared code by code and instant by instant.

use model_format::Library;
use model_format::link::{MotionSource, RecordStartEndpoint, RecordStopEndpoint, StopEndpoint};
use virtual_stylus::Options;
use virtual_stylus::model::dac::Cause;
use virtual_stylus::motion::Motion;
use virtual_stylus::pins::FunctionPins;

use crate::device::{CODE_NS, CODES, Device, MID_SCALE, MS};
use crate::expected::{Heard, Recorded, explain};
use crate::library;

/// Code of the ADC for a force, by default at 2 N/V above a zero at a sixteenth of the range.
pub fn force_code(newton: f64) -> u16 {
    4_096 + (newton / 2.0 / 3.3 * 65_536.0) as u16
}

/// Pins with a force that goes up and down over the grid, and an accelerometer whose axes differ.
fn pins() -> FunctionPins<impl FnMut(u8, u64) -> u16 + Send> {
    FunctionPins(|channel, at_ns| {
        let phase = at_ns as f64 / 1e9 * std::f64::consts::TAU * 1.3;
        match channel {
            5 => force_code(0.8 + 0.7 * phase.sin()),
            _ => 0x8000 + u16::from(channel) * 100,
        }
    })
}

/// Codes at the output before those of the first tick: the timer of the codes runs for 17 of them before the tick's own
/// timer starts and that tick's first code is due.
pub const BEFORE_FIRST_TICK: usize = 17;

/// The codes of each tick that were put out at the triggers, from the first tick on, after a check of their instants.
pub fn latched(device: &mut Device) -> Vec<[u16; CODES]> {
    let outputs: Vec<_> = (device.dac().iter())
        .filter(|output| output.cause == Cause::Trigger)
        .copied()
        .collect();
    let uneven = outputs
        .windows(2)
        .find(|pair| pair[1].at_ns - pair[0].at_ns != CODE_NS);
    assert_eq!(uneven, None, "instants that are not 25 µs apart");
    let codes: Vec<u16> = (outputs[BEFORE_FIRST_TICK..].iter())
        .map(|output| output.code.expect("driven"))
        .collect();
    codes.as_chunks().0.to_vec()
}

fn plays_as_the_host_does(library: &[u8], texture: &str, options: Options) {
    // RAM holds what power-on leaves in it.
    let mut device = Device::started(Options {
        ram_noise: Some(2),
        ..options
    });
    device.stylus.set_pins(pins()).expect("the run goes on");
    let start = device.stylus.now_ns();
    let knots = [
        (0, 0.0),
        (200, 20.0),
        (700, 260.0),
        (1_100, 30.0),
        (1_500, 190.0),
    ];
    let speeds = knots.map(|(ms, speed)| (start + ms * MS, speed));
    let motion = Motion::linear(&speeds, 0.01).expect("instants that rise");
    device.stylus.set_motion(motion).expect("the run goes on");
    device
        .request::<RecordStartEndpoint>(&())
        .expect("nothing is recorded");
    // More than the window of the speed.
    device.run_for(60 * MS);
    let asked = device.status().tick.ticks;
    device.play(texture, MotionSource::Sensors, 77);
    device.run_for(1_600 * MS);
    let stopped = device
        .request::<RecordStopEndpoint>(&())
        .expect("it is recorded");
    assert_eq!(stopped.lost_blocks, 0);
    let status = device.status();
    assert_eq!(
        (
            status.tick.missed,
            status.tick.late_frames,
            status.tick.late_conversions
        ),
        (0, 0, 0)
    );

    let recorded = Recorded::of(&device.blocks);
    let codes = latched(&mut device);
    let library = Library::decode(library).expect("a valid library");
    let texture = library.texture(texture).expect("it is in the library");
    let heard = Heard::of_texture(texture, 77);
    let (began, same_until) = explain(&heard, &recorded, &codes, asked);
    let end = recorded.first_tick + recorded.samples.len() as u64;
    assert_eq!(
        same_until, end,
        "codes differ from tick {same_until} on, with {began:?}"
    );
    let heard = codes[began.unmuted as usize..end as usize]
        .as_flattened()
        .iter()
        .filter(|&&code| code != MID_SCALE);
    assert!(heard.count() > CODES * 4_000, "the motion is heard");
}

#[test]
fn a_lattice_is_put_out_as_the_host_computes_it_code_for_code() {
    plays_as_the_host_does(library::small(), "lattice", library::options());
}

/// The texture whose digest all platforms compare, by the image itself, which gives no words but codes.
#[test]
fn the_texture_of_the_digest_is_put_out_as_the_host_computes_it_code_for_code() {
    let library = kernel_vectors::digest_library();
    let options = Options {
        flash: library::flash_with(&library),
        ..Options::default()
    };
    plays_as_the_host_does(&library, "digest", options);
}

#[test]
fn a_stop_ends_at_mid_scale_and_stays_there() {
    let mut device = Device::started(library::options());
    device.stylus.set_pins(pins()).expect("the run goes on");
    device
        .stylus
        .set_motion(Motion::steady(120.0, 0.01))
        .expect("the run goes on");
    device.play_until_heard("lattice", MotionSource::Sensors, 1);
    device.run_for(300 * MS);
    device.request::<StopEndpoint>(&()).expect("it plays");
    device.run_for(100 * MS);
    let silent_from = device.stylus.now_ns();
    device.run_for(300 * MS);
    let codes = latched(&mut device);
    let mut codes = codes.as_flattened().iter();
    assert!(codes.any(|&code| code != MID_SCALE), "it was heard");
    let late = device
        .dac()
        .iter()
        .filter(|output| output.at_ns > silent_from);
    assert!(
        late.map(|output| output.code)
            .all(|code| code == Some(MID_SCALE))
    );
}
