//! Libraries: bytes that were validated, with what is known of their fit; and their textures with nodes, as Python has
//! them.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use host_tools::dsp::linear_prediction::step_up;
use host_tools::fit::record::FitRecord;
use host_tools::scene::{scene_named, with_scenes};
use host_tools::support::output::check_file;
use host_tools::support::visible::visible_line;
use host_tools::support::{Result, atomic_file};
use host_tools::texture::grid::as_written;
use host_tools::texture::library::{decode_library, read_library};
use host_tools::texture::quantise::reflection;
use model_format::{NodeFlags, Provenance, Texture};
use pyo3::exceptions::PyKeyError;
use pyo3::prelude::*;
use pyo3::types::{PyBytes, PyType};

use crate::convert::{Several, array, made, plain};
use crate::error::{raised, refused};
use crate::scene::Scene;

/// A library of textures and scenes: validated bytes, as the stylus holds them.
///
/// `Library(data)` takes bytes, and optionally the text of the record of their fit; `Library.open(path)` a file with
/// that record beside it. It is a mapping from names to textures, and can be pickled.
#[pyclass(frozen, mapping, module = "stylus_haptics")]
pub struct Library {
    bytes: Arc<[u8]>,
    path: Option<PathBuf>,
    record: Option<Arc<FitRecord>>,
}

impl Library {
    /// A library of valid `bytes`.
    pub fn of(bytes: Arc<[u8]>, path: Option<PathBuf>, record: Option<Arc<FitRecord>>) -> Self {
        Self { bytes, path, record }
    }

    /// Reads a library, and the record beside it.
    pub fn read(path: PathBuf) -> Result<Self> {
        let bytes = read_library(&path)?;
        decode_library(&path, &bytes)?;
        let record = FitRecord::beside(&path, &bytes)?;
        Ok(Self::of(bytes.into(), Some(path), record.map(Arc::new)))
    }

    /// Bytes of the library.
    pub fn bytes(&self) -> &Arc<[u8]> {
        &self.bytes
    }

    /// The record of its fit, if it is known.
    pub fn record(&self) -> Option<&Arc<FitRecord>> {
        self.record.as_ref()
    }

    /// The file, or a name that stands for it in errors.
    pub fn named(&self) -> PathBuf {
        let unnamed = || PathBuf::from("library");
        self.path.clone().unwrap_or_else(unnamed)
    }

    /// The decoded library.
    pub fn decoded(&self) -> Result<model_format::Library<'_>> {
        decode_library(&self.named(), &self.bytes)
    }

    /// A few words about it.
    pub fn text(&self) -> String {
        let names = self
            .decoded()
            .map(|library| {
                library
                    .textures()
                    .map(|texture| visible_line(texture.name()).into_owned())
                    .collect::<Vec<_>>()
                    .join(", ")
            })
            .unwrap_or_default();
        format!("Library({names}; {} bytes)", self.bytes.len())
    }

    /// Writes it with its record, if it has one.
    pub fn write(&self, path: &Path, overwrite: bool) -> PyResult<()> {
        check_file(path, overwrite, &[]).map_err(raised)?;
        let written = match &self.record {
            Some(record) => {
                // Both are checked before either is written, so that library and record stay a pair.
                let beside = FitRecord::path_for(path);
                check_file(&beside, overwrite, &[]).and_then(|()| record.write_with(path, &self.bytes))
            }
            None => atomic_file::write(path, &self.bytes),
        };
        written.map_err(raised)
    }
}

/// Bytes of a library, and the text of its record.
type Made<'py> = (Bound<'py, PyBytes>, Option<String>);

#[pymethods]
impl Library {
    #[new]
    #[pyo3(signature = (data, record = None))]
    fn new(data: &[u8], record: Option<&str>) -> PyResult<Self> {
        let name = Path::new("record");
        let record = record
            .map(|text| FitRecord::from_text(name, text.as_bytes()))
            .transpose()
            .map_err(raised)?
            .map(Arc::new);
        if (record.as_ref()).is_some_and(|record| !record.is_of(data)) {
            return Err(refused("the record is of another library: leave it out"));
        }
        let library = Self::of(data.into(), None, record);
        library.decoded().map_err(raised)?;
        Ok(library)
    }

    /// The arguments that make an equal one, for `pickle`.
    fn __reduce__<'py>(slf: &Bound<'py, Self>) -> PyResult<(Bound<'py, PyType>, Made<'py>)> {
        let library = slf.get();
        let record = library.record.as_ref().map(|record| record.to_text());
        let bytes = PyBytes::new(slf.py(), &library.bytes);
        Ok((slf.get_type(), (bytes, record.transpose().map_err(raised)?)))
    }

    /// Reads the library at `path`, and the record of its fit beside it, if there is one.
    #[staticmethod]
    fn open(path: PathBuf) -> PyResult<Self> {
        Self::read(path).map_err(raised)
    }

    /// Writes the library to `path`, whole or not at all, and the record of its fit, if it is known, to
    /// PATH.fit.json. What is there is replaced with `overwrite` alone.
    #[pyo3(signature = (path, *, overwrite = false))]
    fn save(&self, path: PathBuf, overwrite: bool) -> PyResult<()> {
        self.write(&path, overwrite)
    }

    /// The record of the fit as plain objects, as in LIB.fit.json; None if it is not known.
    #[pyo3(name = "record")]
    fn plain_record<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyAny>>> {
        let record = self.record.as_ref();
        record.map(|record| plain(py, record.as_ref())).transpose()
    }

    /// The textures, in their order.
    #[getter]
    fn textures<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyAny>>> {
        self.decoded()
            .map_err(raised)?
            .textures()
            .map(|texture| described(py, &texture))
            .collect()
    }

    /// The scenes, in their order.
    #[getter]
    fn scenes(&self) -> PyResult<Vec<Scene>> {
        let library = self.decoded().map_err(raised)?;
        let names: Vec<String> = library.scenes().map(|scene| scene.name.as_str().to_owned()).collect();
        names.iter().map(|name| self.scene(Some(name.as_str()))).collect()
    }

    /// The scene `name`, or the only one.
    #[pyo3(signature = (name = None))]
    fn scene(&self, name: Option<&str>) -> PyResult<Scene> {
        let library = self.decoded().map_err(raised)?;
        let scene = scene_named(&library, name, &self.named()).map_err(raised)?;
        Ok(Scene::of(scene, self.bytes.clone()))
    }

    /// The library with these scenes; those of the same name are replaced, all others stay. The record of the fit
    /// does not go with it, because it is of other bytes.
    fn with_scenes(&self, scenes: Several<Py<Scene>>) -> PyResult<Self> {
        let library = self.decoded().map_err(raised)?;
        let mut wired: Vec<model_format::scene::Scene> = Vec::new();
        for scene in &scenes.0 {
            let scene = scene.get().wired();
            if wired.iter().any(|other| other.name == scene.name) {
                return Err(refused(format!("two scenes are called '{}': rename one", scene.name)));
            }
            wired.push(scene.clone());
        }
        let bytes = with_scenes(&library, &wired).map_err(raised)?;
        let made = Self::of(bytes.into(), None, None);
        made.decoded().map_err(raised)?;
        Ok(made)
    }

    fn __getitem__<'py>(&self, py: Python<'py>, name: &str) -> PyResult<Bound<'py, PyAny>> {
        let library = self.decoded().map_err(raised)?;
        let texture = library.texture(name);
        let absent = || PyKeyError::new_err(name.to_owned());
        described(py, &texture.ok_or_else(absent)?)
    }

    fn __contains__(&self, name: &str) -> PyResult<bool> {
        Ok(self.decoded().map_err(raised)?.texture(name).is_some())
    }

    /// Names of the textures, in their order.
    fn keys(&self) -> PyResult<Vec<String>> {
        Ok(self
            .decoded()
            .map_err(raised)?
            .textures()
            .map(|t| t.name().to_owned())
            .collect())
    }

    fn __iter__<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        Ok(self.keys()?.into_pyobject(py)?.try_iter()?.into_any())
    }

    fn __len__(&self) -> PyResult<usize> {
        Ok(self.decoded().map_err(raised)?.len())
    }

    fn __bytes__<'py>(&self, py: Python<'py>) -> Bound<'py, PyBytes> {
        PyBytes::new(py, &self.bytes)
    }

    fn __eq__(&self, other: &Bound<'_, PyAny>) -> bool {
        let other = other.cast::<Self>();
        other.is_ok_and(|other| other.get().bytes == self.bytes)
    }

    fn __hash__(&self) -> u64 {
        // Libraries are equal if their bytes are, whatever their files and records.
        host_tools::support::fnv::Fnv::of(&self.bytes)
    }

    fn __repr__(&self) -> String {
        self.text()
    }
}

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
