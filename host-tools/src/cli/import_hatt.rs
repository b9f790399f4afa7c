//! `stylus import-hatt`

use std::path::{Path, PathBuf};

use stylus_fit::fit::hatt::convert::{Converted, ROLL_OFF_DB_PER_OCTAVE, Summary, far_nodes};
use stylus_fit::fit::hatt::import::{ImportReport, Options, files, import, plan, read_all};
use stylus_support::Result;
use stylus_support::Warning;
use stylus_support::atomic_file;
use stylus_support::number::counted;
use stylus_support::progress;

use super::files::Overwrite;
use super::table::table;
use crate::cli::output::{print, print_json, warn_of};

#[derive(clap::Args)]
pub struct Arguments {
    /// HaTT model files, or folders of them; each file becomes a texture of its name
    #[arg(required = true, value_name = "XML|DIR")]
    paths: Vec<PathBuf>,
    /// Library file to write
    #[arg(long, value_name = "LIB")]
    out: PathBuf,
    #[command(flatten)]
    overwrite: Overwrite,
    #[command(flatten)]
    options: Options,
    /// Print the errors of the conversion, place by place, as JSON
    #[arg(long)]
    json: bool,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let paths = files(&arguments.paths)?;
    arguments.overwrite.file(&arguments.out)?;
    let sources = read_all(&paths, &arguments.options)?;
    // All files at once, because the grids of all textures share the room of one library.
    let plan = plan(&sources, &arguments.options)?;
    let of_file = |kind, path: &Path, text: &str| Warning::of(kind, ("file", &path.display().to_string()), 0.0, text);
    let read = sources.iter().flat_map(|source| {
        source
            .toolkit
            .warnings
            .iter()
            .map(|text| of_file("model", &source.path, text))
    });
    warn_of(&read.collect::<Vec<_>>());
    let bar = progress::bar(sources.len() as u64, "converting");
    let (converted, bytes) = import(&sources, &plan, &|| bar.inc(1))?;
    bar.finish_and_clear();
    atomic_file::write(&arguments.out, &bytes)?;
    let far = sources.iter().zip(&converted).filter_map(|(source, converted)| {
        let text = far_nodes(&converted.nodes)?;
        Some(of_file("far nodes", &source.path, &text))
    });
    warn_of(&far.collect::<Vec<_>>());
    if arguments.json {
        let reports: Vec<ImportReport> = sources.into_iter().zip(converted).map(ImportReport::of).collect();
        return print_json(&reports);
    }
    print(&format!("{}\n", textures(&converted)))?;
    print(&format!(
        "{} -> {} ({}); errors are of what the library plays against the file's own definition, within \
         the models' own band; above it the level falls by {ROLL_OFF_DB_PER_OCTAVE} dB per octave",
        counted(converted.len(), "texture"),
        arguments.out.display(),
        counted(bytes.len(), "byte")
    ))
}

/// Returns a table with a row per texture: the grid, the worst error of a node, and errors at the models' own places
/// and between them.
fn textures(converted: &[Converted]) -> String {
    let rows: Vec<Vec<String>> = converted
        .iter()
        .map(|texture| {
            let spec = &texture.spec;
            let bands = texture.nodes.iter().filter_map(|node| node.worst_band_db);
            let mut row = vec![
                spec.name.clone(),
                format!("{} x {}", spec.speed_axis_mm_s.len(), spec.force_axis_n.len()),
                format!("{:.2}", bands.fold(0.0, f64::max)),
            ];
            for errors in [&texture.own, &texture.between] {
                let summary = Summary::of(errors);
                let number = |of: fn(&Summary) -> f64| summary.as_ref().map_or("-".into(), |s| format!("{:.2}", of(s)));
                row.extend([
                    number(|s| s.level_median_db),
                    number(|s| s.level_95_db),
                    number(|s| s.unfelt_bands_percent),
                ]);
            }
            row
        })
        .collect();
    let header = [
        "texture",
        "grid",
        "worst band dB",
        "own level dB",
        "95 %",
        "bands %",
        "between level dB",
        "95 %",
        "bands %",
    ];
    table(&header, &rows)
}
