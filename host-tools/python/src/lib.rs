//! The Python package `stylus_haptics`: what the command `stylus` does, with NumPy arrays in and out.
//!
//! **Invariant: thin.** A function takes its arguments apart, calls the crate `host-tools`, and puts the results
//! together. All results are computed there, so they are bit for bit those of the command. Results are plain Python
//! objects; their classes in `_results.py` display them and make tables of them.
//!
//! | module | subject |
//! |---|---|
//! | `error` | exceptions and warnings |
//! | `work` | long work: releases the interpreter's lock, shows progress, stops at Ctrl-C |
//! | `convert` | arrays, paths and choices |
//! | `recording` | recordings from arrays and files, and sets of them; simulated ones |
//! | `fitting`, `evaluating` | fits, also of HaTT's models, their evaluation, and the pages that show both |
//! | `options` | the command's options as keywords |
//! | `library` | libraries, their textures and nodes |
//! | `motion` | motions |
//! | `rendering` | renderings of textures and scenes, and their files |
//! | `scene` | scenes, costed and rendered |
//! | `player` | textures and scenes in real time |
//! | `playing` | arguments that stand for a library; textures rendered, scenes compiled |
//! | `device` | a stylus on a link |
//!
//! There is no unsafe code here. PyO3 and rust-numpy contain all that the bindings need.

#![expect(
    clippy::needless_pass_by_value,
    reason = "arguments come out of Python objects by value"
)]

mod convert;
mod device;
mod error;
mod evaluating;
mod fitting;
mod library;
mod motion;
mod options;
mod player;
mod playing;
mod recording;
mod rendering;
mod scene;
mod work;

use pyo3::prelude::*;

/// Data-driven haptic textures: recordings to models, models to what the stylus plays.
#[pymodule]
#[pyo3(name = "_native")]
mod native {
    #[pymodule_export]
    use crate::device::{Device, devices};
    #[pymodule_export]
    use crate::evaluating::{read_answers, score};
    #[pymodule_export]
    use crate::library::Library;
    #[pymodule_export]
    use crate::motion::Motion;
    #[pymodule_export]
    use crate::player::Player;
    #[pymodule_export]
    use crate::playing::{compile_scene, inspect, render};
    #[pymodule_export]
    use crate::recording::{Recording, Recordings, paper_rig, simulate_rig};
    #[pymodule_export]
    use crate::rendering::write_words;
    #[pymodule_export]
    use crate::scene::Scene;

    use super::error;
    use super::evaluating::{compare, evaluate, page};
    use super::fitting::{OF_TRIALS, fit, fit_strokes, import_hatt};
    use super::options::described;
    use host_tools::evaluation::evaluate as evaluation;
    use host_tools::fit::conditioning::Conditioning;
    use host_tools::fit::{Options, hatt};
    use pyo3::prelude::*;

    /// Adds the functions whose options are described elsewhere, the exceptions, and the version of the package.
    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        error::add_to(module)?;
        for function in [
            described::<Options>(wrap_pyfunction!(fit, module)?, &[]),
            described::<Options>(wrap_pyfunction!(fit_strokes, module)?, &OF_TRIALS),
            described::<hatt::import::Options>(wrap_pyfunction!(import_hatt, module)?, &[]),
            described::<evaluation::Options>(wrap_pyfunction!(evaluate, module)?, &[]),
            described::<Conditioning>(wrap_pyfunction!(page, module)?, &[]),
            described::<Conditioning>(wrap_pyfunction!(compare, module)?, &[]),
        ] {
            module.add_function(function?)?;
        }
        module.add("__version__", env!("CARGO_PKG_VERSION"))?;
        module.add("SAMPLE_RATE_HZ", model_format::SAMPLE_RATE_HZ)
    }
}
