//! Names: safe ones for files, on every system, from any names; and names ordered by similarity to a given one, for
//! messages about a name that does not exist.
//!
//! Systems differ. Some treat upper and lower case as the same. Some treat a letter with an accent as the same as the
//! two characters that compose it. Some reserve words such as NUL for devices, and some drop a dot at the end of a
//! name.

use std::collections::{HashMap, HashSet};
use std::path::{MAIN_SEPARATOR, Path};

/// Largest number of characters of a stem that [`Stems`] returns, without a `_` put before it or a number put after.
const MOST_CHARACTERS: usize = 64;

/// Names of devices on Windows, with any extension and in any case. COM and LPT followed by a digit are devices too.
const DEVICES: [&str; 4] = ["con", "prn", "aux", "nul"];

/// Returns `path` with `/` between folders on every system, so that files that contain the path are the same
/// everywhere.
pub fn portable(path: &Path) -> String {
    path.display().to_string().replace(MAIN_SEPARATOR, "/")
}

/// File name stems for things with any names. They are safe on every system, and different for different things.
#[derive(Debug, Default)]
pub struct Stems {
    given: HashMap<String, String>,
    /// The returned stems in lower case.
    taken: HashSet<String>,
}

impl Stems {
    /// Returns the stem for `name`, which is the same in every call. A name of 1 to 64 ASCII letters, digits, `-` and
    /// `_` is its own stem. Exceptions are names that begin with `-`, like options of programs; names of Windows'
    /// devices; and names that differ from an earlier stem only in case, or not at all.
    pub fn of(&mut self, name: &str) -> String {
        if let Some(stem) = self.given.get(name) {
            return stem.clone();
        }
        let safe = safe(name);
        let mut stem = safe.clone();
        let mut number = 2;
        // Some systems treat names that differ only in case as the same.
        while !self.taken.insert(stem.to_ascii_lowercase()) {
            stem = format!("{safe}-{number}");
            number += 1;
        }
        self.given.insert(name.to_owned(), stem.clone());
        stem
    }
}

fn safe(name: &str) -> String {
    let kept = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
    let stem: String = name
        .chars()
        .take(MOST_CHARACTERS)
        .map(|c| if kept(c) { c } else { '_' })
        .collect();
    if stem.is_empty() || stem.starts_with('-') || is_device(&stem) {
        format!("_{stem}")
    } else {
        stem
    }
}

/// Returns the reason why `name` cannot be the name of a file or folder on every system, if there is one.
pub fn fault(name: &str) -> Option<&'static str> {
    if name.is_empty() {
        return Some("must not be empty");
    }
    if name.contains(|c: char| c.is_control() || r#"/\:*?"<>|"#.contains(c)) {
        return Some("must have no path separators, control characters or : * ? \" < > |");
    }
    if name.contains(|c: char| ('\u{300}'..='\u{36f}').contains(&c)) {
        return Some("has an accent as a character of its own: write the letter and its accent as one");
    }
    if name.ends_with(['.', ' ']) {
        return Some("must not end with a dot or a space");
    }
    if is_device(name) {
        return Some("is the name of a device on some systems");
    }
    None
}

/// Returns a form of `name` that is the same for names that some system treats as equal.
pub fn folded(name: &str) -> String {
    name.to_lowercase()
}

fn is_device(name: &str) -> bool {
    // Windows ignores what follows the first dot, and spaces before it.
    let before = name.split('.').next().unwrap_or(name).trim_end();
    let word = before.to_ascii_lowercase();
    let numbered = |word: &str| {
        word.strip_prefix("com")
            .or(word.strip_prefix("lpt"))
            .is_some_and(|rest| rest.len() == 1 && rest.as_bytes()[0].is_ascii_digit())
    };
    DEVICES.contains(&word.as_str()) || numbered(&word)
}

/// Largest number of names that a message lists.
const MOST_LISTED: usize = 12;

/// Number of letters of a name per edit that is allowed between similar names.
const ALIKE_LETTERS: usize = 3;

/// Returns the names in `there` as text, ordered by similarity to `wanted`. If one is similar enough, a question
/// suggests it. Equally similar names keep their order.
///
/// ```
/// use stylus_support::names::listed;
/// let there = ["organza", "paper"].map(str::to_owned);
/// assert_eq!(listed("papr", &there), "paper, organza; did you mean 'paper'?");
/// assert_eq!(listed("silk", &there), "paper, organza");
/// assert_eq!(listed("papr", &[""; 0]), "none");
/// ```
pub fn listed<T: AsRef<str>>(wanted: &str, there: &[T]) -> String {
    if there.is_empty() {
        return "none".to_owned();
    }
    let mut names: Vec<&str> = there.iter().map(AsRef::as_ref).collect();
    names.sort_by_cached_key(|name| distance(wanted, name));
    let more = names.len().saturating_sub(MOST_LISTED);
    names.truncate(MOST_LISTED);
    let mut text = names.join(", ");
    if more > 0 {
        text += &format!(" and {more} more");
    }
    match nearly(wanted, there) {
        Some(name) => format!("{text}; did you mean '{name}'?"),
        None => text,
    }
}

/// Returns the name in `there` that is most similar to `wanted`, if it is similar enough. Case is ignored.
pub fn nearly<'a, T: AsRef<str>>(wanted: &str, there: &'a [T]) -> Option<&'a str> {
    let nearest = there
        .iter()
        .map(AsRef::as_ref)
        .min_by_key(|name| distance(wanted, name))?;
    // By the longer name, so that a letter left out counts like one too many.
    let letters = wanted.chars().count().max(nearest.chars().count());
    (distance(wanted, nearest) <= letters / ALIKE_LETTERS).then_some(nearest)
}

/// Returns the number of edits between two names. Case is ignored.
fn distance(one: &str, other: &str) -> usize {
    strsim::levenshtein(&one.to_lowercase(), &other.to_lowercase())
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use test_helpers::holds;

    use super::*;

    #[test]
    fn names_that_some_system_takes_for_the_same_get_different_stems() {
        let mut stems = Stems::default();
        let names = [
            "a_b",
            "a/b",
            "a b",
            "A_B",
            "grün",
            "gru\u{308}n",
            "GRÜN",
            "",
            ".",
            "..",
            "NUL",
            "nul",
            "con.txt",
            "x.",
            "x",
            "a_b-2",
            "-rf",
        ];
        let given: Vec<String> = names.iter().map(|name| stems.of(name)).collect();
        let different: HashSet<String> = given.iter().map(|stem| stem.to_lowercase()).collect();
        assert_eq!(different.len(), names.len(), "{given:?}");
        assert_eq!(given[0], "a_b");
        assert_eq!(given.last().unwrap(), "_-rf");
        assert_eq!(stems.of("a/b"), given[1]);
    }

    #[test]
    fn names_of_devices_and_endings_that_are_dropped_name_no_folder() {
        for name in [
            "", "NUL", "con", "Com1.txt", "lpt9", "aux .x", "x.", "x ", "a/b", "a\\b", "C:", "a\nb", "e\u{301}",
        ] {
            assert!(fault(name).is_some(), "{name:?}");
        }
        for name in ["denim", "null", "com", "com10", "lpt", "é", "denim (worn)", ".hidden"] {
            assert_eq!(fault(name), None, "{name:?}");
        }
    }

    proptest! {
        #[test]
        fn stems_are_short_safe_and_different(names in prop::collection::hash_set("\\PC{0,200}|[aA_/ ]{0,3}", 1..40)) {
            let mut stems = Stems::default();
            let given: Vec<String> = names.iter().map(|name| stems.of(name)).collect();
            for stem in &given {
                prop_assert_eq!(fault(stem), None);
                prop_assert!(stem.len() <= MOST_CHARACTERS + 4 && stem.is_ascii());
            }
            let different: HashSet<String> = given.iter().map(|stem| stem.to_lowercase()).collect();
            prop_assert_eq!(different.len(), given.len());
        }
    }

    #[test]
    fn of_many_names_the_nearest_are_listed_and_the_rest_counted() {
        let there: Vec<String> = (0..30).map(|n| format!("texture {n}")).collect();
        let told = listed("Texture 17", &there);
        assert!(told.starts_with("texture 17, "), "{told}");
        holds(&told, &[" and 18 more; did you mean 'texture 17'?"]);
    }

    #[test]
    fn a_slip_is_nearly_the_name_and_another_word_is_not() {
        let there = ["denim", "scratched", "a"];
        for (wanted, name) in [
            ("denin", Some("denim")),
            ("DENIM", Some("denim")),
            ("scrathced", Some("scratched")),
            ("linen", None),
            ("b", None),
            ("", None),
        ] {
            assert_eq!(nearly(wanted, &there), name, "{wanted}");
        }
    }
}
