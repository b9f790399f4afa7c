//! Hostile inputs: numbers in files that determine how much memory is allocated, structures that cost more than their
//! length, characters that control a terminal, names that are equal on some systems, and outputs that are closed or
//! full.

use std::process::{Command, Output, Stdio};

use crate::support::{Bench, RATE_HZ, holds, noise, refusal, text, two_textures, wav};

const HEADER: &str = "file,texture,speed_mm_s,force_n,sample_rate_hz\n";

/// A second of noise in a file whose header states this rate.
fn recording(rate_hz: u32) -> Vec<u8> {
    let mut bytes = wav(&[&noise(1, 5000)], RATE_HZ);
    let format = bytes.windows(4).position(|four| four == b"fmt ");
    let rate = format.expect("it has a format") + 12;
    bytes[rate..rate + 4].copy_from_slice(&rate_hz.to_le_bytes());
    bytes
}

/// The library of a small set, in the folder of the set.
fn fitted() -> Bench {
    let bench = two_textures(|signal| [signal.to_vec()]);
    bench.succeed("fit set --out good.lib");
    bench
}

/// Runs `stylus` with at most 4 GB of address space.
#[cfg(target_os = "linux")]
fn within_memory(bench: &Bench, arguments: &str) -> Output {
    let script = format!("ulimit -v 4000000; exec \"$0\" {arguments}");
    Command::new("sh")
        .args(["-c", &script, env!("CARGO_BIN_EXE_stylus")])
        .current_dir(bench.path("."))
        .env("STYLUS_OVERWRITE", "1")
        .output()
        .expect("there is a shell")
}

/// Runs `stylus` with at most 4 GB of address space. It must end with code 2 and one line, which is returned.
#[cfg(target_os = "linux")]
fn refuse_within_memory(bench: &Bench, arguments: &str) -> String {
    refusal(&within_memory(bench, arguments), arguments)
}

#[cfg(target_os = "linux")]
#[test]
fn rates_that_no_recording_has_are_refused_with_file_and_remedy_and_size_no_memory() {
    let bench = Bench::new();
    for rate_hz in [90, u32::MAX] {
        bench.write("a.wav", recording(rate_hz));
        let message = refuse_within_memory(&bench, "fit a.wav --out a.lib");
        holds(&message, &["a.wav", "Hz", "convert it again"]);
    }
    bench.write("a.csv", "1\n-1\n2\n".repeat(2000));
    for rate in ["1", "3999999979"] {
        let fit = format!("fit a.csv --sample-rate {rate} --out a.lib");
        let message = refuse_within_memory(&bench, &fit);
        holds(&message, &["a.csv", "--sample-rate"]);
        let list = format!("{HEADER}../a.csv,silk,100,1,{rate}\n");
        bench.write("set/trials.csv", list);
        let message = refuse_within_memory(&bench, "fit set --out a.lib");
        holds(&message, &["line 2", "sample_rate_hz"]);
    }
    for step_s in [1e-9, 0.1] {
        let row = |n: u32| format!("{},{}\n", f64::from(n) * step_s, n % 7);
        let rows: String = (0..5000).map(row).collect();
        bench.write("times.csv", format!("time_s,x\n{rows}"));
        let message = refuse_within_memory(&bench, "fit times.csv --out a.lib");
        holds(&message, &["times.csv", "time_s"]);
    }
    assert!(!bench.path("a.lib").exists());
}

/// Rates with a long common period, for which a block of the conversion is longest, over the whole permitted range.
#[cfg(target_os = "linux")]
#[test]
fn rates_of_the_whole_range_are_converted_in_bounded_memory() {
    let bench = Bench::new();
    for rate_hz in [100, 101, 44_101, 767_999, 768_000] {
        bench.write("a.wav", recording(rate_hz));
        let output = within_memory(&bench, "fit a.wav --out a.lib");
        let message = text(&output.stderr);
        // A fraction of a second is too short for a fit, which the command reports in one line.
        let ended = output.status.code();
        assert!(matches!(ended, Some(0 | 2)), "{rate_hz} Hz\n{message}");
        assert!(!message.contains("sample rate of"), "{message}");
    }
}

#[cfg(target_os = "linux")]
#[test]
fn sizes_in_a_wav_header_size_no_memory() {
    let bench = Bench::new();
    let good = recording(RATE_HZ);
    let data = good
        .windows(4)
        .position(|four| four == b"data")
        .expect("it has samples");
    let changed = |at: usize, bytes: &[u8]| {
        let mut changed = good.clone();
        changed[at..at + bytes.len()].copy_from_slice(bytes);
        changed
    };
    let length = 0xffff_fff0u32.to_le_bytes();
    let list = [&good[..data], b"LIST", &length, b"INFOISFT", &length, &good[data..]].concat();
    let mut endless = changed(4, &[255; 4]);
    endless[data + 4..data + 8].copy_from_slice(&[255, 255, 255, 63]);
    for (name, bytes, words) in [
        ("channels", changed(22, &[255, 255]), "65535 channels"),
        ("none", changed(22, &[0, 0]), "0 channels"),
        ("list", list, "'LIST' of 4294967280 bytes"),
        ("length", endless, "truncated"),
    ] {
        bench.write(&format!("{name}.wav"), bytes);
        let message = refuse_within_memory(&bench, &format!("fit {name}.wav --out a.lib"));
        holds(&message, &[name, words]);
    }
    // Other chunks in the file are permitted: a recording with titles can be read.
    let title = b"LIST\x04\0\0\0INFOjunk\x03\0\0\0abc\0";
    let titled = [&good[..data], title, &good[data..]];
    bench.write("titled.wav", titled.concat());
    bench.succeed("fit titled.wav --out a.lib");
}

#[cfg(unix)]
#[test]
fn files_are_read_up_to_the_size_of_their_kind() {
    let bench = fitted();
    let grow = |name: &str, bytes: u64| {
        let file = std::fs::File::create(bench.path(name)).expect("there is room for a name");
        file.set_len(bytes).expect("the file is sparse");
    };
    grow("long.toml", 2 << 20);
    grow("long.lib", 1 << 33);
    grow("long.csv", 1 << 33);
    grow("long.xml", 1 << 33);
    grow("good.lib.fit.json", 1 << 33);
    for name in ["long.wav", "long"] {
        std::os::unix::fs::symlink("/dev/zero", bench.path(name)).expect("there is room");
    }
    bench.refuse_each(
        "scene check long.toml --library good.lib | long.toml | bytes, the most of
        page good.lib --plant long.toml --out a.html | long.toml | bytes, the most of
        simulate-rig --rig long.toml --out rig | long.toml | bytes, the most of
        inspect long.lib | long.lib | bytes, the most of
        fit long.csv --sample-rate 5000 --out a.lib | long.csv | bytes, the most of
        import-hatt long.xml --out a.lib | long.xml | bytes, the most of
        evaluate set --library good.lib | good.lib.fit.json | bytes, the most of
        render good.lib --texture silk --motion long.csv --out a.wav | long.csv | bytes, the most of",
    );
    // An input that does not end is read up to the limit, or not at all.
    bench.refuse_each(
        "inspect long | the most of a library
        fit long.wav --out o.lib | is a device",
    );
}

/// Characters that control a terminal: a colour, a C1 control sequence, deletion, and reversed text.
const OBEYED: &str = "a\u{1b}[31m\u{9b}2J\u{7f}\u{202e}z";

/// Runs `stylus` with these arguments, and returns all that it printed. Checks that no control character is in it.
fn shown(bench: &Bench, arguments: &[&str]) -> String {
    let child = bench.spawn(arguments.iter().copied());
    let output = child.wait_with_output().expect("it ends");
    let all = text(&output.stdout) + &text(&output.stderr);
    let is_obeyed = |c: char| c.is_control() && c != '\n' || ('\u{202a}'..='\u{202e}').contains(&c);
    assert!(!all.contains(is_obeyed), "{all:?}");
    all
}

#[test]
fn characters_that_a_terminal_obeys_are_shown_wherever_they_come_from() {
    let bench = fitted();
    let file = format!("{OBEYED}.lib");
    let along = "render good.lib --speed 1 --force 1 --seconds 1 --out a.wav --texture";
    let render: Vec<&str> = along.split(' ').chain([OBEYED]).collect();
    for (arguments, words) in [
        (&["inspect", &file][..], "\\u{1b}[31m"),
        (&["inspect", OBEYED, OBEYED], "unexpected argument"),
        (&[OBEYED], "unrecognized subcommand"),
        (&["status", "--link", OBEYED], "is not an address"),
        (&render, "\\u{202e}z"),
    ] {
        holds(&shown(&bench, arguments), &[words]);
    }
    for (trial, words) in [
        (format!("{OBEYED}.wav,silk"), "\\u{9b}2J"),
        (format!("a.wav,{OBEYED}"), "control character"),
    ] {
        bench.write("set/trials.csv", format!("{HEADER}{trial},100,1,\n"));
        holds(&shown(&bench, &["fit", "set", "--out", "a.lib"]), &[words]);
    }
    bench.write("a.csv", format!("x\n1\n{OBEYED}\n"));
    let read = ["fit", "a.csv", "--sample-rate", "5000", "--out", "a.lib"];
    assert!(shown(&bench, &read).contains("\\u{7f}"));
}

/// Runs `stylus` with closed pipes as the chosen outputs.
fn with_closed(bench: &Bench, arguments: &str, out: bool, err: bool) -> Output {
    let closed = || {
        let (reader, writer) = std::io::pipe().expect("there is a pipe");
        drop(reader);
        Stdio::from(writer)
    };
    Command::new(env!("CARGO_BIN_EXE_stylus"))
        .args(arguments.split_whitespace())
        .current_dir(bench.path("."))
        .stdout(if out { closed() } else { Stdio::piped() })
        .stderr(if err { closed() } else { Stdio::piped() })
        .spawn()
        .expect("the command starts")
        .wait_with_output()
        .expect("it ends")
}

#[test]
fn closed_outputs_are_no_panic_and_the_exit_code_says_what_was_lost() {
    let bench = fitted();
    let code = |arguments: &str, out, err| {
        let output = with_closed(&bench, arguments, out, err);
        let message = text(&output.stderr);
        assert!(!message.contains("panicked"), "{message}");
        output.status.code()
    };
    let inspect = ["inspect good.lib", "inspect good.lib --json"];
    for arguments in inspect.into_iter().chain(["--help", "--version"]) {
        assert_eq!(code(arguments, false, true), Some(0), "{arguments}");
        assert_eq!(code(arguments, true, false), Some(1), "{arguments}");
        assert_eq!(code(arguments, true, true), Some(1), "{arguments}");
    }
    for arguments in ["inspect nowhere.lib", "nothing", "inspect"] {
        assert_eq!(code(arguments, false, true), Some(2), "{arguments}");
        assert_eq!(code(arguments, true, true), Some(2), "{arguments}");
    }
    // If nobody can read the warnings, the result is still written.
    let render = "render good.lib --texture silk --speed 100 --force 1 --seconds 1 --pcm16 0.001 --out loud.wav";
    assert!(text(&bench.run(render).stderr).contains("warning"));
    std::fs::remove_file(bench.path("loud.wav")).unwrap();
    assert_eq!(code(render, false, true), Some(0));
    assert!(bench.path("loud.wav").exists());
}
