//! Whole fits by NumPy with SciPy, and by `stylus`: reading to writing, of the same models.

use std::path::Path;
use std::process::{Command, Stdio};

use crate::pairs::{run, show, simulate};

/// The lowest ratio of CPU seconds that is asked for.
const GOAL: f64 = 6.0;

/// The models of the script: noise of steady level, no lines. Triage has no option, and the script has no triage.
const OPTIONS: [&str; 10] = [
    "--order",
    "400",
    "--estimator",
    "rectangular",
    "--excitation",
    "gaussian",
    "--modulation",
    "none",
    "--lines",
    "none",
];

/// The script that fits with NumPy and SciPy.
const SCRIPT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/benches/fit_numpy.py");

/// Compares fits where `python`, or else python3, has NumPy and SciPy, and says so where it does not.
pub fn compare(python: Option<&Path>, is_quick: bool) {
    let named = python.unwrap_or(Path::new("python3"));
    let Some(versions) = versions(named) else {
        assert!(
            python.is_none(),
            "{} has no NumPy and SciPy",
            named.display()
        );
        println!(
            "fits against NumPy and SciPy: left out, because python3 has not both; name a Python by --python FILE"
        );
        return;
    };
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (turns, axes) = if is_quick {
        (1, Some(("[80, 120, 160]", "[0.6, 1.0]")))
    } else {
        (7, None)
    };
    simulate(folder.path(), axes);
    let list = std::fs::read_to_string(folder.path().join("set/trials.csv"));
    let list = list.expect("it was just written");
    let trials = list.lines().filter(|line| line.contains(".wav")).count();
    println!(
        "fits of {trials} trials at order 400, by {versions} and by stylus, processes of reading to writing:"
    );
    let stylus = Path::new(env!("CARGO_BIN_EXE_stylus"));
    let own = [&["fit", "set", "--out", "a.lib"][..], &OPTIONS].concat();
    let pairs: Vec<_> = (0..turns)
        .map(|_| {
            let before = run(named, &[SCRIPT, "set", "a.npz"], folder.path());
            (before, run(stylus, &own, folder.path()))
        })
        .collect();
    let cpu: Vec<_> = pairs.iter().map(|(a, b)| (a.cpu_s, b.cpu_s)).collect();
    let elapsed: Vec<_> = pairs
        .iter()
        .map(|(a, b)| (a.elapsed_s, b.elapsed_s))
        .collect();
    show("fit, CPU", Some(GOAL), &cpu);
    show("fit, elapsed", None, &elapsed);
}

/// The versions of NumPy and SciPy that `python` has; none if it has not both.
fn versions(python: &Path) -> Option<String> {
    let output = Command::new(python)
        .args([
            "-c",
            "import numpy, scipy; print('NumPy', numpy.__version__, 'with SciPy', scipy.__version__)",
        ])
        .stderr(Stdio::null())
        .output()
        .ok()?;
    let text = String::from_utf8(output.stdout).ok()?;
    output.status.success().then(|| text.trim().to_owned())
}
