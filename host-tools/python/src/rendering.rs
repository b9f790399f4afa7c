//! Renderings: what the stylus plays, sample for sample.

use std::path::PathBuf;
use std::sync::Arc;

use host_tools::evaluation::evaluate::texture_named;
use host_tools::playing::motion::MotionPath;
use host_tools::playing::render::{self as playing, WavFormat, write_wav};
use host_tools::scene::CompiledScene;
use host_tools::support::error::{Error, Result};
use host_tools::support::output::check_file;
use host_tools::texture::library::decode_library;
use model_format::OutputSample;
use numpy::PyArray1;
use pyo3::prelude::*;

use crate::convert::array;
use crate::error::raised;
use crate::work::{self, Steps};

/// The stylus's output along a motion.
#[pyclass(frozen, module = "stylus_haptics")]
pub struct Rendering {
    sample_rate_hz: u32,
    saturations: u32,
    codes: Vec<OutputSample>,
    samples: Py<PyArray1<f32>>,
}

#[pymethods]
impl Rendering {
    /// The samples, m/s², float32: those of the WAV file that `stylus render` writes.
    #[getter]
    fn samples(&self, py: Python<'_>) -> Py<PyArray1<f32>> {
        self.samples.clone_ref(py)
    }

    /// The kernel's own words, int32, in steps of 2⁻²⁰ m/s²: bit-equal on the computer and the stylus.
    #[getter]
    fn words(&self, py: Python<'_>) -> Py<PyArray1<i32>> {
        array(py, self.codes.iter().map(|sample| sample.0).collect())
    }

    /// Sample rate, Hz.
    #[getter]
    fn sample_rate_hz(&self) -> u32 {
        self.sample_rate_hz
    }

    /// Duration, s.
    #[getter]
    fn duration_s(&self) -> f64 {
        self.codes.len() as f64 / f64::from(self.sample_rate_hz)
    }

    /// Number of samples at the kernel's full scale.
    #[getter]
    fn saturations(&self) -> u32 {
        self.saturations
    }

    fn __len__(&self) -> usize {
        self.codes.len()
    }

    /// Writes a mono WAV file, whole or not at all: 32-bit floats in m/s², or with `pcm16_m_s2` 16-bit integers whose
    /// full scale that is. What is there is replaced with `overwrite` alone. Returns the number of clipped
    /// samples.
    #[pyo3(signature = (path, *, pcm16_m_s2 = None, overwrite = false))]
    fn save(
        &self,
        py: Python<'_>,
        path: PathBuf,
        pcm16_m_s2: Option<f64>,
        overwrite: bool,
    ) -> PyResult<u64> {
        let format = pcm16_m_s2.map_or(WavFormat::Float32, |full_scale_m_s2| WavFormat::Pcm16 {
            full_scale_m_s2,
        });
        let written = py.detach(|| {
            check_file(&path, overwrite, &[])?;
            let samples = self.codes.iter().copied();
            write_wav(&path, self.sample_rate_hz, format, samples)
        });
        Ok(written.map_err(raised)?.clipped)
    }

    fn __repr__(&self) -> String {
        format!(
            "Rendering({} samples at {} Hz, {} at full scale)",
            self.codes.len(),
            self.sample_rate_hz,
            self.saturations
        )
    }
}

/// The source of a rendering.
pub enum Played {
    /// A texture by its name.
    Texture(String),
    /// A scene.
    Scene(Box<CompiledScene>),
}

/// Renders what is `played` from the library of `bytes`.
///
/// # Errors
/// A texture that is not there, a duration that no rendering has; an interrupt.
pub fn rendered(
    py: Python<'_>,
    bytes: Arc<[u8]>,
    path: PathBuf,
    played: Played,
    motion: MotionPath,
    (seconds, seed): (f64, u64),
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<Rendering> {
    let total = seconds.ceil() as u64;
    let (sample_rate_hz, saturations, codes, samples) =
        work::run(py, total, progress, move |steps| {
            let library = decode_library(&path, &bytes)?;
            let rendering = match &played {
                Played::Texture(name) => {
                    let texture = texture_named(&library, name)?;
                    playing::Rendering::new(texture, &motion, seconds, seed)?
                }
                Played::Scene(scene) => {
                    playing::Rendering::of_plan(scene.plan(&library)?, &motion, seconds, seed)?
                }
            };
            collected(rendering, steps)
        })?;
    Ok(Rendering {
        sample_rate_hz,
        saturations,
        codes,
        samples: array(py, samples),
    })
}

/// Rate, samples at full scale, words, and samples in m/s²; a step per second.
type Collected = (u32, u32, Vec<OutputSample>, Vec<f32>);

fn collected(mut rendering: playing::Rendering<'_>, steps: &Steps) -> Result<Collected> {
    let rate_hz = rendering.sample_rate_hz();
    let count = rendering.len();
    let failed = |_| {
        Error::Request(format!(
            "{count} samples do not fit into memory: render less"
        ))
    };
    let mut codes: Vec<OutputSample> = Vec::new();
    let mut samples: Vec<f32> = Vec::new();
    codes.try_reserve_exact(count).map_err(failed)?;
    samples.try_reserve_exact(count).map_err(failed)?;
    while codes.len() < count {
        for sample in rendering.by_ref().take(rate_hz as usize) {
            codes.push(sample);
            samples.push(sample.metres_per_second_squared().0);
        }
        steps.done();
    }
    Ok((rate_hz, rendering.saturations(), codes, samples))
}
