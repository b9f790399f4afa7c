//! The output of textures and scenes, compared code by code and instant by instant, at 5 and at 10 kHz.

use model_format::Library;
use stylus_board::{ALL, Board};
use stylus_kernel::scene::cost::BUDGET;
use virtual_stylus::Options;

use crate::cost::{count, count_scene};
use crate::device::{Device, MS, PERIOD_NS};
use crate::expected::{Compared, ExpectedPlay, plays_as_the_host_does};
use crate::library;
use crate::scenes::{OVER_AND_BACK, fast, force_code, plan, press, tapping};

/// Largest number of instructions of a tick at 10 kHz in addition to those of its samples: inputs, safety, and what
/// begins a block.
const BESIDES: u32 = 2_400;

/// Speeds that rise and fall over the grid of a texture: instants in ms with speeds in mm/s.
const STROKES: [(u64, f64); 5] = [(0, 0.0), (200, 20.0), (500, 260.0), (800, 30.0), (1_000, 190.0)];

/// A force that rises and falls over the grid, and an accelerometer whose axes differ.
fn pins(channel: u8, at_ns: u64) -> u16 {
    let phase = at_ns as f64 / 1e9 * std::f64::consts::TAU * 1.3;
    match channel {
        5 => force_code(0.8 + 0.7 * phase.sin()),
        _ => 0x8000 + u16::from(channel) * 100,
    }
}

fn a_texture_is_played(board: &'static Board, bytes: &[u8], texture: &str) {
    // RAM holds noise, as after power-on.
    let mut device = Device::started(Options {
        ram_noise: Some(2),
        flash: library::with(bytes).flash,
        ..Options::on(board)
    });
    device.set_pins(pins);
    let library = Library::decode(bytes).expect("a valid library");
    let heard = ExpectedPlay::of_texture(library.texture(texture).expect("it is there"), 77);
    plays_as_the_host_does(&mut device, &heard, 1_100, |device| {
        device.move_along(&STROKES);
        device.play(texture, 77);
    });
}

#[test]
fn a_lattice_is_put_out_as_the_host_computes_it_code_for_code() {
    for board in ALL {
        a_texture_is_played(board, &library::small(), "lattice");
    }
}

/// Plays, with the image itself, the texture whose digest all platforms compare. The image puts out codes instead of
/// words.
#[test]
fn the_texture_of_the_digest_is_put_out_as_the_host_computes_it_code_for_code() {
    a_texture_is_played(&ALL[0], &kernel_vectors::digest_library(), "digest");
}

/// A device with a force that taps.
fn touched(bytes: &[u8]) -> Device {
    let mut device = Device::started(library::with(bytes));
    device.set_pins(tapping);
    device
}

fn a_scene_is_played(bytes: &[u8], scene: &str) {
    let library = Library::decode(bytes).expect("a valid library");
    let heard = ExpectedPlay::of_scene(plan(&library, scene), 5);
    let Compared { audits, .. } = plays_as_the_host_does(&mut touched(bytes), &heard, 1_300, |device| {
        device.move_along(&OVER_AND_BACK);
        device.play_scene(scene, 5);
    });
    assert!(audits > 0);
}

#[test]
fn a_scene_at_ten_kilohertz_with_all_effects_is_put_out_as_the_host_computes_it() {
    a_scene_is_played(&fast(), "everything");
}

/// A scene of two fed voices with all effects, over the transition and back. Every bit is compared, and no update may
/// be late.
#[test]
fn a_scene_of_fed_textures_is_put_out_as_the_host_computes_it() {
    a_scene_is_played(&crate::scenes::bytes(), "fed everything");
}

/// A tick at 10 kHz keeps its period and its budget. A tick at 5 kHz costs as much as before.
#[test]
fn two_samples_of_the_highest_order_fit_in_a_tick_and_its_period_stays() {
    let mut device = Device::started(library::with(&fast()));
    press(&mut device, 1.0);
    device.move_at(20.0);
    let idle = count(&mut device, "idle", 20);
    device.play_until_heard("slow");
    let slow = count(&mut device, "lattice at 5 kHz", 30);
    device.play_until_heard("fast");
    device.run_for(200 * MS);
    device.stylus.take_ticks();
    device.run_for(50 * MS);
    let ticks = device.stylus.take_ticks();
    assert!(ticks.len() > 240, "{}", ticks.len());
    for pair in ticks.windows(2) {
        let late = (pair[1].at_ns - pair[0].at_ns).abs_diff(PERIOD_NS);
        // A critical section of a task may delay the tick by this much.
        assert!(late < 5_000, "{late} ns");
    }
    let fast = count(&mut device, "lattice at 10 kHz", 30);
    device.run_for(100 * MS);
    let both = count_scene(&mut device, "both");
    device.play_until_heard("slow");
    device.run_for(200 * MS);
    let again = count(&mut device, "lattice at 5 kHz, again", 30);
    assert_eq!(again.within, slow.within);

    let voice = slow.within - idle.within;
    // The difference consists of two samples, and of the safety stages for the second one.
    let more = fast.within - idle.within - 2 * voice;
    assert!(more < 400, "{more}");
    for count in [fast, both] {
        assert!(count.beginning <= BUDGET + BESIDES, "{count:?}");
    }
    device.assert_undisturbed();
}
