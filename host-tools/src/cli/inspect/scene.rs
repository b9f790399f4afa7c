//! Summary of a scene: its surfaces, its effects and its cost.

use host_tools::scene::{CostReport, surface_names};
use host_tools::support::error::Result;
use model_format::Library;
use model_format::scene::{MotionOfScene, Scene};
use serde::Serialize;
use stylus_kernel::scene::cost;

use crate::cli::table::table;

/// Summary of a scene.
#[derive(Serialize)]
pub struct SceneSummary {
    name: String,
    surfaces: Vec<String>,
    regions: usize,
    constant_motion: bool,
    /// Names of its effects, besides textures.
    effects: Vec<&'static str>,
    /// Worst case of the kernel's cost model, instructions per tick.
    worst_case_instructions: u32,
}

impl SceneSummary {
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

/// Table with one line per scene.
pub fn scene_table(scenes: &[SceneSummary]) -> String {
    let header = [
        "scene",
        "surfaces",
        "regions",
        "motion",
        "effects",
        "instructions at most",
    ];
    let rows: Vec<Vec<String>> = scenes
        .iter()
        .map(|scene| {
            let motion = if scene.constant_motion {
                "constant"
            } else {
                "the stylus's"
            };
            vec![
                scene.name.clone(),
                scene.surfaces.join(", "),
                scene.regions.to_string(),
                motion.to_owned(),
                scene.effects.join(", "),
                scene.worst_case_instructions.to_string(),
            ]
        })
        .collect();
    table(&header, &rows)
}
