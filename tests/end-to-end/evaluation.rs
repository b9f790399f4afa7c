//! The removed-node test, what may judge a fit, strokes of a free hand, and HaTT's models, through the command.

use crate::hatt;
use crate::support::{Bench, RATE_HZ, all_pole, denim_rig_of, holds, near, noise, scaled, text, wav};
use model_format::Library;
use model_format::limits::MAX_LIBRARY_BYTES;

/// A simulated set of denim only.
fn simulated() -> Bench {
    let bench = Bench::new();
    let rig = denim_rig_of("80, 100, 120, 140, 160, 180", "0.4, 0.8, 1.2");
    bench.write("rig.toml", rig);
    bench.succeed("simulate-rig --rig rig.toml --out rig --seed 5");
    bench
}

/// Mean of a measure over the removed nodes, for the row whose name contains `row`.
fn mean_of(test: &serde_json::Value, row: &str, measure: &str) -> f64 {
    let mut rows = test["rows"].as_array().unwrap().iter();
    let at = rows.position(|name| name.as_str().unwrap().contains(row));
    let removed = test["removed"].as_array().unwrap();
    let of = |node: &serde_json::Value| node["outcomes"][at.unwrap()][measure].as_f64();
    removed.iter().map(|node| of(node).unwrap()).sum::<f64>() / removed.len() as f64
}

#[test]
fn removed_nodes_are_predicted_alike_by_any_number_of_threads_and_worse_than_a_nodes_own_model() {
    let bench = simulated();
    let run = |threads: &str, out: &str| {
        let evaluate = "evaluate rig --leave-one-out --synthesis 4 --order 150 --json-out";
        let mut command = bench.command(evaluate.split(' ').chain([out]));
        let output = command.env("RAYON_NUM_THREADS", threads).output().unwrap();
        assert!(output.status.success(), "{}", text(&output.stderr));
        text(&output.stdout)
    };
    let (one, three) = (run("1", "one.json"), run("3", "three.json"));
    assert_eq!(one, three);
    assert_eq!(bench.read("one.json"), bench.read("three.json"));
    holds(&one, &["SIMULATED"]);
    let test = &bench.report("one.json")["removed_nodes"];
    // Four inner speeds, one inner force.
    assert_eq!(test["removed"].as_array().unwrap().len(), 4);
    let own = mean_of(test, "not removed", "cost");
    for predicted in ["(the paper)", "(the device)"] {
        let predicted = mean_of(test, predicted, "cost");
        assert!(own < predicted, "{own} against {predicted}");
    }
}

#[test]
fn a_set_without_inner_nodes_is_told_what_it_lacks() {
    let bench = Bench::new();
    let signal = noise(1, 10_000);
    bench.write("a.wav", wav(&[&signal], RATE_HZ));
    holds(&bench.refuse("evaluate a.wav --leave-one-out"), &["three speeds"]);
}

/// Two recordings of noise without structure. A model of high order learns only their random details.
fn white_takes() -> Bench {
    let bench = Bench::new();
    for (folder, seed) in [("one", 1), ("two", 2)] {
        let file = wav(&[&noise(seed, 10_000)], RATE_HZ);
        bench.write_set(folder, &[("felt", 100.0, 1.0, file)]);
    }
    bench
}

#[test]
fn what_a_model_was_fitted_to_does_not_judge_it() {
    let bench = white_takes();
    bench.succeed("fit one --out felt.lib --order 400");
    let said = bench.succeed("evaluate one --library felt.lib --json-out blocks.json");
    let words = "fitted on every other block of 0.5 s of each recording, judged on the rest";
    holds(&said, &[words]);
    let felt = &bench.report("blocks.json")["textures"][0];
    let verdict = "spectrum as near as another part of the recording; impulses as near; evenness as near";
    assert_eq!(felt["verdict"], verdict);
    holds(&said, &[&format!("felt: {verdict} In brackets the target")]);
    let is_wide = |line: &str| line.chars().count() > 80;
    assert!(!said.lines().any(is_wide), "{said}");
    // A model cannot be closer to the recording than another block of the same noise.
    let distance = |of: &serde_json::Value| of["mean_log_spectral_distance_db"].as_f64().unwrap();
    near(distance(&felt["other"]), distance(felt), 1.5);

    // If the record of the fit does not name a recording, the recording judges the library as it is.
    let said = bench.succeed("evaluate two --library felt.lib --json-out unseen.json");
    holds(&said, &["recordings that its fit did not use"]);
    assert_eq!(bench.report("unseen.json")["trials"][0]["judge"], "unseen");
    let said = bench.succeed("evaluate one --library felt.lib --takes two --json-out takes.json");
    holds(&said, &["judged on another take"]);
    let takes = bench.report("takes.json");
    let verdict = &takes["textures"][0]["verdict"];
    holds(verdict, &["as near as another take"]);
    let unseen = bench.report("unseen.json");
    assert_eq!(takes["trials"][0]["judge"], "other_take");
    // This is the same recording at a quarter of its level.
    let loud = "evaluate two --scale 0.25 --library felt.lib --json-out loud.json --full";
    holds(&bench.succeed(loud), &["JND off (target", "dB too strong at", "silent"]);
    let distance = |figures: &serde_json::Value| figures["trials"][0]["log_spectral_distance_db"].as_f64().unwrap();
    // The same recording judges the same synthesis. Segments last 0.5 s in one report, because blocks are judged there
    // too, and 1 s in the other report.
    near(distance(&takes), distance(&unseen), 0.2);
}

#[test]
fn without_a_record_of_the_fit_no_figure_counts() {
    let bench = white_takes();
    bench.succeed("fit one --out felt.lib");
    std::fs::remove_file(bench.path("felt.lib.fit.json")).unwrap();
    let said = bench.succeed("evaluate one --library felt.lib --json-out a.json");
    holds(&said, &["not known to be held out"]);
    holds(&said, &["felt: not judged: nobody knows"]);
    let felt = &bench.report("a.json")["textures"][0];
    assert!(felt["mean_cost"].is_null(), "{felt}");
    assert!(felt["level_error_jnd"].is_null(), "{felt}");
}

#[test]
fn takes_that_are_in_the_fitted_set_are_named_and_judge_nothing() {
    let bench = white_takes();
    bench.succeed("fit one --out felt.lib");
    let file = wav(&[&scaled(&noise(1, 10_000), -0.4)], RATE_HZ);
    bench.write_set("scaled", &[("felt", 100.0, 1.0, file)]);
    let warned = bench.told("evaluate one --library felt.lib --json-out a.json --takes scaled");
    holds(&warned, &["judges nothing", "take scaled/0.wav"]);
    assert_eq!(bench.report("a.json")["trials"][0]["judge"], "blocks");
}

#[test]
fn trials_without_another_take_leave_the_others_to_be_judged() {
    let bench = Bench::new();
    let signal = |seed: u64| all_pole(&[-0.6, 0.4], &noise(seed, 15_000));
    let trial = |speed, seed| ("felt", speed, 1.0, wav(&[&signal(seed)], RATE_HZ));
    bench.write_set("set", &[trial(50.0, 1), trial(100.0, 2)]);
    bench.write_set("others", &[trial(50.0, 3)]);
    bench.succeed("fit set --out felt.lib");
    let evaluate = "evaluate set --library felt.lib --takes others --synthesis 2";
    let output = bench.run(evaluate);
    assert!(output.status.success(), "{}", text(&output.stderr));
    let words = &["1 of 2 trials are judged without --takes", "1.wav"];
    holds(&text(&output.stderr), words);
    let words = "1 of 2 trials: the library as it is, judged on another take";
    holds(&text(&output.stdout), &[words]);
    bench.write_set("others", &[trial(7.0, 3)]);
    holds(&bench.refuse(evaluate), &["no other take"]);
}

/// A stroke of a hand, 4 s long, whose amplitude is a hundredth of speed times force. Each seed gives a different
/// stroke.
fn free_stroke(seed: u64) -> String {
    let signal = all_pole(&[-0.6, 0.4], &noise(seed, 4 * RATE_HZ as usize));
    let mut csv = String::from("# SIMULATED\ntime_s,a,speed_mm_s,force_n\n");
    for (n, a) in signal.iter().enumerate() {
        let time_s = n as f64 / f64::from(RATE_HZ);
        let speed = 100.0 + 60.0 * (0.7 * time_s + seed as f64).sin();
        let force = 1.0 + 0.5 * (0.3 * time_s + 2.0 * seed as f64).cos();
        let a = 0.01 * speed * force * a;
        csv.push_str(&format!("{time_s:.4},{a:.6},{speed:.3},{force:.4}\n"));
    }
    csv
}

#[test]
fn along_strokes_that_it_never_saw_a_library_is_nearer_than_a_constant_level_and_the_nearest_stroke() {
    let bench = Bench::new();
    for seed in 0..16 {
        bench.write(&format!("s{seed}.csv"), free_stroke(seed));
    }
    let files = |seeds: std::ops::Range<u64>| {
        let names: Vec<String> = seeds.map(|seed| format!("s{seed}.csv")).collect();
        names.join(" ")
    };
    let (fitted, judges) = (files(0..12), files(12..16));
    let fit = format!("fit {fitted} --strokes --texture felt --out felt.lib");
    holds(&bench.succeed(&fit), &["-> felt.lib"]);
    let command = format!("evaluate {fitted} --library felt.lib --strokes {judges} --json-out n.json");
    let of = |found: &serde_json::Value, by: &str, field: &str| {
        let mut all = found.as_array().unwrap().iter();
        all.find(|near| near["by"] == by).unwrap()[field].as_f64().unwrap()
    };
    let (said, found) = (bench.succeed(&command), bench.report("n.json")["nearness"].clone());
    holds(&said, &["'felt' along 4 strokes", "SIMULATED"]);
    assert!(of(&found, "library", "correlation") > 0.95, "{found}");
    assert!(of(&found, "library", "bias_db").abs() < 0.5, "{found}");
    let error_db = of(&found, "library", "error_db");
    for other in ["constant level", "nearest stroke"] {
        assert!(error_db < 0.75 * of(&found, other, "error_db"), "{found}");
    }
    // By construction, the line describes this signal exactly.
    let line = "line over log speed, log force";
    assert!(of(&found, line, "error_db") < 0.6, "{found}");
    assert!(of(&found, "library", "band_error_db") < 1.5, "{found}");
    holds(&said, &["the best baseline, the line over log speed,"]);
    refuse_what_does_not_go_with_strokes(&bench);
}

fn refuse_what_does_not_go_with_strokes(bench: &Bench) {
    for (command, option) in [
        ("fit s0.csv --out a.lib", "--time-unit ms"),
        ("fit s0.csv --out a.lib", "--force 1"),
        ("fit s0.csv --out a.lib", "--snap auto"),
        ("page s0.csv --out a.html", "--recordings ."),
    ] {
        let name = option.split(' ').next().unwrap();
        let refused = bench.fail(&format!("{command} --strokes {option}"));
        holds(&refused, &["cannot be used with", name]);
    }
    bench.succeed("fit s0.csv --strokes --scale 2 --out scaled.lib --order 10");
    bench.refuse_each(
        "fit . --strokes --out felt.lib | .: is a folder | give CSVs
        fit s0.csv cork.csv --strokes --out felt.lib | cork.csv | not named like s0.csv | --texture
        fit s0.csv --strokes --floor subtract --out a.lib | leave out --floor
        evaluate . --library felt.lib --strokes s0.csv | .: is a folder | CSVs of strokes that were fitted
        evaluate s0.csv --library scaled.lib --strokes s0.csv | scaled.lib | fitted with --scale 2
        evaluate s0.csv --library felt.lib --strokes s0.csv | s0.csv | cannot judge",
    );
    assert!(!bench.path("a.lib").exists() && !bench.path("a.html").exists());
}

#[test]
fn a_free_hands_counts_without_a_scale_have_a_level_that_is_not_known() {
    let bench = Bench::new();
    let in_counts = |line: &str| match line.split(',').collect::<Vec<_>>()[..] {
        [time_s, a, speed, force] if a != "a" => {
            let count = (10.0 * a.parse::<f64>().unwrap()).round();
            format!("{time_s},{count},{speed},{force}\n")
        }
        _ => format!("{line}\n"),
    };
    let counts: String = free_stroke(0).lines().skip(1).map(in_counts).collect();
    bench.write("hand.csv", counts);
    let told = bench.told("fit hand.csv --strokes --order 10 --out a.lib");
    holds(&told, &["no unit", "--scale"]);
    holds(&bench.succeed("inspect a.lib"), &["level not known"]);
    bench.succeed("fit hand.csv --strokes --order 10 --scale g/256 --out b.lib");
    assert!(!bench.succeed("inspect b.lib").contains("not known"));
}

#[test]
fn a_free_hands_file_that_cannot_be_used_is_named() {
    let bench = Bench::new();
    let with = |rows: &str| format!("time_s,a,speed_mm_s,force_n\n{rows}");
    for (content, word) in [
        ("time_s,a,speed_mm_s\n0,1,2\n", "force_n"),
        ("time_s,speed_mm_s,force_n\n0,1,2\n", "columns of accel"),
        ("a,speed_mm_s,force_n\n0,1,2\n", "sample rate"),
        (&with("0,0,1,1e5\n0.001,0,1,1e5\n"), "impossible values"),
        (&with("0,0,1,1\n0.001,0,1,1\n"), "no node has 0.4 s"),
    ] {
        bench.write("bad.csv", content);
        let refused = bench.refuse("fit bad.csv --strokes --texture felt --out felt.lib");
        holds(&refused, &[word]);
        assert!(!bench.path("felt.lib").exists());
    }
}

/// Number of textures of the Haptic Texture Toolkit.
const ALL_OF_HATT: usize = 100;

#[test]
fn as_many_model_files_as_hatt_has_become_one_library_that_a_slot_holds() {
    let bench = Bench::new();
    let name = |number: usize| format!("texture-{number:03}");
    for number in 1..=ALL_OF_HATT {
        // Each file has its own levels, and fewer models than HaTT's files, which would take minutes.
        let text = hatt::scattered(3 + number / 50);
        let level = format!("<var>0.0{number:03}1</var>");
        let text = text.replace("<var>0.01</var>", &level);
        assert!(text.contains(&level));
        bench.write(&format!("toolkit/Models_{}.xml", name(number)), text);
    }
    bench.succeed("import-hatt toolkit --speeds 40 --forces 40 --out all.lib");
    let bytes = bench.read("all.lib");
    assert!(bytes.len() <= MAX_LIBRARY_BYTES, "{} bytes", bytes.len());
    let library = Library::decode(&bytes).unwrap();
    assert!(
        library
            .textures()
            .map(|texture| texture.name().to_string())
            .eq((1..=ALL_OF_HATT).map(name))
    );
    for texture in library.textures() {
        let (speeds, forces) = (texture.speed_axis().len(), texture.force_axis().len());
        assert!(speeds > 1 && forces > 1, "{speeds} x {forces}");
    }
    bench.succeed("render all.lib --texture texture-100 --speed 60 --force 1 --seconds 0.2 --out a.wav");
}

#[test]
fn model_files_that_cannot_be_used_are_named_and_nothing_is_written() {
    let bench = Bench::new();
    bench.write("a/felt.xml", hatt::whole());
    bench.write("b/Models_felt.xml", hatt::whole());
    bench.write("torn.xml", "<modelSet>");
    bench.refuse_each(
        "import-hatt torn.xml --out x.lib | torn.xml | well-formed
        import-hatt a/felt.xml b/Models_felt.xml --out x.lib | Models_felt.xml | a/felt.xml
        import-hatt a/felt.xml a --out x.lib | a/felt.xml | given twice",
    );
    assert!(!bench.path("x.lib").exists());
    // A folder of a hundred files is refused in one line.
    for number in 0..ALL_OF_HATT {
        let text = hatt::whole().replace("<SampleRate>1000", "<SampleRate>20000");
        bench.write(&format!("fast/{number:03}.xml"), text);
    }
    let message = bench.refuse("import-hatt fast --out x.lib");
    holds(&message, &["100 of 100 files cannot be used", "000.xml"]);
    holds(&message, &["1000 or 10000 Hz"]);
}
