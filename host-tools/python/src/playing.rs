//! Textures, rendered.

use pyo3::prelude::*;

use crate::error::refused;
use crate::library_like::LibraryLike;
use crate::motion::{Along, Asked, MotionLike, warn_if_silent};
use crate::rendering::{Played, Rendering, rendered};

/// Renders a texture, as `stylus render` does: what the stylus plays, sample for sample.
///
/// `library` is a `Library`, a `Fit`, or a path. The motion is a constant `speed_mm_s` and `force_n` for `seconds`, or
/// `motion`, a `Motion` or the path of a table, whose end counts if `seconds` is not given. The same seed gives the
/// same samples. `progress(done, total)` counts seconds.
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
) -> PyResult<Rendering> {
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
    warn_if_silent(py, &path)?;
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
