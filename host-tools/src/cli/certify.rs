//! `stylus certify`

use std::path::PathBuf;

use host_tools::support::error::{Error, Result};
use host_tools::texture::certificate;
use host_tools::texture::certificate::{Cell, Certification, Finding, SAMPLES_PER_SIDE, Stored};
use model_format::Library;

use super::table::table;
use crate::cli::library_file::read_library;
use crate::cli::output::{print, print_json};

/// Number of failing cells that are shown one by one.
const SHOWN_FAILURES: usize = 10;

#[derive(clap::Args)]
pub struct Arguments {
    /// Library to certify
    library: PathBuf,
    /// Print all figures, cell by cell, as JSON
    #[arg(long)]
    json: bool,
    /// Name of a single texture to certify
    #[arg(long, value_name = "NAME")]
    texture: Option<String>,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let bytes = read_library(&arguments.library)?;
    // Uncertified, because this command examines textures that a stylus refuses.
    let library = Library::decode_uncertified(&bytes).map_err(|source| Error::Library {
        path: arguments.library.clone(),
        source,
    })?;
    let textures: Vec<_> = match &arguments.texture {
        Some(name) => vec![host_tools::evaluation::evaluate::texture_named(
            &library, name,
        )?],
        None => library.textures().collect(),
    };
    let reports: Vec<Certification> = textures.iter().map(certificate::certify).collect();
    if arguments.json {
        print_json(&reports)?;
    } else {
        show(&reports)?;
    }
    let unsound = |report: &&Certification| !report.holds || report.stored != Stored::Same;
    match reports.iter().find(unsound) {
        None => Ok(()),
        Some(report) => Err(Error::file(&arguments.library, why_unsound(report))),
    }
}

fn why_unsound(report: &Certification) -> String {
    let texture = &report.texture;
    match report.failures().first() {
        Some(cell) => format!("texture '{texture}': {cell}; fit it as a lattice"),
        None if report.stored == Stored::Missing => {
            format!("texture '{texture}' holds, but its certificate is missing; fit it again")
        }
        None => {
            format!("texture '{texture}' holds, but its certificate differs; fit it again")
        }
    }
}

fn show(reports: &[Certification]) -> Result<()> {
    let header = [
        "texture",
        "structure",
        "cells",
        "hold",
        "margin",
        "worst",
        "at mm/s",
        "at N",
        "stored",
    ];
    let rows: Vec<Vec<String>> = reports.iter().map(row).collect();
    print(&table(&header, &rows))?;
    for report in reports {
        for cell in report.failures().iter().take(SHOWN_FAILURES) {
            print(&format!("texture '{}', FAILS: {cell}", report.texture))?;
        }
    }
    print(&legend(reports))
}

fn row(report: &Certification) -> Vec<String> {
    let holding = report.cells.iter().filter(|cell| cell.holds()).count();
    let [margin, worst, speed, force] = worst(&report.cells);
    let stored = match report.stored {
        Stored::Missing => "missing",
        Stored::Same => "same",
        Stored::Different => "DIFFERENT",
    };
    vec![
        report.texture.clone(),
        report.structure.clone(),
        report.cells.len().to_string(),
        holding.to_string(),
        margin,
        worst,
        speed,
        force,
        stored.to_owned(),
    ]
}

/// Least margin, and largest pole radius or reflection coefficient with its speed and force.
fn worst(cells: &[Cell]) -> [String; 4] {
    let mut margin = Some(f64::INFINITY);
    let (mut largest, mut point) = (0.0f64, None::<(f64, f64, f64)>);
    for cell in cells {
        match &cell.finding {
            Finding::Lattice { largest_reflection } => {
                largest = largest_reflection.max(largest);
                margin = None;
            }
            Finding::Direct {
                proved_margin,
                worst,
                ..
            } => {
                margin = margin.and_then(|least| Some(least.min((*proved_margin)?)));
                if point.is_none_or(|(radius, ..)| worst.pole_radius > radius) {
                    point = Some((worst.pole_radius, worst.speed_mm_s, worst.force_n));
                }
            }
        }
    }
    match point {
        Some((radius, speed, force)) => [
            margin.map_or("none".to_owned(), |margin| format!("{margin:.1e}")),
            format!("{radius:.6}"),
            format!("{speed:.2}"),
            format!("{force:.3}"),
        ],
        None => [
            "-".into(),
            format!("{largest:.6}"),
            String::new(),
            String::new(),
        ],
    }
}

/// Explanation of the table's columns.
fn legend(reports: &[Certification]) -> String {
    let lattice = |cell: &&Cell| matches!(cell.finding, Finding::Lattice { .. });
    let cells = || reports.iter().flat_map(|report| &report.cells);
    let mut lines = Vec::new();
    if cells().any(|cell| lattice(&cell)) {
        lines.push(
            "Lattice, proved: all |θ| below π/2 at the nodes and so between them, rotations that do not lengthen, \
             power in range; so stable under every motion. Worst: the largest |k|."
                .to_owned(),
        );
    }
    if cells().any(|cell| !lattice(&cell)) {
        let side = SAMPLES_PER_SIDE + 1;
        lines.push(format!(
            "Direct form, proved: no zero of A on or outside the unit circle at any point of a cell, |A| at least the \
             margin. Sampled: worst is the largest pole radius of {side} x {side} points per cell. Not covered: \
             changing coefficients, and recovery from saturation (see stylus stress)."
        ));
    }
    format!("\n{}", lines.join("\n"))
}
