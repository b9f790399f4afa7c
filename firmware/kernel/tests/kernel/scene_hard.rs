//! Hard cases: bouncing contact, motion that stops abruptly, sixteen surfaces, jumps, and all effects at once.

use model_format::SAMPLE_RATE_HZ;
use model_format::scene::{Scene, StickSlip, Surface};
use proptest::collection::vec;
use proptest::prelude::*;
use stylus_kernel::Motion;
use stylus_kernel::scene::{Interaction, SLOTS};

use crate::models::{
    add_region, at, biquad, block, lifted, motion, moving, name, peak, plan, player, scene_library, side_by_side, tap,
};

/// A surface with every effect.
fn busy() -> Scene {
    let mut surface = Surface::of_texture(2);
    surface.tap = Some(tap(150.0, 0.05));
    surface.stick_slip = Some(StickSlip {
        period_mm: 0.5,
        duty: 0.3,
        depth: 1.0,
        below_mm_s: 200.0,
        above_n: 0.01,
    });
    let mut scene = Scene::of_surface(name("busy"), SAMPLE_RATE_HZ, surface);
    for section in [biquad(90.0, 0.97, 0.96), biquad(400.0, 0.9, 0.93)] {
        scene.equaliser.push(section).expect("room");
    }
    scene
}

/// Number of blocks until no stage is left, at most `limit`.
fn blocks_to_silence(player: &mut stylus_kernel::scene::ScenePlayer<'_>, limit: usize) -> Option<usize> {
    (0..limit).find(|_| {
        let played = block(player, lifted());
        player.block().stages().is_empty() && peak(&played) == 0.0
    })
}

/// Contact and lift alternate, 200 and 250 times per second, for two seconds.
#[test]
fn contact_that_bounces_stays_within_bounds_and_ends_in_silence() {
    let bytes = scene_library(&[]);
    // In blocks of 2 ms: contact in two of five, and in one of two.
    for touches_at in [|n: u32| n * 2 % 5 < 2, |n: u32| n.is_multiple_of(2)] {
        let mut player = player(&bytes, &busy(), 13);
        let mut highest: f64 = 0.0;
        for n in 0..1000u32 {
            // Each contact comes with 500 N/s, which would exceed the limit.
            let interaction = if touches_at(n) {
                at(n as f32 * 0.1, motion(80.0, 1.0))
            } else {
                lifted()
            };
            highest = highest.max(peak(&block(&mut player, interaction)));
        }
        // The texture's 2 m/s² and the tap's 20, each times the equaliser's gain.
        assert!(highest > 10.0 && highest < 60.0, "{highest}");
        assert_eq!(player.saturations(), 0);
        assert!(blocks_to_silence(&mut player, 2000).is_some());
    }
}

#[test]
fn motion_that_stops_dead_is_silent_a_block_later_and_rings_out() {
    let bytes = scene_library(&[]);
    for scene in [side_by_side(&[2, 3], 5.0), busy()] {
        let mut player = player(&bytes, &scene, 17);
        let mut sounding = 0.0f64;
        for n in 0..100 {
            sounding = sounding.max(peak(&block(&mut player, at(n as f32, moving()))));
        }
        assert!(sounding > 1.0);
        let stopped = at(99.0, motion(0.0, 0.75));
        block(&mut player, stopped);
        let rings = !scene.equaliser.is_empty();
        let quiet = (0..2000).find(|_| peak(&block(&mut player, stopped)) == 0.0);
        assert!(quiet.is_some_and(|blocks| rings || blocks == 0), "{quiet:?}");
        for _ in 0..20 {
            assert_eq!(peak(&block(&mut player, stopped)), 0.0);
        }
    }
}

fn any_scene() -> impl Strategy<Value = Scene> {
    let surface = (
        prop_oneof![4 => (0u8..4).prop_map(Some), 1 => Just(None)],
        prop_oneof![4 => 0.0f32..=1.0, 1 => Just(0.0)],
        prop::option::of((20.0f32..2000.0, 0.001f32..0.05)),
        prop::option::of((0.1f32..10.0, 0.05f32..1.0, 0.0f32..=1.0)),
    )
        .prop_map(|(texture, gain, tapped, sticking)| Surface {
            texture,
            gain,
            tap: tapped.map(|(hz, decay)| tap(hz, decay)),
            stick_slip: sticking
                .filter(|_| texture.is_some())
                .map(|(period_mm, duty, depth)| StickSlip {
                    period_mm,
                    duty,
                    depth,
                    below_mm_s: 80.0,
                    above_n: 0.2,
                }),
        });
    let stretch = (prop_oneof![2 => Just(0.0f32), 1 => 0.0f32..3.0], 0.05f32..20.0);
    let section = (5.0f64..2000.0, 0.5f64..0.98, -0.02f64..0.02);
    (
        vec(surface, 1..=16),
        vec(stretch, 0..32),
        0.0f32..10.0,
        vec(section, 0..3),
    )
        .prop_map(|(surfaces, stretches, transition_mm, sections)| {
            let mut scene = Scene::of_surface(name("any"), SAMPLE_RATE_HZ, surfaces[0].clone());
            scene.surfaces = surfaces.into_iter().collect();
            scene.transition_mm = transition_mm;
            let mut end_mm = 0.0;
            for (index, (gap, length)) in stretches.into_iter().enumerate() {
                let start_mm = end_mm + gap;
                end_mm = start_mm + length;
                let surface = (index * 7 % scene.surfaces.len()) as u8;
                add_region(&mut scene, [start_mm, end_mm], surface);
            }
            for (hz, radius, more) in sections {
                let section = biquad(hz, radius, radius + more);
                scene.equaliser.push(section).expect("few sections");
            }
            scene
        })
}

/// Strokes, jumps, bounces and stops.
fn any_interactions() -> impl Strategy<Value = Vec<Interaction>> {
    let place = prop_oneof![3 => 0.0f32..200.0, 1 => -1e4f32..1e4];
    let stroke = (
        place,
        -0.5f32..0.5,
        0.0f32..200.0,
        0.0f32..2.0,
        1usize..20,
        any::<bool>(),
    );
    vec(stroke, 1..25).prop_map(|strokes| {
        let mut all = Vec::new();
        for (place, step, speed, force, blocks, touches) in strokes {
            for n in 0..blocks {
                let motion: Motion = motion(speed, force);
                let position = place + step * n as f32;
                all.push(Interaction::new(motion, position, touches).expect("finite"));
            }
        }
        all
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn no_scene_and_no_hand_breaks_a_promise(
        scene in any_scene(), second in any_scene(), interactions in any_interactions(), seed: u64,
    ) {
        let bytes = scene_library(&[]);
        // Two voices of at most 2 m/s² RMS and 8 deviations, the taps' limit, and the equaliser's largest gain.
        let equalised = !(scene.equaliser.is_empty() && second.equaliser.is_empty());
        let bound = (2.0 * 16.0 + 20.0) * if equalised { 40.0 } else { 1.0 };
        let mut player = player(&bytes, &scene, seed);
        let cost = plan(&bytes, &scene).worst_case();
        let switch_at = interactions.len() / 2;
        for (n, &interaction) in interactions.iter().enumerate() {
            if n == switch_at {
                player.switch(plan(&bytes, &second));
            }
            let samples = block(&mut player, interaction);
            prop_assert!(peak(&samples) <= bound);
            let stages = player.block().stages();
            prop_assert!(stages.iter().filter(|stage| stage.voice().is_some()).count() <= SLOTS);
            if n < switch_at {
                // The worst case has a term for each stage and one for the sum, but two terms for a voice that sticks.
                prop_assert!(stages.len() < cost.terms().len());
            }
        }
        prop_assert_eq!(player.saturations(), 0);
        prop_assert!(blocks_to_silence(&mut player, 4000).is_some());
        for _ in 0..3 {
            prop_assert_eq!(peak(&block(&mut player, lifted())), 0.0);
        }
    }
}

/// A jump to a third surface waits for a slot, at most two blocks, and never uses a third voice.
#[test]
fn jumps_between_sixteen_surfaces_are_followed_within_three_blocks() {
    let bytes = scene_library(&[]);
    let scene = side_by_side(&[0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3, 0, 1, 2, 3], 5.0);
    let mut player = player(&bytes, &scene, 21);
    for n in 0..500u32 {
        let place = 100.0 * f32::from((n * 7 % 16) as u8) + 50.0;
        for _ in 0..3 {
            block(&mut player, at(place, moving()));
            assert!(player.block().stages().len() <= SLOTS);
        }
        let last = block(&mut player, at(place, moving()));
        assert_eq!(player.block().stages().len(), 1, "jump {n}");
        assert!(peak(&last) > 0.0);
    }
    assert_eq!(player.saturations(), 0);
}
