//! Scenes: surfaces along a path, with effects. And renderings, of textures too: what the stylus plays, sample for
//! sample.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use host_tools::evaluation::evaluate::texture_named;
use host_tools::playing::motion::MotionPath;
use host_tools::playing::render::{self as playing, WavFormat, write_wav};
use host_tools::scene::{CompiledScene, CostReport};
use host_tools::support::output::check_file;
use host_tools::support::visible::visible_line;
use host_tools::support::{Error, Result};
use host_tools::texture::library::decode_library;
use model_format::scene::MotionOfScene;
use model_format::{OutputSample, Provenance};
use pyo3::prelude::*;
use stylus_kernel::scene::cost;

use crate::convert::{array, made, plain};
use crate::error::{raised, refused};
use crate::motion::{Along, Asked, MotionLike};
use crate::work::{self, Steps};

/// A scene, checked against the library that plays it.
#[pyclass(frozen, module = "stylus_haptics")]
pub struct Scene {
    compiled: CompiledScene,
    library: Arc<[u8]>,
}

impl Scene {
    /// A scene with the library that it plays from, given as bytes.
    pub fn of(compiled: CompiledScene, library: Arc<[u8]>) -> Self {
        Self { compiled, library }
    }

    /// Wire form of the scene.
    pub fn wired(&self) -> &model_format::scene::Scene {
        &self.compiled.scene
    }

    fn decoded(&self) -> Result<model_format::Library<'_>> {
        decode_library(Path::new("library"), &self.library)
    }

    /// Cost of the scene against the budget of a tick.
    pub fn costed(&self) -> Result<CostReport> {
        let names = &self.compiled.surface_names;
        CostReport::new(&self.compiled.scene, names, &self.decoded()?, cost::BUDGET)
    }

    /// Returns the constant speed, mm/s, and force, N, of a scene that has them; `None` for both if the scene follows
    /// the hand.
    fn own_motion(&self) -> (Option<f64>, Option<f64>) {
        match self.compiled.scene.motion {
            MotionOfScene::Constant { speed_mm_s, force_n } => (Some(speed_mm_s.into()), Some(force_n.into())),
            MotionOfScene::Followed => (None, None),
        }
    }
}

#[pymethods]
impl Scene {
    /// Name.
    #[getter]
    fn name(&self) -> &str {
        self.compiled.scene.name.as_str()
    }

    /// Names of the surfaces, in their order.
    #[getter]
    fn surfaces(&self) -> Vec<String> {
        self.compiled.surface_names.clone()
    }

    /// Sample rate, Hz.
    #[getter]
    fn sample_rate_hz(&self) -> u32 {
        self.compiled.scene.sample_rate_hz
    }

    /// True if any of its textures is of simulated recordings.
    #[getter]
    fn simulated(&self) -> PyResult<bool> {
        let library = self.decoded().map_err(raised)?;
        Ok(self.compiled.provenance(&library) == Provenance::Simulated)
    }

    /// Instructions per sample of the worst case, by the kernel's cost model.
    #[getter]
    fn worst_case_instructions(&self) -> PyResult<u32> {
        Ok(self.costed().map_err(raised)?.worst_case.instructions)
    }

    /// True if the worst case is within the budget; otherwise the stylus refuses the scene.
    #[getter]
    fn fits(&self) -> PyResult<bool> {
        Ok(self.costed().map_err(raised)?.fits)
    }

    /// The cost of each situation with its arithmetic, in instructions per sample, as plain objects.
    fn cost<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        plain(py, &self.costed().map_err(raised)?)
    }

    /// Renders the scene, as `stylus scene render` does. A scene of constant motion needs no other; see `render`.
    #[pyo3(signature = (
        *, speed_mm_s = None, force_n = None, motion = None, seconds = None, seed = 1, progress = None
    ))]
    #[expect(clippy::too_many_arguments, reason = "they are keywords")]
    fn render<'py>(
        &self,
        py: Python<'py>,
        speed_mm_s: Option<f64>,
        force_n: Option<f64>,
        motion: Option<MotionLike<'py>>,
        seconds: Option<f64>,
        seed: u64,
        progress: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        // The scene's own motion beside a given one would be refused as two motions.
        let is_asked = speed_mm_s.is_some() || force_n.is_some() || motion.is_some();
        let (speed_mm_s, force_n) = if is_asked {
            (speed_mm_s, force_n)
        } else {
            self.own_motion()
        };
        let asked = Asked {
            speed_mm_s,
            force_n,
            motion,
            seconds,
        };
        let name = self.name();
        let Some(Along { path, seconds }) = asked.along()? else {
            return Err(refused(format!(
                "scene '{name}' follows the hand: give motion, or speed_mm_s, force_n and seconds"
            )));
        };
        let no_end = || refused(format!("scene '{name}': a constant motion has no end; give seconds"));
        let seconds = seconds.ok_or_else(no_end)?;
        rendered(
            py,
            self.library.clone(),
            PathBuf::from("library"),
            Played::Scene(Box::new(self.compiled.clone())),
            path,
            (seconds, seed),
            progress,
        )
    }

    fn __repr__(&self) -> String {
        format!(
            "Scene({:?}, surfaces {})",
            self.name(),
            self.compiled.surface_names.join(", ")
        )
    }
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
    let words = crate::convert::words("words", words)?;
    Ok(py
        .detach(|| {
            check_file(&path, overwrite, &[])?;
            let samples = words.into_iter().map(OutputSample);
            write_wav(&path, sample_rate_hz, format, samples)
        })
        .map_err(raised)?
        .clipped)
}

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
