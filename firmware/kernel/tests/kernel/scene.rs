//! Whole scenes: only the stages that a moment needs are played.

use model_format::scene::{MotionOfScene, Scene, StickSlip, Surface};
use model_format::{Library, Newton, SAMPLE_RATE_HZ};
use proptest::collection::vec;
use proptest::prelude::*;
use stylus_kernel::scene::cost::{self, Item};
use stylus_kernel::scene::{ContactDetector, ContactThreshold, Interaction, Plan, ScenePlayer, Stage};
use stylus_kernel::{MAX_FED_SAMPLES, Motion, Synthesis, UPDATE_INTERVAL_SAMPLES};

use crate::fed_scene;
use crate::models::{
    at, biquad, block, largest_step, lifted, motion, moving, name, peak, plan, player, scene_library, side_by_side, tap,
};

fn single(texture: u8) -> Scene {
    Scene::of_surface(name("single"), SAMPLE_RATE_HZ, Surface::of_texture(texture))
}

fn sticking() -> Scene {
    let mut scene = single(2);
    scene.surfaces[0].stick_slip = Some(STICK_SLIP);
    scene
}

/// A tap on a smooth surface.
fn tapped() -> Scene {
    let mut scene = single(2);
    scene.surfaces[0].texture = None;
    scene.surfaces[0].tap = Some(tap(200.0, 0.02));
    scene
}

fn any_motion() -> impl Strategy<Value = Motion> {
    let speed = prop_oneof![6 => 0.0f32..150.0, 1 => Just(0.0), 1 => Just(75.0)];
    let force = prop_oneof![6 => 0.0f32..1.5, 1 => Just(0.0), 1 => Just(0.75)];
    (speed, force).prop_map(|(speed, force)| motion(speed, force))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(96))]

    /// Blocks are played to their end or cut short; motions change or stay.
    #[test]
    fn one_surface_without_effects_is_its_texture_bit_for_bit(
        seed: u64,
        steps in vec((any_motion(), 1..=MAX_FED_SAMPLES as u32, 1usize..4), 1..30),
    ) {
        for bytes in [scene_library(&[]), fed_scene::library()] {
            for (index, texture) in Library::decode(&bytes).expect("a valid library").textures().enumerate() {
                let mut synthesis: Synthesis<'_> = Synthesis::new(texture, seed);
                let mut plain: ScenePlayer<'_> = ScenePlayer::new(Plan::of_texture(texture), seed);
                let mut scene = player(&bytes, &single(index as u8), seed);
                for &(motion, samples, times) in &steps {
                    for _ in 0..times {
                        let followed = samples.max(UPDATE_INTERVAL_SAMPLES);
                        synthesis.follow(motion, followed);
                        plain.follow(Interaction::touching(motion), followed);
                        scene.follow(at(12.0, motion), followed);
                        for _ in 0..samples {
                            let expected = synthesis.next_sample();
                            prop_assert_eq!(plain.next_sample(), expected);
                            prop_assert_eq!(scene.next_sample(), expected);
                        }
                        prop_assert_eq!(scene.block().stages().len(), 1);
                    }
                }
                prop_assert_eq!(scene.saturations(), synthesis.saturations());
            }
        }
    }
}

#[test]
fn at_constant_motion_the_frame_is_computed_once() {
    let bytes = scene_library(&[]);
    let mut scene = single(2);
    scene.motion = MotionOfScene::Constant {
        speed_mm_s: 75.0,
        force_n: 0.75,
    };
    let mut played = player(&bytes, &scene, 3);
    let mut followed = player(&bytes, &single(2), 3);
    for n in 0..50u8 {
        // The scene does not follow the hand's motion.
        let hand = motion(f32::from(n), 0.6);
        let samples = block(&mut played, at(0.0, hand));
        assert_eq!(samples, block(&mut followed, at(0.0, moving())));
        let stage = played.block().stages()[0].voice().expect("a voice");
        assert_eq!(stage.begins, n == 0);
    }
}

#[test]
fn a_gain_of_zero_and_a_surface_without_a_texture_run_no_voice() {
    let bytes = scene_library(&[]);
    let mut mute = single(2);
    mute.surfaces[0].gain = 0.0;
    let mut smooth = single(2);
    smooth.surfaces[0].texture = None;
    for scene in [mute, smooth] {
        let mut player = player(&bytes, &scene, 1);
        for _ in 0..10 {
            assert_eq!(peak(&block(&mut player, at(0.0, moving()))), 0.0);
            assert!(player.block().stages().is_empty());
        }
        assert_eq!(plan(&bytes, &scene).worst_case().terms().len(), 1);
    }
}

/// A gain of two is 6 dB, to the precision of the level's 2⁻¹⁶; a ramp of ten samples may be short by nine steps.
#[test]
fn a_gain_scales_every_sample() {
    let bytes = scene_library(&[]);
    for texture in 0..4 {
        let mut louder = single(texture);
        louder.surfaces[0].gain = 2.0;
        let (mut one, mut two) = (player(&bytes, &single(texture), 4), player(&bytes, &louder, 4));
        for _ in 0..100 {
            let pairs = block(&mut one, at(0.0, moving()));
            let voice = one.block().stages().first().and_then(Stage::voice);
            let precision = if voice.is_some_and(|voice| voice.begins) {
                // Nine of 2¹⁶ steps in the first tenth of the ramp, for each of the two players.
                2.0 * 9.0 / 6_553.6
            } else {
                1e-4
            };
            for (one, two) in pairs.iter().zip(block(&mut two, at(0.0, moving()))) {
                assert!((two - 2.0 * one).abs() <= precision * one.abs() + 1e-5);
            }
        }
    }
}

#[test]
fn two_voices_run_only_while_a_transition_lasts() {
    let bytes = scene_library(&[]);
    let scene = side_by_side(&[2, 3], 10.0);
    let mut player = player(&bytes, &scene, 6);
    let mut most = 0;
    for step in 0..1500 {
        let position = 50.0 + 0.1 * step as f32;
        block(&mut player, at(position, moving()));
        let stages = player.block().stages().len();
        most = most.max(stages);
        // The fade takes one more block to end.
        if !(95.0..=105.2).contains(&position) {
            assert_eq!(stages, usize::from(position < 200.0 + 0.15), "{position} mm");
        }
    }
    assert_eq!(most, 2);
}

#[test]
fn boundaries_make_no_step_larger_than_the_signals_own() {
    let bytes = scene_library(&[]);
    for transition_mm in [0.0, 0.5, 5.0] {
        let scene = side_by_side(&[0, 1], transition_mm);
        let mut own = (0.0f64, 0.0f64);
        for place in [50.0, 150.0] {
            let mut player = player(&bytes, &scene, 9);
            let alone: Vec<f64> = (0..5000)
                .flat_map(|_| block(&mut player, at(place, moving())))
                .collect();
            own = (own.0.max(largest_step(&alone)), own.1.max(peak(&alone)));
        }
        let mut player = player(&bytes, &scene, 9);
        let crossing: Vec<f64> = (0..5000u32)
            .flat_map(|step| {
                let place = if step % 40 < 20 { 99.0 } else { 101.0 };
                block(&mut player, at(place, moving()))
            })
            .collect();
        // Equal power is at most √2 in amplitude, and each voice reaches its level within a block.
        let bound = 1.42 * own.0 + 2.0 * own.1 / f64::from(UPDATE_INTERVAL_SAMPLES);
        assert!(largest_step(&crossing) <= bound);
        assert!(bound < 0.5 * own.1, "a hard cut would pass");
        assert_eq!(player.saturations(), 0);
    }
}

#[test]
fn scenes_are_exchanged_without_a_step_within_four_blocks() {
    let bytes = scene_library(&[]);
    let mut ringing = single(0);
    ringing.surfaces[0].tap = Some(tap(100.0, 0.2));
    ringing.equaliser.push(biquad(80.0, 0.97, 0.95)).expect("room");
    let scenes = [single(0), single(1), ringing, side_by_side(&[1, 0], 1.0)];
    for (from, first) in scenes.iter().enumerate() {
        for (to, second) in scenes.iter().enumerate() {
            let mut player = player(&bytes, first, 11);
            let mut played = block(&mut player, lifted());
            for _ in 0..300 {
                played.extend(block(&mut player, at(50.0, moving())));
            }
            let own = (largest_step(&played[1000..]), peak(&played));
            player.switch(plan(&bytes, second));
            let before = *played.last().expect("some");
            let mut after = vec![before];
            for _ in 0..4 {
                after.extend(block(&mut player, at(50.0, moving())));
            }
            assert!(!player.director().is_switching(), "{from} to {to}");
            assert!(peak(&after[31..]) > 0.0, "{from} to {to}");
            let bound = 2.0 * own.0 + 2.0 * own.1 / f64::from(UPDATE_INTERVAL_SAMPLES);
            assert!(largest_step(&after) <= bound, "{from} to {to}");
            assert_eq!(player.saturations(), 0);
        }
    }
}

#[test]
fn the_worst_case_counts_what_can_sound_at_a_time_and_nothing_else() {
    let bytes = scene_library(&[]);
    let items = |scene: &Scene| -> Vec<Item> {
        plan(&bytes, scene)
            .worst_case()
            .terms()
            .iter()
            .map(|term| term.item)
            .collect()
    };
    let decoded = Library::decode(&bytes).expect("a valid library");
    let texture = decoded.textures().nth(2).expect("it is there");
    assert_eq!(
        plan(&bytes, &single(2)).worst_case(),
        Plan::of_texture(texture).worst_case()
    );
    assert_eq!(items(&single(2)).len(), 2);
    // Of three surfaces, the two most expensive ones count.
    let cost = plan(&bytes, &side_by_side(&[2, 0, 3], 1.0)).worst_case();
    let expected = u32::from(cost::MIX.base) + 2 * u32::from(cost::LATTICE.base + 400 * cost::LATTICE.each);
    assert_eq!(cost.instructions(), expected);
    // A surface without a region costs nothing.
    let mut scene = side_by_side(&[0, 2], 0.0);
    scene.regions.pop();
    assert_eq!(items(&scene).len(), 2);
    scene.surfaces[0].tap = Some(tap(100.0, 0.01));
    assert!(items(&scene).contains(&Item::Tap));
    scene.surfaces[0].stick_slip = Some(STICK_SLIP);
    assert!(items(&scene).contains(&Item::StickSlip { surface: 0 }));
    assert!(!items(&scene).contains(&Item::Equaliser));
}

const STICK_SLIP: StickSlip = StickSlip {
    period_mm: 1.0,
    duty: 0.4,
    depth: 0.9,
    below_mm_s: 60.0,
    above_n: 0.4,
};

#[test]
fn a_plan_over_the_budget_is_refused_with_the_arithmetic() {
    let bytes = scene_library(&[]);
    let plan = plan(&bytes, &side_by_side(&[2, 3], 1.0));
    let needed = plan.worst_case().instructions();
    assert!(plan.within(needed).is_ok());
    let refused = plan.within(needed - 1).expect_err("one short");
    let message = refused.to_string();
    for told in [
        "surface 0, normalised lattice: 153 + 400 x 11 = 4553".to_owned(),
        "surface 1, normalised lattice: 153 + 400 x 11 = 4553".to_owned(),
        format!("together {needed} instructions"),
        format!("the budget of a sample is {}", needed - 1),
    ] {
        assert!(message.contains(&told), "{message}");
    }
    // Two voices of the highest order are within the device's budget.
    assert!(plan.within(cost::BUDGET).is_ok());
}

#[test]
fn stick_slip_comes_with_slow_and_heavy_strokes_only() {
    let bytes = scene_library(&[]);
    let scene = sticking();
    let mut player = player(&bytes, &scene, 2);
    let mut position = 0.0;
    for (speed, force, sticks) in [
        (80.0, 0.9, false),
        (30.0, 0.9, true),
        (30.0, 0.3, false),
        (59.0, 0.9, true),
        (60.0, 0.9, false),
    ] {
        for n in 0..50 {
            position += speed * 0.002;
            block(&mut player, at(position, motion(speed, force)));
            let stage = player.block().stages()[0];
            // The amount goes to zero within one block.
            if n > 1 {
                assert_eq!(matches!(stage, Stage::StickSlip(..)), sticks);
            }
        }
    }
}

/// At 20 mm/s and a period of 1 mm there are 20 slips per second.
#[test]
fn stick_slip_has_the_period_of_the_path() {
    let bytes = scene_library(&[]);
    let scene = sticking();
    let (mut modulated, mut plain) = (player(&bytes, &scene, 2), player(&bytes, &single(2), 2));
    let mut energies = [(0.0, 0.0); 25];
    for n in 0..20_000usize {
        let interaction = at(n as f32 * 0.04, motion(20.0, 0.9));
        let energy = |samples: Vec<f64>| samples.iter().map(|x| x * x).sum::<f64>();
        let (one, other) = (
            energy(block(&mut modulated, interaction)),
            energy(block(&mut plain, interaction)),
        );
        assert!(one <= other * (1.0 + 1e-6));
        // 25 blocks are a period.
        energies[n % 25].0 += one;
        energies[n % 25].1 += other;
    }
    let shares: Vec<f64> = energies.iter().map(|(one, all)| one / all).collect();
    let (low, high) = shares.iter().fold((1.0f64, 0.0f64), |(low, high), &share| {
        (low.min(share), high.max(share))
    });
    // While the tool sticks, a tenth of the amplitude remains.
    assert!((low - 0.01).abs() < 0.005, "{low}");
    assert!(high > 0.7, "{high}");
}

#[test]
fn contact_has_a_hysteresis() {
    let set = ContactThreshold::new(Newton(0.4));
    for (threshold, unit) in [(ContactThreshold::LEAST, 0.02), (set, 0.4)] {
        let mut contact = ContactDetector::new();
        for (share, touches) in [(0.75, false), (1.05, true), (0.75, true), (0.45, false), (0.75, false)] {
            let motion = motion(10.0, share * unit);
            let touched = contact.touches(motion, threshold);
            assert_eq!(touched, touches, "{share} of {unit} N");
        }
    }
}

/// The tool comes down at each of the ten samples between two updates, and its force rises for 6 ms.
#[test]
fn a_tap_is_as_loud_wherever_between_two_updates_contact_falls() {
    let bytes = scene_library(&[]);
    let scene = tapped();
    let peak_at = |phase: u16| {
        let mut player = player(&bytes, &scene, 1);
        let contact = 100 + phase;
        let force = |n: u16| (f32::from(n.saturating_sub(contact)) * 0.01).min(0.3);
        let samples = (0..200u16)
            .map(|index| force(index * UPDATE_INTERVAL_SAMPLES as u16))
            .flat_map(|force| {
                let there = Interaction::new(motion(0.0, force), 0.0, force > 0.02);
                block(&mut player, there.expect("all is finite"))
            });
        peak(&samples.collect::<Vec<_>>())
    };
    let peaks: Vec<f64> = (0..10).map(peak_at).collect();
    let (low, high) = peaks
        .iter()
        .fold((f64::MAX, 0.0f64), |(low, high), &peak| (low.min(peak), high.max(peak)));
    assert!(low > 1.0 && high < 1.01 * low, "{peaks:?}");
}

/// A tap on a smooth surface: silence, then a transient that begins at zero.
#[test]
fn a_tap_sounds_on_contact_alone_and_scales_with_the_rate_of_force() {
    let bytes = scene_library(&[]);
    let scene = tapped();
    let peak_at = |force: f32| {
        let mut player = player(&bytes, &scene, 1);
        block(&mut player, lifted());
        let mut samples = Vec::new();
        for _ in 0..300 {
            samples.extend(block(&mut player, at(0.0, motion(0.0, force))));
        }
        assert_eq!(samples[0], 0.0);
        peak(&samples)
    };
    // 0.1 N in a block of 2 ms is 50 N/s, and 5 m/s² at a gain of 0.1.
    assert!((peak_at(0.1) - 4.7).abs() < 0.3, "{}", peak_at(0.1));
    assert!((peak_at(0.2) / peak_at(0.1) - 2.0).abs() < 0.01);
    assert!(peak_at(100.0) <= 20.0);
    // Without an impact there is no tap: neither for contact from the beginning nor for a force that rises later.
    let mut player = player(&bytes, &scene, 1);
    for force in [0.5, 5.0, 50.0] {
        assert_eq!(peak(&block(&mut player, at(0.0, motion(0.0, force)))), 0.0);
    }
}
