//! Scenes through the command, from their text to what the stylus plays.

use std::sync::OnceLock;

use crate::support::{Bench, RATE_HZ, holds, rig_of, scaled, two_textures};
use host_tools::dsp::sums::rms;
use model_format::Library;

/// A folder with a library of two textures at two speeds and forces. All tests share the library.
fn bench() -> Bench {
    static LIBRARY: OnceLock<Vec<u8>> = OnceLock::new();
    let library = LIBRARY.get_or_init(|| {
        let bench = two_textures(|signal| [scaled(signal, 3.0)]);
        bench.succeed("fit set --out cloths.lib");
        bench.read("cloths.lib")
    });
    let bench = Bench::new();
    bench.write("cloths.lib", library);
    bench
}

const TWO: &str = "\
# Two cloths.
name = \"two\"
transition_mm = 4

[[surface]]
texture = \"silk\"
gain = 0.5
[surface.tap]
frequency_hz = 240
decay_s = 0.012
gain_m_s2_per_n_s = 0.1
limit_m_s2 = 40

[[surface]]
name = \"sticky\"
texture = \"felt\"
[surface.stick_slip]
period_mm = 1.5
duty = 0.4
depth = 0.9
below_mm_s = 60
above_n = 0.5

[[region]]
surface = \"silk\"
start_mm = 0
end_mm = 40

[[region]]
surface = \"sticky\"
start_mm = 40
end_mm = 80

[[equaliser.section]]
kind = \"peaking\"
frequency_hz = 150
q = 2
gain_db = -6
";

const STROKE: &str = "time_s,speed_mm_s,force_n\n0,0,0\n0.1,0,0\n0.104,80,0.8\n1.0,80,0.8\n1.1,0,0\n1.6,0,0\n";

#[test]
fn a_scene_goes_into_a_library_and_plays_from_there_as_from_its_text() {
    let bench = bench();
    bench.write("two.toml", TWO);
    bench.write("stroke.csv", STROKE);
    let said = bench.succeed("scene check two.toml --library cloths.lib");
    holds(&said, &["on sticky, sticking"]);
    let compiled = bench.succeed("scene compile two.toml --library cloths.lib --out scenes.lib");
    holds(&compiled, &["2 textures, 1 scene"]);
    let content = bench.succeed("inspect scenes.lib");
    holds(&content, &["two", "silk, felt", "transitions", "equaliser"]);
    bench.succeed("scene render scenes.lib --scene two --motion stroke.csv --out a.wav");
    bench.succeed("scene render two.toml --library cloths.lib --motion stroke.csv --out b.wav");
    let (a, b) = (bench.samples("a.wav", RATE_HZ), bench.samples("b.wav", RATE_HZ));
    assert_eq!(a, b);
    assert!(a[..500].iter().all(|x| *x == 0.0), "before contact");
    assert!(a[600..5000].iter().any(|x| x.abs() > 0.1));
    assert!(a[7500..].iter().all(|x| *x == 0.0), "after the lift");
}

#[test]
fn joined_libraries_play_their_textures_and_scenes_as_each_did() {
    let bench = bench();
    bench.write("two.toml", TWO);
    bench.write("stroke.csv", STROKE);
    bench.succeed("scene compile two.toml --library cloths.lib --out scenes.lib");
    let render = "render cloths.lib --texture felt --speed 90 --force 0.7 --seconds 1";
    bench.succeed(&format!("{render} --out jute.wav"));
    bench.succeed("fit jute.wav --out jute.lib");
    let joined = bench.succeed("join jute.lib scenes.lib --out all.lib");
    holds(&joined, &["all.lib: 3 textures, 1 scene, "]);
    let joined = render.replace("cloths", "all");
    bench.succeed(&format!("{joined} --out felt.wav"));
    assert_eq!(bench.read("felt.wav"), bench.read("jute.wav"));
    for library in ["scenes", "all"] {
        let rendered = format!("{library}.lib --motion stroke.csv --out {library}.wav");
        bench.succeed(&format!("scene render {rendered}"));
    }
    assert_eq!(bench.read("all.wav"), bench.read("scenes.wav"));
    bench.refuse_each(
        "join cloths.lib scenes.lib --out x.lib | scenes.lib | 'silk', like cloths.lib
        page cloths.lib jute.lib --out x.html | stylus join",
    );
}

#[test]
fn a_scene_of_constant_motion_is_rendered_without_another_and_a_followed_one_asks_for_it() {
    let bench = bench();
    let steady = "name = \"steady\"\n[constant_motion]\nspeed_mm_s = 90\nforce_n = 0.7\n\
                  [[surface]]\ntexture = \"silk\"\n";
    bench.write("steady.toml", steady);
    let render = "scene render steady.toml --library cloths.lib";
    bench.succeed(&format!("{render} --seconds 1 --out alone.wav"));
    bench.succeed(&format!("{render} --speed 90 --force 0.7 --seconds 1 --out told.wav"));
    let alone = bench.samples("alone.wav", RATE_HZ);
    assert!(alone.len() == 5000 && alone.iter().any(|x| x.abs() > 0.1));
    assert_eq!(alone, bench.samples("told.wav", RATE_HZ));
    holds(&bench.refuse(&format!("{render} --out no.wav")), &["give --seconds"]);
    bench.write("two.toml", TWO);
    let still = bench.refuse("scene render two.toml --library cloths.lib --seconds 1 --out no.wav");
    holds(&still, &["give --motion CSV"]);
    assert!(!bench.path("no.wav").exists());
}

#[test]
fn compiling_replaces_scenes_of_the_same_name_and_leaves_all_else() {
    let bench = bench();
    bench.write("two.toml", TWO);
    let other = "name = \"other\"\n[[surface]]\ntexture = \"silk\"\n";
    bench.write("other.toml", other);
    bench.succeed("scene compile two.toml other.toml --library cloths.lib --out a.lib");
    bench.write("other.toml", format!("{other}gain = 0.25\n"));
    bench.succeed("scene compile other.toml --library a.lib --out b.lib");
    let read = |name: &str| bench.read(name);
    let (plain, a, b) = (read("cloths.lib"), read("a.lib"), read("b.lib"));
    let (a, b) = (Library::decode(&a).unwrap(), Library::decode(&b).unwrap());
    assert_eq!((a.scene_count(), b.scene_count()), (2, 2));
    assert_eq!(a.scene("two"), b.scene("two"));
    assert_eq!(b.scene("other").unwrap().surfaces[0].gain, 0.25);
    // With the scenes removed, the bytes are the same as before.
    let plain = Library::decode(&plain).unwrap();
    let again = host_tools::scene::with_scenes(&plain, &[]).unwrap();
    assert_eq!(again, read("cloths.lib"));
    let message = bench.refuse("scene compile two.toml two.toml --library cloths.lib --out c.lib");
    holds(&message, &["its scene is called 'two'"]);
    assert!(!bench.path("c.lib").exists());
}

/// The number of a line of [`TWO`], the text that replaces it, and the message about that text.
const FAULTS: &str = r#"
2 | nam = "two" | unknown field `nam`
3 | transition_mm = 1e40 | transition is inf mm
3 | transition_mm = "4" | invalid type: string
6 | texture = "satin" | no texture 'satin'; it has silk, felt
7 | gain = 60 | makes its texture too loud
8 | [surface.thump] | unknown field `thump`
9 | frequency_hz = 2400 | it must be finite and 10 to 2250
10 | decay_s = 0 | decay is 0 s
15 | name = "silk" | surface 1 is called 'silk' already
16 |  | stick-slip modulates a texture
19 | duty = 0 | duty is 0
25 | surface = "stick" | no surface 'stick'; it has silk, sticky
31 | start_mm = 39 | before the region in line 24 ends at 40 mm
32 | end_mm = 40 | it ends at 40 mm, which is not beyond
35 | kind = "notch" | unknown variant `notch`
36 | frequency_hz = 2 | a pole lies beyond
"#;

/// Checks that a scene with this text is refused with `problem` at `line`.
fn is_told(bench: &Bench, text: &str, line: usize, problem: &str) {
    bench.write("bad.toml", text);
    let message = bench.refuse("scene check bad.toml --library cloths.lib");
    holds(&message, &[problem]);
    let start = format!("stylus: bad.toml, line {line}: ");
    assert!(message.starts_with(&start), "{text}: {message}");
}

#[test]
fn what_is_wrong_with_a_scene_is_said_with_its_line() {
    let bench = bench();
    for row in FAULTS.trim().lines() {
        let row: Vec<&str> = row.split(" | ").collect();
        let [line, bad, problem]: [&str; 3] = row.try_into().expect("it has three cells");
        let line: usize = line.parse().expect("a number");
        let mut lines: Vec<&str> = TWO.lines().collect();
        lines[line - 1] = bad;
        // A missing texture is reported at the stick-slip that needs it, and an unstable pole at its section.
        let told = match bad {
            "" => 17,
            "frequency_hz = 2" => 34,
            _ => line,
        };
        is_told(&bench, &lines.join("\n"), told, problem);
    }
}

#[test]
fn what_a_scene_lacks_or_has_too_many_of_is_said_where_it_should_be() {
    let bench = bench();
    let surfaces = (0..17).fold("name = \"x\"\n".to_owned(), |text, n| {
        text + &format!("[[surface]]\nname = \"s{n}\"\ntexture = \"silk\"\n")
    });
    let silk = "name = \"x\"\n[[surface]]\ntexture = \"silk\"\n";
    let rate = silk.replacen('\n', "\nsample_rate_hz = 4000\n", 1);
    for (text, line, problem) in [
        (surfaces.as_str(), 50, "surface[17]: a scene has at most 16"),
        ("name = \"x\"\n", 1, "no surface"),
        (&format!("{silk}\n[equaliser]\n"), 5, "needs sections"),
        ("name = \"x\"\n[[surface]\n", 2, ""),
        (&rate, 4, "5000 Hz and the scene for 4000 Hz"),
    ] {
        is_told(&bench, text, line, problem);
    }
}

#[test]
fn regions_may_be_named_in_any_order() {
    let bench = bench();
    bench.write("two.toml", TWO);
    let (head, regions) = TWO.split_at(TWO.find("[[region]]").unwrap());
    let (regions, tail) = regions.split_at(regions.find("[[equaliser").unwrap());
    let (first, second) = regions.split_at(regions.rfind("[[region]]").unwrap());
    bench.write("turned.toml", format!("{head}{second}{first}{tail}"));
    bench.succeed("scene compile two.toml --library cloths.lib --out a.lib");
    bench.succeed("scene compile turned.toml --library cloths.lib --out b.lib");
    assert_eq!(bench.read("a.lib"), bench.read("b.lib"));
}

#[test]
fn a_scene_above_the_budget_is_refused_with_its_arithmetic() {
    let bench = bench();
    bench.write("two.toml", TWO);
    let report = bench.json("scene check two.toml --library cloths.lib --json");
    let worst = report["worst_case"]["instructions"].as_u64().unwrap();
    assert_eq!(report["fits"], true);
    for situation in report["typical"].as_array().unwrap() {
        assert!(situation["instructions"].as_u64() < Some(worst), "{situation}");
    }
    let check = "scene check two.toml --library cloths.lib --budget";
    bench.succeed(&format!("{check} {worst}"));
    let message = bench.refuse(&format!("{check} {}", worst - 1));
    holds(&message, &[&format!("takes {worst} instructions"), "mix: "]);
}

#[test]
fn a_tap_that_was_rendered_is_found_again() {
    let bench = bench();
    bench.write(
        "plate.toml",
        "name = \"plate\"\n[[surface]]\n[surface.tap]\nfrequency_hz = 310\ndecay_s = 0.009\n\
         gain_m_s2_per_n_s = 0.2\nlimit_m_s2 = 100\n",
    );
    // The force rises by 0.5 N within an update of 2 ms, so by 250 N/s.
    let mut motion = String::from("time_s,speed_mm_s,force_n\n0,0,0\n");
    for begin_s in [0.2, 0.6, 1.0] {
        let [risen, end, gone] = [0.002, 0.1, 0.11].map(|after_s| begin_s + after_s);
        motion += &format!("{begin_s},0,0\n{risen},0,0.5\n{end},0,0.5\n{gone},0,0\n");
    }
    motion.push_str("1.5,0,0\n");
    bench.write("taps.csv", motion);
    bench.succeed("scene render plate.toml --library cloths.lib --motion taps.csv --out taps.wav");
    let found = bench.json("scene fit-tap taps.wav --force-rates 250 --json");
    assert_eq!(found["impacts"].as_array().unwrap().len(), 3, "{found}");
    for (key, expected, tolerance) in [
        ("frequency_hz", 310.0, 0.5),
        ("decay_s", 0.009, 0.0001),
        ("gain_m_s2_per_n_s", 0.2, 0.01),
    ] {
        let value = found[key].as_f64().unwrap();
        assert!((value - expected).abs() < tolerance, "{key} is {value}");
    }
    // The printed text can be pasted into a scene, which then plays the same taps.
    let printed = bench.succeed("scene fit-tap taps.wav --force-rates 250");
    let table = &printed[printed.find("[surface.tap]").unwrap()..];
    let again = format!("name = \"again\"\n[[surface]]\n{table}");
    bench.write("again.toml", again);
    bench.succeed("scene check again.toml --library cloths.lib");
    let refused = bench.refuse("scene fit-tap taps.wav --force-rates 250,250");
    holds(&refused, &["2 values for 1 recordings"]);
}

#[test]
fn the_scenes_that_come_with_the_program_play_over_a_simulated_library() {
    let bench = Bench::new();
    bench.write("rig.toml", rig_of("40, 120, 200", "0.2, 0.6, 1.2"));
    bench.succeed("simulate-rig --rig rig.toml --out rig");
    bench.succeed("fit rig --out rig.lib --order 60");
    let shipped = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/scenes");
    let scenes = "steady-denim.toml four-cloths.toml equalised-taps.toml";
    for name in scenes.split(' ').chain(["across.csv", "tapping.csv"]) {
        bench.write(name, std::fs::read(shipped.join(name)).unwrap());
    }
    let compiled = bench.succeed(&format!("scene compile {scenes} --library rig.lib --out scenes.lib"));
    holds(&compiled, &["3 scenes"]);
    let render = |scene: &str, arguments: &str| {
        let text = format!("scene render {scene}.toml --library rig.lib {arguments} --out {scene}.wav");
        assert!(bench.succeed(&text).contains("SIMULATED"));
        bench.samples(&format!("{scene}.wav"), RATE_HZ)
    };
    for (scene, arguments) in [
        ("steady-denim", "--speed 0 --force 0.5 --seconds 1"),
        ("four-cloths", "--motion across.csv"),
        ("equalised-taps", "--motion tapping.csv"),
    ] {
        assert!(rms(&render(scene, arguments)) > 0.05, "{scene}");
    }
}
