//! Paired comparisons of what the host's commands take: rendering by the kernel's plain arithmetic and by the host's
//! own, and whole commands of an older `stylus` and of this one. `cargo tasks bench-host` runs it.
//!
//! Both sides of a pair run in turns, so that what else the computer does falls on both. Each turn gives a ratio of
//! CPU times; shown are the median ratio and the quarters around it.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::Instant;

use host_tools::dsp::model::Model;
use host_tools::playing::motion::MotionPath;
use host_tools::playing::render::Rendering;
use host_tools::playing::wavefront::Wavefront;
use host_tools::rig::{RigFile, simulate_to_folder};
use host_tools::texture::grid::Grid;
use host_tools::texture::library::uncertified_library;
use host_tools::texture::quantise::StructureChoice;
use model_format::{Laws, Library, MillimetresPerSecond, Newton, NodeFlags, PartsSpec};
use stylus_kernel::arithmetic::{Arithmetic, Portable};
use stylus_kernel::scene::Plan;

/// Order of the rendered models.
const ORDER: usize = 400;

/// The lowest ratio of a command's CPU seconds that is asked for.
const COMMAND_GOAL: f64 = 3.0;

struct Arguments {
    /// Few and short turns, to see that it runs.
    is_quick: bool,
    /// An older `stylus`, whose commands are compared with this one's.
    before: Option<PathBuf>,
}

impl Arguments {
    fn parse() -> Self {
        let mut arguments = std::env::args().skip(1);
        let (mut is_quick, mut before) = (false, None);
        while let Some(argument) = arguments.next() {
            match argument.as_str() {
                "--quick" => is_quick = true,
                "--before" => before = arguments.next().map(PathBuf::from),
                // Cargo's own.
                "--bench" => {}
                other => panic!("unknown argument {other}: give --quick or --before FILE"),
            }
        }
        Self { is_quick, before }
    }
}

fn main() {
    let arguments = Arguments::parse();
    println!(
        "rendering by the kernel's plain arithmetic against {} instructions",
        Wavefront::instructions()
    );
    println!(
        "{:<44} {:>6} {:>8} {:>18}",
        "pair", "goal", "ratio", "quarters"
    );
    rendering(arguments.is_quick);
    if let Some(before) = &arguments.before {
        commands(before, arguments.is_quick);
    }
}

/// Prints the row of a pair: each turn's CPU seconds before and after.
fn show(name: &str, goal: Option<f64>, turns: &[(f64, f64)]) {
    let mut ratios: Vec<f64> = turns.iter().map(|(before, after)| before / after).collect();
    ratios.sort_by(f64::total_cmp);
    let at = |share: f64| ratios[(share * (ratios.len() - 1) as f64).round() as usize];
    let goal = goal.map_or("-".to_owned(), |goal| format!("{goal:.1}"));
    let quarters = format!("{:.2} to {:.2}", at(0.25), at(0.75));
    let sum = |of: fn(&(f64, f64)) -> f64| turns.iter().map(of).sum::<f64>() / turns.len() as f64;
    let (before, after) = (sum(|turn| turn.0), sum(|turn| turn.1));
    println!(
        "{name:<44} {goal:>6} {:>8.2} {quarters:>18}   {before:.3} s, {after:.3} s",
        at(0.5)
    );
}

/// A library of one texture of four nodes of [`ORDER`], with resonances that differ.
fn library(structure: StructureChoice) -> Vec<u8> {
    let model = |node: usize| {
        let stage = |stage: usize| 0.9 * (1.7 * (stage + node) as f64).sin() / (1.0 + stage as f64);
        Model {
            reflection: (0..ORDER).map(stage).collect(),
            output_power: 1.0 + node as f64,
            flags: NodeFlags::NONE,
        }
    };
    let grid = Grid {
        speeds_mm_s: vec![50.0, 150.0],
        forces_n: vec![0.5, 1.0],
        models: (0..4).map(model).collect(),
        laws: Laws::default(),
        parts: PartsSpec::default(),
    };
    uncertified_library("bench", &grid, structure).expect("the models are stable")
}

/// CPU seconds that rendering takes by `A`, and the sum of the samples, so that none is left out.
fn rendered<A: Arithmetic>(bytes: &[u8], motion: &MotionPath, seconds: f64) -> (f64, i64) {
    let library = Library::decode_uncertified(bytes).expect("it was just encoded");
    let plan = Plan::of_texture(library.textures().next().expect("one was encoded"));
    let rendering = Rendering::<'_, A>::by_arithmetic(plan, motion, seconds, 1);
    let begin = own_cpu_s();
    let sum = rendering
        .expect("a short rendering")
        .map(|sample| i64::from(sample.0))
        .sum();
    (own_cpu_s() - begin, sum)
}

fn rendering(is_quick: bool) {
    let (turns, seconds) = if is_quick { (3, 0.2) } else { (21, 4.0) };
    let rest = MotionPath::constant(MillimetresPerSecond(100.0), Newton(0.7)).expect("finite");
    let table = "time_s,speed_mm_s,force_n\n0,60,0.6\n2,140,0.9\n4,60,0.6\n";
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("motion.csv");
    std::fs::write(&path, table).expect("a temporary file");
    let moving = MotionPath::from_csv(&path).expect("a sound table");
    for (name, structure, motion, goal) in [
        (
            "lattice 400, at rest",
            StructureChoice::Lattice,
            &rest,
            Some(3.0),
        ),
        (
            "lattice 400, in motion",
            StructureChoice::Lattice,
            &moving,
            None,
        ),
        (
            "direct form 400, at rest",
            StructureChoice::Direct,
            &rest,
            None,
        ),
    ] {
        let bytes = library(structure);
        let pairs: Vec<(f64, f64)> = (0..turns)
            .map(|_| {
                let (before, plain) = rendered::<Portable>(&bytes, motion, seconds);
                let (after, fast) = rendered::<Wavefront>(&bytes, motion, seconds);
                assert_eq!(plain, fast, "{name}: the samples differ");
                (before, after)
            })
            .collect();
        show(name, goal, &pairs);
    }
}

/// CPU seconds of this thread, or where nobody tells them, seconds.
fn own_cpu_s() -> f64 {
    if let Ok(text) = std::fs::read_to_string("/proc/thread-self/schedstat")
        && let Some(Ok(nanoseconds)) = text.split(' ').next().map(str::parse::<f64>)
    {
        return 1e-9 * nanoseconds;
    }
    since_start_s()
}

/// User seconds of all processes that were waited for, or where nobody tells them, seconds.
fn children_user_s() -> f64 {
    /// Ticks per second of Linux's counters of time.
    const TICKS_PER_S: f64 = 100.0;
    /// Place of the children's user time behind the name of the program.
    const FIELD: usize = 13;
    let of_children = |text: String| {
        let behind_name = text.rsplit_once(')')?.1;
        behind_name
            .split_whitespace()
            .nth(FIELD)?
            .parse::<f64>()
            .ok()
    };
    let ticks = std::fs::read_to_string("/proc/self/stat")
        .ok()
        .and_then(of_children);
    ticks.map_or_else(since_start_s, |ticks| ticks / TICKS_PER_S)
}

fn since_start_s() -> f64 {
    static START: std::sync::LazyLock<Instant> = std::sync::LazyLock::new(Instant::now);
    START.elapsed().as_secs_f64()
}

/// Compares whole commands of the program at `before` with this build's.
fn commands(before: &Path, is_quick: bool) {
    let after = Path::new(env!("CARGO_BIN_EXE_stylus"));
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (speeds, forces, turns) = if is_quick {
        ("[80, 120, 160]", "[0.6, 1.0]", 1)
    } else {
        ("[40, 80, 120, 160, 200]", "[0.2, 0.6, 1.0, 1.4]", 5)
    };
    let paper = RigFile::paper();
    let lines =
        paper
            .text()
            .lines()
            .map(|line| match line.split('=').next().unwrap_or("").trim() {
                "speeds_mm_s" => format!("speeds_mm_s = {speeds}"),
                "forces_n" => format!("forces_n = {forces}"),
                _ => line.to_owned(),
            });
    let text = lines.collect::<Vec<_>>().join("\n");
    let rig = RigFile::from_toml(&folder.path().join("rig.toml"), &text).expect("a sound rig");
    simulate_to_folder(&rig, 1, &folder.path().join("set")).expect("a temporary folder");
    let user_s = |program: &Path, arguments: &str| {
        let begin = children_user_s();
        let status = Command::new(program)
            .args(arguments.split(' '))
            .current_dir(folder.path())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .status();
        let status = status.unwrap_or_else(|error| panic!("{}: {error}", program.display()));
        assert!(
            status.success(),
            "{} {arguments}: {status}",
            program.display()
        );
        children_user_s() - begin
    };
    user_s(after, "fit set --order 400 --out fitted.lib");
    println!(
        "\ncommands of {} and of this build, user seconds",
        before.display()
    );
    let mut compared = vec![
        ("evaluate", "evaluate set --library fitted.lib"),
        ("report", "report set --library fitted.lib --out page.html"),
        ("evaluate --leave-one-out", "evaluate set --leave-one-out"),
        (
            "fit --densify",
            "fit set --order 400 --densify --out dense.lib",
        ),
    ];
    if !is_quick {
        compared.push(("frontier", "frontier --data set --out frontier"));
    }
    for (name, arguments) in compared {
        let turns = if name == "frontier" { 1 } else { turns };
        let pairs: Vec<(f64, f64)> = (0..turns)
            .map(|_| (user_s(before, arguments), user_s(after, arguments)))
            .collect();
        show(name, Some(COMMAND_GOAL), &pairs);
    }
}
