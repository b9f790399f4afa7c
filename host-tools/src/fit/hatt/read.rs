//! Reading HaTT's XML.

use std::collections::BTreeMap;
use std::path::Path;

use roxmltree::Document;

use super::elements::{self, File};
use super::model::{Found, found};
use super::toolkit::{ArmaModel, Toolkit};
use crate::support::error::{Error, Result};

/// Reads `text`; `path` is only named in errors.
///
/// Elements are found by their names wherever they stand, in any case of letters. Lists are numbers in an element's
/// text, or in that of its children, separated by blanks or commas. An element with a child `ARcoeff` or `ARlsf` is a
/// model. Every `tri` counts, each with one triangle or more.
///
/// # Errors
/// A fault that makes the file unusable, with its line.
pub fn read(path: &Path, text: &str) -> Result<Toolkit> {
    let document = Document::parse(text).map_err(|failure| {
        let problem = format!("is not well-formed XML: {failure}");
        Error::line(path, u64::from(failure.pos().row), problem)
    })?;
    let file = File::new(path, &document);
    file.check_units()?;
    let sample_rate_hz = file.one("SampleRate")?.unwrap_or(1000.0);
    if !(sample_rate_hz.is_finite() && (100.0..=5000.0).contains(&sample_rate_hz)) {
        let problem =
            format!("a sample rate of {sample_rate_hz} Hz is no model's; HaTT's are of 1000 Hz");
        return Err(Error::file(path, problem));
    }
    let mut remarks = Remarks::default();
    let read = models(&file, &mut remarks)?;
    let usable = read.iter().flatten().count();
    if usable == 0 {
        let why = remarks
            .warnings()
            .first()
            .map_or(String::new(), |first| format!(": {first}"));
        let problem = format!("has no model that can be used{why}; is it a HaTT model file?");
        return Err(Error::file(path, problem));
    }
    file.check_count("numMod", read.len(), "models")?;
    let triangles = file.triangles(read.len())?;
    file.check_count("numTri", triangles.len(), "triangles")?;
    remarks.unused(&read, &triangles);
    let missing = |index: &usize| read[*index].is_none();
    let left_out = (0..read.len()).filter(missing).collect();
    let (models, triangles) = without_missing(read, &triangles);
    let largest = |of: fn(&ArmaModel) -> f64| models.iter().map(of).fold(0.0, f64::max);
    let mut warnings = remarks.warnings();
    warnings.extend(file.unknown_elements());
    let mut toolkit = Toolkit {
        sample_rate_hz,
        max_speed_mm_s: file
            .one("maxSpeed")?
            .unwrap_or_else(|| largest(|m| m.speed_mm_s)),
        max_force_n: file
            .one("maxForce")?
            .unwrap_or_else(|| largest(|m| m.force_n)),
        friction: file.one("mu")?,
        models,
        triangles,
        left_out,
        warnings: Vec::new(),
    };
    toolkit.check_orders(path)?;
    warnings.extend(toolkit.uncovered());
    Ok(Toolkit {
        warnings,
        ..toolkit
    })
}

/// All models in the file's order; `None` for one that is left out.
fn models(file: &File<'_>, remarks: &mut Remarks) -> Result<Vec<Option<ArmaModel>>> {
    let (speeds, forces) = (file.list("speedList")?, file.list("forceList")?);
    let mut read = Vec::new();
    for (index, node) in file.models().enumerate() {
        let place = (speeds.get(index).copied(), forces.get(index).copied());
        read.push(match found(file, node, place)? {
            Ok(Found {
                model,
                lsf_error_rad,
            }) => {
                remarks.lines(index, lsf_error_rad);
                Some(model)
            }
            Err(problem) => {
                remarks.add(index, format!("{problem}; left out"));
                None
            }
        });
    }
    Ok(read)
}

/// Leaves out what is missing, and every triangle with it.
fn without_missing(
    read: Vec<Option<ArmaModel>>,
    triangles: &[[usize; 3]],
) -> (Vec<ArmaModel>, Vec<[usize; 3]>) {
    let mut count = 0;
    let places: Vec<Option<usize>> = read
        .iter()
        .map(|model| {
            model.as_ref()?;
            count += 1;
            Some(count - 1)
        })
        .collect();
    let moved = |triangle: &[usize; 3]| {
        let [a, b, c] = triangle.map(|corner| places[corner]);
        Some([a?, b?, c?])
    };
    let triangles = triangles.iter().filter_map(moved).collect();
    (read.into_iter().flatten().collect(), triangles)
}

/// Remarks on models, one per kind.
#[derive(Default)]
struct Remarks {
    /// Models, from 1, of each remark.
    of_models: BTreeMap<String, Vec<usize>>,
    /// Models whose line spectral frequencies are not those of their coefficients, from 1.
    lines: Vec<usize>,
    largest_rad: f64,
}

impl Remarks {
    fn add(&mut self, index: usize, remark: String) {
        self.of_models.entry(remark).or_default().push(index + 1);
    }

    fn lines(&mut self, index: usize, error_rad: f64) {
        if error_rad > elements::LSF_TOLERANCE_RAD {
            self.lines.push(index + 1);
            self.largest_rad = self.largest_rad.max(error_rad);
        }
    }

    fn unused(&mut self, read: &[Option<ArmaModel>], triangles: &[[usize; 3]]) {
        if triangles.is_empty() {
            return;
        }
        let mut used = vec![false; read.len()];
        for &corner in triangles.iter().flatten() {
            used[corner] = true;
        }
        for index in (0..read.len()).filter(|&index| read[index].is_some() && !used[index]) {
            self.add(
                index,
                "no triangle uses it, so that it is never played".into(),
            );
        }
    }

    fn warnings(&self) -> Vec<String> {
        let named = |models: &[usize]| {
            let numbers: Vec<String> = models.iter().map(usize::to_string).collect();
            let plural = if numbers.len() > 1 { "s" } else { "" };
            format!("model{plural} {}", numbers.join(", "))
        };
        let mut warnings: Vec<String> = self
            .of_models
            .iter()
            .map(|(remark, models)| format!("{}: {remark}", named(models)))
            .collect();
        if !self.lines.is_empty() {
            warnings.push(format!(
                "{}: line spectral frequencies that are not those of the coefficients, by up to {:.3} rad where {} are \
                 allowed; they count, as in HaTT's renderer",
                named(&self.lines),
                self.largest_rad,
                elements::LSF_TOLERANCE_RAD
            ));
        }
        warnings
    }
}
