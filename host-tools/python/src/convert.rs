//! Arguments and results: arrays, choices by their names, and results as plain Python objects.

use clap::ValueEnum;
use host_tools::fit::conditioning::Conditioning;
use host_tools::recording::{MAX_CHANNELS, MAX_FRAMES};
use host_tools::support::number;
use numpy::{
    Element, PyArray1, PyArray2, PyArrayDescrMethods, PyArrayMethods, PyReadonlyArrayDyn, PyReadwriteArrayDyn,
    PyUntypedArray, PyUntypedArrayMethods, dtype,
};
use pyo3::Borrowed;
use pyo3::call::PyCallArgs;
use pyo3::conversion::FromPyObjectOwned;
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::{PyList, PyMapping, PyMemoryView, PySequence, PyString};
use serde::Serialize;

use crate::error::refused;

/// The choice that the command calls `text`, of the argument `name`.
///
/// # Errors
/// A text that is no choice, with those that are.
pub fn choice<T: ValueEnum>(name: &str, text: &str) -> PyResult<T> {
    T::from_str(text, false).map_err(|_| {
        let values = T::value_variants().iter().filter_map(ValueEnum::to_possible_value);
        let all: Vec<String> = values.map(|value| value.get_name().to_owned()).collect();
        refused(format!("{name} is '{text}': it must be {}", quoted(&all)))
    })
}

/// Names of choices in a sentence.
pub fn quoted(choices: &[String]) -> String {
    let all: Vec<String> = choices.iter().map(|choice| format!("'{choice}'")).collect();
    all.join(", ")
}

/// The conditioning of recordings, by the names of the command's options.
pub fn conditioning(reduce: &str, high_pass: &str) -> PyResult<Conditioning> {
    let problem = |problem: String| refused(format!("high_pass is '{high_pass}': it {problem}"));
    Ok(Conditioning {
        reduction: choice("reduce", reduce)?,
        high_pass: high_pass.parse().map_err(problem)?,
    })
}

/// Checks a number by the rule of an option of the command.
pub fn checked(name: &str, value: f64, rule: fn(&str) -> std::result::Result<f64, String>) -> PyResult<f64> {
    rule(&value.to_string()).map_err(|problem| refused(format!("{name} is {value}: it {problem}")))
}

/// Checks a number that must be finite and above zero.
pub fn positive(name: &str, value: f64) -> PyResult<f64> {
    checked(name, value, number::positive)
}

/// Checks a number that must be finite and at least zero.
pub fn not_negative(name: &str, value: f64) -> PyResult<f64> {
    checked(name, value, number::not_negative)
}

/// `value` as plain Python objects: what `json.loads` makes of the command's JSON.
///
/// # Errors
/// None for results.
pub fn plain<'py>(py: Python<'py>, value: &impl Serialize) -> PyResult<Bound<'py, PyAny>> {
    let text = serde_json::to_string(value).map_err(|failure| refused(failure.to_string()))?;
    py.import("json")?.call_method1("loads", (text,))
}

/// An object of a class of results, which are plain Python: `_results.py`.
///
/// # Errors
/// None for the arguments of the class.
pub fn made<'py>(py: Python<'py>, class: &str, arguments: impl PyCallArgs<'py>) -> PyResult<Bound<'py, PyAny>> {
    py.import("stylus_haptics._results")?.getattr(class)?.call1(arguments)
}

/// `values` as an array of one dimension, without a copy.
pub fn array<T: Element>(py: Python<'_>, values: Vec<T>) -> Py<PyArray1<T>> {
    PyArray1::from_vec(py, values).unbind()
}

/// `values`, row by row, as an array of `rows` rows.
pub fn table<T: Element>(py: Python<'_>, values: Vec<T>, rows: usize) -> PyResult<Py<PyArray2<T>>> {
    let columns = values.len() / rows.max(1);
    Ok(PyArray1::from_vec(py, values).reshape([rows, columns])?.unbind())
}

/// Largest number of numbers of an array that are copied: 1 GiB of doubles.
const MOST_NUMBERS: usize = 1 << 27;

/// Largest number of values of a list of names, files or scenes.
const MOST_LISTED: usize = 1 << 20;

/// The numbers of an array-like of one dimension, the argument `name`.
///
/// # Errors
/// Something else, masked numbers, or more than a result is made of.
pub fn numbers(name: &str, values: &Bound<'_, PyAny>) -> PyResult<Vec<f64>> {
    let bounded = bounded(name, values, 1, &mut Left::of(MOST_NUMBERS))?;
    of_one_dimension(name, taken(&bounded))
}

/// The only way in for arrays: the values, row by row, and the shape.
///
/// NumPy has strides that are no multiple of an item, items at any address, and the other byte order, of which Rust can
/// express none. `numpy.require` copies such arrays.
fn taken<T: Element + Copy>(values: &Bound<'_, PyAny>) -> PyResult<(Vec<T>, Vec<usize>)> {
    let py = values.py();
    let numpy = py.import("numpy")?;
    let array: PyReadonlyArrayDyn<'_, T> = numpy
        .call_method1("require", (values, dtype::<T>(py), "CAE"))?
        .extract()?;
    // NumPy says that no items are aligned anywhere.
    let items = if array.is_empty() {
        Vec::new()
    } else {
        array.as_slice()?.to_vec()
    };
    Ok((items, array.shape().to_vec()))
}

/// The values of the argument `name`, if it has one dimension.
fn of_one_dimension<T>(name: &str, taken: PyResult<(Vec<T>, Vec<usize>)>) -> PyResult<Vec<T>> {
    let problem = match taken {
        Ok((values, shape)) if shape.len() == 1 => return Ok(values),
        Ok((_, shape)) => format!("it has the shape {shape:?}: give (N,)"),
        Err(failure) => failure.to_string(),
    };
    Err(PyTypeError::new_err(format!("argument '{name}': {problem}")))
}

/// The only way out into an array of the caller, `out`: a writable one of float32, of the shape (N,) or (N, 1). `fill`
/// makes its values without the interpreter's lock.
///
/// # Errors
/// Another array, one that is too long, and one that Rust is using. Nothing is made then.
pub fn filled(out: &Bound<'_, PyAny>, fill: impl FnOnce(&mut [f32]) + Send) -> PyResult<()> {
    let py = out.py();
    let other = || {
        let problem = "fill takes a writable array of float32 that nothing else uses: numpy.empty(n, 'float32')";
        PyTypeError::new_err(problem)
    };
    let array = out.cast::<PyUntypedArray>().map_err(|_| other())?;
    let has = |flag: &str| -> PyResult<bool> { array.getattr("flags")?.getattr(flag)?.extract() };
    if !array.dtype().is_equiv_to(&dtype::<f32>(py)) || !has("writeable")? {
        return Err(other());
    }
    let shape = array.shape().to_vec();
    if !matches!(shape[..], [_] | [_, 1]) {
        return Err(refused(format!(
            "out has the shape {shape:?}: give (N,), such as out[:, 0] for the first channel"
        )));
    }
    Left::of(MOST_NUMBERS).take("out", array.len())?;
    if array.is_c_contiguous() && has("aligned")? && !array.is_empty() {
        let mut out: PyReadwriteArrayDyn<'_, f32> = out.extract().map_err(|_| other())?;
        let samples = out.as_slice_mut()?;
        py.detach(|| fill(samples));
        return Ok(());
    }
    // NumPy writes what Rust cannot: items between others, such as one channel of several, and at any address.
    let mut samples = vec![0.0; array.len()];
    py.detach(|| fill(&mut samples));
    let samples = PyArray1::from_vec(py, samples).reshape(shape)?;
    py.import("numpy")?.call_method1("copyto", (out, samples))?;
    Ok(())
}

/// Numbers that an argument may still have.
struct Left {
    most: usize,
    left: usize,
}

impl Left {
    fn of(most: usize) -> Self {
        Self { most, left: most }
    }

    /// Counts `count` numbers of the argument `name` against the limit, before their copy is made.
    fn take(&mut self, name: &str, count: usize) -> PyResult<()> {
        self.left = self.left.checked_sub(count).ok_or_else(|| {
            let most = self.most;
            refused(format!("{name} has {count} values: give at most {most}"))
        })?;
        Ok(())
    }
}

/// The argument `name` as NumPy may take it: an array, or a list that is as long as it says and nested at most `depth`
/// times. NumPy would otherwise believe a length, and take memory for it. What is neither is left as it is, because
/// NumPy refuses it, or makes one value of it.
fn bounded<'py>(name: &str, values: &Bound<'py, PyAny>, depth: u32, left: &mut Left) -> PyResult<Bound<'py, PyAny>> {
    let py = values.py();
    if !values.hasattr("__len__")? && values.extract::<f64>().is_ok() {
        left.take(name, 1)?;
        return Ok(values.clone());
    }
    let array = if is_array(values)? {
        let array = py.import("numpy")?.call_method1("asanyarray", (values,))?;
        Some(array.cast_into::<PyUntypedArray>()?)
    } else {
        None
    };
    if let Some(array) = array {
        left.take(name, array.len())?;
        check_mask(name, &array)?;
        return Ok(array.into_any());
    }
    let is_text = values.is_instance_of::<PyString>();
    let is_sequence = values.hasattr("__getitem__")? && values.cast::<PyMapping>().is_err();
    let (true, false, Ok(count)) = (is_sequence, is_text, values.len()) else {
        left.take(name, 1)?;
        return Ok(values.clone());
    };
    if depth == 0 {
        let problem = format!("argument '{name}' is nested: a number is to stand there");
        return Err(PyTypeError::new_err(problem));
    }
    // A stated length beyond the limit is refused before a value is read. Otherwise each value is counted as it comes.
    if count > left.left {
        left.take(name, count)?;
    }
    let items = PyList::empty(py);
    // One more than stated shows that the length was wrong.
    for item in values.try_iter()?.take(count.saturating_add(1)) {
        items.append(bounded(name, &item?, depth - 1, left)?)?;
    }
    if items.len() != count {
        return Err(refused(format!(
            "{name} says that it has {count} values, and gives others: make it a list"
        )));
    }
    Ok(items.into_any())
}

/// Returns true for an array, and for an object that is one to NumPy.
fn is_array(values: &Bound<'_, PyAny>) -> PyResult<bool> {
    if values.is_instance_of::<PyUntypedArray>() {
        return Ok(true);
    }
    for name in ["__array__", "__array_interface__", "__array_struct__"] {
        if values.hasattr(name)? {
            return Ok(true);
        }
    }
    Ok(PyMemoryView::from(values).is_ok())
}

/// The values of a list, at most `MOST_LISTED`. The length that an object states is not believed.
pub struct Several<T>(pub Vec<T>);

impl<'py, T: FromPyObjectOwned<'py>> FromPyObject<'_, 'py> for Several<T> {
    type Error = PyErr;

    fn extract(values: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        if values.is_instance_of::<PyString>() || values.cast::<PySequence>().is_err() {
            let kind = values.get_type();
            return Err(PyTypeError::new_err(format!("'{}' is no list", kind.name()?)));
        }
        let mut all = Vec::new();
        for value in values.try_iter()? {
            if all.len() == MOST_LISTED {
                return Err(refused(format!("a list has at most {MOST_LISTED} values")));
            }
            all.push(value?.extract().map_err(Into::into)?);
        }
        Ok(Self(all))
    }
}

/// The 32-bit words of an array of one dimension, the argument `name`.
///
/// # Errors
/// Something else, or more than a result is made of.
pub fn words(name: &str, words: &Bound<'_, PyAny>) -> PyResult<Vec<i32>> {
    let py = words.py();
    let words = bounded(name, words, 1, &mut Left::of(MOST_NUMBERS))?;
    let numpy = py.import("numpy")?;
    let words = numpy.call_method1("asarray", (words,))?;
    if !numpy.call_method1("can_cast", (&words, dtype::<i32>(py)))?.extract()? {
        return Err(PyTypeError::new_err(format!("argument '{name}': give int32")));
    }
    of_one_dimension(name, taken(&words))
}

/// Refuses an array with masked values, because a conversion would drop the mask and keep the values.
fn check_mask(name: &str, array: &Bound<'_, PyAny>) -> PyResult<()> {
    let masks = array.py().import("numpy")?.getattr("ma")?;
    if masks.call_method1("is_masked", (array,))?.extract()? {
        return Err(refused(format!("{name} has masked values: cut them off, or fill them")));
    }
    Ok(())
}

/// Channels of samples: one per column of an array of two dimensions, or one of an array of one.
pub struct Channels {
    /// Samples of each channel; those of integers are divided by their full scale, as those of WAV files.
    pub channels: Vec<Vec<f64>>,
    /// True if the array holds integers.
    pub are_integers: bool,
}

/// The channels of an array-like.
pub fn channels(samples: &Bound<'_, PyAny>) -> PyResult<Channels> {
    let py = samples.py();
    // As many as a file may have.
    let most = &mut Left::of(MAX_CHANNELS * MAX_FRAMES);
    let samples = bounded("samples", samples, 2, most)?;
    let numpy = py.import("numpy")?;
    let array = numpy
        .call_method1("asarray", (samples,))?
        .cast_into::<PyUntypedArray>()?;
    let dtype = array.dtype();
    let kind: String = dtype.getattr("kind")?.extract()?;
    let full_scale = match (kind.as_str(), dtype.getattr("itemsize")?.extract()?) {
        ("f", 2 | 4 | 8) => None,
        ("i", 2) => Some(f64::from(1u32 << 15)),
        ("i", 4) => Some(f64::from(1u32 << 31)),
        _ => {
            return Err(refused(format!(
                "samples are of type {dtype}: give float32 or float64 in units of the scale, or int16 or int32 of full \
                 scale"
            )));
        }
    };
    let axes = match array.shape() {
        [_] => 1,
        [_, axes @ 1..=3] => *axes,
        [axes @ 1..=3, samples] => {
            return Err(refused(format!(
                "samples have the shape ({axes}, {samples}): give one row per sample and one column per axis, which is \
                 the transpose"
            )));
        }
        shape => {
            return Err(refused(format!(
                "samples have the shape {shape:?}: give (N,) or (N, axes), with one to three axes"
            )));
        }
    };
    let (samples, _) = taken::<f64>(&array)?;
    let channel = |axis| samples.iter().skip(axis).step_by(axes).copied().collect();
    let mut channels: Vec<Vec<f64>> = (0..axes).map(channel).collect();
    if let Some(full_scale) = full_scale {
        for sample in channels.iter_mut().flatten() {
            *sample /= full_scale;
        }
    }
    Ok(Channels {
        channels,
        are_integers: full_scale.is_some(),
    })
}
