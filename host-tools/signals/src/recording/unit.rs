//! Units of samples, as they are written in headers of files and by users.

use regex_lite::Regex;
use serde::{Deserialize, Serialize};
use stylus_support::csv_table::comment;
use stylus_support::number::positive;

/// Kind of samples whose acceleration nothing states.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub enum Unscaled {
    /// Fractions of a full scale, as integers of a WAV file are, and floats that a sound card's program writes.
    OfFullScale,
    /// Steps of a converter, as in a table.
    Counts,
}

/// Standard acceleration of gravity, m/s² (exact by definition, CGPM 1901).
pub const GRAVITY_M_S2: f64 = 9.80665;

/// Relative deviation of a measured gravity, caused by offsets and gains of cheap sensors, which read 0.93 to 1.10 g.
pub const GRAVITY_TOLERANCE: f64 = 0.1;

/// A unit that a header or an option can name.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Unit {
    /// An acceleration, m/s².
    Acceleration(f64),
    /// A voltage, V, from which a sensitivity gives an acceleration.
    Voltage(f64),
    /// Steps of a converter, from which a sensitivity gives an acceleration.
    Count,
    /// A quantity that is not an acceleration.
    Other,
}

impl Unit {
    /// Parses a unit, such as `g`, `m/s²`, `mm/s^2`, `LSB` or `g/256`; `None` if it is unknown.
    pub fn parse(text: &str) -> Option<Self> {
        if let Some((unit, count)) = text.rsplit_once('/')
            && let Ok(count) = count.trim().parse::<f64>()
            && count.is_finite()
            && count > 0.0
        {
            return match Self::parse(unit)? {
                Self::Acceleration(m_s2) => Some(Self::Acceleration(m_s2 / count)),
                _ => None,
            };
        }
        named(&plain(text))
    }
}

/// Returns `text` in lower case, without characters that carry no meaning. So `m/s²`, `m·s⁻²`, `m/(s^2)` and `mps2`
/// become only a few forms.
fn plain(text: &str) -> String {
    let text = text.trim().to_lowercase().replace("per", "/");
    let kept = text.chars().filter_map(|sign| match sign {
        '²' => Some('2'),
        '⁻' | '−' => Some('-'),
        'µ' | 'μ' => Some('u'),
        ' ' | '_' | '^' | '*' | '·' | '⋅' | '.' | '(' | ')' | '\'' | '’' => None,
        other => Some(other),
    });
    let text: String = kept.collect();
    text.replace("sec", "s").replace("squared", "2")
}

/// Returns the unit of a name in plain form.
fn named(plain: &str) -> Option<Unit> {
    use Unit::{Acceleration, Count, Other, Voltage};
    let metres = |prefix: f64| Some(Acceleration(prefix));
    for length in ["/s2", "s-2", "ps2", "s2", "/s/s", "/ss"]
        .iter()
        .filter_map(|ending| plain.strip_suffix(ending))
    {
        match length {
            "m" | "meter" | "meters" | "metre" | "metres" => return metres(1.0),
            "cm" => return metres(1e-2),
            "mm" => return metres(1e-3),
            "um" => return metres(1e-6),
            "in" => return metres(0.0254),
            "ft" => return metres(0.3048),
            _ => {}
        }
    }
    Some(match plain {
        "g" | "gs" | "gn" | "g0" | "gee" | "gravity" => Acceleration(GRAVITY_M_S2),
        "mg" | "mgs" | "millig" | "milli-g" => Acceleration(1e-3 * GRAVITY_M_S2),
        "ug" | "microg" | "micro-g" => Acceleration(1e-6 * GRAVITY_M_S2),
        "gal" => Acceleration(1e-2),
        "mgal" => Acceleration(1e-5),
        "v" | "volt" | "volts" => Voltage(1.0),
        "mv" | "millivolt" | "millivolts" => Voltage(1e-3),
        "uv" => Voltage(1e-6),
        "count" | "counts" | "cts" | "lsb" | "lsbs" | "raw" | "digit" | "digits" | "adc" | "adu" | "code" | "codes" => {
            Count
        }
        "m/s" | "cm/s" | "mm/s" | "um/s" | "nm/s" | "m" | "cm" | "mm" | "um" | "n" | "mn" | "nm" | "rad/s"
        | "deg/s" | "°/s" | "dps" | "deg" | "°" | "rad" | "°c" | "degc" | "ut" | "gauss" | "pa" | "kpa" | "ma"
        | "hz" | "db" => Other,
        _ => return None,
    })
}

/// Parses the acceleration of a sample of 1, m/s²: a number, a unit of acceleration, or a number of them.
///
/// # Errors
/// What the text must be, in words.
pub fn scale(text: &str) -> Result<f64, String> {
    // As people state a full scale: `5 g`.
    let (number, unit) = text.split_at(text.find(char::is_alphabetic).unwrap_or(text.len()));
    let number = if number.is_empty() {
        Ok(1.0)
    } else {
        positive(number.trim())
    };
    match (positive(text), number, Unit::parse(unit)) {
        (Ok(number), ..) => Ok(number),
        (Err(_), Ok(number), Some(Unit::Acceleration(m_s2))) => Ok(number * m_s2),
        _ => Err(
            "must be a number above zero, m/s² per sample of 1, or a unit such as g, mg, mm/s^2 or g/256 (256 counts \
             per g) or g/0.3 (300 mV/g, samples in V)"
                .into(),
        ),
    }
}

/// Returns whether the `fields` of a line below the names are units, with or without brackets.
pub(super) fn is_row<'f>(mut fields: impl Iterator<Item = &'f str>) -> bool {
    const TIMES: [&str; 8] = ["s", "sec", "seconds", "ms", "us", "ns", "hh:mm:ss", ""];
    fields.all(|field| {
        let field = bare(field);
        Unit::parse(field).is_some() || TIMES.contains(&plain(field).as_str())
    })
}

/// Returns a unit without the brackets around it.
pub(super) fn bare(field: &str) -> &str {
    ["()", "[]"]
        .iter()
        .find_map(|pair| field.strip_prefix(&pair[..1])?.strip_suffix(&pair[1..]))
        .unwrap_or(field)
        .trim()
}

/// Units of a file's columns of samples, as its header states them.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Stated {
    /// Acceleration of a sample of 1 in each column, m/s², if the header states it.
    pub scales_m_s2: Option<Vec<f64>>,
    /// The units, as the header writes them; empty if it names none.
    pub units: String,
    /// The first unit for which the header states no acceleration.
    pub unscaled: Option<Unit>,
}

/// Largest relative deviation of a given scale from that of the header at which they count as the same: 9.81 means g.
const SAME_SCALE: f64 = 0.01;

impl Stated {
    /// Returns the acceleration of a sample of 1 on each of `axes`, m/s²: as `given`, or from the header, or 1.
    pub fn scales_for(&self, given: Option<f64>, axes: usize) -> Vec<f64> {
        match (given, &self.scales_m_s2) {
            (Some(scale), _) => vec![scale; axes],
            (None, Some(scales)) => scales.clone(),
            (None, None) => vec![1.0; axes],
        }
    }

    /// Returns counts, if the header states that samples are counts, but not their acceleration.
    pub fn counts(&self) -> Option<Unscaled> {
        (self.unscaled == Some(Unit::Count)).then_some(Unscaled::Counts)
    }

    /// Returns the conversion by the header's units, in words.
    pub fn conversion(&self, given: Option<f64>) -> Option<String> {
        self.scales_m_s2
            .as_ref()
            .filter(|_| given.is_none())?
            .iter()
            .any(|scale| scale.to_bits() != 1.0f64.to_bits())
            .then(|| format!("converted from {} to m/s², by the header", self.units))
    }

    /// Returns, in words, how the header's units contradict a `given` scale, or what they leave open.
    pub fn doubt(&self, given: Option<f64>) -> Option<String> {
        let units = &self.units;
        match (given, &self.scales_m_s2) {
            (Some(given), Some(scales)) => {
                let differs = |scale: &&f64| (given.abs() / *scale - 1.0).abs() > SAME_SCALE;
                let scale = scales.iter().find(differs)?;
                Some(format!(
                    "the header says {units}, {scale:.5} m/s² per sample of 1, and the scale that was given, {given}, \
                     counts: remove the wrong one"
                ))
            }
            (None, None) => match self.unscaled? {
                Unit::Voltage(_) => Some(format!(
                    "the header says {units}, and the sensor's sensitivity is missing: for 100 mV/g, give --scale \
                     g/0.1 if samples are in V"
                )),
                // As a vibrometer writes it.
                Unit::Other if plain(units).ends_with("m/s") => Some(format!(
                    "the header says {units}, a velocity: differentiate it, such as by numpy.gradient(v, t)"
                )),
                Unit::Other => Some(format!("the header says {units}, which is no acceleration")),
                // Counts without a scale have a separate note.
                Unit::Acceleration(_) | Unit::Count => None,
            },
            _ => None,
        }
    }
}

/// Returns what `names` of columns and the `comments` above them state about the columns' units.
///
/// A column without a unit has that of the first column with one. The unit of a comment is used only if no name has a
/// unit, and the sensitivity of a comment only if no name has a sensitivity.
pub(super) fn stated(names: &[String], comments: &str) -> Stated {
    let in_names: Vec<Option<(Unit, String)>> = names.iter().map(|name| in_name(name)).collect();
    let mut texts = names.iter().map(String::as_str).chain([comments]);
    let sensitivity = texts.find_map(Sensitivity::found_in);
    // A single v is more likely a direction than volts.
    let is_direction = |text: &str| names.len() == 1 && names[0].ends_with("_v") && text == "v";
    let first = in_names
        .iter()
        .flatten()
        .next()
        .cloned()
        .filter(|(_, text)| sensitivity.is_some() || !is_direction(text))
        .or_else(|| in_comments(comments))
        .or_else(|| sensitivity.as_ref().map(Sensitivity::of_unit));
    let Some(first) = first else {
        return Stated::default();
    };
    let all: Vec<(Unit, String)> = in_names
        .into_iter()
        .map(|own| own.unwrap_or_else(|| first.clone()))
        .collect();
    let mut units: Vec<&str> = all.iter().map(|(_, text)| text.as_str()).collect();
    units.dedup();
    let m_s2 = |(unit, _): &(Unit, String)| m_s2_of(*unit, sensitivity.as_ref());
    Stated {
        scales_m_s2: all.iter().map(m_s2).collect(),
        unscaled: all.iter().find(|own| m_s2(own).is_none()).map(|own| own.0),
        units: units.join(", "),
    }
}

/// Returns the acceleration of one `unit`, m/s², if it is known.
fn m_s2_of(unit: Unit, sensitivity: Option<&Sensitivity>) -> Option<f64> {
    let of_one = |of: Unit| sensitivity.filter(|own| own.of == of).map(|own| own.m_s2);
    match unit {
        Unit::Acceleration(m_s2) => Some(m_s2),
        Unit::Voltage(volts) => Some(volts * of_one(Unit::Voltage(1.0))?),
        Unit::Count => of_one(Unit::Count),
        Unit::Other => None,
    }
}

/// Returns the unit that a column's name contains, with its text: in brackets, or as its last words.
pub(super) fn in_name(name: &str) -> Option<(Unit, String)> {
    let (inside, outside) = brackets(name);
    let of_text = |text: &str| Some((Unit::parse(text)?, text.trim().to_owned()));
    // A sensitivity may follow the unit: `mV, 100 mV/g`.
    // A range may stand in place of the unit: `X (40g)`.
    let of_range = |text: &str| {
        let rest = text
            .trim_start_matches(['±', ' '])
            .trim_start_matches(|sign: char| sign.is_ascii_digit());
        (rest.len() < text.len() && rest.trim().eq_ignore_ascii_case("g")).then(|| of_text("g"))?
    };
    let of_bracket = |text: &String| of_text(text).or_else(|| text.split([',', ';', '@']).find_map(of_text));
    let of_bracket = |text: &String| of_bracket(text).or_else(|| of_range(text));
    let is_g_force = ["gfx", "gfy", "gfz"].contains(&outside.trim().to_lowercase().as_str());
    let g_force = || is_g_force.then(|| of_text("g"))?;
    inside.iter().find_map(of_bracket).or_else(g_force).or_else(|| {
        let outside = Sensitivity::cut_from(&outside);
        let outside = outside.trim().trim_end_matches('_');
        let starts = outside.match_indices([' ', '_', '-', ',', ':', '/', '.', ';']);
        let starts = starts.map(|(at, sign)| at + sign.len());
        // The longest ending comes first, so that `m_s2` is not read as `s2`.
        [0].into_iter().chain(starts).find_map(|at| last_words(&outside[at..]))
    })
}

/// Returns the unit that the last words of a name denote. Positions, such as `tip_mm`, do not count, and only units
/// with powers may contain a separator.
fn last_words(words: &str) -> Option<(Unit, String)> {
    let unit = Unit::parse(words)?;
    let is_power = ["2", "/s/s"].iter().any(|ending| plain(words).ends_with(ending));
    let is_meant = unit != Unit::Other && (is_power || !words.contains([' ', '_', '.']));
    is_meant.then(|| (unit, words.to_owned()))
}

/// Returns the texts within the brackets of a name, and the name without them.
fn brackets(name: &str) -> (Vec<String>, String) {
    let (mut inside, mut outside, mut depth) = (Vec::new(), String::new(), 0usize);
    for sign in name.chars() {
        match sign {
            '(' | '[' | '{' | '<' if depth == 0 => {
                inside.push(String::new());
                depth = 1;
            }
            ')' | ']' | '}' | '>' if depth == 1 => depth = 0,
            _ if depth == 0 => outside.push(sign),
            _ => {
                // A unit may have brackets of its own: `[m/(s^2)]`.
                depth = match sign {
                    '(' | '[' => depth + 1,
                    ')' | ']' => depth - 1,
                    _ => depth,
                };
                inside
                    .iter_mut()
                    .rev()
                    .take(1)
                    .for_each(|text: &mut String| text.push(sign));
            }
        }
    }
    (inside, outside)
}

/// Returns the unit that comments name: `unit: g`, `acceleration in mg`.
fn in_comments(comments: &str) -> Option<(Unit, String)> {
    comments.lines().find_map(|line| {
        let line = comment(line).unwrap_or(line).trim();
        let lower = line.to_lowercase();
        if !["unit", "accel"].iter().any(|word| lower.contains(word)) {
            return None;
        }
        let after = line.rsplit_once([':', '=']).or_else(|| line.rsplit_once(" in "))?;
        after
            .1
            .split([',', ';', ' '])
            .chain([after.1])
            .filter_map(|text| Some((Unit::parse(text)?, text.trim().to_owned())))
            .find(|(unit, _)| *unit != Unit::Other)
    })
}

/// Acceleration per volt, or per step of a converter.
#[derive(Clone, Debug, PartialEq)]
struct Sensitivity {
    /// Unit whose acceleration is stated: the volt or the step.
    of: Unit,
    /// Acceleration of that unit, m/s².
    m_s2: f64,
    /// Text of the sensitivity, as it is written.
    text: String,
}

impl Sensitivity {
    /// Returns the pattern of a sensitivity: a number, a unit, and the unit by which it is divided.
    fn form() -> Option<Regex> {
        Regex::new(concat!(
            r"([0-9]+(?:\.[0-9]+)?(?:[eE][-+]?[0-9]+)?)[\s_]*([A-Za-zµμ]+)",
            r"\s*(?:/|per)\s*(\(?[A-Za-zµμ][A-Za-z0-9/²^]*\)?)"
        ))
        .ok()
    }

    /// Returns the first sensitivity in the first 64 KiB of `text`: `100 mV/g`, `0.0102 V/(m/s²)`, `256 LSB/g`,
    /// `3.9 mg/LSB`.
    fn found_in(text: &str) -> Option<Self> {
        // The pattern takes a microsecond for a byte, and a name may have all bytes of a row.
        let text = &text[..text.floor_char_boundary(1 << 16)];
        Self::form()?.captures_iter(text).find_map(|found| {
            let number: f64 = found[1].parse().ok().filter(|number| *number > 0.0)?;
            let (of, m_s2) = match (Unit::parse(&found[2])?, Unit::parse(&found[3])?) {
                (Unit::Voltage(volts), Unit::Acceleration(m_s2)) => (Unit::Voltage(1.0), m_s2 / (number * volts)),
                (Unit::Acceleration(m_s2), Unit::Voltage(volts)) => (Unit::Voltage(1.0), number * m_s2 / volts),
                (Unit::Count, Unit::Acceleration(m_s2)) => (Unit::Count, m_s2 / number),
                (Unit::Acceleration(m_s2), Unit::Count) => (Unit::Count, number * m_s2),
                _ => return None,
            };
            let text = found[0].to_owned();
            Some(Self { of, m_s2, text })
        })
    }

    /// Returns `text` without the sensitivity in it.
    fn cut_from(text: &str) -> String {
        Self::found_in(text).map_or_else(|| text.to_owned(), |found| text.replace(&found.text, ""))
    }

    /// Returns the unit of samples for which only the sensitivity is stated: steps, or volts with an unknown prefix.
    fn of_unit(&self) -> (Unit, String) {
        let unit = if self.of == Unit::Count {
            Unit::Count
        } else {
            Unit::Other
        };
        (unit, self.text.clone())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn of(names: &[&str]) -> Stated {
        let names: Vec<String> = names.iter().map(|&name| name.to_owned()).collect();
        stated(&names, "")
    }

    const G: f64 = GRAVITY_M_S2;

    #[test]
    fn units_of_acceleration_in_names_are_understood_in_every_common_form() {
        for (name, m_s2) in [
            ("accel_x_g", G),
            ("ax [g]", G),
            ("Acceleration X (g)", G),
            ("x (G)", G),
            ("ax/g", G),
            ("a_x / g", G),
            ("Acc X, g", G),
            ("g", G),
            ("X-Axis (g's)", G),
            ("X (40g)", G),
            ("Z [±8 g]", G),
            ("gFx", G),
            ("gFx []", G),
            ("AccX[mg]", 1e-3 * G),
            ("x_mg", 1e-3 * G),
            ("x (µg)", 1e-6 * G),
            ("ax_m_s2", 1.0),
            ("ax_m/s2", 1.0),
            ("ax_ms2", 1.0),
            ("ax_mps2", 1.0),
            ("ax (m/s²)", 1.0),
            ("Linear Acceleration x (m/s^2)", 1.0),
            ("ax [m/(s^2)]", 1.0),
            ("ax/(m/s²)", 1.0),
            ("ax [m·s⁻²]", 1.0),
            ("ax [m s^-2]", 1.0),
            ("ax_ms-2", 1.0),
            ("acc.x.m.s2", 1.0),
            ("ax_m_per_s2", 1.0),
            ("ax (m/s/s)", 1.0),
            ("ax (m/sec^2)", 1.0),
            ("a_mm_s2", 1e-3),
            ("a [mm/s²]", 1e-3),
            ("a mm/s^2", 1e-3),
            ("a (cm/s²)", 1e-2),
            ("a (Gal)", 1e-2),
            ("a (in/s²)", 0.0254),
            ("a [LSB, 256 LSB/g]", G / 256.0),
            ("a (16384 counts/g)", G / 16384.0),
            ("raw (3.9 mg/LSB)", 3.9e-3 * G),
            ("a [V] 100 mV/g", G / 0.1),
            ("a (mV, 100 mV/g)", 1e-3 * G / 0.1),
            ("a_V_100mV/g", G / 0.1),
            ("a V (100 mV/g)", G / 0.1),
            ("a (V) 0.0102 V/(m/s²)", 1.0 / 0.0102),
        ] {
            let found = of(&[name]).scales_m_s2.unwrap_or_else(|| panic!("{name} has no unit"));
            assert!((found[0] / m_s2 - 1.0).abs() < 1e-12, "{name}: {found:?}");
        }
    }

    #[test]
    fn names_that_tell_no_unit_are_left_alone() {
        for name in [
            "x",
            "a",
            "acc_v",
            "left",
            "tip_mm",
            "x (left)",
            "ch1",
            "gx",
            "",
            "x (16 g range)",
        ] {
            assert_eq!(of(&[name]).scales_m_s2, None, "{name}");
            assert_eq!(of(&[name]).units, "", "{name}");
        }
    }

    #[test]
    fn units_without_an_acceleration_are_kept_by_name() {
        let (volts, milli) = (Unit::Voltage(1.0), Unit::Voltage(1e-3));
        for (names, units, unscaled) in [
            (&["x [LSB]", "y [LSB]"][..], "LSB", Unit::Count),
            (&["x_raw", "y_raw"], "raw", Unit::Count),
            (&["x (V)"], "V", volts),
            (&["x_mV"], "mV", milli),
            (&["x_v", "y_v"], "v", volts),
            (&["x (mm/s)"], "mm/s", Unit::Other),
            (&["x (deg/s)"], "deg/s", Unit::Other),
            (&["x 100 mV/g"], "100 mV/g", Unit::Other),
        ] {
            let expected = Stated {
                scales_m_s2: None,
                units: units.to_owned(),
                unscaled: Some(unscaled),
            };
            assert_eq!(of(names), expected);
        }
        for (name, remedy) in [("v (µm/s)", "differentiate"), ("f (N)", "no acceleration")] {
            let doubt = of(&[name]).doubt(None).unwrap();
            assert!(doubt.contains(remedy), "{doubt}");
        }
    }

    #[test]
    fn each_column_has_its_own_unit_and_one_without_that_of_the_others() {
        let scales = of(&["x (g)", "y", "z (mg)"]).scales_m_s2;
        assert_eq!(scales, Some(vec![G, G, 1e-3 * G]));
        assert_eq!(of(&["x (g)", "y (V)"]).scales_m_s2, None);
    }

    #[test]
    fn comments_count_where_no_name_has_a_unit() {
        let names = ["x".to_owned(), "y".to_owned()];
        for (comment, m_s2) in [
            ("# unit: g", Some(G)),
            ("# Units = m/s^2", Some(1.0)),
            ("# units: s, mg, mg", Some(1e-3 * G)),
            ("# acceleration in mm/s²", Some(1e-3)),
            ("# sensitivity: 256 LSB/g", Some(G / 256.0)),
            ("# unit: V\n# sensitivity: 100 mV/g", Some(G / 0.1)),
            ("# made in g-code", None),
            ("# range: 16 g", None),
        ] {
            let found = stated(&names, comment).scales_m_s2;
            assert_eq!(found, m_s2.map(|m_s2| vec![m_s2; 2]), "{comment}");
        }
        let late = format!("{} 256 LSB/g", "1 ".repeat(1 << 15));
        assert_eq!(Sensitivity::found_in(&late), None);
        let named = ["x (mg)".to_owned()];
        let found = stated(&named, "# unit: g").scales_m_s2;
        assert_eq!(found, Some(vec![1e-3 * G]));
    }

    #[test]
    fn options_take_numbers_and_units() {
        for (text, m_s2) in [
            ("98.1", 98.1),
            ("g", G),
            ("mm/s^2", 1e-3),
            ("g/4096", G / 4096.0),
            ("5 g", 5.0 * G),
            ("0.5m/s²", 0.5),
        ] {
            assert_eq!(scale(text), Ok(m_s2));
        }
        for text in ["0", "-1", "V", "counts", "deg/s", "nonsense", "g/0", "inf"] {
            assert!(scale(text).is_err(), "{text}");
        }
    }
}
