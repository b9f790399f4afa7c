//! Exceptions and warnings: the one line of the command, with its parts as attributes.

use std::ffi::CString;
use std::path::PathBuf;

use host_tools::support::Error;
use host_tools::support::visible::message;
use pyo3::exceptions::{PyException, PyUserWarning};
use pyo3::prelude::*;

pyo3::create_exception!(
    stylus_haptics,
    StylusError,
    PyException,
    "A failure. Its text is the line that the command `stylus` prints: the problem, its place and the remedy.\n\n\
     `kind` is 'io', 'file', 'line', 'library', 'model', 'request' or 'link'; `path` is the file, a `pathlib.Path`, or \
     None; `line` is the line of a text file, from 1, or None."
);

pyo3::create_exception!(
    stylus_haptics,
    StylusWarning,
    PyUserWarning,
    "Something doubtful that the command `stylus` warns of: a scale that is missing, a motion along which nothing is \
     heard."
);

/// Adds the exceptions to the module. What Python code raises itself has the attributes, too.
pub fn add_to(module: &Bound<'_, PyModule>) -> PyResult<()> {
    let py = module.py();
    let error = py.get_type::<StylusError>();
    error.setattr("kind", "request")?;
    error.setattr("path", py.None())?;
    error.setattr("line", py.None())?;
    module.add("StylusError", error)?;
    module.add("StylusWarning", py.get_type::<StylusWarning>())
}

/// The exception of a failure.
pub fn raised(failure: Error) -> PyErr {
    let text = failure.to_string();
    let (kind, path, line): (_, Option<PathBuf>, Option<u64>) = match failure {
        Error::Io { path, .. } => ("io", Some(path), None),
        Error::File { path, .. } => ("file", Some(path), None),
        Error::Line { path, line, .. } => ("line", Some(path), Some(line)),
        Error::Library { path, .. } => ("library", Some(path), None),
        Error::Model(_) => ("model", None, None),
        _ => ("request", None, None),
    };
    exception(&text, kind, path, line)
}

/// The exception of a request that cannot be fulfilled.
pub fn refused(problem: impl Into<String>) -> PyErr {
    raised(Error::Request(problem.into()))
}

/// The exception of a failure of a link, or of a refusal of the device.
pub fn link_raised(failure: &host_tools::link::LinkError) -> PyErr {
    exception(&failure.to_string(), "link", None, None)
}

fn exception(text: &str, kind: &str, path: Option<PathBuf>, line: Option<u64>) -> PyErr {
    // Callers may have released the lock of the interpreter.
    Python::attach(|py| {
        let error = StylusError::new_err(message(text));
        let value = error.value(py);
        let set = value
            .setattr("kind", kind)
            .and_then(|()| value.setattr("path", path))
            .and_then(|()| value.setattr("line", line));
        match set {
            Ok(()) => error,
            Err(other) => other,
        }
    })
}

/// Issues a `StylusWarning`.
///
/// # Errors
/// The warning, where a filter turns warnings into errors.
pub fn warn(py: Python<'_>, text: &str) -> PyResult<()> {
    let text = CString::new(message(text))?;
    let category = py.get_type::<StylusWarning>();
    PyErr::warn(py, &category, &text, 1)
}
