//! Arguments that stand for a library, and the content of one.

use std::path::PathBuf;

use host_tools::scene::SceneSummary;
use host_tools::support::error::Result;
use host_tools::texture::summary::TextureSummary;
use pyo3::prelude::*;
use serde::Serialize;

use crate::convert::plain;
use crate::error::raised;
use crate::fitting::Fit;
use crate::library::Library;

/// A library, a fit, or the path of a library.
#[derive(FromPyObject)]
pub enum LibraryLike<'py> {
    /// A library.
    Library(Bound<'py, Library>),
    /// A fit, whose library is meant.
    Fit(Bound<'py, Fit>),
    /// A file.
    Path(PathBuf),
}

impl LibraryLike<'_> {
    /// The library that is meant.
    ///
    /// # Errors
    /// A file that is none.
    pub fn library(&self, py: Python<'_>) -> PyResult<Py<Library>> {
        match self {
            Self::Library(library) => Ok(library.clone().unbind()),
            Self::Fit(fit) => Ok(fit.get().library(py)),
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
    let scenes = library.scenes();
    let scenes = scenes.map(|scene| SceneSummary::of(&scene, &library));
    let content = Content {
        textures: textures.map(|t| TextureSummary::of(&t, true)).collect(),
        scenes: scenes.collect::<Result<_>>().map_err(raised)?,
    };
    plain(py, &content)
}
