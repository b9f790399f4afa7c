//! Reading HaTT's XML.

use std::path::Path;

use roxmltree::{Document, Node};

use crate::dsp::line_spectral_frequencies as line_spectrum;
use crate::dsp::linear_prediction::step_down;
use crate::support::error::{Error, Result};

/// Largest difference between line spectral frequencies of the file and those of its coefficients, rad.
const LSF_TOLERANCE_RAD: f64 = 0.01;

/// Most numbers that one list may have; more is no model file.
const MOST_NUMBERS: usize = 100_000;

/// A file's models.
#[derive(Clone, Debug, PartialEq)]
pub struct Toolkit {
    /// Samples per second at which the models hold.
    pub sample_rate_hz: f64,
    /// Highest speed of the recordings, mm/s.
    pub max_speed_mm_s: f64,
    /// Highest force of the recordings, N.
    pub max_force_n: f64,
    /// Kinetic friction coefficient; the stylus does not play it.
    pub friction: Option<f64>,
    /// The models that can be used.
    pub models: Vec<ArmaModel>,
    /// Corners of triangles, as indices of `models`.
    pub triangles: Vec<[usize; 3]>,
    /// Parts that were left out, with the reason.
    pub warnings: Vec<String>,
}

/// One model at its place.
#[derive(Clone, Debug, PartialEq)]
pub struct ArmaModel {
    /// Tangential speed, mm/s.
    pub speed_mm_s: f64,
    /// Normal force, N.
    pub force_n: f64,
    /// Reflection coefficients of the autoregressive part, which is stable.
    pub reflection: Vec<f64>,
    /// b(1), b(2) ... of the moving average.
    pub moving_average: Vec<f64>,
    /// Variance of the excitation, (m/s²)²; zero is silence.
    pub variance: f64,
    /// The gain g.
    pub gain: f64,
}

/// Reads `text`; `path` is only named in errors.
///
/// Elements are found by their names wherever they stand, in any case of letters. Lists are numbers in an element's text,
/// or in that of its children, separated by blanks or commas. An element with a child `ARcoeff` is a model.
///
/// # Errors
/// A fault that makes the file unusable, with its line.
pub fn read(path: &Path, text: &str) -> Result<Toolkit> {
    let document = Document::parse(text).map_err(|failure| {
        let problem = format!("is not well-formed XML: {failure}");
        Error::line(path, u64::from(failure.pos().row), problem)
    })?;
    let file = File {
        path,
        document: &document,
    };
    let sample_rate_hz = file.one("SampleRate")?.unwrap_or(1000.0);
    if !(sample_rate_hz.is_finite() && (100.0..=10_000.0).contains(&sample_rate_hz)) {
        let problem =
            format!("a sample rate of {sample_rate_hz} Hz is no model's; HaTT's are of 1000 Hz");
        return Err(Error::file(path, problem));
    }
    let (speeds, forces) = (file.list("speedList")?, file.list("forceList")?);
    let nodes = document
        .descendants()
        .filter(|node| child(*node, "ARcoeff").is_some());
    let mut warnings = Vec::new();
    let mut read = Vec::new();
    for (index, node) in nodes.enumerate() {
        let listed = |list: &[f64]| list.get(index).copied();
        let model = file.model(node, listed(&speeds), listed(&forces))?;
        if let Ok(model) = &model {
            warnings.extend(model.1.iter().map(|w| format!("model {}: {w}", index + 1)));
        }
        if let Err(problem) = &model {
            warnings.push(format!("model {}: {problem}; left out", index + 1));
        }
        read.push(model.ok().map(|(model, _)| model));
    }
    if read.iter().all(Option::is_none) {
        let why = warnings
            .first()
            .map_or(String::new(), |first| format!(" ({first})"));
        let problem = format!("has no model that can be used{why}; is it a HaTT model file?");
        return Err(Error::file(path, problem));
    }
    let triangles = file.triangles(read.len())?;
    let (models, triangles) = without_missing(read, &triangles);
    let largest = |of: fn(&ArmaModel) -> f64| models.iter().map(of).fold(0.0, f64::max);
    Ok(Toolkit {
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
        warnings,
    })
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

struct File<'a> {
    path: &'a Path,
    document: &'a Document<'a>,
}

/// A model and what is to be said of it, or why it cannot be used.
type Read = std::result::Result<(ArmaModel, Vec<String>), String>;

impl File<'_> {
    fn line(&self, node: Node<'_, '_>) -> u64 {
        u64::from(self.document.text_pos_at(node.range().start).row)
    }

    /// The only number of the first element of that name.
    fn one(&self, name: &str) -> Result<Option<f64>> {
        match self.element(name) {
            Some(node) => Ok(self.numbers(node)?.first().copied()),
            None => Ok(None),
        }
    }

    /// The numbers of the first element of that name, outside of models.
    fn list(&self, name: &str) -> Result<Vec<f64>> {
        self.element(name)
            .map_or(Ok(Vec::new()), |node| self.numbers(node))
    }

    fn element(&self, name: &str) -> Option<Node<'_, '_>> {
        self.document
            .descendants()
            .find(|node| is_named(*node, name))
    }

    fn numbers(&self, node: Node<'_, '_>) -> Result<Vec<f64>> {
        let mut numbers = Vec::new();
        for text in node.descendants().filter(Node::is_text) {
            let words = text
                .text()
                .unwrap_or("")
                .split(|c: char| c.is_whitespace() || ",;".contains(c));
            for word in words.filter(|word| !word.is_empty()) {
                let number = word.parse::<f64>().map_err(|_| {
                    let problem =
                        format!("'{word}' in <{}> is not a number", node.tag_name().name());
                    Error::line(self.path, self.line(text), problem)
                })?;
                numbers.push(number);
                if numbers.len() > MOST_NUMBERS {
                    let problem = format!(
                        "<{}> has more than {MOST_NUMBERS} numbers",
                        node.tag_name().name()
                    );
                    return Err(Error::line(self.path, self.line(node), problem));
                }
            }
        }
        Ok(numbers)
    }

    fn model(&self, node: Node<'_, '_>, speed: Option<f64>, force: Option<f64>) -> Result<Read> {
        let list = |name: &str| match child(node, name) {
            Some(node) => self.numbers(node),
            None => Ok(Vec::new()),
        };
        let one = |name: &str| -> Result<Option<f64>> { Ok(list(name)?.first().copied()) };
        let (poles, zeros, lines) = (list("ARcoeff")?, list("MAcoeff")?, list("ARlsf")?);
        let (variance, gain) = (one("var")?, one("gain")?.unwrap_or(1.0));
        let speed = one("speedMod")?.or(speed);
        let force = one("forceMod")?.or(force);
        Ok(checked(&poles, zeros, &lines, variance, gain, speed, force))
    }

    /// Triangles as indices from 0; files count from 0 or from 1.
    fn triangles(&self, models: usize) -> Result<Vec<[usize; 3]>> {
        let Some(node) = self.element("tri") else {
            return Ok(Vec::new());
        };
        let corners = self.numbers(node)?;
        let wrong = |problem: String| Err(Error::line(self.path, self.line(node), problem));
        if !corners.len().is_multiple_of(3) {
            return wrong(format!(
                "<tri> has {} corners, not three a triangle",
                corners.len()
            ));
        }
        let first = f64::from(u8::from(!corners.contains(&0.0)));
        let mut triangles = Vec::new();
        for corner in corners.chunks_exact(3) {
            let mut triangle = [0; 3];
            for (to, &corner) in triangle.iter_mut().zip(corner) {
                let index = corner - first;
                if index.fract() != 0.0 || !(0.0..models as f64).contains(&index) {
                    return wrong(format!("<tri> names model {corner}; there are {models}"));
                }
                *to = index as usize;
            }
            triangles.push(triangle);
        }
        Ok(triangles)
    }
}

fn checked(
    poles: &[f64],
    moving_average: Vec<f64>,
    lines: &[f64],
    variance: Option<f64>,
    gain: f64,
    speed: Option<f64>,
    force: Option<f64>,
) -> Read {
    let finite = |what: &str, value: Option<f64>| match value {
        None => Err(format!("no {what}")),
        Some(value) if value.is_finite() && value >= 0.0 => Ok(value),
        Some(value) => Err(format!("{what} is {value}")),
    };
    let variance = finite("var", variance)?;
    let speed_mm_s = finite("speedMod", speed)?;
    let force_n = finite("forceMod", force)?;
    let gain = finite("gain", Some(gain))?;
    let Some((first, poles)) = poles.split_first() else {
        return Err("ARcoeff is empty".into());
    };
    if *first != 1.0 {
        return Err(format!("ARcoeff begins with {first}, not with 1"));
    }
    if !moving_average.iter().all(|b| b.is_finite()) {
        return Err("MAcoeff is not finite".into());
    }
    let reflection = step_down(poles).ok_or("its coefficients are unstable")?;
    let mut warnings = Vec::new();
    if !lines.is_empty() {
        let own = line_spectrum::frequencies(&reflection);
        let near = |(a, b): (&f64, &f64)| (a - b).abs() <= LSF_TOLERANCE_RAD;
        if own.len() != lines.len() || !own.iter().zip(lines).all(near) {
            warnings.push("its ARlsf are not those of its ARcoeff; the coefficients count".into());
        }
    }
    let model = ArmaModel {
        speed_mm_s,
        force_n,
        reflection,
        moving_average,
        variance,
        gain,
    };
    Ok((model, warnings))
}

fn is_named(node: Node<'_, '_>, name: &str) -> bool {
    node.is_element() && node.tag_name().name().eq_ignore_ascii_case(name)
}

fn child<'a, 'input>(node: Node<'a, 'input>, name: &str) -> Option<Node<'a, 'input>> {
    node.children().find(|child| is_named(*child, name))
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A file of one triangle and a silent edge; `var` and `ar` are of its second model.
    pub fn small(ar: &str, var: &str, tri: &str) -> String {
        let model = |ar: &str, var: &str, speed: f64, force: f64| {
            format!(
                "<model><ARcoeff>{ar}</ARcoeff><MAcoeff></MAcoeff><var>{var}</var><gain>1</gain>\
                 <speedMod>{speed}</speedMod><forceMod>{force}</forceMod></model>\n"
            )
        };
        format!(
            "<?xml version=\"1.0\"?>\n<HaTT>\n<header><SampleRate>1000</SampleRate><maxSpeed>200</maxSpeed>\
             <maxForce>2</maxForce><mu>0.3</mu>\n<tri><value>1</value><value>2</value> 3 {tri}</tri></header>\n{}{}{}{}</HaTT>",
            model("1 -0.5 0.2", "0.01", 20.0, 0.5),
            model(ar, var, 200.0, 0.5),
            model("1 -1.2 0.8", "0.04", 100.0, 2.0),
            model("1 0 0", "0", 0.0, 0.0),
        )
    }

    fn parse(text: &str) -> Result<Toolkit> {
        read(Path::new("felt.xml"), text)
    }

    #[test]
    fn a_file_gives_its_models_and_triangles() {
        let toolkit = parse(&small("1 -0.9 0.5", "0.02", "0 2 3")).unwrap();
        assert_eq!(toolkit.models.len(), 4);
        // One corner is 0, so that all count from 0.
        assert_eq!(toolkit.triangles, [[1, 2, 3], [0, 2, 3]]);
        assert_eq!(
            (toolkit.max_speed_mm_s, toolkit.friction),
            (200.0, Some(0.3))
        );
        assert_eq!(toolkit.models[3].variance, 0.0);
        assert!(toolkit.warnings.is_empty());
        let from_one = parse(&small("1 -0.9 0.5", "0.02", "")).unwrap();
        assert_eq!(from_one.triangles, [[0, 1, 2]]);
    }

    #[test]
    fn models_that_cannot_be_played_are_left_out_and_named() {
        for (ar, var, word) in [
            ("1 -2.5 1.1", "0.02", "unstable"),
            ("1 -0.9 0.5", "-0.02", "var is -0.02"),
            ("1 -0.9 0.5", "nan", "var is NaN"),
            ("0.5 -0.9 0.5", "0.02", "begins with 0.5"),
            ("1 -0.9 nan", "0.02", "unstable"),
        ] {
            let toolkit = parse(&small(ar, var, "")).unwrap();
            assert_eq!((toolkit.models.len(), toolkit.triangles.len()), (3, 0));
            let said = toolkit.warnings.join("; ");
            assert!(said.contains("model 2") && said.contains(word), "{said}");
        }
    }

    #[test]
    fn what_is_no_model_file_is_refused_with_its_place() {
        let good = small("1 -0.9 0.5", "0.02", "");
        for (text, word) in [
            (good.replace("</HaTT>", ""), "well-formed"),
            (good.replace("-1.2", "minus"), "line 7: 'minus'"),
            (small("1 -0.9 0.5", "0.02", "1 2 9"), "names model 9"),
            (small("1 -0.9 0.5", "0.02", "1 2"), "not three a triangle"),
            (good.replace("ARcoeff", "other"), "no model"),
            (
                good.replace("<SampleRate>1000", "<SampleRate>0"),
                "sample rate",
            ),
            (String::new(), "well-formed"),
        ] {
            let message = parse(&text).unwrap_err().to_string();
            assert!(
                message.contains("felt.xml") && message.contains(word),
                "{message}"
            );
        }
    }

    #[test]
    fn line_spectra_that_are_not_the_coefficients_own_are_said() {
        let text =
            small("1 -0.9 0.5", "0.02", "").replace("<var>0.02", "<ARlsf>0.1 3.0</ARlsf><var>0.02");
        let toolkit = parse(&text).unwrap();
        assert!(toolkit.warnings[0].contains("ARlsf"));
    }

    proptest! {
        #[test]
        fn no_text_makes_the_reader_fail_otherwise_than_by_an_error(
            cut in 0usize..900, put in "[<>/a-z0-9 .-]{0,12}",
        ) {
            let mut text = small("1 -0.9 0.5", "0.02", "");
            let cut = cut.min(text.len());
            text.replace_range(cut..(cut + put.len()).min(text.len()), &put);
            let _ = parse(&text);
        }
    }
}
