//! Choices, libraries, rates and gains that change while something plays, also from other threads.

use std::sync::atomic::{AtomicBool, Ordering};

use kernel_vectors::specs;
use stylus_player::{ChoiceError, Fault, Selection, Without, player};

use crate::{LIBRARIES, choose, largest_step, library, playing, playing_as_rendered, rubbed};

const MOTION: (f64, f64) = (100.0, 1.0);

fn is_silent(samples: &[f32]) -> bool {
    samples.iter().all(|sample| *sample == 0.0)
}

#[test]
fn another_librarys_texture_fades_in_within_two_blocks_and_plays_as_in_a_new_player() {
    let other = library(&specs()[..3], 5000);
    let (mover, mut filler) = playing_as_rendered(&LIBRARIES[0], 0, 5000);
    let before = rubbed(&mover, &mut filler, 40, MOTION);
    choose(&mover, &other, 1);
    drop(other);
    let after = rubbed(&mover, &mut filler, 40, MOTION);
    let (fresh_mover, mut fresh) = playing_as_rendered(&LIBRARIES[0], 1, 5000);
    let expected = rubbed(&fresh_mover, &mut fresh, 40, MOTION);
    let fade = &after[..10];
    assert!(!is_silent(&fade[..9]));
    assert_eq!(fade[9], 0.0);
    assert_eq!(after[10..], expected[..390]);
    let joint: Vec<f32> = before[399..].iter().chain(fade).copied().collect();
    assert!(largest_step(&joint) <= largest_step(&before));
}

#[test]
fn the_last_of_many_choices_plays_and_a_stop_is_silence() {
    let (mover, mut filler) = playing_as_rendered(&LIBRARIES[0], 0, 5000);
    rubbed(&mover, &mut filler, 10, MOTION);
    for index in [3, 2, 1] {
        choose(&mover, &LIBRARIES[0], index);
        // Each choice is made while the previous one waits.
        filler.fill(&mut [0.0; 1]);
    }
    filler.fill(&mut [0.0; 7]);
    let played = rubbed(&mover, &mut filler, 60, MOTION);
    let (fresh_mover, mut fresh) = playing_as_rendered(&LIBRARIES[0], 1, 5000);
    let expected = rubbed(&fresh_mover, &mut fresh, 20, MOTION);
    let found = played.windows(200).any(|window| window == expected);
    assert!(found, "the choice that was made last");
    mover.stop();
    rubbed(&mover, &mut filler, 2, MOTION);
    assert!(is_silent(&rubbed(&mover, &mut filler, 20, MOTION)));
    choose(&mover, &LIBRARIES[0], 1);
    assert_eq!(rubbed(&mover, &mut filler, 20, MOTION), expected);
}

#[test]
fn a_texture_of_another_rate_begins_after_the_tail_of_the_one_before() {
    for output_rate_hz in [5000, 10_000, 44_100, 48_000] {
        for (from, to) in [(0, 1), (1, 0)] {
            let (mover, mut filler) = playing_as_rendered(&LIBRARIES[from], 0, output_rate_hz);
            let before = rubbed(&mover, &mut filler, 50, MOTION);
            choose(&mover, &LIBRARIES[to], 1);
            let after = rubbed(&mover, &mut filler, 100, MOTION);
            let (fresh_mover, mut fresh) = playing_as_rendered(&LIBRARIES[to], 1, output_rate_hz);
            let expected = rubbed(&fresh_mover, &mut fresh, 20, MOTION);
            let loudest = largest_step(&before).max(largest_step(&expected));
            let joint = [&before[before.len() - 1..], &after[..]].concat();
            let early = &joint[..joint.len() / 4];
            assert!(largest_step(early) <= 1.2 * loudest, "{from} {output_rate_hz}");
            let lengths = expected.len() - output_rate_hz as usize / 500;
            let found = after.windows(lengths).any(|window| window == &expected[..lengths]);
            assert!(found, "{from} {output_rate_hz}");
            assert!(!is_silent(&after[after.len() / 2..]), "{from} {output_rate_hz}");
        }
    }
}

#[test]
fn a_sudden_motion_makes_no_larger_step_than_the_motion_itself() {
    for output_rate_hz in [5000, 48_000] {
        let (mover, mut filler) = playing(&LIBRARIES[0], 1, output_rate_hz);
        rubbed(&mover, &mut filler, 100, (20.0, 0.2));
        let change = rubbed(&mover, &mut filler, 10, (200.0, 2.0));
        let after = rubbed(&mover, &mut filler, 200, (200.0, 2.0));
        assert!(largest_step(&change) <= largest_step(&after), "{output_rate_hz}");
    }
}

#[test]
fn a_gain_gives_volts_changes_over_a_block_and_is_clamped() {
    let (mover, mut filler) = playing(&LIBRARIES[0], 1, 5000);
    let (plain_mover, mut plain) = playing(&LIBRARIES[0], 1, 5000);
    mover.set_gain(0.25, f32::INFINITY).expect("it is finite");
    let accelerations = rubbed(&plain_mover, &mut plain, 20, MOTION);
    let volts = rubbed(&mover, &mut filler, 20, MOTION);
    let quarter: Vec<f32> = accelerations.iter().map(|sample| 0.25 * sample).collect();
    assert_eq!(volts, quarter);
    mover.set_gain(-0.5, f32::INFINITY).expect("it is finite");
    let accelerations = rubbed(&plain_mover, &mut plain, 2, MOTION);
    let volts = rubbed(&mover, &mut filler, 2, MOTION);
    for (index, (volts, acceleration)) in volts.iter().zip(&accelerations).enumerate() {
        let expected = (0.25 - 0.075 * (index + 1).min(10) as f32) * acceleration;
        assert!((volts - expected).abs() <= 1e-5 * acceleration.abs(), "{index}");
    }
    let peak = volts.iter().fold(0.0f32, |peak, volts| peak.max(volts.abs()));
    mover.set_gain(-0.5, peak / 8.0).expect("it is positive");
    let clamped = rubbed(&mover, &mut filler, 50, MOTION);
    let largest = clamped.iter().fold(0.0f32, |peak, volts| peak.max(volts.abs()));
    assert_eq!(largest, peak / 8.0);
}

#[test]
fn what_cannot_be_played_is_refused_with_its_remedy_and_what_plays_goes_on() {
    let (mover, mut filler) = playing(&LIBRARIES[0], 1, 5000);
    let (other_mover, mut other) = playing(&LIBRARIES[0], 1, 5000);
    let slow = library(&specs()[..2], 2000);
    let choose = |library, selection| {
        mover
            .choose(library, selection, Without::default(), 1)
            .expect_err("it is not there")
    };
    let no_texture = ChoiceError::NoTexture { index: 99, count: 12 };
    assert_eq!(choose(&LIBRARIES[0], Selection::Texture(99)), Fault::Choice(no_texture));
    assert!(matches!(choose(&LIBRARIES[0], Selection::Scene(1)), Fault::Choice(_)));
    assert_eq!(choose(&slow, Selection::Texture(0)), Fault::SampleRate(2000));
    for refused in [
        mover.rub(f64::NAN, 1.0),
        mover.rub(1.0, f64::INFINITY),
        mover.reach(f64::NAN, 1.0, 1.0),
        mover.reach(0.0, f64::NAN, 1.0),
        mover.reach(0.0, 1.0, f64::NAN),
        mover.rub(5e12, 1.0),
        mover.reach(0.0, -1e12, 1.0),
    ] {
        let text = refused.expect_err("no hand has it").to_string();
        assert!(text.contains("give"), "{text}");
    }
    for (gain, limit) in [(f32::NAN, 1.0), (f32::INFINITY, 1.0), (1.0, f32::NAN), (1.0, -1.0)] {
        assert_eq!(mover.set_gain(gain, limit), Err(Fault::Gain));
    }
    for (ohms, watts) in [
        (f32::NAN, 1.0),
        (0.0, 1.0),
        (8.0, f32::INFINITY),
        (8.0, -1.0),
        (1e-30, 1e-30),
    ] {
        assert_eq!(mover.set_coil(ohms, 0.01, watts), Err(Fault::Coil));
    }
    assert_eq!(mover.set_coil(8.0, f32::NAN, 1.0), Err(Fault::Gain));
    for rate_hz in [0, 975, 4999, 8001, 192_025, u32::MAX] {
        assert_eq!(player(rate_hz).err(), Some(Fault::OutputRate(rate_hz)));
    }
    let played = rubbed(&mover, &mut filler, 20, MOTION);
    assert_eq!(played, rubbed(&other_mover, &mut other, 20, MOTION));
}

#[test]
fn what_is_taken_while_threads_move_and_choose_is_a_texture_and_then_the_last_choice() {
    let (mover, mut filler) = playing(&LIBRARIES[0], 0, 48_000);
    let is_over = AtomicBool::new(false);
    std::thread::scope(|threads| {
        for thread in 0..2 {
            let (mover, is_over) = (mover.clone(), &is_over);
            threads.spawn(move || {
                let mut count = 0u32;
                while !is_over.load(Ordering::Relaxed) {
                    let speed_mm_s = 50.0 + f64::from(count % 100);
                    mover.rub(speed_mm_s, 0.5).expect("it is finite");
                    if thread == 0 && count.is_multiple_of(1000) {
                        choose(&mover, &LIBRARIES[count as usize / 1000 % 2], 1);
                    }
                    count += 1;
                }
            });
        }
        let mut samples = [0.0f32; 64];
        for _ in 0..3000 {
            filler.fill(&mut samples);
            assert!(samples.iter().all(|sample| sample.is_finite()));
        }
        is_over.store(true, Ordering::Relaxed);
    });
    choose(&mover, &LIBRARIES[0], 2);
    let mut samples = vec![0.0f32; 4800];
    mover.rub(100.0, 1.0).expect("it is finite");
    filler.fill(&mut samples);
    assert!(samples.iter().any(|sample| *sample != 0.0));
}
