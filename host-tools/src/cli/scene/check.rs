//! `stylus scene check`

use model_format::scene::MotionOfScene;
use stylus_fit::scene::{CompiledScene, CostReport, Situation};
use stylus_kernel::scene::cost;
use stylus_support::number::counted;
use stylus_support::{Error, Result};

use super::render::Source;
use crate::cli::output::{print, print_json};
use crate::cli::table::table;
use stylus_fit::texture::library::{decode_library, read_library};

#[derive(clap::Args)]
pub struct Arguments {
    #[command(flatten)]
    source: Source,
    /// Instructions per tick that the scene may take: for one sample at 5 kHz, for two at 10 kHz
    #[arg(long, value_name = "INSTRUCTIONS", default_value_t = cost::BUDGET)]
    budget: u32,
    /// Print all figures as JSON
    #[arg(long)]
    json: bool,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let path = arguments.source.library_path()?;
    let bytes = read_library(path)?;
    let library = decode_library(path, &bytes)?;
    let compiled = arguments.source.compile(&library)?;
    let report = CostReport::new(&compiled.scene, &compiled.surface_names, &library, arguments.budget)?;
    if arguments.json {
        print_json(&report)?;
    } else {
        print(&text(&compiled, &report))?;
    }
    // Only now, because the arithmetic shows what to leave out of a scene that does not fit.
    if report.fits {
        return Ok(());
    }
    Err(Error::Request(format!(
        "scene '{}' takes {} instructions per sample ({}), and the budget is {} at {} Hz; use fewer sections, or \
         textures of a lower order",
        report.scene,
        report.worst_case.instructions,
        report.worst_case.sum(),
        report.budget_instructions,
        report.sample_rate_hz
    )))
}

/// Returns one line about a scene: its path, its motion, its surfaces and its equaliser.
pub fn headline(compiled: &CompiledScene) -> String {
    let scene = &compiled.scene;
    let path = match (scene.regions.first(), scene.regions.last()) {
        (Some(first), Some(last)) => format!(
            "{} from {} to {} mm, transitions of {} mm",
            counted(scene.regions.len(), "region"),
            first.start_mm,
            last.end_mm,
            scene.transition_mm
        ),
        _ => "the first everywhere".to_owned(),
    };
    let motion = match scene.motion {
        MotionOfScene::Followed => "the stylus's own motion".to_owned(),
        MotionOfScene::Constant { speed_mm_s, force_n } => format!("always {speed_mm_s} mm/s and {force_n} N"),
    };
    format!(
        "scene '{}': {}, {path}; {motion}; {}",
        scene.name,
        counted(scene.surfaces.len(), "surface"),
        match scene.equaliser.len() {
            0 => "no equaliser".to_owned(),
            sections => format!("equaliser of {}", counted(sections, "section")),
        }
    )
}

fn text(compiled: &CompiledScene, report: &CostReport) -> String {
    let row = |situation: &Situation| {
        vec![
            situation.when.clone(),
            situation.instructions.to_string(),
            situation.sum(),
        ]
    };
    let mut rows: Vec<Vec<String>> = report.typical.iter().map(row).collect();
    rows.push(row(&report.worst_case));
    let mut lines = vec![headline(compiled)];
    lines.push(String::new());
    let header = ["situation", "instructions", "arithmetic"];
    lines.push(table(&header, &rows));
    let share = f64::from(report.worst_case.instructions) / f64::from(report.budget_instructions);
    lines.push(format!(
        "\nThe worst case takes {:.0} % of the budget of {} instructions per sample at {} Hz.",
        100.0 * share,
        report.budget_instructions,
        report.sample_rate_hz
    ));
    lines.join("\n")
}
