//! Tables of results, as commands print them and pages show them.

/// A table with a title and a heading for each column.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Table {
    /// The subject of the table.
    pub title: String,
    /// Headings, numbers with their units.
    pub headings: Vec<String>,
    /// Cells, row by row.
    pub rows: Vec<Vec<String>>,
}

impl Table {
    /// A table of `rows`.
    pub fn new<H: Into<String>>(
        title: &str,
        headings: impl IntoIterator<Item = H>,
        rows: impl IntoIterator<Item = Vec<String>>,
    ) -> Self {
        Self {
            title: title.to_owned(),
            headings: headings.into_iter().map(Into::into).collect(),
            rows: rows.into_iter().collect(),
        }
    }

    /// Creates a table from rows of headings and cells. Without a row it has no headings.
    pub fn headed<H: Into<String>>(title: &str, rows: impl IntoIterator<Item = Vec<(H, String)>>) -> Self {
        let mut headings = Vec::new();
        let rows = rows.into_iter().map(|row| {
            let (own, cells) = row.into_iter().unzip();
            headings = own;
            cells
        });
        // The rows are collected before the headings are read, because that sets the headings.
        let rows: Vec<Vec<String>> = rows.collect();
        Self::new(title, headings, rows)
    }

    /// Returns whether all filled cells of a column begin with a digit or a sign.
    pub fn is_of_numbers(&self, column: usize) -> bool {
        let mut filled = self
            .rows
            .iter()
            .filter_map(|row| row.get(column))
            .filter(|cell| !cell.is_empty());
        filled.all(|cell| cell.starts_with(|c: char| c.is_ascii_digit() || "+-".contains(c)))
    }
}

/// Returns a number with this number of decimals, or a dash.
pub fn number(value: Option<f64>, decimals: usize) -> String {
    value.map_or("-".into(), |value| stylus_support::number::fixed(value, decimals))
}

/// Returns a fraction in per cent with this number of decimals, or a dash. The heading has the per cent sign.
pub fn percent(share: Option<f64>, decimals: usize) -> String {
    number(share.map(|share| 100.0 * share), decimals)
}
