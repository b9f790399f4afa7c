//! Outputs: what commands never replace, when they report that, and what is left if they are interrupted.

use std::collections::BTreeMap;
use std::fs;
use std::os::unix::fs::symlink;
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use crate::hatt;
use crate::pages;
use crate::support::{Bench, RATE_HZ, holds, noise, refusal, rig_of, signal as send, text, two_textures};

/// Commands that write a file; `{}` stands for its name.
const FILES: [&str; 11] = [
    "fit set --order 4 --out {}",
    "render good.lib --texture silk --speed 100 --force 1 --seconds 1 --out {}",
    "scene compile scene.toml --library good.lib --out {}",
    "scene render scene.toml --library good.lib --speed 50 --force 1 --seconds 1 --out {}",
    "import-hatt cork.xml --out {}",
    "page good.lib --out {}",
    "compare set --library good.lib --trials 1 --segment 0.3 --out {}",
    "evaluate set --library good.lib --synthesis 2 --json-out {}",
    "record {} --strokes --link tcp:127.0.0.1:9",
    "selftest --link tcp:127.0.0.1:9 --record {}",
    "calibrate --response --yes --link tcp:127.0.0.1:9 --svg {}",
];

/// Number of commands at the beginning of [`FILES`] that take little time and need no device.
const QUICK: usize = 5;

/// Commands that write a folder; `{}` stands for its name.
const FOLDERS: [&str; 2] = [
    "simulate-rig --rig rig.toml --out {}",
    "frontier --data set --orders 4 --out {}",
];

/// A stroke with a steady speed and force.
fn stroke(seconds: usize) -> String {
    let mut csv = String::from("# SIMULATED\ntime_s,x_m_s2,speed_mm_s,force_n\n");
    for (n, x) in noise(7, seconds * RATE_HZ as usize).iter().enumerate() {
        let time_s = n as f64 / f64::from(RATE_HZ);
        csv.push_str(&format!("{time_s:.4},{x:.5},100,0.6\n"));
    }
    csv
}

/// A folder with the inputs of all commands.
fn inputs() -> Bench {
    let bench = two_textures(|signal| [signal.to_vec()]);
    bench.succeed("fit set --out good.lib --order 4");
    bench.write("cork.xml", hatt::whole());
    let scene = "name = \"one\"\n[[surface]]\ntexture = \"silk\"\n";
    bench.write("scene.toml", scene);
    bench.write("stroke.csv", stroke(3));
    bench.write("rig.toml", rig_of("60, 180", "0.5, 1.0"));
    bench.careful()
}

pub fn make_pipe(path: &Path) {
    let made = Command::new("mkfifo").arg(path).status();
    assert!(made.expect("mkfifo is there").success());
}

/// Everything below `folder`: the bytes of files, and links as links.
fn content(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut all = BTreeMap::new();
    let mut folders = vec![folder.to_owned()];
    while let Some(inner) = folders.pop() {
        for entry in fs::read_dir(&inner).unwrap() {
            let path = entry.unwrap().path();
            let kind = fs::symlink_metadata(&path).unwrap().file_type();
            let name = path.strip_prefix(folder).unwrap().display().to_string();
            let bytes = if kind.is_dir() {
                folders.push(path);
                b"folder".to_vec()
            } else if kind.is_symlink() {
                fs::read_link(&path).unwrap().into_os_string().into_encoded_bytes()
            } else if kind.is_file() {
                fs::read(&path).unwrap()
            } else {
                b"special".to_vec()
            };
            all.insert(name, bytes);
        }
    }
    all
}

/// Runs `command` with the output `name`. It must be refused in a line with this word, and change nothing.
fn refuse(bench: &Bench, command: &str, name: &str, word: &str) {
    let before = content(&bench.path("."));
    let arguments = command.replace("{}", name);
    let message = bench.refuse(&arguments);
    holds(&message, &[name, word]);
    assert!(!message.contains(".stylus-"), "{message}");
    assert_eq!(content(&bench.path(".")), before, "stylus {arguments}");
}

#[test]
fn the_rule_of_outputs_holds_for_every_command_before_its_work() {
    let bench = inputs();
    make_pipe(&bench.path("pipe"));
    symlink("nothing", bench.path("dangling")).unwrap();
    bench.write("diary", "today\n");
    bench.write("mine/notes.txt", "mine\n");
    for command in FILES {
        for (name, word) in [
            ("pipe", "is a pipe"),
            ("dangling", "not there"),
            ("nowhere/o", "there is no folder nowhere: make it"),
            ("diary/o", "is a file and no folder"),
            ("page/", "names a folder"),
            ("diary", "--overwrite"),
        ] {
            refuse(&bench, command, name, word);
        }
        if !command.contains("--record") {
            refuse(&bench, command, "mine", "is a folder");
        }
    }
    for command in FOLDERS {
        for (name, word) in [
            ("diary", "is no folder"),
            ("diary/o", "is a file and no folder"),
            ("nowhere/o", "there is no folder"),
            ("mine", "notes.txt"),
        ] {
            refuse(&bench, command, name, word);
        }
    }
    refuse(&bench, "demo --out {}", "mine", "notes.txt");
}

#[test]
fn an_output_that_is_an_input_is_refused_under_every_name_of_it() {
    let bench = inputs();
    fs::hard_link(bench.path("good.lib"), bench.path("hard.lib")).unwrap();
    symlink("good.lib", bench.path("soft.lib")).unwrap();
    fs::hard_link(bench.path("set/silk-50-0.5.wav"), bench.path("hard.wav")).unwrap();
    let render = FILES[1];
    for (command, name) in [
        (render, "good.lib"),
        (render, "set/../good.lib"),
        (render, "hard.lib"),
        (render, "soft.lib"),
        ("fit hard.wav --out {}", "set/silk-50-0.5.wav"),
    ] {
        let command = format!("{command} --overwrite");
        refuse(&bench, &command, name, "is an input");
    }
    // This command adds scenes to the library in place, which is its purpose.
    let compile = FILES[2].replace("{}", "good.lib");
    bench.succeed(&format!("{compile} --overwrite"));
}

/// Commands that write a file, for whose name `{}` stands. Each has all options that read something.
const READERS: [&str; 13] = [
    "fit set --parts parts --out {}",
    "render good.lib --texture silk --motion stroke.csv --plant plant.toml --out {}",
    "export good.lib --texture silk --motion stroke.csv --format wav --out {}",
    "scene compile scene.toml --library good.lib --out {}",
    "scene render scene.toml --library good.lib --motion stroke.csv --plant plant.toml --out {}",
    "import-hatt models cork.xml --out {}",
    "join good.lib cork.lib --out {}",
    "page good.lib --recordings set --plant plant.toml --out {}",
    "compare set --library good.lib --takes other --before cork.lib --out {}",
    "evaluate set --library good.lib --takes other --json-out {}",
    "evaluate stroke.csv --library good.lib --strokes hand.csv --json-out {}",
    "trials set --pattern {texture}-{speed}-{force}.wav --list {}",
    "trials set --pattern {texture}-{speed}-0.5.wav --force 0.5 --list {}",
];

/// Commands that write a folder, for whose name `{}` stands. Each has all options that read something.
const FOLDER_READERS: [&str; 3] = [
    "simulate-rig --rig rig.toml --out {}",
    "frontier --data set --takes other --out {}",
    "evaluate set --library good.lib --takes other --report {}",
];

/// The files that `command` names, and those in the folders that it names, except those that it is meant to change.
fn inputs_of(bench: &Bench, command: &str) -> Vec<String> {
    let words = command.split(' ').map(|word| word.rsplit('=').next().unwrap_or(word));
    let files = |word: &str| match fs::read_dir(bench.path(word)) {
        Ok(entries) => entries
            .map(|entry| entry.unwrap().file_name().into_string().unwrap())
            .map(|name| format!("{word}/{name}"))
            .collect(),
        Err(_) => vec![word.to_owned()],
    };
    let is_changed = |name: &str| match command.split(' ').next() {
        Some("trials") => name == "set/trials.csv",
        Some("scene") => command.starts_with("scene compile") && name == "good.lib",
        _ => false,
    };
    words
        .filter(|word| bench.path(word).exists())
        .flat_map(files)
        .filter(|name| !is_changed(name))
        .collect()
}

#[test]
fn no_input_of_any_command_is_replaced_by_its_output() {
    let bench = inputs();
    for name in "plant.toml parts/a.part models/b.xml cork.lib hand.csv".split(' ') {
        bench.write(name, "mine\n");
    }
    bench.write_set("other", &[("silk", 50.0, 1.0, b"mine".to_vec())]);
    for command in READERS {
        let inputs = inputs_of(&bench, command);
        assert!(!inputs.is_empty(), "{command}");
        for name in inputs {
            let command = format!("{command} --overwrite");
            // This command writes a list in the folder of the recordings.
            let out = if command.starts_with("trials") {
                name.trim_start_matches("set/")
            } else {
                &name
            };
            refuse(&bench, &command, out, "is an input");
        }
    }
    for command in FOLDER_READERS {
        let command = format!("{command} --overwrite");
        refuse(&bench, &command, ".", "holds an input");
    }
    // With --each the libraries are written to a folder that may exist already.
    let list = "file,texture,speed_mm_s,force_n\nlibs/silk.lib,silk,50,1\n";
    bench.write("each.csv", list);
    bench.write("libs/silk.lib", bench.read("set/silk-50-0.5.wav"));
    let each = "fit each.csv --each --out libs";
    refuse(&bench, each, "libs/silk.lib", "is an input");
    // Recordings and their list are also written to such a folder.
    bench.write("libs/trials.csv", "speed_mm_s,force_n\n50,1\n");
    let record = "record libs --texture felt --yes --trials libs/trials.csv --link tcp:127.0.0.1:9";
    refuse(&bench, record, "libs/trials.csv", "is an input");
    // A list is written over the previous one, whatever its name.
    let list = "trials set --pattern {texture}-{speed}-{force}.wav --overwrite --list";
    for name in ["trials.csv", "takes.csv", "takes.csv"] {
        bench.succeed(&format!("{list} {name}"));
    }
}

#[test]
fn every_command_that_writes_is_among_those_whose_inputs_are_tried() {
    let bench = Bench::new();
    let mut commands = vec![String::new()];
    let mut writing = 0;
    while let Some(command) = commands.pop() {
        let help = bench.succeed(&format!("{command} --help"));
        let names = pages::commands(&help).into_iter();
        commands.extend(names.map(|name| format!("{command} {name}").trim().to_owned()));
        if (help.contains("--out <") || help.contains("--list <")) && command != "demo" {
            let is_of = |known: &&&str| known.starts_with(&command);
            let mut known = READERS.iter().chain(&FOLDER_READERS);
            assert!(known.find(is_of).is_some(), "{command}");
            writing += 1;
        }
    }
    assert!(writing >= 12, "{writing}");
}

#[test]
fn what_is_there_is_replaced_where_that_is_asked_for_and_a_link_is_followed() {
    let bench = inputs();
    fs::create_dir(bench.path("deep")).unwrap();
    symlink("deep/there", bench.path("link")).unwrap();
    for command in &FILES[..QUICK] {
        bench.write("deep/there", "");
        let arguments = command.replace("{}", "link");
        bench.succeed(&arguments);
        let first = bench.read("deep/there");
        assert!(bench.path("link").is_symlink() && !first.is_empty());
        refuse(&bench, command, "link", "--overwrite");
        bench.succeed(&format!("{arguments} --overwrite"));
        assert_eq!(bench.read("deep/there"), first);
    }
}

/// Starts `stylus`, with the signal handling that `env` sets, independent of how the tests were started.
fn start(bench: &Bench, env: &str, arguments: &str) -> Child {
    let script = format!("exec env {env} \"$0\" \"$@\"");
    Command::new("sh")
        .args(["-c", &script, env!("CARGO_BIN_EXE_stylus")])
        .args(arguments.split_whitespace())
        .current_dir(bench.path("."))
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .expect("the command starts")
}

/// Returns true if a folder or file with a temporary's name lies in the folder of `bench`.
fn has_begun(bench: &Bench) -> bool {
    let mut names = bench.names().into_iter();
    names.any(|name| name.starts_with(".stylus-"))
}

/// Runs `arguments` and sends `signal` as soon as the command has begun to write, or after the time `after`. Returns
/// the signal that ended the command.
fn signalled(bench: &Bench, (env, arguments): (&str, &str), signal: &str, after: Option<Duration>) -> Option<i32> {
    let mut child = start(bench, env, arguments);
    let begin = Instant::now();
    let is_time = || match after {
        Some(after) => begin.elapsed() >= after,
        None => has_begun(bench),
    };
    while !is_time() && child.try_wait().unwrap().is_none() {
        let is_late = begin.elapsed() > Duration::from_mins(10);
        assert!(!is_late, "{arguments} does not begin");
        thread::sleep(Duration::from_micros(200));
    }
    send(signal.trim_start_matches('-'), child.id());
    std::os::unix::process::ExitStatusExt::signal(&child.wait().unwrap())
}

const RENDER: &str = "render good.lib --texture silk --speed 100 --force 1 --seconds 600 --out out";

/// Returns the signal that ended the rendering `arguments`, to which `signal` is sent as soon as it has begun to write.
/// The rendering is repeated, each time after `prepare`, if a busy computer has sent the signal after its end.
fn rendering_ended_by(bench: &Bench, env: &str, arguments: &str, signal: &str, prepare: impl Fn()) -> Option<i32> {
    (0..100).find_map(|_| {
        prepare();
        signalled(bench, (env, arguments), signal, None)
    })
}

/// At any moment the output is complete or missing, and an earlier result stays.
#[test]
fn an_interrupt_leaves_all_or_nothing_and_no_hidden_file() {
    let bench = inputs();
    let as_ever = "--default-signal=INT,TERM,HUP";
    let simulate = "simulate-rig --rig rig.toml --out out";
    let begin = Instant::now();
    bench.succeed(simulate);
    let long = begin.elapsed();
    fs::remove_dir_all(bench.path("out")).unwrap();
    for (command, signal, number, after) in [
        (RENDER, "-INT", 2, None),
        (RENDER, "-TERM", 15, None),
        (RENDER, "-HUP", 1, None),
        ("demo --out out", "-INT", 2, None),
        (simulate, "-TERM", 15, Some(long / 4)),
        (simulate, "-TERM", 15, Some(long / 2)),
        (simulate, "-TERM", 15, Some(long * 3 / 4)),
        (simulate, "-TERM", 15, Some(long)),
    ] {
        let before = content(&bench.path("."));
        let ended_by = if command == RENDER {
            rendering_ended_by(&bench, as_ever, command, signal, || {
                let _ = fs::remove_file(bench.path("out"));
            })
        } else {
            signalled(&bench, (as_ever, command), signal, after)
        };
        assert!(!has_begun(&bench), "{command}");
        if ended_by.is_some() {
            assert_eq!(ended_by, Some(number), "{command}");
            assert_eq!(content(&bench.path(".")), before, "{command} {signal}");
        } else {
            assert!(command != RENDER, "no signal ends it");
        }
        let _ = fs::remove_dir_all(bench.path("out"));
    }
    let again = format!("{RENDER} --overwrite");
    let earlier = || bench.write("out", "earlier\n");
    let ended_by = rendering_ended_by(&bench, as_ever, &again, "-INT", earlier);
    assert_eq!(ended_by, Some(2));
    assert_eq!(bench.read("out"), b"earlier\n");
}

/// The command is started like by `nohup`: it must not end when the terminal closes.
#[test]
fn a_command_that_was_started_without_the_hang_up_signal_goes_on_after_it() {
    let bench = inputs();
    let ended_by = signalled(&bench, ("--ignore-signal=HUP", RENDER), "-HUP", None);
    assert_eq!(ended_by, None);
    assert!(bench.path("out").is_file() && !has_begun(&bench));
}

/// Runs `stylus` with files limited to `blocks` blocks of 512 bytes, as on a full disk. The signal at the limit keeps
/// its default action.
fn on_a_full_disk(bench: &Bench, blocks: u32, arguments: &str) -> Output {
    let script = format!("ulimit -f {blocks}; exec \"$0\" {arguments}");
    Command::new("sh")
        .args(["-c", &script, env!("CARGO_BIN_EXE_stylus")])
        .current_dir(bench.path("."))
        .output()
        .expect("there is a shell")
}

#[test]
fn help_that_cannot_be_written_says_why() {
    let bench = Bench::new();
    // The signal at the limit is ignored, so that the write itself fails.
    let script = "trap '' XFSZ; ulimit -f 0; exec \"$0\" --help > help.txt";
    let output = Command::new("sh")
        .args(["-c", script, env!("CARGO_BIN_EXE_stylus")])
        .current_dir(bench.path("."))
        .output()
        .expect("there is a shell");
    holds(&refusal(&output, "--help"), &["standard output: cannot write"]);
}

#[test]
fn a_full_disk_leaves_nothing_and_the_line_names_the_users_file() {
    let bench = inputs();
    for (command, blocks) in [
        (FILES[0], 1),
        (FILES[1], 1),
        (FILES[5], 1),
        (FOLDERS[0], 2),
        (FOLDERS[1], 1),
    ] {
        let before = content(&bench.path("."));
        let arguments = command.replace("{}", "out.svg");
        let output = on_a_full_disk(&bench, blocks, &arguments);
        let errors = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{arguments}: {errors}");
        let message = errors.lines().last().unwrap_or_default();
        holds(message, &["out.svg"]);
        assert!(!message.contains(".stylus-"), "{message}");
        assert!(message.contains("too large") || message.contains("cannot"), "{message}");
        assert_eq!(content(&bench.path(".")), before, "{arguments}");
    }
}
