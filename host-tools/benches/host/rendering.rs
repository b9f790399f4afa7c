//! Rendering by the kernel's plain arithmetic, and by the host's own, which give the same samples.

use std::fmt::Write;

use host_tools::dsp::model::Model;
use host_tools::playing::motion::MotionPath;
use host_tools::playing::render::Rendering;
use host_tools::playing::wavefront::Wavefront;
use host_tools::texture::grid::Grid;
use host_tools::texture::library::library_of;
use host_tools::texture::quantise::StructureChoice;
use model_format::{Laws, Library, MillimetresPerSecond, Newton, NodeFlags, PartsSpec};
use stylus_kernel::arithmetic::{Arithmetic, Portable};
use stylus_kernel::scene::Plan;

use crate::pairs::{own_cpu_s, show};

/// Order of the rendered models.
const ORDER: usize = 400;

/// The lowest ratio of CPU seconds that is asked for, at rest.
const GOAL: f64 = 3.0;

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
    library_of("bench", &grid, structure).expect("the models are stable")
}

/// CPU seconds that rendering takes by `A`, and the sum of the samples, so that none is left out.
fn rendered<A: Arithmetic>(bytes: &[u8], motion: &MotionPath, seconds: f64) -> (f64, i64) {
    let library = Library::decode(bytes).expect("it was just encoded");
    let plan = Plan::of_texture(library.textures().next().expect("one was encoded"));
    let rendering = Rendering::<'_, A>::by_arithmetic(plan, motion, seconds, 1);
    let begin = own_cpu_s();
    let sum = rendering
        .expect("a short rendering")
        .map(|sample| i64::from(sample.0))
        .sum();
    (own_cpu_s() - begin, sum)
}

/// Compares the scalar player, the kernel's plain arithmetic, with the host's own.
pub fn compare(is_quick: bool) {
    println!(
        "rendering, by the kernel's plain arithmetic and by {} instructions:",
        Wavefront::instructions()
    );
    // A rendering of so many seconds takes a hundred of the clock's steps.
    let (turns, seconds) = if is_quick { (3, 4.0) } else { (21, 60.0) };
    let rest = MotionPath::constant(MillimetresPerSecond(100.0), Newton(0.7)).expect("finite");
    let mut table = "time_s,speed_mm_s,force_n\n".to_owned();
    for turn in 0..=30 {
        let (speed_mm_s, force_n) = if turn % 2 == 0 { (60, 0.6) } else { (140, 0.9) };
        let _ = writeln!(table, "{},{speed_mm_s},{force_n}", 2 * turn);
    }
    let folder = tempfile::tempdir().expect("a temporary folder");
    let path = folder.path().join("motion.csv");
    std::fs::write(&path, table).expect("a temporary file");
    let moving = MotionPath::from_csv(&path).expect("a sound table");
    for (name, structure, motion, goal) in [
        (
            "lattice 400, at rest",
            StructureChoice::Lattice,
            &rest,
            Some(GOAL),
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
