//! File names that state what was recorded: texture, speed, force and take.

use std::path::{Path, PathBuf};
use std::str::FromStr;

use regex_lite::{Regex, escape};
use stylus_support::files;
use stylus_support::names::portable;
use stylus_support::{Error, Result};

use super::kind::{Kind, remedy};
use super::set::TRIALS_FILE;

/// A number in a name, such as 50 or 0.35.
const NUMBER: &str = r"([0-9]+(?:\.[0-9]+)?)";

/// Largest number of placeholders in a pattern, and largest length of a pattern, bytes. The time of a match grows with
/// both.
const MOST_PLACEHOLDERS: usize = 32;
const LONGEST: usize = 4096;

/// A text in a name, matched as short as possible.
const TEXT: &str = "([^/]+?)";

/// The meaning of a placeholder.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Field {
    Texture,
    /// The number multiplied by this factor is in mm/s.
    Speed(f64),
    /// The number multiplied by this factor is in newtons.
    Force(f64),
    Take,
    Any,
}

/// A pattern of file paths in a folder. The placeholders are `{texture}`, `{speed}`, `{force}` and `{take}`, each at
/// most once, and `{*}` for any text. `{force*0.001}` multiplies the number, here to convert millinewtons to newtons.
#[derive(Clone, Debug)]
pub struct Pattern {
    text: String,
    regex: Regex,
    fields: Vec<Field>,
}

/// A file, with everything that its name states.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Named {
    /// The file, relative to the folder.
    pub file: PathBuf,
    /// Name of the texture.
    pub texture: Option<String>,
    /// Tangential speed, mm/s.
    pub speed_mm_s: Option<f64>,
    /// Normal force, N.
    pub force_n: Option<f64>,
    /// Name of the take.
    pub take: Option<String>,
}

impl FromStr for Pattern {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<Self, String> {
        let placeholders = text.matches('{').count();
        if placeholders > MOST_PLACEHOLDERS || text.len() > LONGEST {
            return Err(format!(
                "has {placeholders} placeholders in {} bytes: give at most {MOST_PLACEHOLDERS} in {LONGEST} bytes",
                text.len()
            ));
        }
        let (mut expression, mut fields) = (String::from("^"), Vec::new());
        let mut rest = text;
        while let Some((literal, after)) = rest.split_once('{') {
            let (inside, after) = after
                .split_once('}')
                .ok_or_else(|| format!("'{{{after}' has no '}}'"))?;
            let field = field(inside)?;
            // `{speed}` and `{speed*10}` are the same placeholder.
            let is_same = |other: &Field| std::mem::discriminant(other) == std::mem::discriminant(&field);
            if field != Field::Any && fields.iter().any(is_same) {
                return Err(format!("{{{inside}}} stands twice"));
            }
            expression += &escape(literal);
            expression += match field {
                Field::Speed(_) | Field::Force(_) => NUMBER,
                Field::Texture | Field::Take => TEXT,
                Field::Any => "([^/]*?)",
            };
            fields.push(field);
            rest = after;
        }
        expression += &escape(rest);
        expression.push('$');
        let regex = Regex::new(&expression).map_err(|fault| fault.to_string())?;
        let text = text.to_owned();
        Ok(Self { text, regex, fields })
    }
}

/// Returns the field for a placeholder, given without its braces.
fn field(inside: &str) -> std::result::Result<Field, String> {
    let (name, factor) = match inside.split_once('*') {
        Some((name, factor)) if !name.is_empty() => (name, Some(factor)),
        _ => (inside, None),
    };
    let number = factor
        .map_or(Ok(1.0), str::parse::<f64>)
        .ok()
        .filter(|n| n.is_finite() && *n > 0.0);
    match (name, number, factor) {
        ("speed", Some(factor), _) => Ok(Field::Speed(factor)),
        ("force", Some(factor), _) => Ok(Field::Force(factor)),
        ("texture", _, None) => Ok(Field::Texture),
        ("take", _, None) => Ok(Field::Take),
        ("*", _, None) => Ok(Field::Any),
        _ => Err(format!(
            "{{{inside}}} is none of {{texture}}, {{speed}} in mm/s, {{force}} in N, {{take}} and {{*}}; \
             {{force*0.001}} takes millinewtons"
        )),
    }
}

impl Pattern {
    /// Reads the path of a file relative to the folder, with '/' between its parts; `None` if it does not match.
    pub fn told(&self, path: &str) -> Option<Named> {
        let found = self.regex.captures(path)?;
        let mut named = Named {
            file: PathBuf::from(path),
            ..Named::default()
        };
        for (index, field) in self.fields.iter().enumerate() {
            let text = found.get(index + 1)?.as_str();
            let number = |factor: f64| Some(text.parse::<f64>().ok()? * factor);
            match *field {
                Field::Texture => named.texture = Some(text.to_owned()),
                Field::Take => named.take = Some(text.to_owned()),
                Field::Speed(factor) => named.speed_mm_s = number(factor),
                Field::Force(factor) => named.force_n = number(factor),
                Field::Any => {}
            }
        }
        Some(named)
    }

    /// Reads the names of all recordings in `folder` and its subfolders, in sorted order. Returns the information from
    /// those that match, and the paths of the others, for display. A name that is not UTF-8 does not match, because no
    /// list can contain it.
    pub fn read(&self, folder: &Path) -> Result<(Vec<Named>, Vec<String>)> {
        let mut paths = Vec::new();
        collect(folder, Path::new(""), &mut paths)?;
        // A folder lists its files in no fixed order.
        paths.sort_by(|one, other| one.as_os_str().cmp(other.as_os_str()));
        let (mut named, mut others) = (Vec::new(), Vec::new());
        for path in paths {
            match path.to_str().and_then(|_| self.told(&portable(&path))) {
                Some(told) => named.push(told),
                None => others.push(path.to_string_lossy().into_owned()),
            }
        }
        if named.is_empty() {
            let found = others.first().map_or_else(
                || "it has no WAV file and no table".to_owned(),
                |first| format!("the first of {} is '{first}'", others.len()),
            );
            let remedy = remedy(&found).map_or(String::new(), |words| format!("; {words}"));
            let problem = format!("has no recording that matches '{}': {found}{remedy}", self.text);
            return Err(Error::file(folder, problem));
        }
        Ok((named, others))
    }
}

/// Adds the recordings in `folder` and its subfolders. `above` is the path of `folder` relative to the top folder.
fn collect(folder: &Path, above: &Path, paths: &mut Vec<PathBuf>) -> Result<()> {
    for entry in files::entries(folder).map_err(Error::io("read", folder))? {
        let entry = entry.map_err(Error::io("read", folder))?;
        let path = above.join(&entry.name);
        // A link to a folder is not a folder here, so that links cannot lead in a circle.
        if entry.is_dir {
            collect(&folder.join(&entry.name), &path, paths)?;
            continue;
        }
        // A Mac writes such a file beside each on a card.
        let is_shadow = entry.name.to_string_lossy().starts_with("._");
        if Kind::of(&path).is_some() && !is_shadow && entry.name != TRIALS_FILE {
            paths.push(path);
        }
    }
    Ok(())
}

/// Returns a pattern for file `names` without extensions that differ in exactly one number, with `{speed}` in place of
/// this number; `None` if they differ otherwise.
pub fn one_number(names: &[&str]) -> Option<String> {
    let number = Regex::new(NUMBER).ok()?;
    let split = |name: &str| -> (Vec<String>, Vec<String>) {
        let mut end = 0;
        let (mut texts, mut numbers) = (Vec::new(), Vec::new());
        for found in number.find_iter(name) {
            texts.push(name[end..found.start()].to_owned());
            numbers.push(found.as_str().to_owned());
            end = found.end();
        }
        texts.push(name[end..].to_owned());
        (texts, numbers)
    };
    let (first, rest) = names.split_first()?;
    let (texts, numbers) = split(first);
    let mut place = None;
    for (other_texts, other_numbers) in rest.iter().map(|name| split(name)) {
        let differ: Vec<usize> = (0..numbers.len())
            .filter(|&index| numbers.get(index) != other_numbers.get(index))
            .collect();
        let [index] = differ[..] else { return None };
        if other_texts != texts || place.is_some_and(|known| known != index) {
            return None;
        }
        place = Some(index);
    }
    let mut numbers = numbers;
    // A single name, or equal names, differ in no number.
    "{speed}".clone_into(&mut numbers[place?]);
    let numbers = numbers.iter().map(String::as_str).chain([""]);
    let pieces = texts.iter().map(String::as_str).zip(numbers);
    Some(pieces.flat_map(|(text, number)| [text, number]).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pattern(text: &str) -> Pattern {
        text.parse().unwrap()
    }

    #[test]
    fn names_of_laboratories_are_understood() {
        let told = |text: &str, path: &str| {
            let named = pattern(text).told(path)?;
            Some((
                named.texture.unwrap_or_default(),
                named.speed_mm_s?,
                named.force_n.unwrap_or(-1.0),
                named.take.unwrap_or_default(),
            ))
        };
        let found = |texture: &str, speed, force, take: &str| Some((texture.to_owned(), speed, force, take.to_owned()));
        let usual = "{texture}_{speed}mms_{force}N_{take}.wav";
        assert_eq!(told(usual, "denim_50mms_0.35N_2.wav"), found("denim", 50.0, 0.35, "2"));
        assert_eq!(
            told(usual, "wet_denim-2_50mms_1N_b.wav"),
            found("wet_denim-2", 50.0, 1.0, "b")
        );
        assert_eq!(told(usual, "denim_50mm_1N_2.wav"), None);
        assert_eq!(told(usual, "denim_50mms_1N_2.wav.bak"), None);
        let cluster = "accel/{texture}/{*}_{speed}_{force*0.001}_{take}.csv";
        assert_eq!(told(cluster, "accel/17/17_N_40_500_1.csv"), found("17", 40.0, 0.5, "1"));
        assert_eq!(told("a (x) {speed*10}.wav", "a (x) 2.5.wav"), found("", 25.0, -1.0, ""));
        assert_eq!(
            told("{texture}_{speed}.wav", "deep/er_50.wav"),
            None,
            "no part of a path"
        );
    }

    #[test]
    fn placeholders_that_there_are_not_are_refused_with_those_that_there_are() {
        for text in [
            "{sped}",
            "{speed",
            "{speed}{speed}",
            "{speed*x}",
            "{texture*2}",
            "{force*0}",
            "{}",
        ] {
            let problem = text.parse::<Pattern>().unwrap_err();
            assert!(problem.contains('{'), "{text}: {problem}");
        }
    }

    /// The time of a match is proportional to the length of the pattern times the length of the path. A match that
    /// tried all places of the placeholders would never end.
    #[test]
    fn a_pattern_is_bounded_and_a_match_of_its_longest_ends() {
        for text in [
            "{*}".repeat(MOST_PLACEHOLDERS + 1),
            "{*}".repeat(30_000),
            "a".repeat(LONGEST + 1),
        ] {
            let problem = text.parse::<Pattern>().unwrap_err();
            assert!(problem.contains("at most 32 in 4096 bytes"), "{problem}");
        }
        let most = pattern(&format!("{}x.wav", "{*}".repeat(MOST_PLACEHOLDERS)));
        assert_eq!(most.told(&"a".repeat(255)), None);
    }

    #[test]
    fn names_that_differ_by_one_number_are_found() {
        assert_eq!(one_number(&["a_50", "a_100", "a_5.5"]).as_deref(), Some("a_{speed}"));
        assert_eq!(one_number(&["v2 50 x", "v2 60 x"]).as_deref(), Some("v2 {speed} x"));
        for names in [
            &["a_50"][..],
            &["a", "b"],
            &["a_50", "b_50"],
            &["a_1_2", "a_2_3"],
            &["a1", "a2", "b1"],
            &["a", "a"],
        ] {
            assert_eq!(one_number(names), None, "{names:?}");
        }
    }
}
