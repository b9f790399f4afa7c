//! Proofs of stability.

use host_tools::evaluation::evaluate::texture_named;
use host_tools::support::error::Error;
use host_tools::texture::certificate::{self, Stored};
use model_format::Library;
use pyo3::prelude::*;

use crate::convert::plain;
use crate::library_like::LibraryLike;
use crate::work;

/// The findings on a texture: stability at every point of its grid.
#[pyclass(frozen, module = "stylus_haptics")]
pub struct Certification(certificate::Certification);

#[pymethods]
impl Certification {
    /// Name of the texture.
    #[getter]
    fn texture(&self) -> &str {
        &self.0.texture
    }

    /// Structure of its filters, in words.
    #[getter]
    fn structure(&self) -> &str {
        &self.0.structure
    }

    /// True if every cell of the grid is stable.
    #[getter]
    fn holds(&self) -> bool {
        self.0.holds
    }

    /// The certificate that the library holds, against this one: 'same', 'different' or 'missing'.
    #[getter]
    fn stored(&self) -> &'static str {
        match self.0.stored {
            Stored::Missing => "missing",
            Stored::Same => "same",
            Stored::Different => "different",
        }
    }

    /// Cells that do not hold, in words, the worst first.
    #[getter]
    fn failures(&self) -> Vec<String> {
        self.0.failures().iter().map(ToString::to_string).collect()
    }

    /// All figures, cell by cell, as plain objects: those of `stylus certify --json`.
    fn as_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        plain(py, &self.0)
    }

    fn __repr__(&self) -> String {
        format!(
            "Certification({:?}, {}, {} cells, holds={})",
            self.0.texture,
            self.0.structure,
            self.0.cells.len(),
            self.0.holds
        )
    }
}

/// Proves the textures of a library stable at every point of their grids, or one of them, as `stylus certify` does.
///
/// `library` is a `Library`, a `Fit`, or a path. A cell that does not hold is a finding, and no exception.
#[pyfunction]
#[pyo3(signature = (library, *, texture = None, progress = None))]
pub fn certify<'py>(
    py: Python<'py>,
    library: LibraryLike<'py>,
    texture: Option<String>,
    progress: Option<&Bound<'py, PyAny>>,
) -> PyResult<Vec<Certification>> {
    // A file is decoded here, because a library that a stylus refuses is examined, too.
    let (bytes, path) = if let LibraryLike::Path(path) = &library {
        let bytes = host_tools::texture::library::read_library(path);
        (bytes.map_err(crate::error::raised)?.into(), path.clone())
    } else {
        let library = library.library(py)?;
        (library.get().bytes().clone(), library.get().named())
    };
    let decoded = |path: &std::path::Path, source| Error::Library {
        path: path.to_owned(),
        source,
    };
    let total = match texture {
        Some(_) => 1,
        None => Library::decode_uncertified(&bytes)
            .map_err(|source| crate::error::raised(decoded(&path, source)))?
            .len() as u64,
    };
    let found = work::run(py, total, progress, move |steps| {
        let library =
            Library::decode_uncertified(&bytes).map_err(|source| decoded(&path, source))?;
        let textures: Vec<_> = match &texture {
            Some(name) => vec![texture_named(&library, name)?],
            None => library.textures().collect(),
        };
        let found = textures.iter().map(|texture| {
            let found = certificate::certify(texture);
            steps.done();
            found
        });
        Ok(found.collect::<Vec<_>>())
    })?;
    Ok(found.into_iter().map(Certification).collect())
}
