//! Scenes: surfaces along a path, with effects.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use host_tools::scene::{CompiledScene, CostReport};
use host_tools::support::Result;
use host_tools::texture::library::decode_library;
use model_format::Provenance;
use model_format::scene::MotionOfScene;
use pyo3::prelude::*;
use stylus_kernel::scene::cost;

use crate::convert::plain;
use crate::error::{raised, refused};
use crate::motion::{Along, Asked, MotionLike};
use crate::rendering::{Played, rendered};

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
