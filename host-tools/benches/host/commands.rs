//! Whole commands of an older `stylus`, and of this one.

use std::path::Path;

use crate::pairs::{COMMAND_GOAL, run, show, simulate};

/// Compares commands of the program at `before` with this build's, and says where there is none to compare with.
pub fn compare(before: Option<&Path>, is_quick: bool) {
    let Some(before) = before else {
        println!("commands: left out, because they need an earlier build of stylus: --before FILE");
        return;
    };
    let after = Path::new(env!("CARGO_BIN_EXE_stylus"));
    let folder = tempfile::tempdir().expect("a temporary folder");
    let (speeds, forces, turns) = if is_quick {
        ("[80, 120, 160]", "[0.6, 1.0]", 1)
    } else {
        ("[40, 80, 120, 160, 200]", "[0.2, 0.6, 1.0, 1.4]", 5)
    };
    simulate(folder.path(), Some((speeds, forces)));
    let cpu_s = |program: &Path, arguments: &str| {
        let arguments: Vec<&str> = arguments.split(' ').collect();
        run(program, &arguments, folder.path()).cpu_s
    };
    // By the older one, because it may not know what this one writes.
    cpu_s(before, "fit set --order 400 --out fitted.lib");
    println!(
        "commands of {} and of this build, CPU seconds:",
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
            .map(|_| (cpu_s(before, arguments), cpu_s(after, arguments)))
            .collect();
        show(name, Some(COMMAND_GOAL), &pairs);
    }
}
