//! Turns of a pair: clocks, a set of recordings for both sides, and the table.

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Instant;

use host_tools::rig::{RigFile, simulate_to_folder};

/// The lowest ratio of a whole command's CPU seconds that is asked for.
pub const COMMAND_GOAL: f64 = 3.0;

/// Seconds of one side of a turn.
#[derive(Clone, Copy)]
pub struct Taken {
    /// CPU seconds.
    pub cpu_s: f64,
    /// Seconds from begin to end.
    pub elapsed_s: f64,
}

/// Prints the head of the table.
pub fn head() {
    println!(
        "{:<44} {:>6} {:>8} {:>7} {:>16}",
        "pair", "goal", "ratio", "", "quarters"
    );
}

/// Prints the row of a pair: each turn's seconds before and after.
pub fn show(name: &str, goal: Option<f64>, turns: &[(f64, f64)]) {
    let mut ratios: Vec<f64> = turns.iter().map(|(before, after)| before / after).collect();
    ratios.sort_by(f64::total_cmp);
    let at = |share: f64| ratios[(share * (ratios.len() - 1) as f64).round() as usize];
    let median = at(0.5);
    let (goal, verdict) = match goal {
        Some(goal) if median >= goal => (format!("{goal:.1}"), "met"),
        Some(goal) => (format!("{goal:.1}"), "missed"),
        None => ("-".to_owned(), ""),
    };
    let quarters = format!("{:.2} to {:.2}", at(0.25), at(0.75));
    let mean = |of: fn(&(f64, f64)) -> f64| turns.iter().map(of).sum::<f64>() / turns.len() as f64;
    let (before, after) = (mean(|turn| turn.0), mean(|turn| turn.1));
    println!(
        "{name:<44} {goal:>6} {median:>8.2} {verdict:>7} {quarters:>16}   {before:.3} s, {after:.3} s",
    );
}

/// Simulates the paper's textures to the folder `set` in `folder`: at the paper's speeds and forces, or at these.
pub fn simulate(folder: &Path, speeds_and_forces: Option<(&str, &str)>) {
    let paper = RigFile::paper();
    let lines = paper.text().lines().map(|line| {
        let key = line.split('=').next().unwrap_or("").trim();
        match (key, speeds_and_forces) {
            ("speeds_mm_s", Some((speeds, _))) => format!("speeds_mm_s = {speeds}"),
            ("forces_n", Some((_, forces))) => format!("forces_n = {forces}"),
            _ => line.to_owned(),
        }
    });
    let text = lines.collect::<Vec<_>>().join("\n");
    let rig = RigFile::from_toml(&folder.join("rig.toml"), &text).expect("a sound rig");
    simulate_to_folder(&rig, 1, &folder.join("set"), false).expect("a temporary folder");
}

/// Runs `program` with `arguments` in `folder`, and returns what it took.
pub fn run(program: &Path, arguments: &[&str], folder: &Path) -> Taken {
    let (begin, begin_cpu_s) = (Instant::now(), children_cpu_s());
    let status = Command::new(program)
        .args(arguments)
        .current_dir(folder)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .status();
    let status = status.unwrap_or_else(|error| panic!("{}: {error}", program.display()));
    assert!(
        status.success(),
        "{} {arguments:?}: {status}",
        program.display()
    );
    Taken {
        cpu_s: children_cpu_s() - begin_cpu_s,
        elapsed_s: begin.elapsed().as_secs_f64(),
    }
}

/// CPU seconds of this thread, or where nobody tells them, seconds.
pub fn own_cpu_s() -> f64 {
    if let Ok(text) = std::fs::read_to_string("/proc/thread-self/schedstat")
        && let Some(Ok(nanoseconds)) = text.split(' ').next().map(str::parse::<f64>)
    {
        return 1e-9 * nanoseconds;
    }
    since_start_s()
}

/// CPU seconds, of user and system, of all processes that were waited for, or where nobody tells them, seconds.
fn children_cpu_s() -> f64 {
    /// Ticks per second of Linux's counters of time.
    const TICKS_PER_S: f64 = 100.0;
    /// Places of the children's user and system time behind the name of the program.
    const FIELDS: std::ops::Range<usize> = 13..15;
    let of_children = |text: String| {
        let behind_name: Vec<&str> = text.rsplit_once(')')?.1.split_whitespace().collect();
        let ticks = behind_name.get(FIELDS)?.iter();
        ticks.map(|ticks| ticks.parse::<f64>().ok()).sum()
    };
    let ticks: Option<f64> = std::fs::read_to_string("/proc/self/stat")
        .ok()
        .and_then(of_children);
    ticks.map_or_else(since_start_s, |ticks| ticks / TICKS_PER_S)
}

fn since_start_s() -> f64 {
    static START: std::sync::LazyLock<Instant> = std::sync::LazyLock::new(Instant::now);
    START.elapsed().as_secs_f64()
}
