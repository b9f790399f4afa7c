//! Decodes arbitrary bytes. They must be refused with a typed error, or be a library that can be read, written again
//! byte for byte, and played.
//!
//! Each input is tried both as it is and with a prefix that fits it, because no fuzzer guesses a checksum.
use crc::{CRC_32_ISO_HDLC, Crc};
use model_format::scene::Scene;
use model_format::{FORMAT_VERSION, Library, MillimetresPerSecond, Newton, Texture, encode_with_scenes};
use stylus_kernel::position::Position;
use stylus_kernel::scene::{Interaction, Plan, ScenePlayer};
use stylus_kernel::{Motion, Synthesis, UPDATE_INTERVAL_SAMPLES};

#[path = "../../../model-format/tests/library/walk.rs"]
mod walk;

/// Checks `input` as a library.
pub fn judge(input: &[u8]) {
    judge_whole(input);
    if let Some(library) = with_fitting_prefix(input) {
        judge_whole(&library);
    }
}

/// Returns `input` with the right magic, version, reserved field, length and checksum.
fn with_fitting_prefix(input: &[u8]) -> Option<Vec<u8>> {
    const PREFIX_BYTES: usize = 16;
    let mut bytes = b"HTXL".to_vec();
    bytes.extend(FORMAT_VERSION.to_le_bytes());
    bytes.extend([0; 2]);
    bytes.extend((input.len() as u32).to_le_bytes());
    let body = input.get(PREFIX_BYTES..)?;
    let crc = Crc::<u32>::new(&CRC_32_ISO_HDLC);
    let mut digest = crc.digest();
    digest.update(&bytes);
    digest.update(body);
    bytes.extend(digest.finalize().to_le_bytes());
    bytes.extend(body);
    Some(bytes)
}

fn judge_whole(bytes: &[u8]) {
    match Library::decode(bytes) {
        Ok(library) => {
            let (content, scenes) = (walk::content(&library), walk::scenes(&library));
            let again = encode_with_scenes(&content, &scenes).expect("what was read from a library makes one");
            assert_eq!(again, bytes, "a library has one encoding");
            library.textures().for_each(play);
            scenes.iter().for_each(|scene| play_scene(scene, &library));
        }
        Err(error) => assert!(error.to_string().starts_with(&error.place.to_string())),
    }
}

/// Moves over the texture's grid, beyond it, and to rest, where it must be silent.
fn play(texture: Texture<'_>) {
    let (speeds, forces) = (texture.speed_axis(), texture.force_axis());
    let last = (speeds.value(speeds.len() - 1), forces.value(forces.len() - 1));
    let mut synthesis: Synthesis<'_> = Synthesis::new(texture, 1);
    for (speed, force) in [
        (speeds.value(0) / 2.0, forces.value(0)),
        (last.0 / 2.0, last.1 / 2.0),
        last,
        (-f32::MAX, f32::MAX),
    ] {
        let motion = Motion::new(MillimetresPerSecond(speed), Newton(force)).expect("axes are finite");
        // First the position follows from the speed, then it jumps to places that no hand reaches within a block.
        for position in [None, Some(0.3), Some(f32::MAX), Some(-1.0e9), None] {
            let position = position.map(Position::from_mm);
            synthesis.follow_to(motion, position, UPDATE_INTERVAL_SAMPLES);
            for _ in 1..UPDATE_INTERVAL_SAMPLES {
                synthesis.next_sample();
            }
        }
    }
    synthesis.follow(Motion::REST, 1);
    assert_eq!(synthesis.next_sample().0, 0);
}

/// Strikes each region, moves to its middle, and lifts. The voices must have ended two blocks later.
fn play_scene(scene: &Scene, library: &Library<'_>) {
    let plan = Plan::new(scene, library).expect("it is in a valid library");
    let mut player: ScenePlayer<'_> = ScenePlayer::new(plan, 1);
    let mut block = |interaction: Interaction| {
        player.follow(interaction, UPDATE_INTERVAL_SAMPLES);
        for _ in 0..UPDATE_INTERVAL_SAMPLES {
            player.next_sample();
        }
        player
            .block()
            .stages()
            .iter()
            .filter(|stage| stage.voice().is_some())
            .count()
    };
    let motion = Motion::new(MillimetresPerSecond(50.0), Newton(1.0)).expect("finite");
    block(Interaction::NONE);
    for region in &scene.regions {
        let middle = region.start_mm + 0.5 * (region.end_mm - region.start_mm);
        for place in [region.start_mm, middle] {
            block(Interaction::new(motion, place, true).expect("places are finite"));
        }
        block(Interaction::NONE);
        assert_eq!(block(Interaction::NONE), 0);
    }
}
