//! Fed textures in scenes: slots, transitions, changes of plans.

use model_format::{PartsSpec, TextureSpec, encode_with_scenes};
use stylus_kernel::arithmetic::Portable;
use stylus_kernel::feed::{Feed, Material};
use stylus_kernel::grid::GridPoint;
use stylus_kernel::lattice::LatticeState;
use stylus_kernel::scene::ScenePlayer;
use stylus_kernel::{Frame, Levels, Playback};

use crate::fed::{all_parts, alternating, bare, bare_of, decibels, encoded, fed_h3, mean_square};
use crate::models::{at, block, lifted, motion, moving, plan, resonant, side_by_side, texture};

/// A plain texture, and fed ones that differ in their parts.
fn textures() -> Vec<TextureSpec> {
    let parts = all_parts().into_iter().enumerate();
    let fed = parts.map(|(number, parts)| TextureSpec {
        name: format!("fed {number}"),
        ..fed_h3(parts)
    });
    std::iter::once(resonant("plain", 110.0)).chain(fed).collect()
}

pub fn library() -> Vec<u8> {
    encode_with_scenes(&textures(), &[]).expect("valid textures")
}

/// Tests every pair of parts: both voices in a transition, each alone far from it, and the way back. The two voices
/// have their own noise and their own random choices.
#[test]
fn two_fed_voices_sound_on_a_transition_each_at_its_share() {
    let bytes = library();
    for [one, other] in [[1, 2], [2, 1]] {
        let scene = side_by_side(&[one, other], 40.0);
        let mut player: ScenePlayer<'_> = ScenePlayer::new(plan(&bytes, &scene), 5);
        block(&mut player, at(50.0, moving()));
        let mut power = [0.0; 3];
        for (place_mm, power) in [50.0, 100.0, 150.0].into_iter().zip(&mut power) {
            for _ in 0..100 {
                block(&mut player, at(place_mm, moving()));
            }
            let mut samples = Vec::new();
            for _ in 0..10_000 {
                samples.extend(block(&mut player, at(place_mm, moving())));
            }
            *power = decibels(mean_square(&samples) / 4.0);
        }
        // In the middle of the transition each voice has half its power. The powers add up if the voices are
        // independent.
        assert!(power[0].abs() < 1.2 && power[2].abs() < 1.2, "{power:?}");
        assert!(power[1].abs() < 1.0, "{power:?}");
        assert_eq!(player.saturations(), 0);
    }
}

/// Changes repeatedly between plans with fed textures and one without: no sample is at full scale or louder than the
/// textures, and the same seed repeats every sample.
#[test]
fn plans_with_and_without_feeds_are_exchanged_without_a_click() {
    let bytes = library();
    let run = |seed| {
        let scene = |index: u8| side_by_side(&[index], 0.0);
        let mut player: ScenePlayer<'_> = ScenePlayer::new(plan(&bytes, &scene(0)), seed);
        let mut samples = Vec::new();
        for round in 0..60u16 {
            player.switch(plan(&bytes, &scene((round * 7 % 3) as u8)));
            for n in 0..60 {
                let interaction = if n == 30 { lifted() } else { at(50.0, moving()) };
                samples.extend(block(&mut player, interaction));
            }
        }
        assert_eq!(player.saturations(), 0);
        samples
    };
    let samples = run(1);
    assert_eq!(samples, run(1));
    assert_ne!(samples, run(2));
    let loudest = samples.iter();
    let loudest = loudest.fold(0.0, |loudest: f64, x| loudest.max(x.abs()));
    assert!(loudest > 4.0 && loudest < 200.0, "{loudest}");
}

/// The Gaussian noise of a seed is used only once, whichever texture uses it.
#[test]
fn noise_goes_on_from_a_plain_texture_through_a_fed_one_to_a_plain_one() {
    let plain = encoded(bare(PartsSpec::default()));
    // The node of the motion has no codebook.
    let fed = bare_of(vec![alternating([0; 16])], [0, 0, 0, 1]);
    let slow = || motion(50.0, 0.5);
    let (plain, fed) = (texture(&plain), texture(&fed));
    let play = |playback: &mut Playback, texture, feed: Option<&mut Feed>| {
        let mut frame = Frame::silent(&texture);
        frame.update::<Portable>(&texture, slow(), Levels::SILENT, 1);
        if let Some(feed) = feed {
            frame.feed(feed, &texture, slow(), 10);
        }
        playback.begin_frame(10);
        [(); 10].map(|()| playback.next_sample::<Portable>(&frame).0)
    };
    let mut feed = Feed::new(9);
    let mut playback = Playback::new(&plain, 9);
    let before = play(&mut playback, plain, None);
    playback.restart(&fed, &mut feed);
    play(&mut playback, fed, Some(&mut feed));
    playback.restart(&plain, &mut feed);
    let after = play(&mut playback, plain, None);
    let mut without = Playback::new(&plain, 9);
    let expected = [(); 3].map(|()| play(&mut without, plain, None));
    assert_eq!([before, after], [expected[0], expected[2]]);
}

/// Sample rates at which a snippet has only a few samples, and the highest rate.
#[test]
fn a_feed_suits_every_sample_rate() {
    for rate in [1, 13, 199, 1000, 8000, 48_000] {
        let bytes = encoded(TextureSpec {
            sample_rate_hz: rate,
            ..bare(all_parts()[1].clone())
        });
        let texture = texture(&bytes);
        let (material, point) = (Material::of(&texture), GridPoint::locate(&texture, moving()));
        let mut feed = Feed::new(1);
        let samples: Vec<f64> = (0..400_000)
            .map(|_| f64::from(feed.next_sample(&material, &point)) / crate::fed::SIGMA)
            .collect();
        let level_db = decibels(mean_square(&samples));
        assert!(level_db.abs() < 1.0, "{rate} Hz: {level_db} dB");
    }
}

#[test]
fn a_fed_lattice_begins_in_the_state_of_the_plain_one_in_coarser_steps() {
    let mut sources = [(); 2].map(|()| stylus_kernel::excitation::Excitation::new(3));
    let [plain, fed] = &mut sources;
    let plain = LatticeState::stationary(400, plain);
    let fed = LatticeState::fed_stationary(400, fed);
    for (&plain, &fed) in plain.backward(400).iter().zip(fed.backward(400)) {
        assert!((plain - 8 * fed).abs() <= 4);
    }
}
