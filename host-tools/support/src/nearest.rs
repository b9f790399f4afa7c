//! Names ordered by similarity to a given name, for messages about a name that does not exist.

/// Largest number of names that a message lists.
const MOST_LISTED: usize = 12;

/// Number of letters of a name per edit that is allowed between similar names.
const ALIKE_LETTERS: usize = 3;

/// Returns the names in `there` as text, ordered by similarity to `wanted`. If one is similar enough, a question
/// suggests it. Equally similar names keep their order.
///
/// ```
/// use stylus_support::nearest::listed;
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
    use super::*;
    use test_helpers::holds;
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
