//! The data of pictures as files: a CSV file for each picture, and all of them in one `figures.npz` for NumPy, with
//! `figures.json` as its contents.
//!
//! Values are those that the pictures are drawn from, whole and unrounded: a picture is made from its
//! [`Figure`], and so are these files.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use serde::Serialize;

use super::npz::NpzWriter;
use super::plot::figure::{AxisData, AxisScale, Kind, Panel, Series};
use super::plot::{Figure, Svg};
use crate::support::atomic_file;
use crate::support::error::{Error, Result};

/// Name of the file of arrays.
const ARRAYS: &str = "figures.npz";

/// Name of the file that says what the arrays are.
const CONTENTS: &str = "figures.json";

/// A folder that takes the data of pictures.
pub struct Folder {
    path: PathBuf,
    arrays: NpzWriter,
    contents: Vec<Entry>,
    names: BTreeSet<String>,
}

/// A picture in the contents.
#[derive(Serialize)]
struct Entry {
    name: String,
    title: String,
    simulated: bool,
    csv: String,
    panels: Vec<PanelEntry>,
}

/// A pair of axes in the contents.
#[derive(Serialize)]
struct PanelEntry {
    name: String,
    x: AxisData,
    y: AxisData,
    series: Vec<SeriesEntry>,
}

/// A series in the contents, with the names of its arrays.
#[derive(Serialize)]
struct SeriesEntry {
    name: String,
    kind: Kind,
    x: String,
    y: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    z: Option<ThirdEntry>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    notes: Vec<String>,
}

/// A third quantity in the contents.
#[derive(Serialize)]
struct ThirdEntry {
    array: String,
    quantity: String,
    unit: String,
}

impl Folder {
    /// Begins the files in `path`, which is made if it is not there.
    ///
    /// # Errors
    /// A folder that cannot be made or written to.
    pub fn new(path: &Path) -> Result<Self> {
        std::fs::create_dir_all(path).map_err(Error::io("create", path))?;
        Ok(Self {
            path: path.to_owned(),
            arrays: NpzWriter::create(&path.join(ARRAYS))?,
            contents: Vec::new(),
            names: BTreeSet::new(),
        })
    }

    /// Writes the data of a picture as `NAME.csv`, and its arrays as `NAME.PANEL.SERIES.x`, `y` and `z`.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn add(&mut self, name: &str, picture: &Svg) -> Result<()> {
        self.add_figure(name, picture.figure())
    }

    /// As [`Self::add`], of a picture that a page's script draws.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn add_figure(&mut self, name: &str, figure: &Figure) -> Result<()> {
        let csv = format!("{name}.csv");
        atomic_file::write(&self.path.join(&csv), csv_of(figure).as_bytes())?;
        let mut panels = Vec::new();
        for panel in &figure.panels {
            let mut series = Vec::new();
            for one in &panel.series {
                series.push(self.add_series(name, panel, one)?);
            }
            panels.push(PanelEntry {
                name: panel.name.clone(),
                x: panel.x.clone(),
                y: panel.y.clone(),
                series,
            });
        }
        self.contents.push(Entry {
            name: name.to_owned(),
            title: figure.title.clone(),
            simulated: figure.simulated,
            csv,
            panels,
        });
        Ok(())
    }

    /// Writes the contents, and ends the arrays.
    ///
    /// # Errors
    /// A file that cannot be written.
    pub fn finish(self) -> Result<()> {
        self.arrays.finish()?;
        let mut text = serde_json::to_string_pretty(&self.contents).expect("plain data are JSON");
        text.push('\n');
        atomic_file::write(&self.path.join(CONTENTS), text.as_bytes())
    }

    fn add_series(&mut self, figure: &str, panel: &Panel, series: &Series) -> Result<SeriesEntry> {
        let words = [&panel.name, &series.name].map(|name| slug(name));
        let words: Vec<&str> = words.iter().map(String::as_str).collect();
        let named: Vec<&str> = words.into_iter().filter(|word| !word.is_empty()).collect();
        let mut stem = std::iter::once(figure)
            .chain(named)
            .collect::<Vec<_>>()
            .join(".");
        let first = stem.clone();
        for number in 2.. {
            if self.names.insert(stem.clone()) {
                break;
            }
            stem = format!("{first}-{number}");
        }
        let [x, y] = axis_values(panel, series);
        let names = ["x", "y"].map(|axis| format!("{stem}.{axis}"));
        self.arrays.add(&names[0], &[x.len()], &x)?;
        self.arrays.add(&names[1], &[y.len()], &y)?;
        let mut z = None;
        if let Some(third) = &series.z {
            let array = format!("{stem}.z");
            let shape = match series.kind {
                Kind::Cells | Kind::Levels => vec![x.len(), y.len()],
                Kind::Line | Kind::Points | Kind::Bars => vec![third.values.len()],
            };
            self.arrays.add(&array, &shape, &third.values)?;
            z = Some(ThirdEntry {
                array,
                quantity: third.quantity.clone(),
                unit: third.unit.clone(),
            });
        }
        let [x, y] = names;
        Ok(SeriesEntry {
            name: series.name.clone(),
            kind: series.kind,
            x,
            y,
            z,
            notes: series.notes.clone(),
        })
    }
}

/// The values of both axes: of cells those of the axes themselves, each once.
fn axis_values(panel: &Panel, series: &Series) -> [Vec<f64>; 2] {
    let numbers = |axis: &AxisData, values: &[f64]| -> Vec<f64> {
        let number = |value: &f64| match axis.scale {
            AxisScale::Names => axis.written(*value).parse().unwrap_or(*value),
            AxisScale::Linear | AxisScale::Log => *value,
        };
        values.iter().map(number).collect()
    };
    if series.kind == Kind::Cells {
        let positions = |axis: &AxisData| {
            (0..axis.names.len())
                .map(|n| n as f64)
                .collect::<Vec<f64>>()
        };
        let values = |axis| numbers(axis, &positions(axis));
        return [values(&panel.x), values(&panel.y)];
    }
    [numbers(&panel.x, &series.x), numbers(&panel.y, &series.y)]
}

/// A column of a file.
struct Column {
    heading: String,
    cells: Vec<String>,
}

/// The columns of a picture side by side, each under its quantity and unit; shorter ones end with empty cells. The
/// last column says SIMULATED or recorded.
fn csv_of(figure: &Figure) -> String {
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
    let headings = columns.iter().map(|column| quoted(&column.heading));
    let mut text = headings
        .chain(["origin".to_owned()])
        .collect::<Vec<_>>()
        .join(",");
    text.push('\n');
    for row in 0..rows {
        for column in &columns {
            text.push_str(column.cells.get(row).map_or("", String::as_str));
            text.push(',');
        }
        text.push_str(origin);
        text.push('\n');
    }
    text
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
        values.map(|value| quoted(&written(axis, value))).collect()
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
        let notes = series.notes.iter().map(|note| quoted(note));
        add(heading("note", ""), notes.collect());
    }
}

fn written(axis: &AxisData, value: f64) -> String {
    match axis.scale {
        AxisScale::Names => axis.written(value),
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

/// A field of a CSV file (RFC 4180).
fn quoted(text: &str) -> String {
    if text.contains([',', '"', '\n', '\r']) {
        format!("\"{}\"", text.replace('"', "\"\""))
    } else {
        text.to_owned()
    }
}

/// Letters and digits of `text`, with one underscore for all between them.
fn slug(text: &str) -> String {
    let words = text.split(|c: char| !c.is_alphanumeric());
    let words: Vec<&str> = words.filter(|word| !word.is_empty()).collect();
    words.join("_").to_lowercase()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::plot::properties::pictures;

    /// A CSV file as columns by heading, read by the csv crate, which did not write it.
    fn columns(text: &str) -> Vec<(String, Vec<String>)> {
        let mut reader = csv::Reader::from_reader(text.as_bytes());
        let headings: Vec<String> = reader
            .headers()
            .unwrap()
            .iter()
            .map(str::to_owned)
            .collect();
        let mut columns: Vec<(String, Vec<String>)> = headings
            .into_iter()
            .map(|heading| (heading, Vec::new()))
            .collect();
        for record in reader.records() {
            for (column, cell) in columns.iter_mut().zip(&record.unwrap()) {
                column.1.push(cell.to_owned());
            }
        }
        columns
    }

    #[test]
    fn every_column_has_a_name_of_its_own_with_its_unit_and_says_where_it_is_from() {
        for (name, picture) in pictures() {
            let columns = columns(&csv_of(picture.figure()));
            assert!(columns.len() >= 3, "{name}");
            let headings: BTreeSet<&String> = columns.iter().map(|column| &column.0).collect();
            assert_eq!(headings.len(), columns.len(), "{name}: {headings:?}");
            let (last, origins) = columns.last().unwrap();
            assert_eq!(last, "origin", "{name}");
            assert!(origins.iter().all(|origin| origin == "SIMULATED"), "{name}");
        }
    }

    #[test]
    fn a_file_has_every_value_of_its_picture_to_the_last_bit() {
        for (name, picture) in pictures() {
            let columns = columns(&csv_of(picture.figure()));
            for panel in &picture.figure().panels {
                for series in &panel.series {
                    let values = series.z.as_ref().map_or(&series.y, |third| &third.values);
                    let is_same = |cells: &Vec<String>| {
                        let read = cells.iter().map(|cell| cell.parse::<f64>().ok());
                        let read: Vec<Option<f64>> = read.take(values.len()).collect();
                        let own = values
                            .iter()
                            .map(|value| Some(*value).filter(|v| v.is_finite()));
                        read == own.collect::<Vec<Option<f64>>>()
                    };
                    assert!(
                        columns.iter().any(|column| is_same(&column.1)),
                        "{name}, {}, {}",
                        panel.name,
                        series.name
                    );
                }
            }
        }
    }

    #[test]
    fn names_with_commas_and_quotes_are_read_as_they_are() {
        for text in ["plain", "a, b", "a \"b\"", "two\nlines", ""] {
            let file = format!("heading,last\n{},x\n", quoted(text));
            assert_eq!(columns(&file)[0].1[0], text);
        }
    }
}
