//! Simulated recordings of a drum rig.

use std::path::PathBuf;

use host_tools::rig::{self, RigFile};
use host_tools::support::error::Result;
use host_tools::support::toml_field::TEXT;
use pyo3::prelude::*;

use crate::error::raised;
use crate::recording::Recordings;

/// Returns the description of the paper's rig, as `stylus simulate-rig --print-rig` prints it: a start for one's own.
#[pyfunction]
pub fn paper_rig() -> String {
    RigFile::paper().text().to_owned()
}

/// Simulates the recordings of a drum rig into the folder `out`, as `stylus simulate-rig` does, and returns the set.
///
/// `rig` is the path or the text of a rig's description; None is the paper's protocol: 4 textures at 15 speeds and 8
/// forces. The folder is new or empty; an earlier simulated set is replaced with `overwrite` alone. The same
/// seed gives the same recordings.
#[pyfunction]
#[pyo3(signature = (out, *, rig = None, seed = 1, overwrite = false))]
pub fn simulate_rig(
    py: Python<'_>,
    out: PathBuf,
    rig: Option<&Bound<'_, PyAny>>,
    seed: u64,
    overwrite: bool,
) -> PyResult<Recordings> {
    let rig = match rig {
        None => Ok(RigFile::paper()),
        Some(rig) => match rig
            .extract::<String>()
            .ok()
            .filter(|text| text.contains('\n'))
        {
            Some(text) => RigFile::from_toml(&PathBuf::from("rig.toml"), &text),
            None => file(&rig.extract::<PathBuf>()?),
        },
    };
    let rig = rig.map_err(raised)?;
    let set = py.detach(|| {
        rig::simulate_to_folder(&rig, seed, &out, overwrite)?;
        host_tools::recording::RecordingSet::open(&[out])
    });
    set.map(Recordings).map_err(raised)
}

fn file(path: &std::path::Path) -> Result<RigFile> {
    RigFile::from_toml(path, &TEXT.read_text(path)?)
}
