//! Scenes on the host: from a TOML text to the scene in a library, its cost, and the samples that the stylus plays.
//!
//! A scene has one type per form, in the order in which the forms are made:
//!
//! | form | type |
//! |---|---|
//! | the content of the TOML text | [`SceneDescription`], in a [`SceneFile`] |
//! | the wire form, as a library holds it | [`model_format::scene::Scene`], in a [`CompiledScene`] |
//! | the stages of a tick | [`stylus_kernel::scene::Plan`] |
//! | the samples along a motion | [`Rendering`](stylus_signals::playing::render::Rendering) |
//!
//! **Invariant: a scene plays what its text names and nothing else, and a rendering is bit for bit what the stylus
//! plays.** Synthesis belongs to the kernel, and the wire form to the model format; neither belongs here.
//!
//! The keys of the text have their units in their names:
//!
//! ```toml
//! name = "two cloths"
//! transition_mm = 4                    # fade between neighbours over 4 mm of path; 0 if not given
//!
//! [[surface]]
//! texture = "denim"                    # in the library; without one the surface is smooth
//! gain = 1.0                           # the default
//! [surface.tap]                        # a decaying sine at an impact; `stylus scene fit-tap` fits it to recordings
//! frequency_hz = 240
//! decay_s = 0.012
//! gain_m_s2_per_n_s = 0.4
//! limit_m_s2 = 40
//!
//! [[surface]]
//! name = "sticky vinyl"                # the default is the texture's name
//! texture = "vinyl"
//! [surface.stick_slip]                 # bursts below a speed and above a force
//! period_mm = 1.5
//! duty = 0.4
//! depth = 0.9
//! below_mm_s = 60
//! above_n = 0.5
//!
//! [[region]]                           # a stretch of the path; without any, the first surface is everywhere
//! surface = "denim"
//! start_mm = 0
//! end_mm = 40
//! [[region]]
//! surface = "sticky vinyl"
//! start_mm = 40
//! end_mm = 80
//!
//! [[equaliser.section]]                # of all that the scene plays
//! kind = "low-shelf"                   # or "peaking", "high-shelf"
//! frequency_hz = 80
//! q = 0.7
//! gain_db = 3
//! ```
//! `[constant_motion]` with `speed_mm_s` and `force_n` plays the textures at that motion while there is contact. The
//! default of `sample_rate_hz` is 5000.

mod compile;
mod cost;
mod description;
mod library;
pub mod tap;

pub use compile::CompiledScene;
pub use cost::{CostReport, SceneSummary, Situation, StageCost};
pub use description::{
    ConstantMotion, EqualiserDescription, RegionDescription, SceneDescription, SceneFile, SectionDescription,
    SurfaceDescription,
};
pub use library::{joined, parts, scene_named, surface_names, texture_spec, with_scenes};
