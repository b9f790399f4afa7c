//! Renderings of textures and scenes: what the stylus plays, sample for sample.

use std::path::PathBuf;
use std::sync::Arc;

use host_tools::evaluation::evaluate::texture_named;
use host_tools::playing::motion::MotionPath;
use host_tools::playing::render::{self as playing, WavFormat, write_wav};
use host_tools::scene::CompiledScene;
use host_tools::support::output::check_file;
use host_tools::support::visible::visible_line;
use host_tools::support::{Error, Result};
use host_tools::texture::library::decode_library;
use model_format::{OutputSample, Provenance};
use pyo3::prelude::*;

use crate::convert::{self, array, made};
use crate::error::raised;
use crate::work::{self, Steps};

/// The source of a rendering.
pub enum Played {
    /// A texture by its name.
    Texture(String),
    /// A scene.
    Scene(Box<CompiledScene>),
}

/// Renders what is `played` from the library of `bytes`.
pub fn rendered<'py>(
    py: Python<'py>,
    bytes: Arc<[u8]>,
    path: PathBuf,
    played: Played,
    motion: MotionPath,
    (seconds, seed): (f64, u64),
    progress: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyAny>> {
    let total = seconds.ceil() as u64;
    let ((sample_rate_hz, saturations, words, samples), label, simulated) =
        work::run(py, total, progress, move |steps| {
            let library = decode_library(&path, &bytes)?;
            let (rendering, label, provenance) = match &played {
                Played::Texture(name) => {
                    let texture = texture_named(&library, name)?;
                    let rendering = playing::Rendering::new(texture, &motion, seconds, seed)?;
                    (rendering, visible_line(name).into_owned(), texture.provenance())
                }
                Played::Scene(scene) => {
                    let (name, plan) = (scene.scene.name.as_str(), scene.plan(&library)?);
                    let rendering = playing::Rendering::of_plan(plan, &motion, seconds, seed)?;
                    (rendering, name.to_owned(), scene.provenance(&library))
                }
            };
            let simulated = provenance == Provenance::Simulated;
            Ok((collected(rendering, steps)?, label, simulated))
        })?;
    let (samples, words) = (array(py, samples), array(py, words));
    let arguments = (samples, words, sample_rate_hz, saturations, label, simulated);
    made(py, "Rendering", arguments)
}

/// Rate, Hz; number of samples at full scale; words; and samples in m/s².
type Collected = (u32, u32, Vec<i32>, Vec<f32>);

fn collected(mut rendering: playing::Rendering<'_>, steps: &Steps) -> Result<Collected> {
    let rate_hz = rendering.sample_rate_hz();
    let count = rendering.len();
    let failed = |_| Error::Request(format!("{count} samples do not fit into memory: render less"));
    let mut words: Vec<i32> = Vec::new();
    let mut samples: Vec<f32> = Vec::new();
    // An allocation that fails would end the interpreter.
    words.try_reserve_exact(count).map_err(failed)?;
    samples.try_reserve_exact(count).map_err(failed)?;
    while words.len() < count {
        // One second at a time, so that Ctrl-C ends a long rendering soon.
        for sample in rendering.by_ref().take(rate_hz as usize) {
            words.push(sample.0);
            samples.push(sample.metres_per_second_squared().0);
        }
        steps.done();
    }
    Ok((rate_hz, rendering.saturations(), words, samples))
}

/// Writes the file of `Rendering.save`: a mono WAV file of these words. Returns the number of clipped samples.
#[pyfunction]
#[pyo3(name = "_write_wav")]
pub fn write_words(
    py: Python<'_>,
    path: PathBuf,
    words: &Bound<'_, PyAny>,
    sample_rate_hz: u32,
    pcm16_m_s2: Option<f64>,
    overwrite: bool,
) -> PyResult<u64> {
    let format = pcm16_m_s2.map_or(WavFormat::Float32, |full_scale_m_s2| WavFormat::Pcm16 {
        full_scale_m_s2,
    });
    let words = convert::words("words", words)?;
    Ok(py
        .detach(|| {
            check_file(&path, overwrite, &[])?;
            let samples = words.into_iter().map(OutputSample);
            write_wav(&path, sample_rate_hz, format, samples)
        })
        .map_err(raised)?
        .clipped)
}
