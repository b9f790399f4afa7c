//! The command as a user sees it: its results for good input, and its messages about bad input.

use crate::support::{Bench, RATE_HZ, all_pole, holds, integers, noise, rig_of, scaled, two_textures, wav};

/// A set of two textures at two speeds and forces, on two axes. The second axis is weak.
fn small_set() -> Bench {
    two_textures(|signal| [signal.to_vec(), scaled(signal, 0.1)])
}

#[test]
fn recordings_become_a_library_that_is_judged_inspected_and_rendered() {
    let bench = small_set();
    let said = bench.succeed("fit set --out textures.lib");
    holds(&said, &["8 trials -> textures.lib"]);
    holds(&bench.succeed("inspect textures.lib"), &["silk", "2 x 2"]);
    let judged =
        bench.succeed("evaluate set --library textures.lib --json-out figures.json --report report --synthesis 2");
    holds(&judged, &["felt", "report/index.html"]);
    let figures = bench.report("figures.json");
    assert_eq!(figures["trials"].as_array().unwrap().len(), 8);
    assert_eq!(figures["simulated"], false);
    for texture in figures["textures"].as_array().unwrap() {
        let cost = texture["mean_cost"].as_f64().unwrap();
        let floor = texture["mean_cost_floor"].as_f64().unwrap();
        // The recordings are autoregressive like the models, so the cost is only that of the synthesis's own noise.
        assert!(cost < 1.2 * floor, "{texture}");
    }
    let along = "textures.lib --texture silk --speed 100 --force 0.7 --seconds 2 --out";
    bench.succeed(&format!("render {along} a.wav"));
    assert_eq!(bench.samples("a.wav", RATE_HZ).len(), 10_000);
    let export = format!("export {along}");
    for format in ["hjif", "haptic", "ahap", "wav"] {
        let said = bench.succeed(&format!("{export} b.{format} --format {format}"));
        holds(&said, &["'silk' (recorded)", "1.0 is "]);
    }
    assert_eq!(bench.read("b.wav"), bench.read("a.wav"));
    let refused = bench.refuse(&format!("{export} c --format hjif --full-scale 1e-3"));
    holds(&refused, &["'silk'", "more than 0.001", "--full-scale"]);
    let refused = bench.refuse(&format!("{export} c --format ahap").replace('2', "601"));
    holds(&refused, &["'silk'", "600 s", "stylus render"]);
    assert!(!bench.path("c").exists());
}

#[test]
fn reports_for_scripts_are_json() {
    let bench = small_set();
    let report = bench.json("fit set --out textures.lib --json");
    assert_eq!(report["trials"].as_array().unwrap().len(), 8);
    let trial = &report["trials"][0];
    assert!(trial["energy_share"].as_f64().unwrap() > 0.98);
    // What a method section states: how much of each recording is behind its model, and the order of each model.
    assert_eq!(
        trial["samples"].as_f64().unwrap() / 5000.0,
        trial["seconds"].as_f64().unwrap()
    );
    for texture in report["textures"].as_array().unwrap() {
        assert!(
            texture["nodes"]
                .as_array()
                .unwrap()
                .iter()
                .all(|node| node["order"].is_u64())
        );
    }
    let content = bench.json("inspect textures.lib --json");
    assert_eq!(content["textures"][0]["nodes"].as_array().unwrap().len(), 4);
}

#[test]
fn the_same_seed_gives_the_same_bytes() {
    let bench = small_set();
    bench.succeed("fit set --out a.lib");
    let read = |name: &str| bench.read(name);
    let motion = "time_s,speed_mm_s,force_n\n0,0,0\n1,200,1\n2,20,0.2\n";
    bench.write("m.csv", motion);
    for (out, seed) in [("a.wav", 5), ("b.wav", 5), ("c.wav", 6)] {
        bench.succeed(&format!(
            "render a.lib --texture felt --motion m.csv --out {out} --seed {seed}"
        ));
    }
    assert_eq!(read("a.wav"), read("b.wav"));
    assert_ne!(read("a.wav"), read("c.wav"));
}

#[test]
fn a_simulated_set_is_simulated_wherever_it_goes() {
    let bench = Bench::new();
    bench.write("rig.toml", rig_of("60, 180", "0.0, 1.0"));
    let said = bench.succeed("simulate-rig --rig rig.toml --out rig --seed 3");
    holds(&said, &["SIMULATED"]);
    holds(&bench.succeed("fit rig --out rig.lib"), &["SIMULATED"]);
    let judged = bench.succeed("evaluate rig --library rig.lib --report out --synthesis 2");
    holds(&judged, &["SIMULATED"]);
    bench.succeed("page rig.lib --out rub.html");
    bench.succeed("compare rig --library rig.lib --out listen.html --trials 9 --segment 0.3");
    for page in ["out/index.html", "rub.html", "listen.html"] {
        let page = String::from_utf8(bench.read(page)).unwrap();
        assert!(page.contains("<p class=\"notice\">SIMULATED"));
    }
    let rendered = bench.succeed("render rig.lib --texture denim --speed 60 --force 1 --seconds 1 --out d.wav");
    holds(&rendered, &["SIMULATED"]);
}

#[test]
fn what_cannot_be_used_is_refused_in_one_line_and_nothing_is_written() {
    let bench = small_set();
    bench.succeed("fit set --out good.lib");
    bench.write("empty/readme.txt", "no trials here");
    let header = "file,texture,speed_mm_s,force_n";
    let list = format!("{header}\na.wav,silk,100,1\na.wav,silk,x,1\n");
    bench.write("bad/trials.csv", list);
    let list = format!("{header}\nnot-there.wav,silk,100,1\n");
    bench.write("gone/trials.csv", list);
    bench.write("not.wav", "RIFF but not really");
    let mut nan = noise(1, 10_000);
    nan[77] = f64::INFINITY;
    bench.write("infinite.wav", wav(&[&nan], RATE_HZ));
    let whole = wav(&[&noise(1, 10_000)], RATE_HZ);
    bench.write("noise.wav", &whole);
    bench.write("cut.wav", &whole[..20_000]);
    let before = bench.names();
    bench.refuse_each(
        "fit nowhere --out o.lib | nowhere
        fit empty --out o.lib | empty | trials.csv
        fit bad --out o.lib | line 3 | speed_mm_s | 'x'
        fit gone --out o.lib | not-there.wav
        fit infinite.wav --out o.lib | infinite.wav | sample 77 | not a finite number
        fit not.wav --out o.lib | not.wav | WAV
        fit cut.wav --out o.lib | cut.wav | truncated
        fit noise.wav --start 1e300 --out o.lib | noise.wav | give an earlier start_s
        fit noise.wav --reduce z --out o.lib | axis 3 | has 1 in all
        fit noise.wav --out nowhere/o.lib | nowhere
        evaluate set --library nowhere.lib | nowhere.lib
        evaluate noise.wav --library good.lib | 'noise' | silk
        render good.lib --texture wool --speed 1 --force 1 --seconds 1 --out o.wav | 'wool' | felt
        render good.lib --texture silk --motion nowhere.csv --out o.wav | nowhere.csv
        inspect noise.wav | noise.wav | not a texture library
        simulate-rig --rig nowhere.toml --out rig | nowhere.toml",
    );
    assert_eq!(bench.names(), before, "something is left behind");
}

#[test]
fn an_output_can_be_named_as_in_other_programs() {
    let bench = small_set();
    for option in ["--out", "--output", "-o"] {
        bench.succeed(&format!("fit set {option} a.lib --overwrite"));
    }
}

#[test]
fn damaged_libraries_are_refused_by_every_command_with_the_place() {
    let bench = small_set();
    bench.succeed("fit set --out good.lib");
    let good = bench.read("good.lib");
    let mut flipped = good.clone();
    flipped[good.len() / 2] ^= 4;
    bench.write("flipped.lib", flipped);
    let mut newer = good.clone();
    newer[4] += 1;
    bench.write("newer.lib", newer);
    for (name, word) in [("flipped", "damaged"), ("newer", "version")] {
        for command in [
            format!("inspect {name}.lib"),
            format!("evaluate set --library {name}.lib"),
            format!("render {name}.lib --texture silk --speed 1 --force 1 --seconds 1 --out o.wav"),
        ] {
            holds(&bench.refuse(&command), &[name, word]);
        }
    }
}

#[test]
fn arguments_out_of_range_are_refused() {
    let bench = small_set();
    for arguments in [
        "fit set --out o.lib --order 401",
        "fit set --out o.lib --drop nonsense",
        "fit set",
        "render a.lib --texture silk --speed NaN --force 1 --seconds 1 --out o.wav",
    ] {
        assert_ne!(bench.fail(arguments), "");
    }
    assert_eq!(bench.names(), ["set"]);
}

#[test]
fn holes_are_filled_and_flagged_and_dropped_trials_are_holes() {
    let bench = small_set();
    let list = String::from_utf8(bench.read("set/trials.csv")).unwrap();
    let rest = list.lines().filter(|line| !line.starts_with("silk-50-1."));
    bench.write("set/trials.csv", rest.collect::<Vec<_>>().join("\n"));
    let report = bench.json("fit set --out a.lib --json");
    assert_eq!(report["textures"][0]["filled_nodes"], 1);
    assert_eq!(report["textures"][1]["filled_nodes"], 0);
}

#[test]
fn a_recording_as_wav_of_floats_or_integers_or_as_csv_gives_the_same_model() {
    let bench = Bench::new();
    let signal = scaled(&all_pole(&[-1.2, 0.7], &noise(5, 10_000)), 0.1);
    bench.write("float.wav", wav(&[&signal], RATE_HZ));
    bench.write("pcm.wav", integers(&signal, 24));
    let rows = (0..)
        .zip(&signal)
        .map(|(n, x)| format!("{},{x}\n", f64::from(n) / f64::from(RATE_HZ)));
    bench.write("table.csv", "time_s,x_m_s2\n".to_owned() + &rows.collect::<String>());
    bench.succeed("fit float.wav pcm.wav table.csv --out a.lib --order 10");
    let bytes = bench.read("a.lib");
    let library = model_format::Library::decode(&bytes).unwrap();
    let powers: Vec<f32> = library.textures().map(|t| t.node(0, 0).output_power).collect();
    assert_eq!(powers.len(), 3);
    for power in &powers {
        assert!((power / powers[0] - 1.0).abs() < 1e-3, "{powers:?}");
    }
}
