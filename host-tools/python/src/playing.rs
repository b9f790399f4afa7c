//! Functions on a library: its content, textures rendered, and scenes compiled.

use std::path::PathBuf;

use host_tools::scene::{SceneFile, SceneSummary};
use host_tools::support::Result;
use host_tools::texture::summary::TextureSummary;
use pyo3::prelude::*;
use serde::Serialize;

use crate::convert::plain;
use crate::error::{raised, refused, warn};
use crate::library::Library;
use crate::motion::{Along, Asked, MotionLike, warn_of_motion};
use crate::rendering::{Played, rendered};
use crate::scene::Scene;

/// A library, a fit, or the path of a library.
#[derive(FromPyObject)]
pub enum LibraryLike<'py> {
    /// A library.
    Library(Bound<'py, Library>),
    /// A result with a library, which is meant.
    Of {
        /// The library of a fit or an import.
        library: Bound<'py, Library>,
    },
    /// A file.
    Path(PathBuf),
}

impl LibraryLike<'_> {
    /// The library that is meant.
    pub fn library(&self, py: Python<'_>) -> PyResult<Py<Library>> {
        match self {
            Self::Library(library) | Self::Of { library } => Ok(library.clone().unbind()),
            Self::Path(path) => Py::new(py, Library::read(path.clone()).map_err(raised)?),
        }
    }
}

/// The content of a library.
#[derive(Serialize)]
struct Content {
    textures: Vec<TextureSummary>,
    scenes: Vec<SceneSummary>,
}

/// Returns the content of a library as plain objects, node by node: that of `stylus inspect --json`.
///
/// `library` is a `Library`, a `Fit`, or a path.
#[pyfunction]
pub fn inspect<'py>(py: Python<'py>, library: LibraryLike<'py>) -> PyResult<Bound<'py, PyAny>> {
    let library = library.library(py)?;
    let library = library.get().decoded().map_err(raised)?;
    let textures = library.textures();
    let scenes = library.scenes().map(|scene| SceneSummary::of(&scene, &library));
    let content = Content {
        textures: textures.map(|t| TextureSummary::of(&t, true)).collect(),
        scenes: scenes.collect::<Result<_>>().map_err(raised)?,
    };
    plain(py, &content)
}

/// Renders a texture, as `stylus render` does: what the stylus plays, sample for sample.
///
/// `library` is a `Library`, a `Fit`, or a path. The motion is a constant `speed_mm_s` and `force_n` for `seconds`, or
/// `motion`, a `Motion` or the path of a table, whose end counts if `seconds` is not given. The same seed gives the
/// same samples. `progress(done, total)` counts seconds. This needs the whole motion beforehand: called per block it
/// begins anew each time. For a motion of the moment take a `Player`.
#[pyfunction]
#[pyo3(signature = (
    library, texture, *, speed_mm_s = None, force_n = None, motion = None, seconds = None, seed = 1, progress = None
))]
#[expect(clippy::too_many_arguments, reason = "they are keywords")]
pub fn render<'py>(
    py: Python<'py>,
    library: LibraryLike<'py>,
    texture: String,
    speed_mm_s: Option<f64>,
    force_n: Option<f64>,
    motion: Option<MotionLike<'py>>,
    seconds: Option<f64>,
    seed: u64,
    progress: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyAny>> {
    let library = library.library(py)?;
    let library = library.get();
    let asked = Asked {
        speed_mm_s,
        force_n,
        motion,
        seconds,
    };
    let Some(Along { path, seconds }) = asked.along()? else {
        return Err(refused(
            "a texture is played along a motion: give speed_mm_s and force_n, or motion",
        ));
    };
    let seconds = seconds.ok_or_else(|| refused("a constant motion has no end: give seconds"))?;
    warn_of_motion(py, &path)?;
    rendered(
        py,
        library.bytes().clone(),
        library.named(),
        Played::Texture(texture),
        path,
        (seconds, seed),
        progress,
    )
}

/// Compiles a scene against the library with its textures, and checks it, as `stylus scene check` does.
///
/// `source` is the path of a scene file, or the text of one; files that a text names are relative to `folder`. Warns of
/// a scene that is beyond the stylus's budget. `StylusError.line` is the line of a value that cannot be used.
#[pyfunction]
#[pyo3(signature = (source, library, *, folder = None))]
pub fn compile_scene<'py>(
    py: Python<'py>,
    source: &Bound<'py, PyAny>,
    library: LibraryLike<'py>,
    folder: Option<PathBuf>,
) -> PyResult<Scene> {
    let library = library.library(py)?;
    let library = library.get();
    let text = source.extract::<String>().ok();
    // A text has line breaks, and a path has none.
    let file = match text.filter(|text| text.contains('\n')) {
        Some(text) => {
            // The path serves errors, and its folder the files that the text names.
            let path = folder.unwrap_or_default().join("scene.toml");
            SceneFile::from_toml(&path, &text)
        }
        None => SceneFile::read(&source.extract::<PathBuf>()?),
    };
    let decoded = library.decoded().map_err(raised)?;
    let compiled = file.and_then(|file| file.compile(&decoded)).map_err(raised)?;
    let scene = Scene::of(compiled, library.bytes().clone());
    let report = scene.costed().map_err(raised)?;
    if !report.fits {
        warn(
            py,
            &format!(
                "scene '{}' takes {} instructions per sample in the worst case, and the budget is {}; the stylus \
                 will refuse it",
                report.scene, report.worst_case.instructions, report.budget_instructions
            ),
        )?;
    }
    Ok(scene)
}
