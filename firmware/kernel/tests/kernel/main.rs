//! Promises of the kernel for every texture and motion, tested through its public interface only.

mod blocks;
#[cfg(feature = "direct-form")]
mod direct_form;
mod fed;
mod fed_lattice;
mod fed_scene;
mod grid;
mod hard;
mod lattice;
mod level;
mod lines;
mod models;
mod scene;
mod scene_effects;
mod scene_hard;
mod scene_path;
mod start;
mod synthesis;
mod theta;
