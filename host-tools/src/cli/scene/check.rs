//! `stylus scene check` and `stylus scene compile`: a scene's cost, and scenes put into a library.

use std::path::PathBuf;

use model_format::Library;
use model_format::scene::{MotionOfScene, Scene};
use stylus_fit::scene::{CompiledScene, CostReport, SceneFile, Situation, with_scenes};
use stylus_fit::texture::library::{decode_library, read_library};
use stylus_kernel::scene::cost;
use stylus_support::number::counted;
use stylus_support::{Error, Result, atomic_file};

use super::Source;
use crate::cli::files::Overwrite;
use crate::cli::output::{print, print_json, warn};
use crate::cli::table::table;

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

#[derive(clap::Args)]
pub struct CompileArguments {
    /// Scene files
    #[arg(required = true, value_name = "SCENE.toml")]
    scenes: Vec<PathBuf>,
    /// Library with their textures; its scenes are kept, except those of the same name
    #[arg(long, value_name = "LIB")]
    library: PathBuf,
    /// Library file to write, with the scenes; may be the same
    #[arg(long, value_name = "LIB")]
    out: PathBuf,
    #[command(flatten)]
    overwrite: Overwrite,
}

pub fn compile(arguments: &CompileArguments) -> Result<()> {
    let out = &arguments.out;
    // The output may be the library itself, which is then replaced like any other file.
    (arguments.overwrite).file_in_place(out, &arguments.library)?;
    let bytes = read_library(&arguments.library)?;
    let library = decode_library(&arguments.library, &bytes)?;
    let mut scenes: Vec<Scene> = Vec::new();
    let mut lines = Vec::new();
    for path in &arguments.scenes {
        let compiled = SceneFile::read(path)?.compile(&library)?;
        let name = &compiled.scene.name;
        // A scene replaces that of the same name in the library, so one of two given ones would be lost.
        if let Some(other) = scenes.iter().position(|scene| scene.name == *name) {
            let other = arguments.scenes[other].display();
            let problem = format!("its scene is called '{name}', like that of {other}; rename one");
            return Err(Error::file(path, problem));
        }
        let report = CostReport::new(&compiled.scene, &compiled.surface_names, &library, cost::BUDGET)?;
        if !report.fits {
            warn(&format!(
                "{}: takes {} instructions per sample in the worst case, and the budget is {}; the stylus \
                 will refuse it",
                path.display(),
                report.worst_case.instructions,
                report.budget_instructions
            ));
        }
        lines.push(headline(&compiled));
        scenes.push(compiled.scene);
    }
    let written = with_scenes(&library, &scenes)?;
    // The stylus will decode these bytes, so they are decoded here before they are written.
    let checked = decode_library(out, &written).map(|l: Library<'_>| l.scene_count())?;
    atomic_file::write(out, &written)?;
    for line in lines {
        print(&line)?;
    }
    print(&format!(
        "-> {}: {}, {}, {}",
        out.display(),
        counted(library.len(), "texture"),
        counted(checked, "scene"),
        counted(written.len(), "byte")
    ))
}
