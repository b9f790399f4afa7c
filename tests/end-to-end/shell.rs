//! The command for a shell and its user: the configuration, quiet, colours, completions and manual pages.

use std::collections::BTreeSet;
use std::fs;
use std::os::unix::fs::symlink;
use std::path::Path;
use std::process::{Command, Output, Stdio};

use crate::support::{Bench, json, refusal, text, two_textures};

/// Runs `stylus` in the folder of `bench` with its configuration in `config`, and with these variables.
fn run_with(bench: &Bench, variables: &[(&str, &str)], arguments: &str) -> Output {
    let mut command = Command::new(env!("CARGO_BIN_EXE_stylus"));
    for name in ["NO_COLOR", "STYLUS_LINK", "TERM"] {
        command.env_remove(name);
    }
    command
        .args(arguments.split_whitespace())
        .current_dir(bench.path("."))
        .env("XDG_CONFIG_HOME", bench.path("config"))
        .envs(variables.iter().copied())
        .output()
        .expect("the command runs")
}

fn configure(bench: &Bench, text: &str) {
    bench.write("config/stylus/config.toml", text);
}

/// Standard output of a run that must succeed.
fn succeed(bench: &Bench, variables: &[(&str, &str)], arguments: &str) -> String {
    let output = run_with(bench, variables, arguments);
    assert!(
        output.status.success(),
        "{arguments}: {}",
        text(&output.stderr)
    );
    text(&output.stdout)
}

fn order_of(bench: &Bench, library: &str) -> u64 {
    let content = json(&succeed(bench, &[], &format!("inspect {library} --json")));
    content["textures"][0]["orders"][2]
        .as_u64()
        .expect("an order")
}

#[test]
fn a_default_of_the_file_is_taken_and_the_command_line_wins_over_it() {
    let bench = two_textures(|signal| [signal.to_vec()]);
    configure(&bench, "[fit]\norder = 7\nexcitation = \"gaussian\"\n");
    succeed(&bench, &[], "fit set --out file.lib");
    succeed(&bench, &[], "fit set --order 3 --out line.lib");
    assert_eq!(order_of(&bench, "file.lib"), 7);
    assert_eq!(order_of(&bench, "line.lib"), 3);
    let record = json(&fs::read_to_string(bench.path("file.lib.fit.json")).unwrap());
    assert_eq!(record["options"]["excitation"], "gaussian");
    let help = succeed(&bench, &[], "fit --help");
    assert!(help.contains("[default: 7]"), "{help}");
}

#[cfg(feature = "device")]
#[test]
fn of_links_the_command_line_wins_over_the_environment_and_that_over_the_file() {
    let stylus = fake_stylus::FakeStylus::start();
    let bench = Bench::new();
    let runtime = bench.path("run").display().to_string();
    let (here, nowhere) = (stylus.link(), "tcp:127.0.0.1:1");
    let status = |file: &str, variable: Option<&str>, line: &str| {
        configure(&bench, &format!("link = '{file}'\ntimeout = 5\n"));
        let mut variables = vec![("XDG_RUNTIME_DIR", runtime.as_str())];
        variables.extend(variable.map(|link| ("STYLUS_LINK", link)));
        let command = format!("status --no-broker {line}");
        run_with(&bench, &variables, &command).status.code()
    };
    let flag = |link: &str| format!("--link {link}");
    assert_eq!(status(&here, None, ""), Some(0));
    assert_eq!(status(nowhere, None, ""), Some(2));
    assert_eq!(status(nowhere, Some(&here), ""), Some(0));
    assert_eq!(status(&here, Some(nowhere), ""), Some(2));
    assert_eq!(status(nowhere, Some(nowhere), &flag(&here)), Some(0));
    assert_eq!(status(&here, Some(&here), &flag(nowhere)), Some(2));
}

#[test]
fn a_configuration_that_cannot_be_used_is_one_line_with_its_place_and_help_still_works() {
    let bench = Bench::new();
    for (content, words) in [
        (
            "\nlnik = 'usb'\n",
            &["config.toml, line 2", "`lnik`", "is `link` meant?"][..],
        ),
        (
            "[fit]\norder = 4\nodrer = 5\n",
            &["config.toml, line 3", "is `order` meant?"],
        ),
        ("[fit]\norder = 401\n", &["config.toml, line 2", "'401'"]),
        ("quiet = maybe\n", &["config.toml, line 1"]),
        ("color = 'blue'\n", &["line 1", "always"]),
    ] {
        configure(&bench, content);
        for command in ["config", "simulate-rig --print-rig", "inspect a.lib"] {
            let message = refusal(&run_with(&bench, &[], command), command);
            for word in words {
                assert!(message.contains(word), "{command}: {message}");
            }
        }
        for command in [
            "--help",
            "--version",
            "fit --help",
            "config --path",
            "config --template",
        ] {
            succeed(&bench, &[], command);
        }
    }
    let path = bench.path("config/stylus/config.toml");
    assert_eq!(
        succeed(&bench, &[], "config --path").trim_end(),
        path.display().to_string()
    );
    // A file without an end, and one that is none.
    fs::remove_file(&path).unwrap();
    bench.write("long", vec![b'#'; 70_000]);
    for (target, words) in [
        ("long", "the most of a configuration"),
        ("config", "is a folder"),
    ] {
        symlink(bench.path(target), &path).unwrap();
        let message = refusal(&run_with(&bench, &[], "config"), "config");
        assert!(message.contains(words), "{message}");
        fs::remove_file(&path).unwrap();
    }
}

#[test]
fn the_configuration_is_shown_with_the_source_of_each_value() {
    let bench = Bench::new();
    let shown = succeed(&bench, &[], "config");
    assert!(
        shown.contains("is not there") && shown.contains("--template"),
        "{shown}"
    );
    configure(
        &bench,
        "# mine\nquiet = true\nlink = 'usb'\n[fit]\norder = 100\n",
    );
    let shown = succeed(&bench, &[("STYLUS_LINK", "tcp:rig:4000")], "config --json");
    let shown = json(&shown);
    let of = |key: &str| {
        let keys = shown["keys"].as_array().unwrap();
        let row = keys.iter().find(|row| row["key"] == key).unwrap();
        [&row["value"], &row["from"]].map(|text| text.as_str().unwrap_or("none").to_owned())
    };
    assert_eq!(of("quiet"), ["true", "line 2"]);
    #[cfg(feature = "device")]
    assert_eq!(of("link"), ["tcp:rig:4000", "STYLUS_LINK"]);
    assert_eq!(of("fit.order"), ["100", "line 5"]);
    assert_eq!(of("fit.structure"), ["lattice", "default"]);
    assert_eq!(of("fit.snap"), ["none", "default"]);
    // The template changes nothing, and all of its values are taken.
    let template = succeed(&bench, &[], "config --template");
    configure(&bench, &template);
    let all = json(&succeed(&bench, &[], "config --json"));
    assert!(
        all["keys"]
            .as_array()
            .unwrap()
            .iter()
            .all(|row| row["from"] == "default")
    );
}

#[test]
fn quiet_leaves_results_warnings_and_errors_alone_on_both_streams() {
    let bench = two_textures(|signal| [signal.to_vec()]);
    // A note, and a warning.
    let fit = "fit set --order 4 --snap 0.001 --out a.lib";
    let loud = run_with(&bench, &[], fit);
    assert!(
        text(&loud.stderr).contains("no speed or force is moved"),
        "{loud:?}"
    );
    for command in [
        format!("--quiet {fit}"),
        format!("{fit} -q"),
        format!("{fit} --quiet=true"),
    ] {
        let quiet = run_with(&bench, &[], &command);
        assert_eq!(text(&quiet.stderr), "", "{command}");
        assert_eq!(text(&quiet.stdout), text(&loud.stdout), "{command}");
    }
    configure(&bench, "quiet = true\n");
    assert_eq!(text(&run_with(&bench, &[], fit).stderr), "");
    let again = run_with(&bench, &[], &format!("{fit} --quiet=false"));
    assert_eq!(text(&again.stderr), text(&loud.stderr));
    // What is doubtful is said all the same, and so are errors.
    let still = "render a.lib --texture silk --speed 0 --force 1 --seconds 1 --out o.wav";
    assert!(text(&run_with(&bench, &[], still).stderr).starts_with("warning: "));
    let message = refusal(&run_with(&bench, &[], "inspect nowhere"), "inspect nowhere");
    assert!(message.starts_with("stylus: nowhere"), "{message}");
}

/// Progress on a terminal, by the pseudo-terminal of util-linux.
fn on_a_terminal(bench: &Bench, variables: &[(&str, &str)], arguments: &str) -> String {
    let command = format!("{} {arguments}", env!("CARGO_BIN_EXE_stylus"));
    let output = Command::new("script")
        .args(["--quiet", "--return", "--command", &command, "/dev/null"])
        .current_dir(bench.path("."))
        .env_remove("NO_COLOR")
        .env("TERM", "xterm")
        .env("XDG_CONFIG_HOME", bench.path("config"))
        .envs(variables.iter().copied())
        .stdin(Stdio::null())
        .output()
        .expect("`script` of util-linux is there");
    text(&output.stdout)
}

#[test]
fn colours_and_progress_are_for_terminals() {
    const ESCAPE: char = '\u{1b}';
    let bench = two_textures(|signal| [signal.to_vec()]);
    for (variables, arguments, is_coloured) in [
        (&[][..], "--help", true),
        (&[], "inspect nowhere", true),
        (&[], "fti", true),
        (&[], "--color never --help", false),
        (&[], "inspect nowhere --color=never", false),
        (&[], "fti --color never", false),
        (&[("NO_COLOR", "1")], "--help", false),
        (&[("NO_COLOR", "1")], "inspect nowhere", false),
        (&[("NO_COLOR", "1")], "--color always --help", true),
        (&[("NO_COLOR", "")], "--help", true),
        (&[("TERM", "dumb")], "--help", false),
    ] {
        let shown = on_a_terminal(&bench, variables, arguments);
        assert!(shown.len() > 20, "{arguments}: {shown}");
        assert_eq!(
            shown.contains(ESCAPE),
            is_coloured,
            "{variables:?} {arguments}: {shown}"
        );
        // The words are the same.
        if is_coloured {
            let plain = on_a_terminal(
                &bench,
                &[("NO_COLOR", "1")],
                &format!("{arguments} --color never"),
            );
            assert_eq!(without_colours(&shown), plain, "{arguments}");
        }
    }
    let fit = "fit set --order 4 --out a.lib";
    assert!(on_a_terminal(&bench, &[("NO_COLOR", "1")], fit).contains("fitting "));
    assert!(!on_a_terminal(&bench, &[("NO_COLOR", "1")], &format!("{fit} -q")).contains(ESCAPE));
    // A pipe takes none, unless it is asked for.
    for (variables, arguments, is_coloured) in [
        (&[][..], "--help", false),
        (&[], "inspect nowhere", false),
        (&[], "--color always --help", true),
        (&[], "inspect nowhere --color always", true),
        (&[("NO_COLOR", "1")], "inspect nowhere", false),
    ] {
        let output = run_with(&bench, variables, arguments);
        let shown = text(&output.stdout) + &text(&output.stderr);
        assert_eq!(shown.contains(ESCAPE), is_coloured, "{arguments}: {shown}");
    }
    configure(&bench, "color = 'always'");
    let shown = |variables| text(&run_with(&bench, variables, "inspect nowhere").stderr);
    assert!(shown(&[]).contains(ESCAPE));
    assert!(!shown(&[("NO_COLOR", "1")]).contains(ESCAPE));
}

/// `shown` without sequences that set colours.
fn without_colours(shown: &str) -> String {
    let mut parts = shown.split("\u{1b}[");
    let mut plain = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        plain.push_str(part.split_once('m').map_or("", |(_, rest)| rest));
    }
    plain
}

/// A name that a terminal would obey.
#[test]
fn what_the_environment_or_the_file_brings_into_coloured_help_is_not_obeyed() {
    let bench = Bench::new();
    let hostile = [("STYLUS_LINK", "tcp:\u{1b}[31mred:1")];
    for arguments in [
        "status --help --color always",
        "fti\u{1b}[2J --color always",
    ] {
        let output = run_with(&bench, &hostile, arguments);
        let shown = text(&output.stdout) + &text(&output.stderr);
        assert!(
            !shown.contains("\u{1b}[31mred") && !shown.contains("\u{1b}[2J"),
            "{shown}"
        );
        assert!(shown.contains("\u{1b}[1m"), "{shown}");
    }
}

/// Names of all commands that a help lists, those of groups too.
fn commands(bench: &Bench) -> Vec<String> {
    let listed = |help: &str| -> Vec<String> {
        let lines = help.lines().skip_while(|line| *line != "Commands:").skip(1);
        let names = lines.map_while(|line| line.strip_prefix("  ")?.split_whitespace().next());
        names
            .filter(|name| *name != "help")
            .map(str::to_owned)
            .collect()
    };
    let mut all = Vec::new();
    for name in listed(&succeed(bench, &[], "--help")) {
        let inner = listed(&succeed(bench, &[], &format!("{name} --help")));
        all.extend(inner.iter().map(|inner| format!("{name} {inner}")));
        all.push(name);
    }
    all
}

#[test]
fn every_command_has_a_manual_page_with_its_options() {
    let bench = Bench::new();
    // The user's own defaults are not those of the pages.
    configure(&bench, "[fit]\norder = 7\n");
    succeed(&bench, &[("STYLUS_LINK", "tcp:mine:1")], "man --out pages");
    let pages: BTreeSet<String> = fs::read_dir(bench.path("pages"))
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .filter(|name| !name.starts_with('.'))
        .collect();
    let mut expected: BTreeSet<String> = (commands(&bench).iter())
        .map(|name| format!("stylus-{}.1", name.replace(' ', "-")))
        .collect();
    expected.insert("stylus.1".to_owned());
    assert_eq!(pages, expected);
    let fit = fs::read_to_string(bench.path("pages/stylus-fit.1")).unwrap();
    assert!(
        fit.contains(r"\-\-silence\-floor") && fit.contains("[default: auto]"),
        "{fit}"
    );
    for page in &pages {
        let page = fs::read_to_string(bench.path("pages").join(page)).unwrap();
        assert!(page.contains(".TH ") && page.contains(".SH NAME"), "{page}");
        assert!(
            !page.contains("mine") && !page.contains("share\\-link"),
            "{page}"
        );
    }
    // Where there is a formatter, it has nothing to complain of.
    if let Ok(formatted) = Command::new("groff")
        .args(["-man", "-Tutf8", "-ww"])
        .arg(bench.path("pages/stylus-fit.1"))
        .output()
    {
        assert!(
            formatted.status.success() && formatted.stderr.is_empty(),
            "{formatted:?}"
        );
    }
}

/// Words that bash offers after `line`, by the script of `stylus completions bash`.
fn offered(script: &Path, line: &str) -> Vec<String> {
    let words: Vec<&str> = line.split(' ').collect();
    let program = format!(
        "source '{}'; COMP_WORDS=('{}'); COMP_CWORD={}; _stylus stylus '{}' '{}'; printf '%s\\n' \"${{COMPREPLY[@]}}\"",
        script.display(),
        words.join("' '"),
        words.len() - 1,
        words[words.len() - 1],
        words[words.len() - 2],
    );
    let output = Command::new("bash")
        .args(["--norc", "-c", &program])
        .output();
    let output = output.expect("bash is there");
    assert!(output.stderr.is_empty(), "{}", text(&output.stderr));
    text(&output.stdout).lines().map(str::to_owned).collect()
}

#[test]
fn bash_completes_commands_options_and_values_by_the_script() {
    let bench = Bench::new();
    let script = succeed(&bench, &[("STYLUS_LINK", "tcp:mine:1")], "completions bash");
    assert!(!script.contains("share-link") && !script.contains("mine"));
    bench.write("stylus.bash", script);
    let script = bench.path("stylus.bash");
    let top: BTreeSet<String> = offered(&script, "stylus ").into_iter().collect();
    for name in commands(&bench).iter().filter(|name| !name.contains(' ')) {
        assert!(top.contains(name), "{name}: {top:?}");
    }
    assert_eq!(offered(&script, "stylus inspe"), ["inspect"]);
    assert_eq!(offered(&script, "stylus scene comp"), ["compile"]);
    assert_eq!(
        offered(&script, "stylus fit --silence"),
        ["--silence-floor"]
    );
    assert_eq!(offered(&script, "stylus fit --structure la"), ["lattice"]);
    let values = offered(&script, "stylus fit --color ");
    assert_eq!(values, ["auto", "always", "never"]);
}

#[test]
fn every_shell_gets_a_script_that_names_every_command() {
    let bench = Bench::new();
    let names = commands(&bench);
    for shell in ["bash", "elvish", "fish", "powershell", "zsh"] {
        let script = succeed(&bench, &[], &format!("completions {shell}"));
        for name in &names {
            let last = name.split(' ').next_back().unwrap();
            assert!(script.contains(last), "{shell}: {name}");
        }
        assert!(!script.contains("share-link"), "{shell}");
    }
    // A shell that is here reads its own.
    for shell in ["bash", "zsh", "fish"] {
        let script = succeed(&bench, &[], &format!("completions {shell}"));
        bench.write("script", script);
        let checked = Command::new(shell)
            .arg("-n")
            .arg(bench.path("script"))
            .output();
        if let Ok(checked) = checked {
            assert!(
                checked.status.success(),
                "{shell}: {}",
                text(&checked.stderr)
            );
        }
    }
}
