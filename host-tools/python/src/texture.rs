//! Textures of a library with their nodes, as Python has them.

use host_tools::dsp::linear_prediction::step_up;
use host_tools::texture::grid::as_written;
use host_tools::texture::quantise::reflection;
use model_format::{NodeFlags, Provenance, Texture};
use pyo3::prelude::*;

use crate::convert::{array, made};

/// Names of the properties of nodes.
const FLAGS: [(NodeFlags, &str); 4] = [
    (NodeFlags::SILENT, "silent"),
    (NodeFlags::INTERPOLATED, "interpolated"),
    (NodeFlags::EXTRAPOLATED, "extrapolated"),
    (NodeFlags::DOUBTFUL, "doubtful"),
];

/// The texture as an object of Python.
///
/// # Errors
/// None for textures of a library.
pub fn described<'py>(py: Python<'py>, texture: &Texture<'_>) -> PyResult<Bound<'py, PyAny>> {
    let (speeds, forces) = (texture.speed_axis(), texture.force_axis());
    let speeds: Vec<f64> = speeds.values().map(as_written).collect();
    let forces: Vec<f64> = forces.values().map(as_written).collect();
    let rate_hz = texture.sample_rate_hz();
    // Nodes are in the order of speeds, and for each speed in that of forces.
    let places = (speeds.iter()).flat_map(|&speed| forces.iter().map(move |&force| (speed, force)));
    let nodes = texture.nodes().zip(places).map(|(node, (speed, force))| {
        let reflection = reflection(node.coefficients);
        // A(z) is 1 + a(1) z⁻¹ + ..., and the predictor h = -a.
        let predictor = step_up(&reflection).into_iter().map(|a| -a).collect();
        let flags = FLAGS.iter().filter(|(flag, _)| node.flags.contains(*flag));
        let arguments = (
            speed,
            force,
            f64::from(node.output_power).sqrt(),
            f64::from(node.prediction_error_power).sqrt(),
            flags.map(|(_, name)| *name).collect::<Vec<_>>(),
            rate_hz,
            array(py, reflection),
            array(py, predictor),
        );
        made(py, "Node", arguments)
    });
    let nodes = nodes.collect::<PyResult<Vec<_>>>()?;
    let origin = texture.provenance();
    let (simulated, level_is_known) = (origin == Provenance::Simulated, origin != Provenance::Unscaled);
    let (name, speeds, forces) = (texture.name(), array(py, speeds), array(py, forces));
    made(
        py,
        "Texture",
        (name, simulated, level_is_known, rate_hz, speeds, forces, nodes),
    )
}
