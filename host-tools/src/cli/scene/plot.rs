//! `stylus scene plot`

use std::path::PathBuf;

use host_tools::playing::motion::Hand;
use host_tools::playing::render::Rendering;
use host_tools::report::plot;
use host_tools::report::plot::{Caption, SceneRegion, SceneView};
use host_tools::support::error::Result;
use model_format::{OutputSample, Provenance};

use super::source::{Along, Source};
use crate::cli::output::print;
use crate::cli::overwrite::Overwrite;
use host_tools::texture::library::{decode_library, read_library};

/// Longest duration that is drawn, s; beyond it, the columns of a spectrogram are too narrow to be seen.
const LONGEST_S: f64 = 600.0;

/// Highest frequency of the spectrogram, Hz: what a fingertip feels.
const HIGHEST_HZ: f64 = 1000.0;

#[derive(clap::Args)]
pub struct Arguments {
    #[command(flatten)]
    source: Source,
    #[command(flatten)]
    along: Along,
    /// SVG file to write
    #[arg(long, value_name = "SVG")]
    out: PathBuf,
    #[command(flatten)]
    overwrite: Overwrite,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let inputs = arguments.source.inputs(&arguments.along);
    arguments.overwrite.file(&arguments.out, &inputs)?;
    let path = arguments.source.library_path()?;
    let bytes = read_library(path)?;
    let library = decode_library(path, &bytes)?;
    let compiled = arguments.source.compile(&library)?;
    let (motion, seconds) = arguments.along.motion(&compiled.scene)?;
    let seconds = seconds.min(LONGEST_S);
    let plan = compiled.plan(&library)?;
    let rendering = Rendering::of_plan(plan, &motion, seconds, arguments.along.seed)?;
    let rate_hz = f64::from(rendering.sample_rate_hz());
    let samples_m_s2: Vec<f64> = rendering
        .map(|sample: OutputSample| f64::from(sample.metres_per_second_squared().0))
        .collect();
    let regions: Vec<SceneRegion> = compiled
        .scene
        .regions
        .iter()
        .map(|region| SceneRegion {
            start_mm: region.start_mm.into(),
            end_mm: region.end_mm.into(),
            surface: region.surface.into(),
        })
        .collect();
    let caption = Caption {
        title: &format!("{} along a motion", compiled.scene.name),
        simulated: compiled.provenance(&library) == Provenance::Simulated,
    };
    let view = SceneView {
        surface_names: &compiled.surface_names,
        regions: &regions,
        hand: Hand::new(&motion),
        samples_m_s2: &samples_m_s2,
        rate_hz,
        highest_hz: HIGHEST_HZ,
    };
    plot::scene(&caption, &view)?.write(&arguments.out)?;
    print(&format!("-> {}", arguments.out.display()))
}
