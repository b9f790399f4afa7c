//! Scenes: every valid scene is unchanged after encoding and decoding, and each fault is reported with its place and
//! its numbers.

use std::f64::consts::PI;

use model_format::scene::limits::{
    MAX_EQUALISER_GAIN, MAX_POLE_RADIUS_1024THS, MAX_REGIONS, MAX_SCENES, MAX_SECTIONS, MAX_SURFACES,
};
use model_format::scene::{
    Biquad, MotionOfScene, Region, Scene, SceneError, SceneName, ScenePlace, SceneProblem, StickSlip, Surface, Tap,
    check_equaliser,
};
use model_format::{DecodeError, Library, Place, Problem, SAMPLE_RATE_HZ, encode_with_scenes};
use proptest::collection::vec;
use proptest::prelude::*;

use crate::bytes::RawLibrary;
use crate::walk::{content, scenes};

fn name(text: &str) -> SceneName {
    SceneName::try_from(text).expect("a short name")
}

fn sound() -> Vec<u8> {
    RawLibrary::sound().bytes()
}

/// The fault of the scene "full" with one change. Checking the scene by itself and as part of a library must give the
/// same fault.
fn fault(spoil: impl FnOnce(&mut Scene)) -> SceneError {
    let bytes = RawLibrary::full().bytes();
    let library = Library::decode(&bytes).expect("a valid library");
    let mut scene = library.scene("full").expect("it is there");
    assert_eq!(scene.validate(&library), Ok(()));
    spoil(&mut scene);
    let error = scene.validate(&library).expect_err("a fault");
    let refused = encode_with_scenes(&content(&library), &[scene]).expect_err("a fault");
    assert_eq!(refused.place, Place::Scene(0));
    assert_eq!(refused.to_string(), format!("scene 0: {error}"));
    error
}

/// Checks that the scene "full" with one change is refused with a message that begins with `begin`.
fn tells(spoil: impl FnOnce(&mut Scene), begin: &str) {
    let message = fault(spoil).to_string();
    assert!(message.starts_with(begin), "'{message}' is not '{begin}'");
}

fn tap(scene: &mut Scene) -> &mut Tap {
    scene.surfaces[0].tap.as_mut().expect("there is one")
}

fn slip(scene: &mut Scene) -> &mut StickSlip {
    scene.surfaces[0].stick_slip.as_mut().expect("there is one")
}

type Set = fn(&mut Scene, f32);

/// A number of a scene: its setter, its name, and the lowest and highest value that it may have in the scene "full".
type Field = (Set, &'static str, f32, f32);

/// Every number of a scene, by its place.
const FIELDS: [(ScenePlace, &[Field]); 7] = [
    (
        ScenePlace::Scene,
        &[(|s, x| s.transition_mm = x, "transition", 0.0, 100.0)],
    ),
    (
        ScenePlace::Surface(0),
        &[(|s, x| s.surfaces[0].gain = x, "gain", 0.0, 64.0)],
    ),
    (
        ScenePlace::Tap(0),
        &[
            (|s, x| tap(s).frequency_hz = x, "frequency", 10.0, 2250.0),
            (|s, x| tap(s).decay_s = x, "decay", 0.0005, 1.0),
            (|s, x| tap(s).gain_m_s2_per_n_s = x, "gain", 0.0, 100.0),
            (|s, x| tap(s).limit_m_s2 = x, "limit", 0.0, 256.0),
        ],
    ),
    (
        ScenePlace::StickSlip(0),
        &[
            (|s, x| slip(s).period_mm = x, "period", 0.01, 1000.0),
            (|s, x| slip(s).duty = x, "duty", 0.05, 1.0),
            (|s, x| slip(s).depth = x, "depth", 0.0, 1.0),
            (|s, x| slip(s).below_mm_s = x, "below", 0.001, 1e4),
            (|s, x| slip(s).above_n = x, "above", 0.001, 1000.0),
        ],
    ),
    (
        ScenePlace::Region(0),
        &[(|s, x| s.regions[0].start_mm = x, "start", -1e5, 19.0)],
    ),
    (
        ScenePlace::Region(1),
        &[(|s, x| s.regions[1].end_mm = x, "end", 21.0, 1e5)],
    ),
    (
        ScenePlace::Motion,
        &[
            (|s, x| s.motion = constant(x, 1.0), "speed", 0.0, 1e4),
            (|s, x| s.motion = constant(1.0, x), "force", 0.0, 1000.0),
        ],
    ),
];

#[test]
fn numbers_must_be_finite_and_within_their_ranges() {
    let bytes = RawLibrary::full().bytes();
    let library = Library::decode(&bytes).expect("a valid library");
    let scene = library.scene("full").expect("it is there");
    let fields = FIELDS.iter();
    for (place, (set, field, lowest, highest)) in
        fields.flat_map(|(place, fields)| fields.iter().map(move |field| (place, field)))
    {
        for value in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, -1e9, 1e9] {
            let told = format!("{place}: {field} is {value} ");
            assert_eq!(fault(|scene| set(scene, value)).place, *place);
            tells(|scene| set(scene, value), &told);
        }
        for value in [*lowest, *highest] {
            let mut scene = scene.clone();
            if *field == "gain" {
                scene.surfaces[0].texture = None;
                scene.surfaces[0].stick_slip = None;
            }
            set(&mut scene, value);
            assert_eq!(scene.validate(&library), Ok(()), "{field} {value}");
        }
    }
}

fn constant(speed_mm_s: f32, force_n: f32) -> MotionOfScene {
    MotionOfScene::Constant { speed_mm_s, force_n }
}

#[test]
fn each_fault_is_told_with_its_place_and_its_numbers() {
    tells(|s| s.name.clear(), "scene: the name is empty");
    tells(|s| s.name = name("a\nb"), "scene: a name with a control");
    tells(|s| s.surfaces.clear(), "scene: no surface");
    tells(|s| s.sample_rate_hz = 0, "scene: a sample rate of 0 Hz");
    tells(|s| s.sample_rate_hz = 48_001, "scene: a sample rate of 480");
    let told = "surface 0: its texture is for 5000 Hz and the scene for 4000 Hz";
    tells(|s| s.sample_rate_hz = 4000, told);
    let told = "surface 0: texture 5 is not there: the library has 4";
    tells(|s| s.surfaces[0].texture = Some(5), told);
    let told = "surface 0, stick-slip: stick-slip modulates a texture, and the surface has none";
    tells(|s| s.surfaces[0].texture = None, told);
    let told = "region 1: surface 2 is not there: the scene has 2";
    tells(|s| s.regions[1].surface = 2, told);
    let told = "region 1: it begins at 19.5 mm, before region 0 ends at 20 mm";
    tells(|s| s.regions[1].start_mm = 19.5, told);
    let told = "region 1: it begins at -10 mm, before region 0 ends at 50 mm";
    tells(|s| s.regions.swap(0, 1), told);
    let told = "region 0: it ends at -10 mm, which is not beyond its beginning at -10 mm";
    tells(|s| s.regions[0].end_mm = -10.0, told);
    let told = "equaliser, section 0: a pole lies beyond a radius of 1023/1024";
    tells(|s| s.equaliser[0].denominator = [-(2 << 28), 1 << 28], told);
}

/// The loudest node has a power of 4 (m/s²)², an RMS of 2 m/s². A gain of 64 raises it to 128 m/s², the highest value
/// allowed.
#[test]
fn a_gain_above_one_must_leave_its_texture_room() {
    let bytes = RawLibrary::full().bytes();
    let library = Library::decode(&bytes).expect("a valid library");
    let mut scene = library.scene("plain").expect("it is there");
    scene.surfaces[0].gain = 64.0;
    assert_eq!(scene.validate(&library), Ok(()));
    let mut loud = RawLibrary::sound();
    for node in &mut loud.textures[0].nodes[2..] {
        node.output_power = 1000.0;
    }
    let bytes = loud.bytes();
    let library = Library::decode(&bytes).expect("a valid library");
    let highest = 4.0;
    scene.surfaces[0].gain = highest;
    assert_eq!(scene.validate(&library), Ok(()));
    scene.surfaces[0].gain = 4.001;
    let error = scene.validate(&library).expect_err("too loud");
    let problem = SceneProblem::TooLoud { gain: 4.001, highest };
    assert_eq!(error.place, ScenePlace::Surface(0));
    assert_eq!(error.problem, problem);
}

#[test]
fn names_are_unique_and_scenes_are_few() {
    let bytes = RawLibrary::full().bytes();
    let library = Library::decode(&bytes).expect("a valid library");
    let (textures, mut all) = (content(&library), scenes(&library));
    all.push(all[0].clone());
    let error = encode_with_scenes(&textures, &all).expect_err("twice the same");
    let (place, problem) = (Place::Scene(2), Problem::Taken { what: "name", other: 0 });
    assert_eq!(error, DecodeError { place, problem });
    let many = |count: usize| -> Vec<Scene> {
        let numbered = |number: usize| Scene {
            name: name(&number.to_string()),
            ..all[0].clone()
        };
        (0..count).map(numbered).collect()
    };
    assert!(encode_with_scenes(&textures, &many(MAX_SCENES)).is_ok());
    let error = encode_with_scenes(&textures, &many(MAX_SCENES + 1)).expect_err("one too many");
    assert!(error.to_string().contains("the number of scenes is 33"));
}

/// A record must contain exactly one scene, and the number of scenes is checked before any scene.
#[test]
fn a_record_is_one_scene_and_no_more() {
    for spoil in [
        (|record: &mut Vec<u8>| record.push(0)) as fn(&mut Vec<u8>),
        |record| record.truncate(record.len() - 1),
        Vec::clear,
        |record| record[0] = 49,
    ] {
        let mut library = RawLibrary::full();
        spoil(&mut library.scenes[1]);
        let error = Library::decode(&library.bytes()).expect_err("no scene");
        let (place, problem) = (Place::Scene(1), Problem::Malformed("its record"));
        assert_eq!(error, DecodeError { place, problem });
    }
    let mut library = RawLibrary::full();
    library.scene_count = Some(33);
    let error = Library::decode(&library.bytes()).expect_err("too many");
    assert!(error.to_string().contains("the number of scenes is 33"));
}

#[test]
fn jurys_triangle_is_the_radius_of_the_poles() {
    const LIMIT: f64 = MAX_POLE_RADIUS_1024THS as f64 / 1024.0;
    for (radius, within) in [(LIMIT - 1e-5, true), (LIMIT + 1e-5, false), (1.0, false), (1.2, false)] {
        for step in 0..=24 {
            let angle = PI * f64::from(step) / 24.0;
            let denominator = [-2.0 * radius * angle.cos(), radius * radius];
            let biquad = Biquad::from_f64([1.0, 0.0, 0.0], denominator).expect("in range");
            // Coefficients are rounded, and a double pole on the real axis moves by the square root of the rounding
            // error.
            let split = angle.sin() < 1e-6 && (radius - LIMIT).abs() < 1e-4;
            assert!(
                split || biquad.poles_are_within_limit() == within,
                "{radius} at {angle}"
            );
        }
        for other in [-0.9, 0.0, 0.5] {
            for pole in [radius, -radius] {
                let denominator = [-(pole + other), pole * other];
                let biquad = Biquad::from_f64([1.0, 0.0, 0.0], denominator).expect("in range");
                assert_eq!(biquad.poles_are_within_limit(), within, "{pole} and {other}");
            }
        }
    }
}

/// Gain of a section at the cosine of a frequency, by its transfer function.
fn gain_at(section: &Biquad, cosine: f64) -> f64 {
    let [a1, a2] = section.denominator();
    gain_of(section.numerator(), [1.0, a1, a2], cosine)
}

fn gain_of(numerator: [f64; 3], denominator: [f64; 3], cosine: f64) -> f64 {
    let square = |[c0, c1, c2]: [f64; 3]| {
        let real = (c0 + c2) * cosine + c1;
        real * real + (c0 - c2) * (c0 - c2) * (1.0 - cosine * cosine)
    };
    (square(numerator) / square(denominator)).sqrt()
}

/// Notches at a resonance hide the amplification by later sections at frequencies near the resonance.
#[test]
fn a_peak_beside_a_notch_is_found() {
    let (radius, cosine) = (1022.9 / 1024.0, 0.974_66);
    let a2 = radius * radius;
    let denominator = [-4.0 * a2 * cosine / (1.0 + a2), a2];
    let resonant = |gain: f64| {
        let one = Biquad::from_f64([1.0, 0.0, 0.0], denominator).expect("in range");
        let peak = gain / gain_at(&one, cosine);
        Biquad::from_f64([peak, 0.0, 0.0], denominator).expect("in range")
    };
    let notch = Biquad::from_f64([1.0, -2.0 * cosine, 1.0], denominator).expect("in range");
    let hidden = [
        notch,
        notch,
        resonant(15.9),
        resonant(15.9),
        resonant(15.9),
        resonant(15.9),
    ];
    let beside: f64 = hidden.iter().map(|s| gain_at(s, cosine + 0.000_2)).product();
    assert!(beside > 1000.0, "{beside}");
    let found = fault(|scene| scene.equaliser = hidden.iter().copied().collect());
    assert_eq!(found.problem, SceneProblem::EqualiserGain);
    #[cfg(feature = "link")]
    {
        use model_format::link::{RESPONSE_BYTES, Response, ResponseError, Sections, Settings};
        let mut response = Response::from_bytes(&[0; RESPONSE_BYTES]);
        response.sections_5khz = Sections::new(&hidden).expect("room");
        let checked = response.check(&Settings::default());
        let is_refused = matches!(checked, Err(ResponseError::Gain { rate_hz: 5000, .. }));
        assert!(is_refused, "{checked:?}");
    }
    // Up to the limit of gain, nothing is refused, however narrow a peak or a notch is.
    for sections in [
        &[resonant(15.99)][..],
        &[notch],
        &[notch, notch, resonant(15.99), notch, notch],
        &[Biquad::from_f64([4.0, 0.0, 0.0], [0.0; 2]).expect("in range"); 2],
        &[Biquad::IDENTITY; 6],
    ] {
        assert_eq!(check_equaliser(sections), Ok(()), "{sections:?}");
    }
}

#[test]
fn an_equaliser_with_too_much_gain_is_refused_where_it_gets_too_much() {
    let flat = |gain: f64| Biquad::from_f64([gain, 0.0, 0.0], [0.0, 0.0]).expect("in range");
    for (gains, section) in [
        (vec![4.0, 4.0], None),
        (vec![4.0, 4.0, 1.01], Some(2)),
        // A later section with a low gain does not help, because the signal before it saturates.
        (vec![7.0, 7.0, 0.1], Some(1)),
    ] {
        let set = |scene: &mut Scene| scene.equaliser = gains.iter().copied().map(flat).collect();
        if let Some(section) = section {
            let error = fault(set);
            let place = ScenePlace::Section(section);
            assert_eq!(error.place, place);
            assert_eq!(error.problem, SceneProblem::EqualiserGain);
        } else {
            let bytes = RawLibrary::full().bytes();
            let library = Library::decode(&bytes).expect("a valid library");
            let mut scene = library.scene("plain").expect("it is there");
            set(&mut scene);
            assert_eq!(scene.validate(&library), Ok(()));
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(512))]

    /// Sections with poles and zeros near the unit circle, also close to each other, whose gain is a little below or
    /// above the limit. The expected gain is computed at frequencies that are dense around all poles and zeros.
    #[test]
    fn no_peak_of_a_cascade_is_missed_and_none_is_invented(
        drawn in vec((0.9f64..0.999, 0.005f64..3.13, -0.05f64..0.05, 0.0f64..0.999, 0.3f64..3.0), 1..=MAX_SECTIONS),
        near in prop::option::of(0.005f64..3.13),
        excess in 0.9f64..1.1,
    ) {
        let place = |angle: f64| near.map_or(angle, |near| near + 0.02 * (angle - near));
        let mut cosines: Vec<f64> = (0..1000).map(|n| (f64::from(n) / 999.0 * PI).cos()).collect();
        for &(radius, angle, off, ..) in &drawn {
            let around = (-200..=200).map(|n| place(angle) + f64::from(n) / 20.0 * (1.0 - radius));
            cosines.extend(around.flat_map(|angle| [angle, angle + off]).map(f64::cos));
        }
        let pair = |radius: f64, angle: f64| [1.0, -2.0 * radius * angle.cos(), radius * radius];
        let mut sections: Vec<[[f64; 3]; 2]> = drawn.iter().map(|&(radius, angle, off, zeros, gain)| {
            let [above, below] = [pair(zeros, place(angle) + off), pair(radius, place(angle))];
            let peak = cosines.iter().map(|c| gain_of(above, below, *c)).fold(0.0, f64::max);
            [above.map(|b| b * gain / peak), below]
        }).collect();
        // The largest gain of any section, and of any cascade from the first section on.
        let highest = |sections: &[[[f64; 3]; 2]]| cosines.iter().map(|c| {
            sections.iter()
                .map(|[above, below]| gain_of(*above, *below, *c))
                .fold((1.0, 0.0), |(all, highest): (f64, f64), own| (all * own, highest.max(own).max(all * own)))
                .1
        }).fold(0.0, f64::max);
        let scale = excess * MAX_EQUALISER_GAIN / highest(&sections);
        sections[0][0] = sections[0][0].map(|b| b * scale);
        let found = highest(&sections) / MAX_EQUALISER_GAIN;
        prop_assume!((found - 1.005).abs() > 0.007);
        let stored = sections.iter()
            .map(|&[above, [_, a1, a2]]| Biquad::from_f64(above, [a1, a2]))
            .collect::<Option<Vec<Biquad>>>();
        prop_assume!(stored.is_some());
        let checked = check_equaliser(&stored.unwrap_or_default());
        prop_assert_eq!(checked.is_ok(), found < 1.0, "{}", found);
    }

    #[test]
    fn any_valid_scene_goes_through_a_library_unchanged(
        surfaces in vec((prop::option::of(0u8..3), 0.0f32..1.0, any::<bool>()), 1..=MAX_SURFACES),
        lengths in vec((0.0f32..3.0, 0.001f32..50.0, any::<prop::sample::Index>()), 0..=MAX_REGIONS),
        transition_mm in 0.0f32..=100.0,
        motion in prop::option::of((0.0f32..1000.0, 0.0f32..100.0)),
        text in "[a-zA-ZäöüßéÅ ]{1,24}",
    ) {
        let mut scene = Scene::of_surface(name(&text), SAMPLE_RATE_HZ, Surface::of_texture(0));
        scene.surfaces = surfaces.iter().map(|&(texture, gain, tapped)| Surface {
            texture,
            gain,
            tap: tapped.then_some(Tap {
                frequency_hz: 200.0,
                decay_s: 0.1,
                gain_m_s2_per_n_s: 1.0,
                limit_m_s2: 1.0,
            }),
            stick_slip: None,
        }).collect();
        let mut end_mm = -100.0;
        for (gap, length, surface) in lengths {
            let start_mm = end_mm + gap;
            end_mm = start_mm + length;
            let surface = surface.index(surfaces.len()) as u8;
            scene.regions.push(Region { start_mm, end_mm, surface }).expect("not too many");
        }
        scene.transition_mm = transition_mm;
        if let Some((speed, force)) = motion {
            scene.motion = constant(speed, force);
        }
        let bytes = sound();
        let textures = content(&Library::decode(&bytes).expect("a valid library"));
        let with = encode_with_scenes(&textures, std::slice::from_ref(&scene)).expect("a valid scene");
        let library = Library::decode(&with).expect("encode checks what it gives");
        prop_assert_eq!(scenes(&library), vec![scene]);
        prop_assert_eq!(content(&library), textures);
    }
}
