//! Ratios of what the host's work takes: rendering by the kernel's plain arithmetic and by the host's own, and whole
//! fits by another program and by this build's `stylus`.
//!
//! `cargo bench --locked -p host-tools --bench host -- [python3 | OLDER-STYLUS]...`, with absolute paths: a Python that
//! has NumPy and SciPy runs `fit_numpy.py`, any other program gets the arguments of `stylus fit`. Both sides of a pair
//! run in turns, so that what else the computer does falls on both.

use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Instant;

use host_tools::dsp::model::Model;
use host_tools::playing::motion::MotionPath;
use host_tools::playing::render::Rendering;
use host_tools::playing::wavefront::Wavefront;
use host_tools::rig::{RigFile, simulate_to_folder};
use host_tools::texture::grid::Grid;
use host_tools::texture::library::library_of;
use model_format::{Laws, Library, MillimetresPerSecond, Newton, NodeFlags, PartsSpec};
use stylus_kernel::arithmetic::{Arithmetic, Portable};
use stylus_kernel::scene::Plan;

/// Turns of each pair.
const TURNS: usize = 7;

/// Order of all models.
const ORDER: usize = 400;

/// Length of a rendering, s.
const RENDERED_S: f64 = 60.0;

/// The script that fits with NumPy and SciPy.
const SCRIPT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/benches/fit_numpy.py");

/// A fit of the script's models: noise of steady level, no lines.
const FIT: &str = "fit set --out a.lib --order 400 --estimator rectangular --excitation gaussian --modulation none \
                   --lines none";

fn main() {
    println!(
        "{:<50} {:>6}",
        "ratio of seconds, before to after", "median"
    );
    show("rendering, plain and the host's own arithmetic", || {
        let (before, plain) = rendered::<Portable>();
        let (after, fast) = rendered::<Wavefront>();
        assert_eq!(plain, fast, "the samples differ");
        (before, after)
    });
    let folder = tempfile::tempdir().expect("a temporary folder");
    simulate_to_folder(&RigFile::paper(), 1, &folder.path().join("set"), false)
        .expect("recordings");
    let own = Path::new(env!("CARGO_BIN_EXE_stylus"));
    // Cargo gives an option of its own.
    for other in std::env::args().skip(1).filter(|word| word != "--bench") {
        let arguments = if other.contains("python") {
            format!("{SCRIPT} set a.npz")
        } else {
            FIT.to_owned()
        };
        show(&format!("fit, {other} and this stylus"), || {
            let before = run(Path::new(&other), &arguments, folder.path());
            (before, run(own, FIT, folder.path()))
        });
    }
}

/// Prints the median ratio of [`TURNS`] turns, with the quarters around it and the last turn's seconds.
fn show(name: &str, mut turn: impl FnMut() -> (f64, f64)) {
    let turns: Vec<(f64, f64)> = (0..TURNS).map(|_| turn()).collect();
    let mut ratios: Vec<f64> = turns.iter().map(|(before, after)| before / after).collect();
    ratios.sort_by(f64::total_cmp);
    let [low, median, high] = [1, 2, 3].map(|quarter| ratios[quarter * (TURNS - 1) / 4]);
    let (before, after) = turns[TURNS - 1];
    println!("{name:<50} {median:>6.2}   {low:.2} to {high:.2}; {before:.3} s, {after:.3} s");
}

/// Seconds that `program` takes with `arguments` in `folder`.
fn run(program: &Path, arguments: &str, folder: &Path) -> f64 {
    let begin = Instant::now();
    let status = Command::new(program)
        .args(arguments.split(' '))
        .current_dir(folder)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .status();
    let status = status.unwrap_or_else(|error| panic!("{}: {error}", program.display()));
    assert!(
        status.success(),
        "{} {arguments}: {status}",
        program.display()
    );
    begin.elapsed().as_secs_f64()
}

/// Seconds that rendering takes by `A`, and the sum of the samples, so that none is left out.
fn rendered<A: Arithmetic>() -> (f64, i64) {
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
    let bytes = library_of("bench", &grid);
    let bytes = bytes.expect("the models are stable");
    let library = Library::decode(&bytes).expect("it was just encoded");
    let plan = Plan::of_texture(library.textures().next().expect("one was encoded"));
    let rest = MotionPath::constant(MillimetresPerSecond(100.0), Newton(0.7)).expect("finite");
    let rendering = Rendering::<'_, A>::by_arithmetic(plan, &rest, RENDERED_S, 1);
    let begin = Instant::now();
    let samples = rendering.expect("a short rendering");
    let sum = samples.map(|sample| i64::from(sample.0)).sum();
    (begin.elapsed().as_secs_f64(), sum)
}
