//! HaTT's model files.

use std::path::PathBuf;

use host_tools::fit::hatt::convert::far_nodes;
use host_tools::fit::hatt::import::{ImportReport, Options, files, import, plan, read_all};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::convert::{Several, made, plain};
use crate::error::{raised, warn};
use crate::library::Library;
use crate::options::of_keywords;
use crate::work;

/// One path, or several.
#[derive(FromPyObject)]
pub enum Paths {
    /// One.
    One(PathBuf),
    /// Several.
    Several(Several<PathBuf>),
}

impl Paths {
    /// All of them.
    pub fn all(self) -> Vec<PathBuf> {
        match self {
            Self::One(path) => vec![path],
            Self::Several(paths) => paths.0,
        }
    }
}

/// Converts HaTT's model files, or folders of them, as `stylus import-hatt` does.
///
/// `progress(done, total)` counts files. Options:
#[pyfunction]
#[pyo3(signature = (paths, *, progress = None, **options))]
pub fn import_hatt<'py>(
    py: Python<'py>,
    paths: Paths,
    progress: Option<&Bound<'py, PyAny>>,
    options: Option<&Bound<'py, PyDict>>,
) -> PyResult<Bound<'py, PyAny>> {
    let options: Options = of_keywords(options, &[])?;
    let files = files(&paths.all()).map_err(raised)?;
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
        Ok((bytes, warnings, reports.collect::<Vec<_>>()))
    })?;
    for warning in &warnings {
        warn(py, warning)?;
    }
    let library = Library::of(bytes.into(), None, None);
    made(py, "HattImport", (library, warnings, plain(py, &reports)?))
}
