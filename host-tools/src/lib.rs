#![doc = include_str!("../README.md")]

pub use stylus_fit::{fit, scene, texture};
pub use stylus_link::{link, procedures};
pub use stylus_signals::{export, playing, recording, rig};
pub use {stylus_dsp as dsp, stylus_evaluation as evaluation, stylus_report as report, stylus_support as support};
