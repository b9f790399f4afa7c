//! HaTT's model files.

use std::path::PathBuf;

use host_tools::fit::hatt::convert::far_nodes;
use host_tools::fit::hatt::import::{ImportReport, Options, files, import, plan, read_all};
use model_format::SAMPLE_RATE_HZ;
use pyo3::prelude::*;

use crate::convert::plain;
use crate::error::{raised, warn};
use crate::library::Library;
use crate::work;

/// A library of HaTT's models, with the errors of the conversion.
#[pyclass(frozen, module = "stylus_haptics")]
pub struct HattImport {
    library: Py<Library>,
    warnings: Vec<String>,
    reports: Vec<ImportReport>,
}

#[pymethods]
impl HattImport {
    /// The library.
    #[getter]
    fn library(&self, py: Python<'_>) -> Py<Library> {
        self.library.clone_ref(py)
    }

    /// Notes on what is doubtful, one line each; each was warned of, too.
    #[getter]
    fn warnings(&self) -> Vec<String> {
        self.warnings.clone()
    }

    /// The errors of the conversion, place by place, as plain objects: those of `stylus import-hatt --json`.
    fn as_dict<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        plain(py, &self.reports)
    }

    fn __repr__(&self) -> String {
        format!("HattImport({})", self.library.get().text())
    }
}

/// One path, or several.
#[derive(FromPyObject)]
pub enum Paths {
    /// One.
    One(PathBuf),
    /// Several.
    Several(Vec<PathBuf>),
}

/// Converts HaTT's model files, or folders of them, as `stylus import-hatt` does.
///
/// `speeds` and `forces` are the most of a grid, as many as the slot has room for if None; `model_rate_hz` is 5000 or
/// 10000. `progress(done, total)`
/// counts files.
#[pyfunction]
#[pyo3(signature = (
    paths, *, speeds = None, forces = None, model_rate_hz = SAMPLE_RATE_HZ, progress = None
), text_signature = "(paths, *, speeds=None, forces=None, model_rate_hz=5000, progress=None)")]
pub fn import_hatt(
    py: Python<'_>,
    paths: Paths,
    speeds: Option<usize>,
    forces: Option<usize>,
    model_rate_hz: u32,
    progress: Option<&Bound<'_, PyAny>>,
) -> PyResult<HattImport> {
    let paths = match paths {
        Paths::One(path) => vec![path],
        Paths::Several(paths) => paths,
    };
    let options = Options {
        speeds,
        forces,
        sample_rate_hz: model_rate_hz,
    };
    let files = files(&paths).map_err(raised)?;
    let total = files.len() as u64;
    let (bytes, warnings, reports) = work::run(py, total, progress, move |steps| {
        let sources = read_all(&files, &options)?;
        let plan = plan(&sources, &options)?;
        let mut warnings: Vec<String> = Vec::new();
        for source in &sources {
            let own = source.toolkit.warnings.iter();
            warnings.extend(own.map(|warning| format!("{}: {warning}", source.path.display())));
        }
        let (converted, bytes) = import(&sources, &plan, &|| steps.done())?;
        for (source, converted) in sources.iter().zip(&converted) {
            let far = far_nodes(&converted.nodes);
            warnings.extend(far.map(|far| format!("{}: {far}", source.path.display())));
        }
        let reports = sources.into_iter().zip(converted).map(ImportReport::of);
        Ok((bytes, warnings, reports.collect()))
    })?;
    for warning in &warnings {
        warn(py, warning)?;
    }
    Ok(HattImport {
        library: Py::new(py, Library::of(bytes.into(), None, None))?,
        warnings,
        reports,
    })
}
