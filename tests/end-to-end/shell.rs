//! The command for a shell and its user: environment variables, quiet mode and colours.

use std::process::{Command, Output, Stdio};

use crate::support::{Bench, refusal, text, two_textures};

/// Runs `stylus` in the folder of `bench` with these environment variables.
fn run_with(bench: &Bench, variables: &[(&str, &str)], arguments: &str) -> Output {
    let mut command = bench.command(arguments.split_whitespace());
    for name in ["NO_COLOR", "STYLUS_QUIET", "TERM"] {
        command.env_remove(name);
    }
    command
        .envs(variables.iter().copied())
        .output()
        .expect("the command runs")
}

#[test]
fn of_links_the_command_line_wins_over_the_environment() {
    let stylus = fake_stylus::FakeStylus::start();
    let bench = Bench::new();
    let (here, nowhere) = (stylus.link(), "tcp:127.0.0.1:1");
    let status = |variable: &str, line: &str| {
        let command = format!("status {line}");
        let variables = [("STYLUS_LINK", variable), ("STYLUS_TIMEOUT", "600")];
        run_with(&bench, &variables, &command).status.code()
    };
    let flag = |link: &str| format!("--link {link}");
    assert_eq!(status(&here, ""), Some(0));
    assert_eq!(status(nowhere, ""), Some(2));
    assert_eq!(status(nowhere, &flag(&here)), Some(0));
    assert_eq!(status(&here, &flag(nowhere)), Some(2));
}

#[test]
fn quiet_leaves_results_warnings_and_errors_alone_on_both_streams() {
    let bench = two_textures(|signal| [signal.to_vec()]);
    // This fit prints a note and a warning.
    let fit = "fit set --order 4 --snap 0.001 --out a.lib --overwrite";
    let note = "no speed or force is moved";
    let loud = run_with(&bench, &[("STYLUS_QUIET", "0")], fit);
    assert!(text(&loud.stderr).contains(note), "{loud:?}");
    for (variables, command) in [
        (&[][..], format!("--quiet {fit}")),
        (&[("STYLUS_QUIET", "1")], fit.to_owned()),
    ] {
        let quiet = run_with(&bench, variables, &command);
        assert_eq!(text(&quiet.stderr), "", "{command}");
        assert_eq!(text(&quiet.stdout), text(&loud.stdout), "{command}");
    }
    // Warnings are printed all the same, and so are errors.
    let quiet = [("STYLUS_QUIET", "true")];
    let still = "render a.lib --texture silk --speed 0 --force 1 --seconds 1 --out o.wav";
    assert!(text(&run_with(&bench, &quiet, still).stderr).starts_with("warning: "));
    let message = refusal(&run_with(&bench, &quiet, "inspect nowhere"), "inspect nowhere");
    assert!(message.starts_with("stylus: nowhere"), "{message}");
}

/// Runs `stylus` on the pseudo-terminal of util-linux, and returns its output.
fn on_a_terminal(bench: &Bench, variables: &[(&str, &str)], arguments: &str) -> String {
    let command = format!("{} {arguments}", env!("CARGO_BIN_EXE_stylus"));
    let output = Command::new("script")
        .args(["--quiet", "--return", "--command", &command, "/dev/null"])
        .current_dir(bench.path("."))
        .env_remove("NO_COLOR")
        .env("TERM", "xterm")
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
    for arguments in ["--help", "inspect nowhere", "fti"] {
        let shown = on_a_terminal(&bench, &[], arguments);
        assert!(shown.contains(ESCAPE), "{arguments}: {shown}");
        for variable in [("NO_COLOR", "1"), ("TERM", "dumb")] {
            let shown = on_a_terminal(&bench, &[variable], arguments);
            assert!(shown.len() > 20, "{arguments}: {shown}");
            assert!(!shown.contains(ESCAPE), "{arguments}: {shown}");
        }
        let output = run_with(&bench, &[], arguments);
        let shown = text(&output.stdout) + &text(&output.stderr);
        assert!(!shown.contains(ESCAPE), "{arguments}: {shown}");
    }
    let plain = [("NO_COLOR", "1")];
    let fit = "fit set --order 4 --out a.lib --overwrite";
    assert!(on_a_terminal(&bench, &plain, fit).contains("fitting "));
    assert!(!on_a_terminal(&bench, &plain, &format!("{fit} -q")).contains(ESCAPE));
}
