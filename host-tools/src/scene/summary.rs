//! Summary of a scene: its surfaces, its effects and its cost.

use model_format::Library;
use model_format::scene::{MotionOfScene, Scene};
use serde::Serialize;
use stylus_kernel::scene::cost;

use super::cost::CostReport;
use super::library::surface_names;
use crate::support::error::Result;

/// Summary of a scene.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct SceneSummary {
    /// Name.
    pub name: String,
    /// Names of its surfaces.
    pub surfaces: Vec<String>,
    /// Number of its regions.
    pub regions: usize,
    /// True if it plays at a motion of its own.
    pub constant_motion: bool,
    /// Names of its effects, besides textures.
    pub effects: Vec<&'static str>,
    /// Worst case of the kernel's cost model, instructions per sample.
    pub worst_case_instructions: u32,
}

impl SceneSummary {
    /// Summary of `scene`, which is one of `library`.
    ///
    /// # Errors
    /// A scene that the library does not bear out.
    pub fn of(scene: &Scene, library: &Library<'_>) -> Result<Self> {
        let names = surface_names(scene, library);
        let report = CostReport::new(scene, &names, library, cost::BUDGET)?;
        let effects = [
            (
                "transitions",
                scene.transition_mm > 0.0 && scene.regions.len() > 1,
            ),
            ("taps", scene.surfaces.iter().any(|s| s.tap.is_some())),
            (
                "stick-slip",
                scene.surfaces.iter().any(|s| s.stick_slip.is_some()),
            ),
            ("equaliser", !scene.equaliser.is_empty()),
        ];
        Ok(Self {
            name: scene.name.as_str().to_owned(),
            surfaces: names,
            regions: scene.regions.len(),
            constant_motion: scene.motion != MotionOfScene::Followed,
            effects: effects
                .into_iter()
                .filter_map(|(effect, is_there)| is_there.then_some(effect))
                .collect(),
            worst_case_instructions: report.worst_case.instructions,
        })
    }
}
