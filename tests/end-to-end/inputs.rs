//! Inputs as a tired person writes them: lists without a scale, values in other units, tables as a spreadsheet saves
//! them, motions that end before they begin. The command reports doubtful input in a line, and refuses impossible input
//! with its place.

use crate::support::{Bench, RATE_HZ, all_pole, holds, integers, json, near, noise, scaled, text, two_textures, wav};

const HEADER: &str = "file,texture,speed_mm_s,force_n";

/// Options that keep a fit of noise short.
const QUICK: &str = "--order 10 --excitation gaussian --lines none";

/// Noise of 2 s, as WAV.
fn recording(seed: u64) -> Vec<u8> {
    wav(&[&all_pole(&[-0.6, 0.7], &noise(seed, 10_000))], RATE_HZ)
}

/// Writes the set `set`, with a trial of noise for each of these textures, speeds and forces.
fn set(bench: &Bench, trials: &[(&str, f64, f64)]) {
    let trials = (0..)
        .zip(trials)
        .map(|(seed, &(texture, v, f))| (texture, v, f, recording(seed)));
    bench.write_set("set", &trials.collect::<Vec<_>>());
}

#[test]
fn a_motion_off_the_grid_is_told_on_either_side_of_it() {
    let bench = Bench::new();
    set(&bench, &[("silk", 100.0, 1.0), ("silk", 200.0, 1.0)]);
    bench.succeed(&format!("fit set --out a.lib {QUICK}"));
    let below = "was recorded from 100 mm/s on: below, the noise is that of 100 mm/s";
    let beyond = "was recorded up to 200 mm/s: beyond, noise and level are those of 200 mm/s";
    for (speed, words) in [("0.1", Some(below)), ("150", None), ("600", Some(beyond))] {
        let render = format!("render a.lib --texture silk --speed {speed} --force 1 --seconds 0.1");
        let said = bench.told(&format!("{render} --out {speed}.wav"));
        match words {
            Some(words) => holds(&said, &[words]),
            None => assert!(!said.contains("warning"), "{said}"),
        }
    }
}

#[test]
fn a_logger_of_3200_hz_is_a_note_and_one_below_skins_band_a_verdict() {
    let bench = Bench::new();
    for (rate_hz, word) in [(3200, None), (2000, Some("wrong rate: 2000 Hz"))] {
        let signal = all_pole(&[-0.6, 0.7], &noise(3, 8000));
        bench.write("silk.wav", wav(&[&signal], rate_hz));
        let fit = format!("fit silk.wav --speed 100 --force 1 --out a.lib --overwrite {QUICK}");
        let said = bench.told(&fit);
        holds(&said, &["sample rates below 5000 Hz in 1 of 1 recording"]);
        match word {
            Some(word) => holds(&said, &[word]),
            None => assert!(!said.contains("warning"), "{said}"),
        }
    }
}

#[test]
fn tables_as_programs_write_them_are_read_as_a_plain_one_is() {
    let bench = Bench::new();
    let signal = all_pole(&[-0.6, 0.7], &noise(3, 4000));
    let table = |header: &str, row: &dyn Fn(usize, f64) -> String| {
        let rows = signal.iter().enumerate().map(|(n, x)| row(n, *x) + "\n");
        format!("{header}\n{}", rows.collect::<String>())
    };
    let seconds = |n: usize| format!("{}.{:03}", n / 1000, n % 1000);
    let plain = table("time,ax", &|n, x| format!("{},{x}", seconds(n)));
    let utf_16 = |text: &str| -> Vec<u8> {
        let units = text.encode_utf16().flat_map(u16::to_le_bytes);
        [0xff, 0xfe].into_iter().chain(units).collect()
    };
    let bytes = |text: String| text.into_bytes();
    for (name, content, told) in [
        ("plain", bytes(plain.clone()), ""),
        ("shell", utf_16(&plain.replace('\n', "\r\n")), ""),
        (
            "numpy",
            bytes(table("", &|n, x| format!("{} {x:e}", seconds(n)))),
            "no name and rises",
        ),
        (
            "spreadsheet",
            bytes(table("n,Time,ax,", &|n, x| format!("{n},{},{x},", seconds(n))) + ",,,\n,,,\n"),
            "column 'n' is left out",
        ),
        (
            "arduino",
            bytes(table("", &|n, x| format!("t:{},ax:{x}", seconds(n)))),
            "",
        ),
        ("power", bytes(format!("{plain}4.0")), "last line is cut off"),
    ] {
        bench.write(&format!("{name}/felt.csv"), content);
        let fit = format!("fit {name}/felt.csv --speed 100 --force 1 --out {name}.lib {QUICK}");
        holds(&bench.told(&fit), &[told]);
        let library = bench.read(&format!("{name}.lib"));
        assert_eq!(library, bench.read("plain.lib"), "{name}");
    }
}

#[test]
fn samples_without_a_value_are_interpolated_or_cut_with_and_without_times() {
    let bench = Bench::new();
    let signal = noise(3, 10_000);
    let is_lost = |n: usize| n % 900 == 7 || (4000..4500).contains(&n);
    for (header, option) in [("time_s,x", ""), ("x", "--sample-rate 5000")] {
        let mut text = format!("{header}\n");
        for (n, x) in signal.iter().enumerate() {
            let x = if is_lost(n) { "NaN".to_owned() } else { x.to_string() };
            text += &match option {
                "" => format!("{:.4},{x}\n", n as f64 / f64::from(RATE_HZ)),
                _ => format!("{x}\n"),
            };
        }
        bench.write("a.csv", text);
        let fit = format!("fit a.csv --speed 100 --force 1 --out a.lib --overwrite {QUICK}");
        let told = bench.told(&format!("{fit} {option}"));
        holds(&told, &["gaps in the times", "12 samples of 10000 missing one by one"]);
    }
}

#[test]
fn what_is_not_read_is_refused_with_the_way_to_what_is() {
    let bench = Bench::new();
    for (file, content, words) in [
        ("a.xlsx", "PK", "stylus-convert FILE.xlsx --out"),
        ("a.mp3", "ID3", "`ffmpeg -i FILE.mp3 FILE.wav`"),
        ("a.mat", "MATLAB", "stylus-convert FILE.mat --out"),
        ("a.bag", "#ROSBAG", "rostopic echo -b FILE.bag -p /TOPIC"),
        ("a.json", "{}", "as a table, .csv"),
        ("a.bin", "?", "export the samples as .csv"),
        ("a.csv", "", "is empty: give a row for each sample"),
        ("b.csv", "time_s\n0\n1\n", "has times alone"),
        ("b.csv", "t,x\n0,1\n1,2\nBrownout (reset)\n2,3\n", "remove this line"),
        ("b.csv", "9,0.3\n0,1,2,3\n1,2,3,4\n", "the first line is cut"),
        (
            "b.csv",
            "t,x\n0,1\n1,2\n2,3\n3,4\n4,5\n5,6\n6,7\n7,8\n8,99,1\n10,2\n",
            "was not ended",
        ),
        (
            "b.txt",
            "10:00:00.1 -> 0.5,1\n10:00:00.2 -> 0.5,2\n",
            "a serial monitor",
        ),
        ("b.txt", "X: 1 Y: 2 Z: 3\nX: 2 Y: 3 Z: 4\n", "a space after the colon"),
        ("b.csv", "t,x\n0,1\n1,∞\n", "record with a larger range"),
        (
            "b.csv",
            "X,CH1,Start,Increment\nSequence,Volt,0,2e-4\n0,1,,\n",
            "1/interval by --sample-rate",
        ),
        (
            "b.csv",
            "Record Length,100,,0,1\nSample Interval,1,,1,2\n,,,2,3\n",
            "the columns of the settings",
        ),
        ("b.csv", "t\0,\0x\0\n\0", "UTF-16 without a mark"),
        ("b.csv", "t,x\r0,1\r1,2\r", "an old Macintosh's"),
        ("b.csv", "t,x\n0,1.5D+00\n1,2.5D+00\n", "E in place of D"),
        (
            "b.csv",
            "t,x\n0,1\n1,2\n2,3\n3,4\n4,5\n5,6\n6,7\n7,8\nt,x\n8,9\n",
            "names stand between the rows",
        ),
        (
            "b.csv",
            "{\"t\":0,\"x\":1,\"y\":2}\n{\"t\":1,\"x\":2,\"y\":3}\n",
            "it is JSON",
        ),
    ] {
        bench.write(file, content);
        let refused = bench.refuse(&format!("fit {file} --speed 100 --force 1 --out a.lib"));
        holds(&refused, &[words]);
        assert!(file == "a.mp3" || !refused.contains("ffmpeg"), "{refused}");
    }
}

#[test]
fn a_rate_that_is_given_counts_before_headers_and_times_and_says_so() {
    let bench = Bench::new();
    let signal = noise(4, 10_000);
    let lines = signal.iter().fold(String::new(), |text, x| text + &format!("{x:?}\n"));
    bench.write("a.csv", lines);
    let table = |n: usize, x: &f64| format!("{},{x:?}\n", n as f64 / 1000.0);
    let rows: String = signal.iter().enumerate().map(|(n, x)| table(n, x)).collect();
    bench.write("times/a.csv", format!("t,x\n{rows}"));
    bench.write("sound/a.wav", wav(&[&signal], 44_100));
    let fit = |file: &str| format!("fit {file} --sample-rate 5000 --out o.lib --overwrite {QUICK}");
    assert!(!bench.told(&fit("a.csv")).contains("given"));
    let plain = bench.read("o.lib");
    for (file, words) in [
        ("times/a.csv", "a rate was given"),
        ("sound/a.wav", "header says 44100"),
    ] {
        holds(&bench.told(&fit(file)), &[words, "5000 Hz"]);
    }
    // The WAV file holds singles, so only the table has the same samples.
    bench.succeed(&fit("times/a.csv"));
    assert_eq!(bench.read("o.lib"), plain);
}

#[test]
fn files_of_one_name_and_files_of_one_axis_are_refused_with_the_remedy() {
    let bench = Bench::new();
    for file in [
        "denim/a.csv",
        "silk/a.csv",
        "felt_X.csv",
        "felt_Y.csv",
        "felt_Z.csv",
        "felt.wav",
    ] {
        bench.write(file, "0\n1\n");
    }
    for (files, words) in [
        (
            "denim/a.csv silk/a.csv",
            ["silk/a.csv: has the name of denim/a.csv", "stylus trials"],
        ),
        (
            "felt_X.csv felt_Y.csv felt_Z.csv",
            ["are axes of one recording", "paste -d ,"],
        ),
    ] {
        holds(&bench.refuse(&format!("fit {files} --out o.lib")), &words);
    }
}

#[test]
fn samples_without_a_unit_are_told_with_the_level_that_comes_out() {
    let bench = Bench::new();
    let quiet = scaled(&noise(1, 10_000), 0.1);
    bench.write("set/a.wav", integers(&quiet, 16));
    bench.write("set/b.wav", recording(2));
    // As a sound card's program writes it.
    bench.write("set/c.wav", wav(&[&scaled(&noise(3, 96_000), 0.1)], 48_000));
    let list = |header: &str, row: &str| {
        let rows = format!("a.wav,silk,100,1{row}\nb.wav,felt,100,1{row}\nc.wav,cork,100,1{row}\n");
        bench.write("set/trials.csv", format!("{header}\n{rows}"));
    };
    let fit = format!("fit set --out a.lib {QUICK}");
    list(HEADER, "");
    let told = bench.told(&fit);
    holds(&told, &["2 of 3 recordings hold samples without a unit", "scale_m_s2"]);
    holds(&told, &["levels of 0.03", " to 0.099 m/s² RMS", "--scale"]);
    let unknown = "recorded, level not known";
    holds(&bench.succeed("inspect a.lib"), &[unknown]);
    let of_textures = bench.json("inspect a.lib --json")["textures"].clone();
    let found = of_textures
        .as_array()
        .unwrap()
        .iter()
        .map(|own| (own["name"].clone(), own["level_is_known"].clone()));
    assert_eq!(
        found.collect::<Vec<_>>(),
        [("silk", false), ("felt", true), ("cork", false)].map(|(name, known)| (name.into(), known.into()))
    );
    let evaluated = bench.told("evaluate set --library a.lib --report report");
    let which = "level of silk, cork is not known";
    holds(&evaluated, &[which, "--scale"]);
    let on_page = format!("The {which}");
    holds(&text(&bench.read("report/index.html")), &[&on_page]);
    bench.succeed("page a.lib --out page.html");
    holds(&text(&bench.read("page.html")), &[&on_page]);
    // Any scale in the list resolves the doubt, and so does an option.
    for (header, row, option, rms) in [(",scale_m_s2", ",98.1", "", 9.81), ("", "", "--scale 98.1", 9.81)] {
        list(&format!("{HEADER}{header}"), row);
        assert!(!bench.told(&format!("{fit} {option}")).contains("without a unit"));
        assert!(!bench.succeed("inspect a.lib").contains(unknown));
        let report = bench.json(&format!("{fit} --json {option}"));
        let found = report["trials"][0]["rms_m_s2"].as_f64().expect("a level");
        near(found / rms, 1.0, 0.02);
    }
}

/// A table with this header: noise on three axes around these means, in units of `unit_m_s2`.
fn table_of(header: &str, means: [f64; 3], unit_m_s2: f64, is_whole: bool) -> String {
    let axes: Vec<Vec<f64>> = (1..4).map(|seed| noise(seed, 10_000)).collect();
    let mut table = format!("{header}\n");
    for n in 0..10_000 {
        let time = f64::from(n) / f64::from(RATE_HZ);
        let value = |axis: usize| {
            let value = (means[axis] + axes[axis][n as usize]) / unit_m_s2;
            if is_whole { value.round() } else { value }
        };
        table += &format!("{time:.4}\t{}\t{}\t{}\n", value(0), value(1), value(2));
    }
    table
}

#[test]
fn a_unit_that_is_wrong_is_told_and_refused_by_strict_and_its_remedy_works() {
    const G: f64 = 9.80665;
    let bench = Bench::new();
    let gravity = [0.3, -0.5, 1.04 * G];
    bench.write("g.tsv", table_of("time_s\tx\ty\tz", gravity, G, false));
    let counts = table_of("time_s\tx\ty\tz", [0.0; 3], G / 256.0, true);
    bench.write("counts.dat", counts);
    for (file, words, unit) in [
        ("g.tsv", "the mean is 1.04, as gravity is in g", "g"),
        ("counts.dat", "1 of 1 recordings hold samples without a unit", "g/256"),
    ] {
        let fit = format!("fit {file} --speed 100 --force 1 --out a.lib --overwrite {QUICK}");
        holds(&bench.told(&fit), &[words, "--scale"]);
        let refused = bench.refuse(&format!("{fit} --strict"));
        holds(&refused, &[file, "refused because of --strict"]);
        let mended = bench.told(&format!("{fit} --strict --unit {unit}"));
        assert!(!mended.contains("scale"), "{mended}");
    }
}

#[test]
fn units_of_headers_are_converted_and_a_set_says_so_once() {
    let bench = Bench::new();
    let mut list = format!("{HEADER}\n");
    for speed in [100, 200, 300] {
        let header = "time_s\tx [mg]\ty [mg]\tz [mg]";
        let table = table_of(header, [f64::from(speed), 0.0, 0.0], 9.80665e-3, false);
        bench.write(&format!("set/{speed}.txt"), table);
        list += &format!("{speed}.txt,silk,{speed},1\n");
    }
    bench.write("set/trials.csv", list);
    let fit = format!("fit set --out a.lib {QUICK}");
    let message = bench.told(&fit);
    let words = "3 recordings, such as set/100.txt: converted from mg to m/s², by the header";
    assert_eq!(message.matches("converted").count(), 1, "{message}");
    holds(&message, &[words]);
}

#[test]
fn the_first_example_of_the_readme_gives_the_scale_of_its_integers() {
    let readme = include_str!("../../README.md");
    let list = readme.split("```").find(|block| block.contains(HEADER));
    let list = list.expect("it has a list").trim();
    let (header, rows) = list.split_once('\n').expect("it has rows");
    assert_eq!(header, "file,texture,speed_mm_s,force_n,scale_m_s2");
    let bench = Bench::new();
    for (seed, row) in (0..).zip(rows.lines()) {
        let file = row.split(',').next().expect("a file");
        let signal = scaled(&noise(seed, 10_000), 0.1);
        bench.write(&format!("set/{file}"), integers(&signal, 16));
    }
    bench.write("set/trials.csv", list);
    let said = bench.told(&format!("fit set --out a.lib {QUICK}"));
    assert!(!said.contains("scale"), "{said}");
}

#[test]
fn speeds_and_forces_of_no_hand_are_refused_with_their_line_and_doubtful_ones_told() {
    let bench = Bench::new();
    let speeds = "speed of 120000 mm/s, and no hand or drum exceeds 10000";
    let forces = "force of 500 N, and no hand or drum exceeds 100";
    for (speed, force, words) in [(120_000.0, 1.0, speeds), (120.0, 500.0, forces)] {
        set(&bench, &[("silk", 120.0, 1.0), ("silk", speed, force)]);
        holds(&bench.refuse("fit set --out a.lib"), &["trials.csv", "line 3", words]);
    }
    for (speed, force, words) in [
        (5000.0, 1.0, "speeds reach 5000 mm/s"),
        (120.0, 50.0, "are they in grams"),
        (0.12, 1.0, "are they in m/s"),
    ] {
        set(&bench, &[("silk", speed, force)]);
        holds(&bench.told(&format!("fit set --out a.lib {QUICK}")), &[words]);
    }
}

/// A table of noise at 1 kHz. Its times are `stamp`, s, multiplied by `factor`.
fn stamped(header: &str, factor: f64, stamp: impl Fn(usize) -> f64) -> String {
    let rows = noise(7, 4000)
        .into_iter()
        .enumerate()
        .map(|(n, x)| format!("{:.7},{x}\n", factor * stamp(n)));
    format!("{header},x\n{}", rows.collect::<String>())
}

#[test]
fn every_remedy_for_times_that_are_refused_works() {
    let bench = Bench::new();
    let even = |n: usize| n as f64 / 1000.0;
    let paused = |n: usize| even(n) + if n < 3000 { 0.0 } else { 9.0 };
    let milliseconds = stamped("time_s", 1e3, even);
    let none = noise(7, 4000).into_iter().map(|x| format!("{x}\n"));
    let fit = format!("fit a.csv --out a.lib --overwrite {QUICK}");
    for (text, words, option) in [
        (milliseconds, "holds times in s", "--time-unit ms"),
        (none.collect(), "no sample rate", "--sample-rate 1000"),
        // The file's own columns select a part without the gap.
        (stamped("t", 1.0, paused), "a gap of 9.001", "--duration 2.5"),
    ] {
        bench.write("a.csv", &text);
        let named = match option {
            "--duration 2.5" => "start_s and duration_s",
            _ => option.split(' ').next().expect("a name"),
        };
        holds(&bench.refuse(&fit), &[named, words]);
        bench.succeed(&format!("{fit} {option}"));
    }
}

#[test]
fn a_duration_beyond_the_file_is_told_with_both() {
    let bench = Bench::new();
    bench.write("a.wav", recording(1));
    let fit = |duration: &str| bench.told(&format!("fit a.wav --duration {duration} --out a.lib {QUICK}"));
    holds(&fit("2.5"), &["a.wav with 2.000 s of 2.5 s", "duration_s"]);
    for duration in ["1.5", "2"] {
        let within = fit(duration);
        assert!(!within.contains("shorter than"), "{within}");
    }
}

#[test]
fn measured_speeds_are_snapped_where_their_gaps_are_clear_and_make_a_sparse_grid_otherwise() {
    let bench = Bench::new();
    // Four nominal speeds with five nominal forces each, measured to within 2 %.
    let measured = |n: i32| {
        let off = |k: i32| 1.0 + f64::from((n * k) % 9 - 4) / 230.0;
        let (speed, force) = (50.0 * f64::from(n / 5 + 1), 0.4 * f64::from(n % 5 + 1));
        let places = |value: f64| (value * 1e4).round() / 1e4;
        let speed = places(speed * off(7) + f64::from(n) * 1e-3);
        ("silk", speed, places(force * off(5) + f64::from(n) * 1e-4))
    };
    set(&bench, &(0..20).map(measured).collect::<Vec<_>>());
    let told = bench.told(&format!("fit set --snap none --out a.lib {QUICK}"));
    holds(&told, &["380 of 400 nodes", "grid of 20 x 20"]);
    holds(&told, &["--snap auto", "4 x 5"]);
    let told = bench.told(&format!("fit set --out b.lib {QUICK}"));
    holds(&told, &["20 speeds become 4 (50, 100, 150, 200 mm/s)"]);
    holds(&told, &["20 forces become 5 (0.4, 0.8, 1.2, 1.6, 2 N)"]);
    holds(&told, &["% at most"]);
    assert!(!told.contains("are filled from neighbours"), "{told}");
    let content = bench.json("inspect b.lib --json");
    let speeds = content["textures"][0]["speeds_mm_s"].as_array();
    assert_eq!(speeds, json("[50.0, 100.0, 150.0, 200.0]").as_array());
    // The evaluation must recognise the trials as those of the fit.
    bench.succeed("evaluate set --library b.lib --synthesis 2 --json-out b.json");
    let judged = bench.report("b.json");
    for trial in judged["trials"].as_array().expect("trials") {
        assert!(speeds.expect("speeds").contains(&trial["speed_mm_s"]), "{trial}");
    }
}

#[test]
fn nodes_that_are_next_to_equal_are_told_with_the_remedy() {
    let bench = Bench::new();
    set(&bench, &[("silk", 100.0, 1.0), ("silk", 100.0001, 0.5)]);
    let message = bench.told(&format!("fit set --out a.lib {QUICK}"));
    holds(&message, &["100 and 100.0001 mm/s", "--snap 0.01"]);
    let message = bench.told(&format!("fit set --snap 0.01 --out a.lib {QUICK}"));
    holds(&message, &["2 speeds become 1 (100 mm/s)"]);
}

/// A library of two textures, in a folder with its set.
fn fitted() -> Bench {
    let bench = two_textures(|signal| [signal.to_vec()]);
    bench.succeed(&format!("fit set --out good.lib {QUICK}"));
    bench
}

/// One rule holds in every motion: a speed's sign is its direction, and a force at or below zero means no contact.
#[test]
fn the_sign_of_a_speed_is_its_direction_and_a_negative_force_no_contact_in_every_motion() {
    let bench = fitted();
    let table = |speed: f64, force: f64| format!("time_s,speed_mm_s,force_n\n0,{speed},{force}\n1,{speed},{force}\n");
    let samples = |name: &str| bench.samples(name, RATE_HZ);
    let render = "render good.lib --texture silk --seconds 1";
    bench.write("back.csv", table(-100.0, 1.0));
    bench.write("off.csv", table(100.0, -1.0));
    bench.succeed(&format!("{render} --speed 100 --force 1 --out plus.wav"));
    let plus = samples("plus.wav");
    assert!(plus.iter().any(|&sample| sample != 0.0));
    for way in ["--speed -100 --force 1", "--motion back.csv"] {
        bench.succeed(&format!("{render} {way} --out minus.wav"));
        assert_eq!(samples("minus.wav"), plus, "{way}");
    }
    for way in ["--speed 100 --force -1", "--motion off.csv"] {
        let told = bench.told(&format!("{render} {way} --out off.wav"));
        assert!(samples("off.wav").iter().all(|&x| x == 0.0), "{way}");
        holds(&told, &["nothing is heard", "no contact"]);
    }
}

#[test]
fn a_motion_of_one_line_has_no_end_and_says_so() {
    let bench = fitted();
    bench.write("one.csv", "time_s,speed_mm_s,force_n\n0,100,1\n");
    bench.write("s.toml", "name = \"s\"\n[[surface]]\ntexture = \"silk\"\n");
    for command in [
        "render good.lib --texture silk --motion one.csv --out o.wav",
        "scene render s.toml --library good.lib --motion one.csv --out o.wav",
    ] {
        holds(&bench.refuse(command), &["one.csv", "one row", "--seconds"]);
        bench.succeed(&format!("{command} --seconds 0.5"));
    }
}

#[test]
fn a_folder_of_named_recordings_becomes_a_list_by_their_names() {
    let bench = Bench::new();
    let signal = noise(3, 4_000);
    for (texture, take) in [("denim", "1"), ("denim", "2"), ("wet silk", "1")] {
        for speed in [50, 100] {
            let name = format!("set/{texture}_{speed}mms_500mN_{take}.wav");
            bench.write(&name, wav(&[&signal], 5_000));
        }
    }
    bench.write("set/rest.wav", wav(&[&signal], 5_000));
    let proposed = "`stylus trials set --pattern '{texture}_{speed}mms_{force}N.wav'`";
    holds(&bench.refuse("fit set --out a.lib"), &["no trials.csv", proposed]);
    let output = bench.run("trials set --pattern {texture}_{speed}mms_{force*0.001}N_{take}.wav");
    let words = &["{speed}mms_{force*0.001}N", "first of 7 is"];
    holds(&text(&output.stderr), words);
    let trials = "trials set --pattern {texture}_{speed}mms_{force*0.001}mN_{take}.wav";
    let output = bench.run(trials);
    let words = &["denim", "50 100", "0.5", "1 2", "6 trials -> set/trials.csv"];
    holds(&text(&output.stdout), words);
    let words = &["the pattern does not match: 1 file", "rest.wav"];
    holds(&text(&output.stderr), words);
    let list = text(&bench.read("set/trials.csv"));
    let first = format!("{HEADER}\ndenim_100mms_500mN_1.wav,denim,100,0.5\n");
    assert!(list.starts_with(&first), "{list}");
    holds(&bench.succeed("fit set --out a.lib"), &["wet silk"]);
    let told = bench.succeed(&format!("{trials} --take 2 --list takes.csv --scale 9.81"));
    holds(&told, &["2 trials"]);
    let takes = text(&bench.read("set/takes.csv"));
    assert_eq!(
        takes.lines().filter(|line| line.ends_with(",9.81")).count(),
        2,
        "{takes}"
    );
    let output = bench.run("trials set --pattern {texture}_{*}.wav --list b.csv");
    holds(&text(&output.stderr), &["no {speed}", "--speed"]);
}

#[test]
fn what_lies_below_a_folder_is_named_and_left_out_or_refused_and_never_waited_for() {
    use std::os::unix::ffi::OsStrExt;
    let bench = Bench::new();
    bench.write("set/a_50.wav", wav(&[&noise(3, 4_000)], 5_000));
    let odd = bench.path("set").join(std::ffi::OsStr::from_bytes(b"b\xff_60.wav"));
    std::fs::write(odd, "").expect("any name is taken");
    let trials = "trials set --pattern {texture}_{speed}.wav --force 1";
    let output = bench.run(trials);
    holds(&text(&output.stdout), &["1 trial -> set/trials.csv"]);
    let words = &["the pattern does not match: 1 file", "b\u{fffd}_60.wav"];
    holds(&text(&output.stderr), words);
    crate::outputs::make_pipe(&bench.path("set/c_70.wav"));
    let refused = bench.refuse(&format!("{trials} --overwrite"));
    holds(&refused, &["c_70.wav", "is a pipe", "copy it to one"]);
}

#[test]
fn the_name_of_a_texture_that_no_fit_takes_is_refused_where_it_is_given() {
    let bench = Bench::new();
    let long = "x".repeat(49);
    for (name, word) in [("", "empty"), (&long, "49 bytes")] {
        for command in [
            "fit a.csv --strokes --out a.lib --texture",
            "trials . --pattern {speed}.wav --force 1 --texture",
        ] {
            let mut command = bench.command(command.split(' '));
            let output = command.arg(name).output().expect("it runs");
            assert_eq!(output.status.code(), Some(2), "{name:?}");
            holds(&text(&output.stderr), &["--texture", word]);
        }
    }
    bench.write(&format!("{long}_50.wav"), wav(&[&noise(3, 4_000)], 5_000));
    let refused = bench.refuse("trials . --pattern {texture}_{speed}.wav --force 1");
    holds(&refused, &[&long, "at most 48"]);
    assert!(!bench.path("trials.csv").exists());
}

#[test]
fn recordings_without_a_list_whose_names_differ_by_one_number_are_pointed_at() {
    let bench = Bench::new();
    for speed in [50, 100] {
        let file = wav(&[&noise(3, 4_000)], 5_000);
        bench.write(&format!("denim_{speed}.wav"), file);
    }
    let note = bench.told("fit denim_50.wav denim_100.wav --out a.lib");
    holds(&note, &["differ by one number", "'denim_{speed}.wav'"]);
    let list = "file,texture,speed_mm_s,force_n,note\ndenim_50.wav,denim,50,1,a new tip\n";
    bench.write("list.csv", list);
    bench.succeed("fit list.csv --out b.lib");
    bench.write("capital.csv", list.replace("denim_50", "Denim_50"));
    let refused = bench.refuse("fit capital.csv --out c.lib");
    holds(&refused, &["Denim_50.wav", "'denim_50.wav' is"]);
}

#[test]
fn gravity_on_three_axes_is_taken_off_without_a_word_and_another_mean_with_one() {
    let bench = Bench::new();
    let signal = noise(5, 12_000);
    for (mean, is_told) in [(9.81, false), (5.0, true)] {
        let mut table = "time_s,x,y,z\n".to_owned();
        for (index, x) in signal.iter().enumerate() {
            let time = index as f64 / 5000.0;
            let (y, z) = (0.2 * x, mean + 0.1 * x);
            table += &format!("{time:.4},{x:.5},{y:.5},{z:.5}\n");
        }
        bench.write("a.csv", table);
        let told = bench.told("fit a.csv --out a.lib --overwrite");
        assert_eq!(told.contains("mean above the RMS"), is_told, "{told}");
    }
}
