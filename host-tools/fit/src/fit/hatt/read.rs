//! Reading HaTT's XML.

use std::collections::BTreeMap;
use std::path::Path;

use model_format::PlayRate;
use stylus_signals::recording::RATES_HZ;
use stylus_support::{Error, Result};

use super::elements::{self, File};
use super::toolkit::{ArmaModel, Toolkit, found};

/// Largest number of models of a file. The published files have some hundred. The choice of a grid visits all of them
/// for each position.
const MOST_MODELS: usize = 1000;

/// Largest number of triangles per model. Triangles in a plane that do not overlap are fewer than two per corner.
const TRIANGLES_PER_MODEL: usize = 2;

/// Reads `text`; `path` is only named in errors.
///
/// Elements are found by their names at any depth, in upper or lower case. Lists are numbers in an element's text, or
/// in that of its children, separated by blanks or commas. An element with a child `ARcoeff` or `ARlsf` is a model.
/// Every `tri` element is read; each holds one triangle or more.
///
/// # Errors
/// A fault that makes the file unusable, with its line if it is in one.
pub fn read(path: &Path, text: &str) -> Result<Toolkit> {
    let document = elements::document(path, text)?;
    let file = File::new(path, &document);
    file.check_units()?;
    let sample_rate_hz = file.one("SampleRate")?.unwrap_or(1000.0);
    if !(sample_rate_hz.is_finite() && is_models_rate(sample_rate_hz)) {
        let problem = format!("a sample rate of {sample_rate_hz} Hz is no model's; HaTT's are of 1000 or 10000 Hz");
        return Err(Error::file(path, problem));
    }
    let mut remarks = BTreeMap::new();
    let read = models(&file, &mut remarks)?;
    let usable = read.iter().flatten().count();
    if usable == 0 {
        let why = warnings(&remarks)
            .first()
            .map_or(String::new(), |first| format!(": {first}"));
        let problem = format!("has no model that can be used{why}; is it a HaTT model file?");
        return Err(Error::file(path, problem));
    }
    file.check_count("numMod", read.len(), "models")?;
    // Triangles name models by their place in the file, so models that are left out count here.
    let triangles = file.triangles(read.len())?;
    file.check_count("numTri", triangles.len(), "triangles")?;
    if triangles.len() > TRIANGLES_PER_MODEL * read.len() {
        let (count, models) = (triangles.len(), read.len());
        let problem = format!(
            "has {count} triangles over {models} models, and at most {TRIANGLES_PER_MODEL} per model fit beside each \
             other: leave out those that overlap"
        );
        return Err(Error::file(path, problem));
    }
    let (models, triangles) = without_missing(read, &triangles);
    let largest = |of: fn(&ArmaModel) -> f64| models.iter().map(of).fold(0.0, f64::max);
    let mut toolkit = Toolkit {
        sample_rate_hz,
        play_rate: PlayRate::default(),
        max_speed_mm_s: file.one("maxSpeed")?.unwrap_or_else(|| largest(|m| m.speed_mm_s)),
        max_force_n: file.one("maxForce")?.unwrap_or_else(|| largest(|m| m.force_n)),
        models,
        triangles,
        warnings: warnings(&remarks),
    };
    toolkit.check_orders(path)?;
    Ok(toolkit)
}

/// Highest sample rate of models, Hz.
const MOST_RATE_HZ: f64 = 10_000.0;

/// Returns whether models may have this sample rate, Hz.
fn is_models_rate(rate_hz: f64) -> bool {
    RATES_HZ.contains(&rate_hz) && rate_hz <= MOST_RATE_HZ
}

/// Returns all models in the file's order; `None` for each that is left out.
fn models(file: &File<'_>, remarks: &mut Remarks) -> Result<Vec<Option<ArmaModel>>> {
    let (speeds, forces) = (file.list("speedList")?, file.list("forceList")?);
    let mut read = Vec::new();
    for (index, node) in file.models().enumerate() {
        if index == MOST_MODELS {
            return Err(file.too_many(node, MOST_MODELS));
        }
        let place = (speeds.get(index).copied(), forces.get(index).copied());
        read.push(match found(file, node, place)? {
            Ok(model) => Some(model),
            Err(problem) => {
                let remark = format!("{problem}; left out");
                remarks.entry(remark).or_default().push(index + 1);
                None
            }
        });
    }
    Ok(read)
}

/// Leaves out the missing models, and every triangle that uses one.
fn without_missing(read: Vec<Option<ArmaModel>>, triangles: &[[usize; 3]]) -> (Vec<ArmaModel>, Vec<[usize; 3]>) {
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

/// Faults, each with the numbers of the models that have it, from 1.
type Remarks = BTreeMap<String, Vec<usize>>;

fn warnings(remarks: &Remarks) -> Vec<String> {
    let warning = |(remark, models): (&String, &Vec<usize>)| {
        let numbers: Vec<String> = models.iter().map(usize::to_string).collect();
        let plural = if numbers.len() > 1 { "s" } else { "" };
        format!("model{plural} {}: {remark}", numbers.join(", "))
    };
    remarks.iter().map(warning).collect()
}

#[cfg(test)]
pub(super) mod tests {
    use super::super::fixture;
    use super::*;
    use proptest::prelude::*;
    use test_helpers::holds;

    /// Returns a file of one triangle and a silent model outside of it, without line spectral frequencies; `var` and
    /// `ar` are those of its second model.
    fn small(ar: &str, var: &str, tri: &str) -> String {
        let model = |ar: &str, var: &str, speed: f64, force: f64| {
            format!(
                "<model><ARcoeff>{ar}</ARcoeff><MAcoeff></MAcoeff><var>{var}</var><gain>1</gain>\
                 <speedMod>{speed}</speedMod><forceMod>{force}</forceMod></model>\n"
            )
        };
        format!(
            "<?xml version=\"1.0\"?>\n<HaTT>\n<header><SampleRate>1000</SampleRate><maxSpeed>200</maxSpeed>\
             <maxForce>2</maxForce><mu>0.3</mu>\n<tri><value>1</value><value>2</value> 3 {tri}</tri></header>\n\
             {}{}{}{}</HaTT>",
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
    fn a_file_of_the_published_shape_gives_every_model_and_every_triangle() {
        let toolkit = parse(&fixture::whole()).unwrap();
        assert_eq!(
            toolkit.triangles,
            fixture::TRIANGLES.map(|t| t.map(|corner| corner - 1))
        );
        assert_eq!(toolkit.models.len(), fixture::PLACES.len());
        assert_eq!(toolkit.max_speed_mm_s, 200.0);
        assert!(toolkit.warnings.is_empty(), "{:?}", toolkit.warnings);
        for (model, place) in toolkit.models.iter().zip(fixture::PLACES) {
            assert_eq!((model.speed_mm_s, model.force_n, model.variance), place);
            let timbre = model.timbre.as_ref().unwrap();
            assert_eq!((timbre.poles.len(), timbre.zeros.len()), (4, 2));
            assert_eq!(timbre.gain, fixture::gain(place.0));
        }
    }

    #[test]
    fn coefficients_alone_give_the_same_models() {
        let whole = fixture::whole();
        let mut text = String::new();
        for piece in whole.split_inclusive("lsf>") {
            // A list of line spectral frequencies ends at its closing tag.
            if !piece.ends_with("</ARlsf>") && !piece.ends_with("</MAlsf>") {
                text.push_str(piece.trim_end_matches("<ARlsf>").trim_end_matches("<MAlsf>"));
            }
        }
        assert!(!text.contains("lsf"));
        let (with, without) = (parse(&whole).unwrap(), parse(&text).unwrap());
        for (a, b) in with.models.iter().zip(&without.models) {
            let (a, b) = (a.timbre.as_ref().unwrap(), b.timbre.as_ref().unwrap());
            let pairs = a.poles.iter().chain(&a.zeros).zip(b.poles.iter().chain(&b.zeros));
            assert!(pairs.into_iter().all(|(a, b)| (a - b).abs() < 1e-6));
        }
    }

    #[test]
    fn a_leading_coefficient_is_that_of_lag_zero_and_may_be_left_out() {
        let gain = |text: &str| parse(text).unwrap().models[4].timbre.clone().unwrap().gain;
        let whole = fixture::whole();
        let halves = whole.replace("<MAcoeff><value>1.0", "<MAcoeff><value>2.0");
        assert_eq!(gain(&halves), 2.0 * gain(&whole));
        let left_out = whole
            .replace("<MAcoeff><value>1.000000000</value>", "<MAcoeff>")
            .replace("<ARcoeff><value>1.000000000</value>", "<ARcoeff>");
        assert_ne!(left_out, whole);
        assert_eq!(parse(&left_out).unwrap(), parse(&whole).unwrap());
    }

    #[test]
    fn models_that_cannot_be_played_are_left_out_and_named() {
        for (ar, var, word) in [
            ("1 -2.5 1.1", "0.02", "unstable"),
            ("1 -0.9 0.5", "-0.02", "var is -0.02"),
            ("1 -0.9 0.5", "nan", "var is NaN"),
            ("0.5 -0.9 0.5", "0.02", "begins with 0.5"),
            ("1 -0.9 nan", "0.02", "not finite"),
            (&format!("1{}", " 0.001".repeat(101)), "0.02", "more than 100 AR"),
        ] {
            let toolkit = parse(&small(ar, var, "")).unwrap();
            assert_eq!((toolkit.models.len(), toolkit.triangles.len()), (3, 0));
            let said = toolkit.warnings.join("; ");
            holds(&said, &["model 2", word]);
        }
    }

    #[test]
    fn what_is_no_model_file_is_refused_with_its_place() {
        let good = small("1 -0.9 0.5", "0.02", "");
        let whole = fixture::whole();
        let triangle = "<tri type=\"array\">\n<value>2</value>\n<value>6</value>\n<value>5</value>\n</tri>\n";
        for (text, word) in [
            (good.replace("</HaTT>", ""), "well-formed"),
            (good.replace("-1.2", "minus"), "line 7: 'minus'"),
            (small("1 -0.9 0.5", "0.02", "1 2 9"), "names model 9"),
            (small("1 -0.9 0.5", "0.02", "1 2"), "not three per triangle"),
            (small("1 -0.9 0.5", "0.02", "1 1 2"), "names a model twice"),
            (
                small("1 -0.9 0.5", "0.02", &"1 2 3 ".repeat(8)),
                "9 triangles over 4 models",
            ),
            (good.replace("ARcoeff", "other"), "no model"),
            (good.replace("<SampleRate>1000", "<SampleRate>0"), "sample rate"),
            (String::new(), "well-formed"),
            (
                whole.replace(triangle, ""),
                "<numTri> says 6, and the file has 5 triangles",
            ),
            (
                whole.replace("<numMod>6", "<numMod>7"),
                "<numMod> says 7, and the file has 6 models",
            ),
            (
                whole.replace("<value>6</value>", "<value>16</value>"),
                "names model 16; there are 6",
            ),
            (whole.replace("<ForceUnits>N", "<ForceUnits>lbf"), "'lbf'; only 'N'"),
            (small("1 -0.9", "0.02", ""), "1 poles and 0 zeros, others have 2 and 0"),
        ] {
            holds(&parse(&text).unwrap_err(), &["felt.xml", word]);
        }
    }

    #[test]
    fn line_spectra_count_whatever_the_coefficients_are() {
        let lines = fixture::lines(60.0)[0][1];
        let text = fixture::whole().replace(&format!("{lines:.9}"), &format!("{:.9}", lines + 0.05));
        let toolkit = parse(&text).unwrap();
        let counted = toolkit.models[4].timbre.as_ref().unwrap().poles[1];
        assert!((counted - lines - 0.05).abs() < 1e-8);
    }

    proptest! {
        #[test]
        fn no_text_makes_the_reader_fail_otherwise_than_by_an_error(
            cut in 0usize..4000, put in "[<>/a-z0-9 .-]{0,12}",
        ) {
            for mut text in [small("1 -0.9 0.5", "0.02", ""), fixture::whole()] {
                let cut = cut % text.len();
                text.replace_range(cut..(cut + put.len()).min(text.len()), &put);
                let _ = parse(&text);
            }
        }
    }

    #[test]
    fn shapes_that_cost_more_than_their_length_are_refused_with_their_line() {
        let many = |one: fn(usize) -> String| (0..60_000).map(one).collect::<String>();
        for hostile in [
            format!("<a>\n<b{}/></a>", many(|i| format!(" c{i}=\"\""))),
            format!("<a>\n{}</a>", many(|i| format!("<b xmlns:n{i}=\"{i}\"/>"))),
            format!("<a>\n{}", "<a>".repeat(60_000)),
        ] {
            holds(&parse(&hostile).unwrap_err(), &["line 2", "more than"]);
        }
    }
}
