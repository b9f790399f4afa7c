//! Scenes, compiled.

use std::path::PathBuf;

use host_tools::scene::SceneFile;
use pyo3::prelude::*;

use crate::error::{raised, warn};
use crate::library_like::LibraryLike;
use crate::scene::Scene;

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
    let file = match text.filter(|text| text.contains('\n')) {
        Some(text) => {
            let path = folder.unwrap_or_default().join("scene.toml");
            SceneFile::from_toml(&path, &text)
        }
        None => SceneFile::read(&source.extract::<PathBuf>()?),
    };
    let decoded = library.decoded().map_err(raised)?;
    let compiled = file
        .and_then(|file| file.compile(&decoded))
        .map_err(raised)?;
    let scene = Scene::of(compiled, library.bytes().clone());
    let report = scene.costed().map_err(raised)?;
    if !report.fits {
        warn(
            py,
            &format!(
                "scene '{}' takes {} instructions per tick in the worst case, and the budget is {}; the stylus will \
                 refuse it",
                report.scene, report.worst_case.instructions, report.budget_instructions
            ),
        )?;
    }
    Ok(scene)
}
