//! Table of scenes.

use host_tools::scene::SceneSummary;

use crate::cli::table::folded_table;

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
    folded_table(&header, &rows, 1)
}
