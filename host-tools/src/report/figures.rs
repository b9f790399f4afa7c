//! The data of a picture as a CSV file.
//!
//! Values are those that the picture is drawn from, whole and unrounded: a picture is made from its [`Figure`], and so
//! is the file.

use std::collections::BTreeSet;
use std::path::Path;

use super::plot::Figure;
use super::plot::figure::{AxisData, AxisScale, Kind, Panel, Series};
use crate::support::atomic_file;
use crate::support::error::Result;

/// Writes the data of a picture.
///
/// # Errors
/// A file that cannot be written.
pub fn write(figure: &Figure, path: &Path) -> Result<()> {
    atomic_file::write(path, &csv_of(figure))
}

/// A column of a file.
struct Column {
    heading: String,
    cells: Vec<String>,
}

/// The columns of a picture side by side, each under its quantity and unit; shorter ones end with empty cells. The
/// last column says SIMULATED or recorded.
fn csv_of(figure: &Figure) -> Vec<u8> {
    let mut columns = Vec::new();
    for panel in &figure.panels {
        let mut before: Option<&Series> = None;
        for series in &panel.series {
            let shares_x = before.is_some_and(|before| before.x == series.x);
            add_columns(&mut columns, panel, series, shares_x);
            before = Some(series);
        }
    }
    // Several stretches of one curve have one name.
    let mut headings = BTreeSet::new();
    for column in &mut columns {
        let first = column.heading.clone();
        for number in 2.. {
            if headings.insert(column.heading.clone()) {
                break;
            }
            column.heading = format!("{first} {number}");
        }
    }
    let rows = columns.iter().map(|column: &Column| column.cells.len());
    let rows = rows.max().unwrap_or(0);
    let origin = if figure.simulated {
        "SIMULATED"
    } else {
        "recorded"
    };
    let mut csv = csv::Writer::from_writer(Vec::new());
    let headings = columns.iter().map(|column| column.heading.as_str());
    let mut written = csv.write_record(headings.chain(["origin"]));
    for row in 0..rows {
        let cells = columns.iter();
        let cells = cells.map(|column| column.cells.get(row).map_or("", String::as_str));
        written = written.and_then(|()| csv.write_record(cells.chain([origin])));
    }
    written.expect("rows of one length go to memory");
    csv.into_inner().expect("memory takes them")
}

fn add_columns(columns: &mut Vec<Column>, panel: &Panel, series: &Series, shares_x: bool) {
    let of = [panel.name.as_str(), series.name.as_str()];
    let of: Vec<&str> = of.into_iter().filter(|name| !name.is_empty()).collect();
    let prefix = of.join(", ");
    let heading = |quantity: &str, unit: &str| {
        let own = if unit.is_empty() {
            quantity.to_owned()
        } else {
            format!("{quantity} ({unit})")
        };
        if prefix.is_empty() {
            own
        } else {
            format!("{prefix}: {own}")
        }
    };
    let mut add = |heading: String, cells: Vec<String>| columns.push(Column { heading, cells });
    let along = |axis: &AxisData, values: &mut dyn Iterator<Item = f64>| {
        values.map(|value| written(axis, value)).collect()
    };
    let (x_heading, y_heading) = (
        heading(&panel.x.quantity, &panel.x.unit),
        heading(&panel.y.quantity, &panel.y.unit),
    );
    if series.kind == Kind::Levels {
        let (x, y) = (&series.x, &series.y);
        let mut every_x = x.iter().flat_map(|x| y.iter().map(move |_| *x));
        let mut every_y = x.iter().flat_map(|_| y.iter().copied());
        add(x_heading, along(&panel.x, &mut every_x));
        add(y_heading, along(&panel.y, &mut every_y));
    } else {
        if !shares_x {
            add(x_heading, along(&panel.x, &mut series.x.iter().copied()));
        }
        add(y_heading, along(&panel.y, &mut series.y.iter().copied()));
    }
    if let Some(third) = &series.z {
        let values = third.values.iter().map(|value| number(*value));
        add(heading(&third.quantity, &third.unit), values.collect());
    }
    if series.notes.iter().any(|note| !note.is_empty()) {
        add(heading("note", ""), series.notes.clone());
    }
}

fn written(axis: &AxisData, value: f64) -> String {
    match axis.scale {
        AxisScale::Names => {
            let name = axis.names.get(value.round().max(0.0) as usize);
            name.cloned().unwrap_or_default()
        }
        AxisScale::Linear | AxisScale::Log => number(value),
    }
}

/// A value with all its digits; nothing for none.
fn number(value: f64) -> String {
    if value.is_finite() {
        value.to_string()
    } else {
        String::new()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::plot::properties::pictures;

    #[test]
    fn a_file_has_every_value_of_its_picture_to_the_last_bit_under_a_name_of_its_own() {
        for (name, picture) in pictures() {
            let text = csv_of(picture.figure());
            let mut reader = csv::Reader::from_reader(text.as_slice());
            let headings = reader.headers().unwrap().clone();
            let distinct: BTreeSet<&str> = headings.iter().collect();
            assert_eq!(distinct.len(), headings.len(), "{name}: {headings:?}");
            let mut columns: Vec<Vec<String>> = vec![Vec::new(); headings.len()];
            for record in reader.records() {
                for (column, cell) in columns.iter_mut().zip(&record.unwrap()) {
                    column.push(cell.to_owned());
                }
            }
            let origins = columns.pop().unwrap();
            assert!(headings.iter().next_back() == Some("origin"), "{name}");
            assert!(origins.iter().all(|origin| origin == "SIMULATED"), "{name}");
            for panel in &picture.figure().panels {
                for series in &panel.series {
                    let values = series.z.as_ref().map_or(&series.y, |third| &third.values);
                    let own: Vec<Option<f64>> = values
                        .iter()
                        .map(|value| Some(*value).filter(|v| v.is_finite()))
                        .collect();
                    let is_same = |cells: &Vec<String>| {
                        let read = cells.iter().map(|cell| cell.parse::<f64>().ok());
                        read.take(own.len()).collect::<Vec<_>>() == own
                    };
                    assert!(columns.iter().any(is_same), "{name}, {}", series.name);
                }
            }
        }
    }
}
