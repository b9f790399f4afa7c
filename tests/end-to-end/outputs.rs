//! Outputs: what they never replace, when a command says so, and what is left where it is broken off.

use std::collections::BTreeMap;
use std::fs;
use std::os::unix::fs::{FileTypeExt, PermissionsExt, symlink};
use std::os::unix::net::UnixListener;
use std::path::Path;
use std::process::{Child, Command, Output, Stdio};
use std::thread;
use std::time::{Duration, Instant};

use crate::hatt;
use crate::support::{Bench, RATE_HZ, noise, refusal, text, two_textures};

/// Commands with a file to write, `{}`.
const FILES: [&str; 13] = [
    "fit set --order 4 --out {}",
    "evaluate set --library good.lib --synthesis 2 --json {}",
    "evaluate set --leave-one-out --order 4 --json {}",
    "compare set --library good.lib --trials 1 --segment 0.3 --out {}",
    "import-hatt cork.xml --out {}",
    "resample good.lib --rate 10000 --out {}",
    "render good.lib --texture silk --speed 100 --force 1 --seconds 1 --out {}",
    "scene compile scene.toml --library good.lib --out {}",
    "scene render scene.toml --library good.lib --speed 50 --force 1 --seconds 1 --out {}",
    "scene plot scene.toml --library good.lib --speed 50 --force 1 --seconds 1 --out {}",
    "record-strokes {} --again --link tcp:127.0.0.1:9",
    "selftest --link tcp:127.0.0.1:9 --record {}",
    "page good.lib --out {}",
];

/// Commands with a folder to write.
const FOLDERS: [&str; 9] = [
    "simulate-rig --rig rig.toml --out {}",
    "segment stroke.csv --texture felt --out {}",
    "demo --out {}",
    "frontier --data set --orders 4 --out {}",
    "evaluate set --library good.lib --synthesis 2 --report {}",
    "fit set --order 4 --each --out {}",
    "fit set --order 4 --shard 1/1 --parts {}",
    "man --out {}",
    "record {} --texture silk --speeds 50 --forces 1 --link tcp:127.0.0.1:9",
];

/// Options and arguments that name an output, by command: all of [`FILES`] and [`FOLDERS`].
const OUTPUT_OPTIONS: [&str; 3] = ["--out", "--json", "--report"];

/// A stroke that is steady at one speed and force.
fn stroke(seconds: usize) -> String {
    let mut csv = String::from("# SIMULATED\ntime_s,x_m_s2,speed_mm_s,force_n\n");
    let samples = noise(7, seconds * RATE_HZ as usize);
    for (n, x) in samples.iter().enumerate() {
        let time_s = n as f64 / f64::from(RATE_HZ);
        csv.push_str(&format!("{time_s:.4},{x:.5},100,0.6\n"));
    }
    csv
}

/// A rig of so many speeds.
fn rig(bench: &Bench, speeds: &str) -> String {
    let lines = bench.succeed("simulate-rig --print-rig");
    let lines = lines
        .lines()
        .map(|line| match line.split('=').next().unwrap_or("").trim() {
            "speeds_mm_s" => format!("speeds_mm_s = [{speeds}]\n"),
            "forces_n" => "forces_n = [0.5, 1.0]\n".to_owned(),
            _ => format!("{line}\n"),
        });
    lines.collect()
}

/// A folder with all inputs of the commands.
fn inputs() -> Bench {
    let bench = two_textures(|signal| [signal.to_vec()]);
    bench.succeed("fit set --out good.lib --order 4");
    bench.write("cork.xml", hatt::whole());
    bench.write(
        "scene.toml",
        "name = \"one\"\n[[surface]]\ntexture = \"silk\"\n",
    );
    bench.write("stroke.csv", stroke(3));
    bench.write("rig.toml", rig(&bench, "60, 180"));
    bench
}

fn make_pipe(path: &Path) {
    let made = Command::new("mkfifo").arg(path).status();
    assert!(made.expect("mkfifo is there").success());
}

/// All that is below `folder`, with the bytes of files, and links as they are.
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
                fs::read_link(&path)
                    .unwrap()
                    .into_os_string()
                    .into_encoded_bytes()
            } else if kind.is_file() {
                fs::read(&path).unwrap()
            } else {
                assert!(kind.is_fifo() || kind.is_socket());
                b"special".to_vec()
            };
            all.insert(name, bytes);
        }
    }
    all
}

/// Runs `command` with the output `name`, which must be refused in a line with these words and change nothing.
fn refuse(bench: &Bench, command: &str, name: &str, words: &[&str]) {
    let before = content(&bench.path("."));
    let arguments = command.replace("{}", name);
    let message = bench.refuse(&arguments);
    for word in words {
        assert!(message.contains(word), "stylus {arguments}\n{message}");
    }
    assert!(!message.contains(".stylus-"), "{message}");
    assert_eq!(content(&bench.path(".")), before, "stylus {arguments}");
}

#[test]
fn nothing_but_a_regular_file_or_a_folder_is_replaced() {
    let bench = inputs();
    make_pipe(&bench.path("pipe"));
    let _socket = UnixListener::bind(bench.path("socket")).unwrap();
    fs::create_dir(bench.path("folder")).unwrap();
    symlink("pipe", bench.path("to-pipe")).unwrap();
    symlink("nothing", bench.path("dangling")).unwrap();
    bench.write("diary", "today\n");
    for command in FILES {
        for (name, word) in [
            ("pipe", "is a pipe"),
            ("socket", "is a socket"),
            ("to-pipe", "is a pipe"),
            ("dangling", "not there"),
        ] {
            refuse(&bench, command, name, &[name, word]);
        }
        if !command.contains("--record") {
            refuse(&bench, command, "folder", &["folder", "is a folder"]);
        }
    }
    for command in FOLDERS {
        for name in ["pipe", "socket", "to-pipe", "diary"] {
            refuse(&bench, command, name, &[name, "is no folder"]);
        }
        refuse(&bench, command, "dangling", &["dangling", "not there"]);
        refuse(
            &bench,
            command,
            "diary/inner",
            &["diary/inner", "lies in a file"],
        );
    }
}

#[test]
fn an_output_that_is_an_input_is_refused_under_every_name_of_it() {
    let bench = inputs();
    bench.write("response.csv", "frequency_hz,magnitude_db\n10,0\n1000,0\n");
    bench.write(
        "scene.toml",
        "name = \"one\"\n[[surface]]\ntexture = \"silk\"\n[equaliser]\nresponse = \"response.csv\"\n",
    );
    fs::hard_link(bench.path("good.lib"), bench.path("hard.lib")).unwrap();
    symlink("good.lib", bench.path("soft.lib")).unwrap();
    fs::hard_link(bench.path("set/silk-50-0.5.wav"), bench.path("hard.wav")).unwrap();
    let whole = bench.path("good.lib").display().to_string();
    for name in [
        "good.lib",
        "./good.lib",
        "set/../good.lib",
        "hard.lib",
        "soft.lib",
        &whole,
    ] {
        for command in [FILES[1], FILES[3], FILES[5], FILES[6], FILES[8], FILES[9]] {
            let overwriting = format!("{command} --overwrite");
            refuse(&bench, command, name, &["is an input"]);
            refuse(&bench, &overwriting, name, &["is an input"]);
        }
    }
    for (command, name) in [
        (FILES[0], "set/silk-50-0.5.wav"),
        (FILES[0], "hard.wav"),
        (FILES[0], "set/trials.csv"),
        ("fit set/trials.csv --out {}", "set/felt-50-1.wav"),
        ("fit hard.wav --out {}", "set/silk-50-0.5.wav"),
        (FILES[1], "good.lib.fit.json"),
        (FILES[4], "cork.xml"),
        ("import-hatt . --out {}", "cork.xml"),
        (FILES[7], "scene.toml"),
        (FILES[8], "response.csv"),
        (FILES[9], "response.csv"),
    ] {
        refuse(
            &bench,
            &format!("{command} --overwrite"),
            name,
            &["is an input"],
        );
    }
    refuse(
        &bench,
        "evaluate set --library good.lib --json both --report {}",
        "both",
        &["two outputs"],
    );
    // A library gets its scenes in place: that is what the command is for.
    bench.write(
        "scene.toml",
        "name = \"one\"\n[[surface]]\ntexture = \"silk\"\n",
    );
    bench.succeed("scene compile scene.toml --library good.lib --out good.lib");
}

#[test]
fn a_file_of_another_kind_is_replaced_only_where_that_is_asked_for() {
    let bench = inputs();
    bench.write("empty", "");
    let kinds: [(&str, &[u8]); 8] = [
        (
            "a texture library",
            &fs::read(bench.path("good.lib")).unwrap(),
        ),
        (
            "a WAV recording",
            &fs::read(bench.path("set/silk-50-0.5.wav")).unwrap(),
        ),
        ("a JSON file", b"{\"a\": 1}"),
        ("an HTML page", b"<!doctype html>\n<title>mine</title>"),
        (
            "an SVG picture",
            b"<svg xmlns=\"http://www.w3.org/2000/svg\"/>",
        ),
        ("a table (CSV)", b"a,b\n1,2\n"),
        ("a TOML file", b"[mine]\na = 1\n"),
        ("something of another kind", b"today\n"),
    ];
    let mut own = 0;
    for command in FILES {
        for (kind, bytes) in &kinds {
            bench.write("there.svg", bytes);
            if kind_of(command) == *kind {
                own += 1;
            } else {
                refuse(
                    &bench,
                    command,
                    "there.svg",
                    &["there.svg", kind, "name another file"],
                );
            }
        }
    }
    assert_eq!(own, FILES.len());
    for command in [FILES[0], FILES[4], FILES[5], FILES[6], FILES[7], FILES[8]] {
        for there in ["there.svg", "empty.svg", "new.svg"] {
            bench.write("there.svg", "today\n");
            bench.write("empty.svg", "");
            let arguments = command.replace("{}", there);
            let option = if there == "there.svg" {
                " --overwrite"
            } else {
                ""
            };
            bench.succeed(&format!("{arguments}{option}"));
            // Of the kind now, it is replaced as ever.
            bench.succeed(&arguments);
            fs::remove_file(bench.path(there)).unwrap();
            let _ = fs::remove_file(bench.path(&format!("{there}.fit.json")));
        }
    }
    // The record that comes with a library is an output too.
    bench.write("new.lib.fit.json", "today\n");
    refuse(
        &bench,
        FILES[0],
        "new.lib",
        &["new.lib.fit.json", "another kind"],
    );
    bench.write("locked.wav", "");
    let read_only = fs::Permissions::from_mode(0o444);
    fs::set_permissions(bench.path("locked.wav"), read_only).unwrap();
    refuse(&bench, FILES[6], "locked.wav", &["must not be written"]);
}

/// Kind of file that a command of [`FILES`] writes, in its own words.
fn kind_of(command: &str) -> &'static str {
    match command.split_whitespace().next().unwrap() {
        "evaluate" | "selftest" => "a JSON file",
        "compare" | "page" => "an HTML page",
        "render" => "a WAV recording",
        "record-strokes" => "a table (CSV)",
        _ if command.starts_with("scene render") => "a WAV recording",
        _ if command.starts_with("scene plot") => "an SVG picture",
        _ => "a texture library",
    }
}

#[test]
fn a_link_to_a_file_is_followed_and_stays() {
    let bench = inputs();
    fs::create_dir(bench.path("deep")).unwrap();
    bench.write("deep/a.wav", "");
    symlink("deep/a.wav", bench.path("link.wav")).unwrap();
    bench.succeed(&FILES[6].replace("{}", "link.wav"));
    assert!(bench.path("link.wav").is_symlink());
    assert!(
        fs::read(bench.path("deep/a.wav"))
            .unwrap()
            .starts_with(b"RIFF")
    );
}

/// Inputs that are not there would be an error of their own: the output is known to be wrong before they are looked at.
#[test]
fn a_place_that_takes_no_output_is_named_before_the_work_with_the_remedy() {
    let bench = Bench::new();
    bench.write("diary", "today\n");
    for command in FILES {
        refuse(
            &bench,
            command,
            "nowhere/deep/o.svg",
            &[
                "nowhere/deep/o.svg",
                "there is no folder nowhere/deep: make it",
            ],
        );
        refuse(
            &bench,
            command,
            "diary/o.svg",
            &["diary/o.svg", "is a file and no folder"],
        );
    }
    for command in FOLDERS {
        refuse(&bench, command, "diary", &["diary", "is no folder"]);
    }
}

/// Every option of every command that is called an output is tried here.
#[test]
fn every_output_option_is_among_those_that_are_tried() {
    let bench = Bench::new();
    let tried: Vec<&str> = FILES.into_iter().chain(FOLDERS).collect();
    let commands = |help: &str| -> Vec<String> {
        let lines = help.lines().skip_while(|line| *line != "Commands:").skip(1);
        let names = lines.map_while(|line| line.strip_prefix("  ")?.split_whitespace().next());
        names
            .filter(|name| *name != "help")
            .map(str::to_owned)
            .collect()
    };
    let mut names = commands(&bench.succeed("--help"));
    let inner = commands(&bench.succeed("scene --help"));
    names.extend(inner.iter().map(|name| format!("scene {name}")));
    let mut found = 0;
    for name in names.iter().filter(|name| *name != "scene") {
        let help = bench.succeed(&format!("{name} --help"));
        for option in OUTPUT_OPTIONS {
            let with_a_path = format!("{option} <");
            if help.contains(&with_a_path) {
                let is_tried = |command: &&str| {
                    command.starts_with(&format!("{name} "))
                        && command.contains(&format!("{option} {{}}"))
                };
                assert!(tried.iter().any(is_tried), "stylus {name} {option}");
                found += 1;
            }
        }
    }
    assert!(found >= 16, "{found}");
}

#[test]
fn a_folder_with_other_files_is_not_emptied_and_nothing_is_mixed_into_it() {
    let bench = inputs();
    bench.write("mine/notes.txt", "mine\n");
    for command in FOLDERS
        .iter()
        .filter(|command| !command.contains("--parts"))
    {
        refuse(&bench, command, "mine", &["mine", "notes.txt"]);
        refuse(&bench, command, "mine/", &["notes.txt"]);
    }
    for command in [FOLDERS[0], FOLDERS[1], FOLDERS[4], FOLDERS[5]] {
        bench.succeed(&command.replace("{}", "out"));
        bench.write("out/notes.txt", "mine\n");
        refuse(&bench, command, "out", &["notes.txt"]);
        fs::remove_dir_all(bench.path("out")).unwrap();
    }
}

#[test]
fn the_same_command_run_twice_replaces_its_own_result() {
    let bench = inputs();
    for command in [FOLDERS[0], FOLDERS[4], FOLDERS[5]] {
        let arguments = command.replace("{}", "out");
        bench.succeed(&arguments);
        let first = content(&bench.path("out"));
        bench.succeed(&arguments);
        let names = |all: &BTreeMap<String, Vec<u8>>| all.keys().cloned().collect::<Vec<_>>();
        assert_eq!(
            names(&content(&bench.path("out"))),
            names(&first),
            "{command}"
        );
        fs::remove_dir_all(bench.path("out")).unwrap();
    }
    // Pieces are worked on, as by another tolerance, and lists of them are edited.
    bench.succeed(&FOLDERS[1].replace("{}", "out"));
    let first = content(&bench.path("out"));
    refuse(
        &bench,
        FOLDERS[1],
        "out",
        &["is there already", "--overwrite"],
    );
    bench.succeed(&format!(
        "{} --overwrite --least 1.4",
        FOLDERS[1].replace("{}", "out")
    ));
    assert!(content(&bench.path("out")) != first || first.len() == 3);
    bench.succeed("fit out --order 4 --out felt.lib");
}

/// Starts `stylus`, whose signals do what they do in a terminal, whatever started the tests.
fn start(bench: &Bench, arguments: &str) -> Child {
    let script = "exec env --default-signal=INT,TERM,HUP \"$0\" \"$@\"";
    Command::new("sh")
        .args(["-c", script, env!("CARGO_BIN_EXE_stylus")])
        .args(arguments.split_whitespace())
        .current_dir(bench.path("."))
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .expect("the command starts")
}

fn has_temporaries(folder: &Path) -> bool {
    content(folder).keys().any(|name| name.contains(".stylus-"))
}

/// Returns true if a folder or file with a temporary's name lies in `folder`, without looking into others' folders.
fn has_begun(folder: &Path) -> bool {
    let names = fs::read_dir(folder).unwrap().flatten();
    names
        .into_iter()
        .any(|entry| entry.file_name().to_string_lossy().starts_with(".stylus-"))
}

/// Stops `arguments` by `signal` as soon as it has begun to write, or `after` so long, and checks that nothing is left
/// of it, unless it was done. Gives whether it was stopped.
fn stop(bench: &Bench, arguments: &str, signal: &str, after: Option<Duration>) -> bool {
    let before = content(&bench.path("."));
    let mut child = start(bench, arguments);
    let begin = Instant::now();
    let is_time = || match after {
        Some(after) => begin.elapsed() >= after,
        None => {
            has_begun(&bench.path("."))
                || bench.path("deep").exists()
                || bench.path("out").is_dir() && has_begun(&bench.path("out"))
        }
    };
    while !is_time() && child.try_wait().unwrap().is_none() {
        assert!(
            begin.elapsed() < Duration::from_mins(2),
            "{arguments} does not begin"
        );
        thread::sleep(Duration::from_micros(200));
    }
    let pid = child.id().to_string();
    let _ = Command::new("kill").args([signal, &pid]).status();
    let status = child.wait().unwrap();
    let after = content(&bench.path("."));
    if status.success() {
        assert!(!has_temporaries(&bench.path(".")), "{arguments}");
        return false;
    }
    let number = std::os::unix::process::ExitStatusExt::signal(&status);
    let sent = match signal {
        "-HUP" => 1,
        "-INT" => 2,
        _ => 15,
    };
    assert_eq!(number, Some(sent), "{arguments}: {status}");
    let names = |all: &BTreeMap<String, Vec<u8>>| all.keys().cloned().collect::<Vec<_>>();
    assert_eq!(names(&after), names(&before), "stylus {arguments} {signal}");
    assert_eq!(after, before, "stylus {arguments} {signal}");
    true
}

#[test]
fn an_interrupt_leaves_no_half_of_a_result_and_no_hidden_file() {
    let bench = inputs();
    bench.write(
        "rig.toml",
        rig(&bench, "20, 40, 60, 80, 100, 120, 140, 160, 180, 200"),
    );
    bench.write("stroke.csv", stroke(60));
    bench.write(
        "more.toml",
        "name = \"one\"\n[[surface]]\ntexture = \"silk\"\n",
    );
    let mut stopped = Vec::new();
    for (command, signal) in [
        ("simulate-rig --rig rig.toml --out {}", "-INT"),
        ("simulate-rig --rig rig.toml --out {}", "-TERM"),
        ("simulate-rig --rig rig.toml --out deep/er/{}", "-TERM"),
        ("demo --out {}", "-INT"),
        ("demo --out {}", "-TERM"),
        ("simulate-rig --rig rig.toml --out {}", "-HUP"),
        ("simulate-rig --rig rig.toml --out deep/er/{}", "-HUP"),
        ("demo --out {}", "-HUP"),
        (
            "evaluate set --library good.lib --synthesis 2 --report {}",
            "-INT",
        ),
        ("segment stroke.csv --texture felt --out {}", "-TERM"),
        (
            "render good.lib --texture silk --speed 100 --force 1 --seconds 3000 --out {}",
            "-INT",
        ),
        (
            "render good.lib --texture silk --speed 100 --force 1 --seconds 3000 --out {}",
            "-TERM",
        ),
        (
            "render good.lib --texture silk --speed 100 --force 1 --seconds 3000 --out {}",
            "-HUP",
        ),
    ] {
        let arguments = command.replace("{}", "out");
        if stop(&bench, &arguments, signal, None) {
            stopped.push((command, signal));
        } else {
            let _ = fs::remove_dir_all(bench.path("out"))
                .or_else(|_| fs::remove_file(bench.path("out")));
        }
    }
    // The short ones may be done before the signal comes.
    for name in ["simulate-rig", "demo", "render"] {
        let is_stopped = |(command, _): &(&str, _)| command.starts_with(name);
        assert!(stopped.iter().any(is_stopped), "{stopped:?}");
    }
    for signal in ["-INT", "-TERM", "-HUP"] {
        let by_this = stopped.iter().filter(|(_, sent)| *sent == signal);
        assert!(by_this.count() >= 2, "{signal}: {stopped:?}");
    }
}

/// As `nohup` starts a command: a terminal that closes is no reason to end.
#[test]
fn a_command_that_was_started_without_the_hang_up_signal_goes_on_after_it() {
    let bench = inputs();
    let render = "render good.lib --texture silk --speed 100 --force 1 --seconds 600 --out out";
    let script = "exec env --ignore-signal=HUP \"$0\" \"$@\"";
    let mut child = Command::new("sh")
        .args(["-c", script, env!("CARGO_BIN_EXE_stylus")])
        .args(render.split_whitespace())
        .current_dir(bench.path("."))
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .expect("the command starts");
    let mut hung_up = false;
    while child.try_wait().unwrap().is_none() {
        if has_begun(&bench.path(".")) && !hung_up {
            let pid = child.id().to_string();
            let sent = Command::new("kill").args(["-HUP", &pid]).status().unwrap();
            hung_up = sent.success();
        }
        thread::sleep(Duration::from_micros(200));
    }
    assert!(hung_up, "it was done before the signal came");
    assert!(child.wait().unwrap().success());
    assert!(bench.path("out").is_file() && !has_temporaries(&bench.path(".")));
}

#[test]
fn an_interrupt_leaves_the_earlier_result_as_it_was() {
    let bench = inputs();
    let simulate = "simulate-rig --rig rig.toml --out out";
    bench.succeed(simulate);
    bench.write(
        "rig.toml",
        rig(&bench, "20, 40, 60, 80, 100, 120, 140, 160, 180, 200"),
    );
    assert!(stop(&bench, simulate, "-INT", None));
    bench.succeed("fit out --order 4 --out rig.lib");
}

/// At any moment there is all or nothing.
#[test]
fn an_interrupt_at_any_time_leaves_all_or_nothing() {
    let bench = inputs();
    let simulate = "simulate-rig --rig rig.toml --out out";
    let begin = Instant::now();
    bench.succeed(simulate);
    let whole = content(&bench.path("out"));
    let long = begin.elapsed();
    fs::remove_dir_all(bench.path("out")).unwrap();
    for part in 0..12 {
        if !stop(&bench, simulate, "-TERM", Some(long * part / 10)) {
            assert!(content(&bench.path("out")) == whole);
            fs::remove_dir_all(bench.path("out")).unwrap();
        }
    }
}

/// A journal of partial results is meant to be taken up again.
#[test]
fn partial_results_of_an_interrupted_fit_stay_and_are_used() {
    let bench = inputs();
    bench.write(
        "rig.toml",
        rig(&bench, "20, 40, 60, 80, 100, 120, 140, 160, 180, 200"),
    );
    bench.succeed("simulate-rig --rig rig.toml --out rig");
    let fit = "fit rig --order 60 --parts parts --out a.lib";
    let mut child = start(&bench, fit);
    let begin = Instant::now();
    let is_kept = || {
        let found = fs::read_dir(bench.path("parts"));
        found.is_ok_and(|mut found| {
            found.any(|entry| entry.unwrap().metadata().unwrap().len() > 4000)
        })
    };
    while !is_kept() && child.try_wait().unwrap().is_none() {
        assert!(begin.elapsed() < Duration::from_mins(2));
        thread::sleep(Duration::from_millis(1));
    }
    let _ = Command::new("kill")
        .args(["-INT", &child.id().to_string()])
        .status();
    child.wait().unwrap();
    assert!(is_kept(), "what was computed is there");
    assert!(!has_temporaries(&bench.path(".")));
    bench.succeed(fit);
}

/// Runs `stylus` with files of at most this many blocks of 512 bytes, as on a full disk. The limit's signal does what
/// it does by itself.
fn on_a_full_disk(bench: &Bench, blocks: u32, arguments: &str) -> Output {
    let script = format!("ulimit -f {blocks}; exec \"$0\" {arguments}");
    Command::new("sh")
        .args(["-c", &script, env!("CARGO_BIN_EXE_stylus")])
        .current_dir(bench.path("."))
        .output()
        .expect("there is a shell")
}

#[test]
fn a_full_disk_leaves_nothing_and_the_line_names_the_users_file() {
    let bench = inputs();
    for (command, blocks) in [
        (FILES[0], 1),
        (FILES[3], 1),
        (FILES[4], 1),
        (FILES[5], 1),
        (FILES[6], 1),
        (FILES[9], 1),
        (FOLDERS[0], 2),
        (FOLDERS[1], 1),
        (FOLDERS[2], 2),
        (FOLDERS[4], 1),
        (FOLDERS[5], 1),
    ] {
        let before = content(&bench.path("."));
        let arguments = command.replace("{}", "out.svg");
        let output = on_a_full_disk(&bench, blocks, &arguments);
        assert_eq!(
            output.status.code(),
            Some(2),
            "{arguments}: {}",
            text(&output.stderr)
        );
        let errors = text(&output.stderr);
        let message = errors.lines().last().unwrap_or_default();
        assert!(
            message.contains("out.svg") && !message.contains(".stylus-"),
            "{message}"
        );
        assert!(
            message.contains("too large") || message.contains("cannot"),
            "{message}"
        );
        let after = content(&bench.path("."));
        // Parts of a fit stay, to be taken up.
        let is_of_the_fit =
            |name: &&String| name.starts_with("out.svg") && command.contains("--each");
        let left: Vec<&String> = after.keys().filter(|name| !is_of_the_fit(name)).collect();
        assert_eq!(left, before.keys().collect::<Vec<_>>(), "{arguments}");
        let _ = fs::remove_dir_all(bench.path("out.svg"));
    }
}

/// Feeds a pipe without an end until its reader closes it.
fn feed(path: &Path) -> thread::JoinHandle<()> {
    let path = path.to_owned();
    thread::spawn(move || {
        use std::io::Write;
        let Ok(mut pipe) = fs::OpenOptions::new().write(true).open(path) else {
            return;
        };
        let zeros = vec![0; 1 << 16];
        while pipe.write_all(&zeros).is_ok() {}
    })
}

#[test]
fn an_input_that_does_not_end_is_refused_in_one_line() {
    let bench = inputs();
    for name in [
        "endless",
        "endless.toml",
        "endless.csv",
        "endless.wav",
        "endless.xml",
    ] {
        symlink("/dev/zero", bench.path(name)).unwrap();
    }
    for (arguments, word) in [
        ("inspect endless", "the most of a library"),
        ("certify endless", "the most of a library"),
        (
            "resample endless --rate 10000 --out o.lib",
            "the most of a library",
        ),
        (
            "render endless --texture a --speed 1 --force 1 --seconds 1 --out o.wav",
            "the most of a library",
        ),
        (
            "render good.lib --texture silk --motion endless.csv --out o.wav",
            "the most of a motion",
        ),
        ("evaluate set --library endless", "the most of a library"),
        ("evaluate endless.csv --library good.lib", "is a device"),
        ("evaluate endless.wav --library good.lib", "is a device"),
        ("compare --score endless.csv", "the most of"),
        ("fit endless.wav --out o.lib", "is a device"),
        ("fit endless.csv --out o.lib", "is a device"),
        ("segment endless.csv --texture a --out o", "is a device"),
        ("fit-tap endless.csv", "is a device"),
        ("fit-tap endless.wav", "is a device"),
        (
            "import-hatt endless.xml --out o.lib",
            "the most of a HaTT model file",
        ),
        (
            "simulate-rig --rig endless.toml --out o",
            "the most of a TOML text",
        ),
        (
            "scene check endless.toml --library good.lib",
            "the most of a TOML text",
        ),
        (
            "scene check scene.toml --library endless",
            "the most of a library",
        ),
        (
            "scene compile endless.toml --library good.lib --out o.lib",
            "the most of a TOML text",
        ),
        (
            "scene render endless.toml --library good.lib --out o.wav",
            "the most of a TOML text",
        ),
        (
            "scene plot endless.toml --library good.lib --out o.svg",
            "the most of a TOML text",
        ),
        ("frontier --data endless.wav --out o", "is a device"),
    ] {
        let message = bench.refuse(arguments);
        assert!(
            message.contains("endless") && message.contains(word),
            "{arguments}: {message}"
        );
    }
    // A list may name such a file, and a record beside a library may be one.
    bench.write(
        "list/trials.csv",
        "file,texture,speed_mm_s,force_n\n../endless.wav,a,1,1\n",
    );
    assert!(bench.refuse("fit list --out o.lib").contains("is a device"));
    // A pipe that goes on is read up to the limit; one for a recording, which is read twice, is not opened.
    make_pipe(&bench.path("pipe"));
    let fed = feed(&bench.path("pipe"));
    let message = bench.refuse("inspect pipe");
    assert!(message.contains("the most of a library"), "{message}");
    fed.join().unwrap();
    make_pipe(&bench.path("pipe.wav"));
    for arguments in ["fit pipe.wav --out o.lib", "fit-tap pipe.wav"] {
        let message = refusal(&bench.run(arguments), arguments);
        assert!(message.contains("is a pipe"), "{message}");
    }
    assert!(!bench.path("o.lib").exists());
}
