//! Textures of a library, and their nodes.

use std::f64::consts::TAU;
use std::sync::Arc;

use host_tools::dsp::linear_prediction::step_up;
use host_tools::support::error::Error;
use host_tools::texture::grid::as_written;
use host_tools::texture::quantise as stored;
use model_format::{Coefficients, Library, NodeFlags, Provenance};
use numpy::{PyArray1, PyArray2};
use pyo3::exceptions::PyIndexError;
use pyo3::prelude::*;

use crate::convert::{array, numbers, table};
use crate::error::raised;

/// A texture: models over a grid of speeds and forces.
///
/// Arrays over the grid have the shape (speeds, forces).
#[pyclass(frozen, module = "stylus_haptics")]
pub struct Texture {
    bytes: Arc<[u8]>,
    index: usize,
}

impl Texture {
    /// The texture `index` of the library of these bytes.
    pub fn of(bytes: Arc<[u8]>, index: usize) -> PyResult<Self> {
        let texture = Self { bytes, index };
        texture.decoded()?;
        Ok(texture)
    }

    fn decoded(&self) -> PyResult<model_format::Texture<'_>> {
        let library = Library::decode(&self.bytes);
        let library = library.map_err(|failure| raised(Error::Model(failure.to_string())))?;
        let absent = || raised(Error::Model("the library has no such texture".into()));
        library.texture_at(self.index).ok_or_else(absent)
    }

    /// A number of each node.
    fn of_nodes<T: numpy::Element>(
        &self,
        py: Python<'_>,
        of: impl Fn(&model_format::Node<'_>) -> T,
    ) -> PyResult<Py<PyArray2<T>>> {
        let texture = self.decoded()?;
        let values = texture.nodes().map(|node| of(&node)).collect();
        table(py, values, texture.speed_axis().len())
    }
}

#[pymethods]
impl Texture {
    /// Name.
    #[getter]
    fn name(&self) -> PyResult<String> {
        Ok(self.decoded()?.name().to_owned())
    }

    /// True if its recordings were simulated.
    #[getter]
    fn simulated(&self) -> PyResult<bool> {
        Ok(self.decoded()?.provenance() == Provenance::Simulated)
    }

    /// Sample rate, Hz.
    #[getter]
    fn sample_rate_hz(&self) -> PyResult<u32> {
        Ok(self.decoded()?.sample_rate_hz())
    }

    /// Values of the speed axis, mm/s, ascending.
    #[getter]
    fn speeds_mm_s(&self, py: Python<'_>) -> PyResult<Py<PyArray1<f64>>> {
        let texture = self.decoded()?;
        let axis = texture.speed_axis();
        Ok(array(py, axis.values().map(as_written).collect()))
    }

    /// Values of the force axis, N, ascending.
    #[getter]
    fn forces_n(&self, py: Python<'_>) -> PyResult<Py<PyArray1<f64>>> {
        let texture = self.decoded()?;
        let axis = texture.force_axis();
        Ok(array(py, axis.values().map(as_written).collect()))
    }

    /// Orders of the models.
    #[getter]
    fn orders(&self, py: Python<'_>) -> PyResult<Py<PyArray2<i64>>> {
        self.of_nodes(py, |node| node.coefficients.order() as i64)
    }

    /// RMS of the outputs, m/s²; 0 of silent nodes.
    #[getter]
    fn rms_m_s2(&self, py: Python<'_>) -> PyResult<Py<PyArray2<f64>>> {
        self.of_nodes(py, |node| f64::from(node.output_power).sqrt())
    }

    /// True of nodes without a recording of their own, which were filled from neighbours.
    #[getter]
    fn filled(&self, py: Python<'_>) -> PyResult<Py<PyArray2<bool>>> {
        self.of_nodes(py, |node| {
            node.flags.contains(NodeFlags::INTERPOLATED)
                || node.flags.contains(NodeFlags::EXTRAPOLATED)
        })
    }

    /// True of silent nodes.
    #[getter]
    fn silent(&self, py: Python<'_>) -> PyResult<Py<PyArray2<bool>>> {
        self.of_nodes(py, |node| node.flags.contains(NodeFlags::SILENT))
    }

    /// True of nodes with a doubtful recording.
    #[getter]
    fn doubtful(&self, py: Python<'_>) -> PyResult<Py<PyArray2<bool>>> {
        self.of_nodes(py, |node| node.flags.contains(NodeFlags::DOUBTFUL))
    }

    /// The node at these indices of the axes.
    fn node(&self, speed_index: usize, force_index: usize) -> PyResult<Node> {
        let texture = self.decoded()?;
        let (speeds, forces) = (texture.speed_axis(), texture.force_axis());
        if speed_index >= speeds.len() || force_index >= forces.len() {
            return Err(PyIndexError::new_err(format!(
                "the grid has {} speeds and {} forces",
                speeds.len(),
                forces.len()
            )));
        }
        let node = texture.node(speed_index, force_index);
        let names = [
            (NodeFlags::SILENT, "silent"),
            (NodeFlags::INTERPOLATED, "interpolated"),
            (NodeFlags::EXTRAPOLATED, "extrapolated"),
            (NodeFlags::DOUBTFUL, "doubtful"),
        ];
        let flags = names.iter().filter(|(flag, _)| node.flags.contains(*flag));
        let (reflection, predictor) = coefficients(node.coefficients);
        Ok(Node {
            speed_mm_s: as_written(speeds.value(speed_index)),
            force_n: as_written(forces.value(force_index)),
            order: node.coefficients.order(),
            rms_m_s2: f64::from(node.output_power).sqrt(),
            prediction_error_rms_m_s2: f64::from(node.prediction_error_power).sqrt(),
            flags: flags.map(|(_, name)| (*name).to_owned()).collect(),
            sample_rate_hz: texture.sample_rate_hz(),
            reflection,
            predictor,
        })
    }

    fn __repr__(&self) -> PyResult<String> {
        let texture = self.decoded()?;
        Ok(format!(
            "Texture({:?}, {} speeds x {} forces{})",
            texture.name(),
            texture.speed_axis().len(),
            texture.force_axis().len(),
            if texture.provenance() == Provenance::Simulated {
                ", SIMULATED"
            } else {
                ""
            }
        ))
    }
}

/// Reflection coefficients and predictor of a node.
fn coefficients(stored_ones: Coefficients<'_>) -> (Vec<f64>, Vec<f64>) {
    let reflection = stored::reflection(stored_ones);
    let predictor = negated(step_up(&reflection));
    (reflection, predictor)
}

/// A(z) is 1 + a(1) z⁻¹ + ..., and the predictor h = -a.
fn negated(mut coefficients: Vec<f64>) -> Vec<f64> {
    coefficients.iter_mut().for_each(|a| *a = -*a);
    coefficients
}

/// A node of a texture's grid: a linear predictor with its level.
#[pyclass(frozen, module = "stylus_haptics")]
pub struct Node {
    /// Tangential speed, mm/s.
    #[pyo3(get)]
    speed_mm_s: f64,
    /// Normal force, N.
    #[pyo3(get)]
    force_n: f64,
    /// Order of the predictor.
    #[pyo3(get)]
    order: usize,
    /// RMS of the output, m/s².
    #[pyo3(get)]
    rms_m_s2: f64,
    /// RMS of the prediction error, m/s².
    #[pyo3(get)]
    prediction_error_rms_m_s2: f64,
    /// Properties: 'silent', 'interpolated', 'extrapolated', 'doubtful'.
    #[pyo3(get)]
    flags: Vec<String>,
    sample_rate_hz: u32,
    reflection: Vec<f64>,
    predictor: Vec<f64>,
}

#[pymethods]
impl Node {
    /// Reflection coefficients k(1) to k(order), of the stored codes.
    #[getter]
    fn reflection(&self, py: Python<'_>) -> Py<PyArray1<f64>> {
        array(py, self.reflection.clone())
    }

    /// Coefficients h(1) to h(order) of the predictor: x(n) is predicted as the sum of h(i) x(n - i).
    #[getter]
    fn predictor(&self, py: Python<'_>) -> Py<PyArray1<f64>> {
        array(py, self.predictor.clone())
    }

    /// Power spectral density of the model at `frequencies_hz`, one-sided, (m/s²)²/Hz: 2 σ² / (fs |A|²), where σ² is
    /// the variance of the prediction error, fs the sample rate, and A the prediction error filter.
    fn spectrum(
        &self,
        py: Python<'_>,
        frequencies_hz: &Bound<'_, PyAny>,
    ) -> PyResult<Py<PyArray1<f64>>> {
        let frequencies = numbers("frequencies_hz", frequencies_hz)?;
        let rate_hz = f64::from(self.sample_rate_hz);
        let variance = self.prediction_error_rms_m_s2.powi(2);
        let density = |frequency_hz: f64| {
            let step = TAU * frequency_hz / rate_hz;
            let (mut real, mut imaginary) = (1.0, 0.0);
            for (index, h) in self.predictor.iter().enumerate() {
                let (sine, cosine) = (step * (index + 1) as f64).sin_cos();
                real -= h * cosine;
                imaginary += h * sine;
            }
            2.0 * variance / (rate_hz * (real * real + imaginary * imaginary))
        };
        Ok(array(py, frequencies.into_iter().map(density).collect()))
    }

    fn __repr__(&self) -> String {
        format!(
            "Node(speed_mm_s={}, force_n={}, order={}, rms_m_s2={:.4}{})",
            self.speed_mm_s,
            self.force_n,
            self.order,
            self.rms_m_s2,
            if self.flags.is_empty() {
                String::new()
            } else {
                format!(", {}", self.flags.join(", "))
            }
        )
    }
}
