//! Names in the order of their likeness to one that was given, for messages about a name that is not there.

/// Most names that a message lists.
const MOST_LISTED: usize = 12;

/// The names of `there` in words, those first that are most like `wanted`; names equally like it keep their order.
///
/// ```
/// use host_tools::support::nearest::listed;
/// assert_eq!(listed("papr", &["organza".to_owned(), "paper".to_owned()]), "paper, organza");
/// assert_eq!(listed("papr", &[]), "none");
/// ```
pub fn listed(wanted: &str, there: &[String]) -> String {
    if there.is_empty() {
        return "none".to_owned();
    }
    let mut names: Vec<&str> = there.iter().map(String::as_str).collect();
    names.sort_by_cached_key(|name| distance(wanted, name));
    let more = names.len().saturating_sub(MOST_LISTED);
    names.truncate(MOST_LISTED);
    let names = names.join(", ");
    match more {
        0 => names,
        more => format!("{names} and {more} more"),
    }
}

/// Edits that make one name of the other, whatever their case.
fn distance(one: &str, other: &str) -> usize {
    strsim::levenshtein(&one.to_lowercase(), &other.to_lowercase())
}

#[cfg(test)]
mod tests {
    use super::*;
    #[test]
    fn of_many_names_the_nearest_are_listed_and_the_rest_counted() {
        let there: Vec<String> = (0..30).map(|n| format!("texture {n}")).collect();
        let told = listed("Texture 17", &there);
        assert!(told.starts_with("texture 17, "), "{told}");
        assert!(told.ends_with(" and 18 more"), "{told}");
    }
}
