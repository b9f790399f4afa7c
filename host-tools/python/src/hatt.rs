//! HaTT's model files.

use std::path::PathBuf;

use host_tools::fit::hatt::convert::far_nodes;
use host_tools::fit::hatt::import::{ImportReport, Options, files, import, plan, read_all};
use model_format::SAMPLE_RATE_HZ;
use pyo3::prelude::*;

use crate::convert::{Several, made, plain};
use crate::error::{raised, warn};
use crate::library::Library;
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
/// `speeds` and `forces` are the most of a grid, as many as the slot has room for if None; `model_rate_hz` is 5000 or
/// 10000. `progress(done, total)` counts files.
#[pyfunction]
#[pyo3(signature = (
    paths, *, speeds = None, forces = None, model_rate_hz = SAMPLE_RATE_HZ, progress = None
), text_signature = "(paths, *, speeds=None, forces=None, model_rate_hz=5000, progress=None)")]
pub fn import_hatt<'py>(
    py: Python<'py>,
    paths: Paths,
    speeds: Option<usize>,
    forces: Option<usize>,
    model_rate_hz: u32,
    progress: Option<&Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyAny>> {
    let options = Options {
        speeds,
        forces,
        sample_rate_hz: model_rate_hz,
    };
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
