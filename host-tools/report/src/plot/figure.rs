//! The data of a picture: the values that each pair of axes shows, with quantities and units.
//!
//! A picture is drawn from these values. It also contains a thinned copy of them, which is shown where a reader points.

use std::fmt::Write as _;

use plotters::style::RGBColor;
use serde::{Serialize, Serializer};
use stylus_support::visible::{escaped, page_json};

use super::colours::hex;

/// A rectangle parallel to the axes, in drawn pixels, x to the right and y down.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Frame {
    /// Left edge of the rectangle.
    pub left: i32,
    /// Upper edge of the rectangle.
    pub top: i32,
    /// Right edge of the rectangle.
    pub right: i32,
    /// Lower edge of the rectangle.
    pub bottom: i32,
}

/// A quantity with its unit, as it is written along an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
pub struct Quantity {
    /// The name.
    #[serde(rename = "quantity")]
    pub name: &'static str,
    /// The unit; empty for a count or a ratio.
    pub unit: &'static str,
}

/// Tangential speed.
pub const SPEED: Quantity = Quantity::new("tangential speed", "mm/s");
/// Normal force.
pub const FORCE: Quantity = Quantity::new("normal force", "N");
/// Acceleration.
pub const ACCELERATION: Quantity = Quantity::new("acceleration", "m/s²");
/// Frequency.
pub const FREQUENCY: Quantity = Quantity::new("frequency", "Hz");
/// Time in seconds.
pub const TIME_S: Quantity = Quantity::new("time", "s");
/// Time in milliseconds.
pub const TIME_MS: Quantity = Quantity::new("time", "ms");
/// The paper's cost.
pub const COST: Quantity = Quantity::new("mismatch C", "%");
/// Power spectral density.
pub const POWER_DENSITY: Quantity = Quantity::new("power spectral density", "dB re 1 (m/s²)²/Hz");

impl Quantity {
    /// Creates a quantity. The unit of a count or a ratio is empty.
    pub const fn new(name: &'static str, unit: &'static str) -> Self {
        Self { name, unit }
    }

    /// Returns name and unit in one line.
    pub fn label(&self) -> String {
        if self.unit.is_empty() {
            self.name.to_owned()
        } else {
            format!("{}, {}", self.name, self.unit)
        }
    }
}

/// One pair of axes with the data drawn in it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Panel {
    /// Name of the panel; empty if the picture has only one.
    pub name: String,
    /// The rectangle between the axes.
    pub frame: Frame,
    /// The horizontal axis.
    pub x: AxisData,
    /// The vertical axis.
    pub y: AxisData,
    /// Curves, points, cells.
    pub series: Vec<Series>,
    /// Name of the texture whose nodes a map shows, if a page can play them.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub play: Option<String>,
    /// A bitmap that fills the frame.
    #[serde(skip_serializing_if = "Option::is_none", rename = "levels")]
    pub bitmap: Option<Bitmap>,
}

/// A bitmap whose colours stand for levels.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Bitmap {
    /// The bytes of a PNG, in base64.
    #[serde(skip)]
    pub png: String,
    /// Level of the first colour of the palette.
    pub from: f64,
    /// Level of the last colour of the palette.
    pub to: f64,
    /// The palette: six hexadecimal digits per colour.
    pub palette: String,
    /// x of the first column, and the step to the next column.
    pub x: [f64; 2],
    /// y of the first row, and the step to the next row.
    pub y: [f64; 2],
}

/// One axis.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct AxisData {
    /// The quantity.
    #[serde(flatten)]
    pub quantity: Quantity,
    /// Scale by which values are placed.
    pub scale: AxisScale,
    /// Value at the left or lower end.
    pub from: f64,
    /// Value at the right or upper end.
    pub to: f64,
    /// Names at the positions 0, 1, and so on, if the scale is one of names.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub names: Vec<String>,
}

/// The scale of an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum AxisScale {
    /// Equal steps are equal differences.
    Linear,
    /// Equal steps are equal ratios.
    Log,
    /// Positions with names.
    Names,
}

/// The kind of a series.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    /// A curve with ascending x.
    Line,
    /// Points in any order.
    Points,
    /// Cells of a map, at positions along two axes of names.
    Cells,
    /// Levels. Their values are only in the bitmap.
    Levels,
}

/// Values that are drawn together.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Series {
    /// Name of the series; empty if the panel's name suffices.
    pub name: String,
    /// Kind of the series.
    pub kind: Kind,
    /// Colour of the series; `None` for cells and levels.
    #[serde(serialize_with = "as_hex")]
    pub colour: Option<RGBColor>,
    /// Values along the horizontal axis.
    pub x: Vec<f64>,
    /// Values along the vertical axis; NaN where there is no value.
    pub y: Vec<f64>,
    /// A third quantity: one value for each cell; without values for levels, which the bitmap has.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub z: Option<Third>,
    /// A text for each point or cell; empty if there are no texts.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub notes: Vec<String>,
}

/// Values of a third quantity.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Third {
    /// The quantity.
    #[serde(flatten)]
    pub quantity: Quantity,
    /// The values; NaN where there is no value.
    pub values: Vec<f64>,
}

#[expect(
    clippy::ref_option,
    clippy::trivially_copy_pass_by_ref,
    reason = "serde passes fields so"
)]
fn as_hex<S: Serializer>(colour: &Option<RGBColor>, to: S) -> Result<S::Ok, S::Error> {
    colour.map(hex).serialize(to)
}

impl AxisData {
    /// Creates an axis of equal cells, one for each name.
    pub fn of_cells(quantity: Quantity, names: Vec<String>) -> Self {
        Self {
            quantity,
            scale: AxisScale::Names,
            from: -0.5,
            to: names.len() as f64 - 0.5,
            names,
        }
    }
}

impl Panel {
    /// Creates a panel without data.
    pub fn new(name: &str, frame: Frame, x: AxisData, y: AxisData) -> Self {
        Self {
            name: name.to_owned(),
            frame,
            x,
            y,
            series: Vec::new(),
            play: None,
            bitmap: None,
        }
    }
}

impl Series {
    /// Creates a curve or points.
    pub fn new(name: &str, kind: Kind, colour: RGBColor, points: &[(f64, f64)]) -> Self {
        let (x, y) = points.iter().copied().unzip();
        Self {
            name: name.to_owned(),
            kind,
            colour: Some(colour),
            x,
            y,
            z: None,
            notes: Vec::new(),
        }
    }

    /// Creates the cells of a map. The values are column by column.
    pub fn cells(quantity: Quantity, (columns, rows): (usize, usize), values: Vec<f64>, notes: Vec<String>) -> Self {
        let (x, y) = (0..columns * rows)
            .map(|n| ((n / rows) as f64, (n % rows) as f64))
            .unzip();
        Self {
            kind: Kind::Cells,
            x,
            y,
            z: Some(Third { quantity, values }),
            notes,
            ..Self::levels(quantity)
        }
    }

    /// Creates levels whose values are in the panel's bitmap.
    pub fn levels(quantity: Quantity) -> Self {
        let values = Vec::new();
        Self {
            name: String::new(),
            kind: Kind::Levels,
            colour: None,
            x: Vec::new(),
            y: Vec::new(),
            z: Some(Third { quantity, values }),
            notes: Vec::new(),
        }
    }

    /// Returns the series as a page contains it: curves are thinned, and values have five digits.
    fn shown(&self) -> Self {
        let points = self.x.iter().copied().zip(self.y.iter().copied());
        let (x, y): (Vec<f64>, Vec<f64>) = match self.kind {
            Kind::Line => thinned(points).into_iter().unzip(),
            Kind::Points | Kind::Cells | Kind::Levels => points.unzip(),
        };
        let short = |values: &[f64]| values.iter().map(|value| short(*value)).collect();
        let has_notes = self.notes.iter().any(|note| !note.is_empty());
        Self {
            x: short(&x),
            y: short(&y),
            z: self.z.as_ref().map(|third| Third {
                values: short(&third.values),
                ..third.clone()
            }),
            notes: if has_notes { self.notes.clone() } else { Vec::new() },
            ..self.clone()
        }
    }
}

/// Returns the elements that let a reader point at a picture's values: a group for each panel, with its data as JSON.
pub fn overlay(panels: &[Panel]) -> String {
    let mut svg = String::new();
    for panel in panels {
        let shown = Panel {
            series: panel.series.iter().map(Series::shown).collect(),
            ..panel.clone()
        };
        let text = page_json(&shown);
        // Writing into a string cannot fail.
        let _ = writeln!(svg, "<g class=\"axes\" data-panel=\"{}\">", escaped(&text));
        let place = place(panel.frame);
        if let Some(Bitmap { png, .. }) = &panel.bitmap {
            // The bitmap has one pixel per window and bin, so it is stretched to the shape of the frame.
            let _ = writeln!(
                svg,
                "<image {place} preserveAspectRatio=\"none\" href=\"data:image/png;base64,{png}\"/>"
            );
        }
        // Unfilled elements receive no pointer events unless this attribute says so.
        let _ = writeln!(svg, "<rect {place} fill=\"none\" pointer-events=\"all\"/>\n</g>");
    }
    svg
}

fn place(frame: Frame) -> String {
    let (width, height) = (frame.right - frame.left, frame.bottom - frame.top);
    format!(
        "x=\"{}\" y=\"{}\" width=\"{width}\" height=\"{height}\"",
        frame.left, frame.top
    )
}

/// Rounds a value to five significant digits.
fn short(value: f64) -> f64 {
    format!("{value:.4e}").parse().unwrap_or(value)
}

/// Returns at most `MAX_POINTS` points that look like `points`, whose x ascends. The points are divided into equal
/// groups, and the lowest and the highest of each group are kept. Points that are not finite are left out.
pub fn thinned(points: impl Iterator<Item = (f64, f64)>) -> Vec<(f64, f64)> {
    const MAX_POINTS: usize = 1500;
    let points: Vec<(f64, f64)> = points.filter(|(x, y)| x.is_finite() && y.is_finite()).collect();
    if points.len() <= MAX_POINTS {
        return points;
    }
    // Two points of each group are kept.
    let share = points.len().div_ceil(MAX_POINTS / 2);
    let extremes = points.chunks(share).flat_map(|chunk| {
        let by_y = |a: &&(f64, f64), b: &&(f64, f64)| a.1.total_cmp(&b.1);
        let lowest = chunk.iter().min_by(by_y);
        let highest = chunk.iter().max_by(by_y);
        // The highest point may precede the lowest.
        let mut both: Vec<(f64, f64)> = lowest.into_iter().chain(highest).copied().collect();
        both.sort_by(|a, b| a.0.total_cmp(&b.0));
        both
    });
    extremes.collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn thinning_keeps_the_extremes_and_the_order(
            values in prop::collection::vec(-1e6..1e6f64, 1..6000),
        ) {
            let points = values.iter().enumerate().map(|(n, y)| (n as f64, *y));
            let thin = thinned(points.clone());
            prop_assert!(thin.len() <= 1500);
            prop_assert!(thin.windows(2).all(|pair| pair[0].0 <= pair[1].0));
            prop_assert!(thin.iter().all(|point| values[point.0 as usize].to_bits() == point.1.to_bits()));
            for pick in [f64::max, f64::min] {
                let of = |points: &mut dyn Iterator<Item = (f64, f64)>| points.map(|point| point.1).reduce(pick);
                prop_assert_eq!(of(&mut thin.iter().copied()), of(&mut points.clone()));
            }
        }

        #[test]
        fn a_value_is_shown_to_five_digits(value in prop::num::f64::NORMAL) {
            prop_assert!((short(value) - value).abs() <= 5.001e-5 * value.abs());
        }
    }
}
