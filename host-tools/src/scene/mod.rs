//! Scenes on the host: from a text with comments and units to the scene that a library holds, and from that to its cost and
//! the very samples that the stylus plays.
//!
//! A scene's text is TOML. Units are in the names of the keys; what is not named is not played.
//!
//! ```toml
//! name = "two cloths"
//! transition_mm = 4                    # fade between neighbours over 4 mm of path; 0 if not given
//!
//! [[surface]]
//! texture = "denim"                    # of the library; without one the surface is smooth
//! gain = 1.0                           # the default
//! [surface.tap]                        # a decaying sine at an impact; `stylus fit-tap` finds these from recordings
//! frequency_hz = 240
//! decay_s = 0.012
//! gain_m_s2_per_n_s = 0.4
//! limit_m_s2 = 40
//!
//! [[surface]]
//! name = "sticky vinyl"                # the texture's name if not given
//! texture = "vinyl"
//! [surface.stick_slip]                 # bursts below a speed and above a force
//! period_mm = 1.5
//! duty = 0.4
//! depth = 0.9
//! below_mm_s = 60
//! above_n = 0.5
//!
//! [[region]]                           # where on the path; none is the first surface everywhere
//! surface = "denim"
//! start_mm = 0
//! end_mm = 40
//! [[region]]
//! surface = "sticky vinyl"
//! start_mm = 40
//! end_mm = 80
//!
//! [equaliser]                          # the inverse of a measured response, or [[equaliser.section]]s
//! response = "coil.csv"                # beside this file: frequency_hz,magnitude_db
//! max_gain_db = 12
//! ```
//! `[constant_motion]` with `speed_mm_s` and `force_n` plays a texture as if always moved so while there is contact;
//! `sample_rate_hz` is 5000 if not given.

mod compile;
mod cost;
mod description;
pub mod equaliser;
mod file;
mod library;
mod place;
mod rendering;
pub mod tap;

pub use compile::CompiledScene;
pub use cost::{CostReport, Situation, StageCost};
pub use description::{
    ConstantMotion, EqualiserDescription, RegionDescription, SceneDescription, SectionDescription,
    SurfaceDescription,
};
pub use file::SceneFile;
pub use library::{surface_names, texture_spec, with_scenes};
pub use rendering::{Hand, SceneRendering};
