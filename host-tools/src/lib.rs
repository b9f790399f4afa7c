//! From recordings of a surface to a library of texture models, and from a library to the very samples that the stylus
//! plays. The command `stylus` is a thin layer over this library.

pub mod atomic_file;
pub mod autocorrelation;
pub mod budget;
pub mod certificate;
pub mod densify;
pub mod error;
pub mod evaluate;
mod field;
pub mod fit;
pub mod freehand;
pub mod frontier;
pub mod hatt;
pub mod html;
pub mod leave_one_out;
pub mod line_spectrum;
pub mod linear_prediction;
pub mod link;
pub mod log_spectrum;
pub mod motion;
pub mod plot;
pub mod progress;
pub mod recording;
pub mod reduction;
pub mod render;
pub mod report;
pub mod rig;
pub mod scene;
pub mod spectrum;
pub mod stress;
pub mod takes;
mod transform;
pub mod triage;
pub mod whole_report;
