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

/// Least number of characters to insert, remove or replace that makes one name of the other, whatever their case
/// (Levenshtein's distance).
fn distance(one: &str, other: &str) -> usize {
    let other: Vec<char> = other.to_lowercase().chars().collect();
    let mut row: Vec<usize> = (0..=other.len()).collect();
    for (index, letter) in one.to_lowercase().chars().enumerate() {
        let mut diagonal = index;
        row[0] = index + 1;
        for (column, &theirs) in other.iter().enumerate() {
            let replaced = diagonal + usize::from(letter != theirs);
            diagonal = row[column + 1];
            row[column + 1] = replaced.min(row[column] + 1).min(diagonal + 1);
        }
    }
    row.last().copied().unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn the_distance_is_a_metric(names in prop::array::uniform3("[a-d]{0,7}")) {
            let [a, b, c] = &names;
            prop_assert_eq!(distance(a, b), distance(b, a));
            prop_assert_eq!(distance(a, b) == 0, a == b);
            prop_assert!(distance(a, c) <= distance(a, b) + distance(b, c));
            prop_assert!(distance(a, b) >= a.len().abs_diff(b.len()));
        }
    }

    #[test]
    fn of_many_names_the_nearest_are_listed_and_the_rest_counted() {
        let there: Vec<String> = (0..30).map(|n| format!("texture {n}")).collect();
        let told = listed("Texture 17", &there);
        assert!(told.starts_with("texture 17, "), "{told}");
        assert!(told.ends_with(" and 18 more"), "{told}");
    }
}
