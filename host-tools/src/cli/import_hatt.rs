//! `stylus import-hatt`

use std::path::PathBuf;

use host_tools::fit::hatt::convert::{ConvertedNode, Options, ROLL_OFF_DB_PER_OCTAVE, convert};
use host_tools::fit::hatt::read::read;
use host_tools::support::atomic_file;
use host_tools::support::error::{Error, Result};

use super::table::table;
use crate::cli::output::{print, print_json};

#[derive(clap::Args)]
pub struct Arguments {
    /// HaTT model files; each becomes a texture named like the file
    #[arg(required = true, value_name = "XML")]
    files: Vec<PathBuf>,
    /// Library file to write
    #[arg(long, value_name = "LIB")]
    out: PathBuf,
    /// Number of speeds of the grid, up to the file's highest
    #[arg(long, default_value_t = 10)]
    speeds: usize,
    /// Number of forces of the grid, up to the file's highest
    #[arg(long, default_value_t = 6)]
    forces: usize,
    /// Print the errors of the conversion, node by node, as JSON
    #[arg(long)]
    json: bool,
}

#[derive(serde::Serialize)]
struct ImportReport {
    texture: String,
    warnings: Vec<String>,
    nodes: Vec<ConvertedNode>,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let options = Options {
        speeds: arguments.speeds,
        forces: arguments.forces,
    };
    let mut specs = Vec::new();
    let mut reports = Vec::new();
    for path in &arguments.files {
        let text = std::fs::read_to_string(path).map_err(Error::io("read", path))?;
        let toolkit = read(path, &text)?;
        let name = path
            .file_stem()
            .unwrap_or_default()
            .to_string_lossy()
            .into_owned();
        let converted =
            convert(&name, &toolkit, &options).map_err(|e| Error::file(path, e.to_string()))?;
        for warning in &toolkit.warnings {
            eprintln!("warning: {}: {warning}", path.display());
        }
        specs.push(converted.spec);
        reports.push(ImportReport {
            texture: name,
            warnings: toolkit.warnings,
            nodes: converted.nodes,
        });
    }
    let bytes = model_format::encode(&specs).map_err(|failure| {
        Error::Model(format!("the textures do not make a library: {failure}"))
    })?;
    atomic_file::write(&arguments.out, &bytes)?;
    if arguments.json {
        return print_json(&reports);
    }
    for report in &reports {
        let number = |value: Option<f64>| value.map_or("-".into(), |value| format!("{value:.2}"));
        let rows: Vec<Vec<String>> = report
            .nodes
            .iter()
            .map(|node| {
                let place = if node.rms_m_s2 <= 0.0 {
                    "silent"
                } else if node.is_extrapolated {
                    "beyond the models"
                } else {
                    "between models"
                };
                vec![
                    node.speed_mm_s.to_string(),
                    node.force_n.to_string(),
                    format!("{:.3}", node.rms_m_s2),
                    node.order.to_string(),
                    number(node.worst_band_db),
                    number(node.level_db),
                    place.to_owned(),
                ]
            })
            .collect();
        let header = [
            "mm/s",
            "N",
            "RMS m/s²",
            "order",
            "worst band dB",
            "level dB",
            "",
        ];
        print(&format!("{}\n{}\n", report.texture, table(&header, &rows)))?;
    }
    print(&format!(
        "{} textures -> {} ({} bytes); errors are of the conversion, within the models' own band; above it the level \
         falls by {ROLL_OFF_DB_PER_OCTAVE} dB per octave",
        reports.len(),
        arguments.out.display(),
        bytes.len()
    ))
}
