//! A library that takes much work to decode. Neither requests nor the watchdog may wait for that work.

use model_format::link::{PlayEndpoint, PlayError, UploadCommitEndpoint};
use model_format::scene::limits::{MAX_REGIONS, MAX_SCENES, MAX_SECTIONS, MAX_SURFACES};
use model_format::scene::{Biquad, Region, Scene, Surface, Tap};
use model_format::{CodeSpec, NodeFlags, NodeSpec, SAMPLE_RATE_HZ, TailSpec, TextureSpec, encode_with_scenes};
use postcard_rpc::Endpoint;

use crate::device::{Device, MS};
use crate::library;
use crate::requests::{announced, scene_request};

/// Longest time from a stop to an output at mid-scale.
const MUTE_NS: u64 = 100 * MS;

/// Longest time between two feeds of the watchdog, µs. The watchdog is fed every 20 ms and resets the part after 100
/// ms.
const MOST_GAP_US: u32 = 40_000;

/// Many nodes of a low order with fractions of θ, and the largest number of scenes, surfaces, taps and sections. The
/// library has about 100 KB.
fn hostile() -> Vec<u8> {
    let axis = || (1..=40u8).map(f32::from).collect::<Vec<_>>();
    let node = NodeSpec {
        output_power: 1.0,
        prediction_error_power: 0.5,
        flags: NodeFlags::NONE,
        codes: CodeSpec {
            codes: vec![-9000; 8],
            fractions: vec![7; 8],
            tail: TailSpec::default(),
        },
    };
    let texture = TextureSpec {
        speed_axis_mm_s: axis(),
        force_axis_n: axis(),
        nodes: vec![node; 40 * 40],
        ..fake_stylus::library::texture("many nodes", 1, 0, SAMPLE_RATE_HZ)
    };
    let tap = Tap {
        frequency_hz: 180.0,
        decay_s: 0.02,
        gain_m_s2_per_n_s: 1.0,
        limit_m_s2: 100.0,
    };
    let surface = Surface {
        tap: Some(tap),
        ..Surface::of_texture(0)
    };
    let section = |at: usize| {
        let cos = (0.2 + 0.3 * at as f64).cos();
        let numerator = [0.96, -1.92 * cos, 0.96];
        Biquad::from_f64(numerator, [-1.96 * cos, 0.9604]).expect("it is in range")
    };
    let scenes: Vec<Scene> = (0..MAX_SCENES)
        .map(|index| {
            let name = format!("scene {index}");
            let name = name.as_str().try_into().expect("it is short");
            let mut scene = Scene::of_surface(name, SAMPLE_RATE_HZ, surface.clone());
            scene.surfaces = core::iter::repeat_n(surface.clone(), MAX_SURFACES).collect();
            scene.equaliser = (0..MAX_SECTIONS).map(section).collect();
            let region = |at: usize| Region {
                start_mm: at as f32,
                end_mm: at as f32 + 1.0,
                surface: (at % MAX_SURFACES) as u8,
            };
            scene.regions = (0..MAX_REGIONS).map(region).collect();
            scene
        })
        .collect();
    encode_with_scenes(&[texture], &scenes).expect("within the limits")
}

#[test]
fn a_library_of_much_work_keeps_neither_the_watchdog_nor_a_stop_waiting() {
    let mut device = Device::started(library::options());
    device.move_at(120.0);
    device.play_until_heard("lattice");
    let hostile = hostile();
    let progress = device.begin_upload(&hostile);
    device.send_chunks(&hostile, progress, hostile.len());
    let before = device.status().marks;

    let commit = device.send_frame(UploadCommitEndpoint::REQ_KEY, &());
    // The commit has arrived by then, and the library is still being checked.
    device.run_for(6 * MS);
    let asked_ns = device.stylus.now_ns();
    device.stop();
    let committed = device.take_answer(UploadCommitEndpoint::RESP_KEY, commit);
    assert!(committed.is_none(), "the stop came after the commit");
    device.run_for(MUTE_NS + 200 * MS);
    assert!(device.sounds_from(0) > 0, "it was heard");
    assert_eq!(device.sounds_from(asked_ns + MUTE_NS), 0);

    device.run_for(500 * MS);
    let committed = device
        .take_answer(UploadCommitEndpoint::RESP_KEY, commit)
        .expect("it is committed by now");
    let committed: <UploadCommitEndpoint as Endpoint>::Response =
        postcard::from_bytes(&committed).expect("an answer of its type");
    let slot = committed.expect("a valid library").slot;
    let activated = device.activate(slot);
    assert_eq!(activated.library.crc32, announced(&hostile).crc32);
    // A scene with sixteen taps and eight sections is planned, and then accepted or refused because of its cost.
    let played = device.request::<PlayEndpoint>(&scene_request("scene 31", 1));
    let refused = played.err();
    assert!(
        matches!(refused, None | Some(PlayError::OverBudget { .. })),
        "{refused:?}"
    );
    let marks = device.status().marks;
    println!("before the commit {before:?}, in the end {marks:?}");
    assert!(
        (20_000..=MOST_GAP_US).contains(&marks.longest_watchdog_gap_us),
        "{marks:?}, before the commit {before:?}"
    );
}
