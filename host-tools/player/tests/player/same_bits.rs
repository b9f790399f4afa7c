//! At the rate of the texture, a player without a DC blocker outputs the same bits as `stylus render`.

use host_tools::playing::motion::{MotionPath, MotionRow};
use host_tools::playing::render::{Rendering, SampleClock};
use proptest::prelude::*;
use stylus_player::{BlockMotion, Selection, Without, plan_of, player_as_rendered};

use crate::LIBRARIES;

/// Motions of a hand, slow and fast, light and heavy, that stay for a while; in single precision, like those of a file.
fn motions() -> impl Strategy<Value = Vec<BlockMotion>> {
    let speed = prop_oneof![5 => -400.0..400.0f32, 1 => Just(0.0), 1 => -1e-3..1e-3f32];
    let force = prop_oneof![5 => 0.0..4.0f32, 1 => Just(0.0), 1 => 0.0..0.03f32];
    let motion = (speed, force, -60.0..60.0f32, -2.0..2.0f32, any::<bool>()).prop_map(
        |(speed, force, begin_mm, way_mm, contact)| BlockMotion {
            begin_mm: f64::from(begin_mm),
            end_mm: f64::from(begin_mm + way_mm),
            contact: f64::from(u8::from(contact)),
            ..BlockMotion::new(f64::from(speed), f64::from(force))
        },
    );
    let held = prop::collection::vec((motion, 1usize..12), 1..12);
    (held, any::<bool>()).prop_map(|(held, tells_contact)| {
        let blocks = held
            .into_iter()
            .flat_map(|(motion, times)| std::iter::repeat_n(motion, times));
        let untold = |motion| BlockMotion {
            contact: f64::NAN,
            ..motion
        };
        let told = |motion| {
            if tells_contact { motion } else { untold(motion) }
        };
        blocks.map(told).collect()
    })
}

/// A motion whose rows are those of the blocks' first and last samples.
fn path_of(blocks: &[BlockMotion], rate_hz: u32) -> MotionPath {
    let clock = SampleClock::new(1.0, rate_hz).expect("it is long enough");
    let rows = blocks.iter().enumerate().flat_map(|(block, motion)| {
        let begin_s = (block * clock.block_samples() as usize) as f64 / f64::from(rate_hz);
        let row = |time_s, position_mm| MotionRow {
            time_s,
            speed_mm_s: motion.speed_mm_s,
            force_n: motion.force_n,
            position_mm: Some(position_mm),
            contact: (!motion.contact.is_nan()).then_some(motion.contact != 0.0),
        };
        [
            row(begin_s, motion.begin_mm),
            row(begin_s + clock.block_s(), motion.end_mm),
        ]
    });
    MotionPath::from_rows(rows).expect("a hand has such motions")
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]

    #[test]
    fn a_motion_told_block_by_block_gives_the_bits_of_render_however_the_samples_are_taken(
        is_fast in any::<bool>(),
        // All textures, and the scene.
        choice in 0..=15usize,
        without in 0u32..8,
        seed in any::<u64>(),
        blocks in motions(),
        splits in prop::collection::vec(1usize..20, 1..9),
    ) {
        let shared = &LIBRARIES[usize::from(is_fast)];
        let library = shared.library();
        let selection = if choice < library.len() { Selection::Texture(choice) } else { Selection::Scene(0) };
        let without = Without::of_bits(without);
        let plan = plan_of(&library, selection, without).expect("it is there");
        let rate_hz = plan.sample_rate_hz();
        let path = path_of(&blocks, rate_hz);
        let rendering = Rendering::of_plan(plan, &path, blocks.len() as f64 * 0.002, seed);
        let rendered: Vec<u32> = rendering.expect("it is short")
            .map(|word| word.metres_per_second_squared().0.to_bits())
            .collect();

        let (mover, mut filler) = player_as_rendered(rate_hz).expect("it is a rate of textures");
        mover.choose(shared, selection, without, seed).expect("it is there");
        let mut played = vec![0.0f32; rendered.len()];
        let mut splits = splits.into_iter().cycle();
        for (motion, mut block) in blocks.iter().zip(played.chunks_mut(rate_hz as usize / 500)) {
            mover.follow(*motion).expect("it is finite");
            while !block.is_empty() {
                let split = splits.next().unwrap_or(1).min(block.len());
                let (now, later) = block.split_at_mut(split);
                filler.fill(now);
                block = later;
            }
        }
        let played: Vec<u32> = played.into_iter().map(f32::to_bits).collect();
        prop_assert_eq!(played, rendered);
    }
}
