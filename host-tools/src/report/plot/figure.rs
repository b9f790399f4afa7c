//! The data of a picture: what each pair of its axes shows, with quantities and units.
//!
//! A picture is drawn from these values, carries them thinned for whoever points at it, and files of data hold them
//! whole. So a value that is read from a picture is one of its file.

use std::fmt::Write as _;

use plotters::style::RGBColor;
use serde::Serialize;

use super::colours::hex;
use super::labels::Frame;
use super::quantity::Quantity;
use super::thinned::thinned;
use crate::support::visible::escaped;

/// The data of one picture.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Figure {
    /// Title of the picture.
    pub title: String,
    /// True if anything in it comes from the rig simulator.
    pub simulated: bool,
    /// Pairs of axes, in the order in which they were drawn.
    pub panels: Vec<Panel>,
}

/// One pair of axes with what is drawn between them.
#[derive(Clone, Debug, PartialEq)]
pub struct Panel {
    /// Name of the panel; empty where the picture has one alone.
    pub name: String,
    /// The rectangle between the axes, drawn pixels.
    pub frame: Frame,
    /// The horizontal axis.
    pub x: AxisData,
    /// The vertical axis.
    pub y: AxisData,
    /// Curves, points, cells.
    pub series: Vec<Series>,
    /// The texture whose nodes a map shows, which a page can play.
    pub plays: Option<String>,
    /// A bitmap in the frame, as the bytes of a PNG.
    pub bitmap: Option<Bitmap>,
}

/// A bitmap whose colours stand for levels.
#[derive(Clone, Debug, PartialEq)]
pub struct Bitmap {
    /// The bytes of a PNG, in base64.
    pub png: String,
    /// The rectangle that it fills, drawn pixels.
    pub frame: Frame,
    /// Level of the first colour of the palette.
    pub from: f64,
    /// Level of the last.
    pub to: f64,
    /// The palette: six hexadecimal digits a colour.
    pub palette: String,
}

/// One axis.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct AxisData {
    /// Name of the quantity.
    pub quantity: String,
    /// Its unit; empty for a count or a ratio.
    pub unit: String,
    /// From values to places.
    pub scale: AxisScale,
    /// Value at the left or lower end.
    pub from: f64,
    /// Value at the right or upper end.
    pub to: f64,
    /// Names at 0, 1, and so on, on an axis of names.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub names: Vec<String>,
}

/// The scale of an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum AxisScale {
    /// Equal differences are equal steps.
    Linear,
    /// Equal ratios are equal steps.
    Log,
    /// Positions with names.
    Names,
}

/// The kind of a series.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    /// A curve, whose x rises.
    Line,
    /// Points in any order.
    Points,
    /// Bars at positions of an axis of names.
    Bars,
    /// Cells of a map at positions of two axes of names.
    Cells,
    /// Levels over all pairs of an x and a y.
    Levels,
}

/// Values that belong together.
#[derive(Clone, Debug, PartialEq)]
pub struct Series {
    /// Their name; empty where the panel's says it all.
    pub name: String,
    /// Their kind.
    pub kind: Kind,
    /// Their colour, where they have one.
    pub colour: Option<RGBColor>,
    /// Along the horizontal axis.
    pub x: Vec<f64>,
    /// Along the vertical axis; NaN where there is no value.
    pub y: Vec<f64>,
    /// A third quantity: of each point or cell, or of each x with every y.
    pub z: Option<Third>,
    /// A text for each point, or none at all.
    pub notes: Vec<String>,
}

/// Values of a third quantity.
#[derive(Clone, Debug, PartialEq)]
pub struct Third {
    /// Name of the quantity.
    pub quantity: String,
    /// Its unit.
    pub unit: String,
    /// The values; NaN where there is none.
    pub values: Vec<f64>,
}

impl AxisData {
    /// An axis of cells of one size, one for each name.
    pub fn of_cells(quantity: Quantity<'_>, names: Vec<String>) -> Self {
        Self {
            quantity: quantity.name().to_owned(),
            unit: quantity.unit().to_owned(),
            scale: AxisScale::Names,
            from: -0.5,
            to: names.len() as f64 - 0.5,
            names,
        }
    }

    /// The value that a position on this axis stands for, as it is written: of an axis of names, the name.
    pub fn written(&self, value: f64) -> String {
        match self.scale {
            AxisScale::Names => self
                .names
                .get(value.round().max(0.0) as usize)
                .cloned()
                .unwrap_or_default(),
            AxisScale::Linear | AxisScale::Log => value.to_string(),
        }
    }
}

impl Panel {
    /// A panel without anything in it.
    pub fn new(name: &str, frame: Frame, x: AxisData, y: AxisData) -> Self {
        Self {
            name: name.to_owned(),
            frame,
            x,
            y,
            series: Vec::new(),
            plays: None,
            bitmap: None,
        }
    }
}

impl Series {
    /// A curve or points.
    pub fn new(name: &str, kind: Kind, colour: RGBColor, points: &[(f64, f64)]) -> Self {
        Self {
            name: name.to_owned(),
            kind,
            colour: Some(colour),
            x: points.iter().map(|point| point.0).collect(),
            y: points.iter().map(|point| point.1).collect(),
            z: None,
            notes: Vec::new(),
        }
    }

    /// The cells of a map, all rows of the first column first.
    pub fn cells(
        quantity: Quantity<'_>,
        (columns, rows): (usize, usize),
        values: Vec<f64>,
        notes: Vec<String>,
    ) -> Self {
        let places = || (0..columns).flat_map(|column| (0..rows).map(move |row| (column, row)));
        Self {
            name: String::new(),
            kind: Kind::Cells,
            colour: None,
            x: places().map(|place| place.0 as f64).collect(),
            y: places().map(|place| place.1 as f64).collect(),
            z: Some(Third::new(quantity, values)),
            notes,
        }
    }
}

impl Third {
    /// Values of a quantity.
    pub fn new(quantity: Quantity<'_>, values: Vec<f64>) -> Self {
        Self {
            quantity: quantity.name().to_owned(),
            unit: quantity.unit().to_owned(),
            values,
        }
    }
}

/// A quantity as the pages' script reads it.
#[derive(Serialize)]
struct QuantityText<'a> {
    quantity: &'a str,
    unit: &'a str,
}

/// The palette of a bitmap as the pages' script reads it.
#[derive(Serialize)]
struct Levels<'a> {
    from: f64,
    to: f64,
    palette: &'a str,
    /// First x and the step to the next; likewise of y.
    x: [f64; 2],
    y: [f64; 2],
}

/// The elements that make a picture readable by pointing: a group for each pair of axes.
pub fn overlay(figure: &Figure) -> String {
    let mut svg = String::new();
    for panel in &figure.panels {
        write_panel(&mut svg, panel);
    }
    svg
}

fn write_panel(svg: &mut String, panel: &Panel) {
    let Frame {
        left,
        top,
        right,
        bottom,
    } = panel.frame;
    let (width, height) = (right - left, bottom - top);
    let plays = panel.plays.as_ref().map_or(String::new(), |texture| {
        format!(" data-play=\"{}\"", escaped(texture))
    });
    // Writing into a string does not fail.
    let _ = writeln!(
        svg,
        "<g class=\"axes\" data-name=\"{}\" data-frame=\"{left} {top} {right} {bottom}\" data-x=\"{}\" \
         data-y=\"{}\"{plays}>",
        escaped(&panel.name),
        attribute(&panel.x),
        attribute(&panel.y)
    );
    if let Some(bitmap) = &panel.bitmap {
        let Frame {
            left,
            top,
            right,
            bottom,
        } = bitmap.frame;
        let (width, height) = (right - left, bottom - top);
        let _ = writeln!(
            svg,
            "<image x=\"{left}\" y=\"{top}\" width=\"{width}\" height=\"{height}\" preserveAspectRatio=\"none\" \
             href=\"data:image/png;base64,{}\"/>",
            bitmap.png
        );
    }
    let _ = writeln!(
        svg,
        "<rect x=\"{left}\" y=\"{top}\" width=\"{width}\" height=\"{height}\" fill=\"none\" pointer-events=\"all\"/>"
    );
    for series in &panel.series {
        write_series(svg, series, panel.bitmap.as_ref());
    }
    svg.push_str("</g>\n");
}

fn write_series(svg: &mut String, series: &Series, bitmap: Option<&Bitmap>) {
    let kind = format!("{:?}", series.kind).to_lowercase();
    let _ = write!(
        svg,
        "<g class=\"series\" data-name=\"{}\" data-kind=\"{kind}\"",
        escaped(&series.name)
    );
    if let Some(colour) = series.colour {
        let _ = write!(svg, " data-colour=\"{}\"", hex(colour));
    }
    if let Some(third) = &series.z {
        let quantity = QuantityText {
            quantity: &third.quantity,
            unit: &third.unit,
        };
        let _ = write!(svg, " data-z-quantity=\"{}\"", attribute(&quantity));
    }
    if series.kind == Kind::Levels {
        if let Some(Bitmap {
            from, to, palette, ..
        }) = bitmap
        {
            let levels = Levels {
                from: *from,
                to: *to,
                palette,
                x: first_and_step(&series.x),
                y: first_and_step(&series.y),
            };
            let _ = write!(svg, " data-levels=\"{}\"", attribute(&levels));
        }
        svg.push_str("/>\n");
        return;
    }
    let points = series.x.iter().copied().zip(series.y.iter().copied());
    let (x, y): (Vec<f64>, Vec<f64>) = if series.kind == Kind::Line {
        thinned(points).into_iter().unzip()
    } else {
        points.unzip()
    };
    let _ = write!(svg, " data-x=\"{}\" data-y=\"{}\"", list(&x), list(&y));
    if let Some(third) = &series.z {
        let _ = write!(svg, " data-z=\"{}\"", list(&third.values));
    }
    if series.notes.iter().any(|note| !note.is_empty()) {
        let _ = write!(svg, " data-notes=\"{}\"", attribute(&series.notes));
    }
    svg.push_str("/>\n");
}

/// The first of evenly spaced values, and the step between them.
fn first_and_step(values: &[f64]) -> [f64; 2] {
    let first = values.first().copied().unwrap_or(0.0);
    let last = values.last().copied().unwrap_or(0.0);
    let steps = values.len().saturating_sub(1).max(1);
    [first, (last - first) / steps as f64]
}

/// A value as JSON in an attribute.
fn attribute(value: &impl Serialize) -> String {
    let text = serde_json::to_string(value).expect("plain data become JSON");
    escaped(&text)
}

fn list(values: &[f64]) -> String {
    let written: Vec<String> = values.iter().map(|value| short(*value)).collect();
    written.join(" ")
}

/// A value with five significant digits, `-` for what is not a number.
fn short(value: f64) -> String {
    if !value.is_finite() {
        return "-".to_owned();
    }
    let rounded: f64 = format!("{value:.4e}").parse().unwrap_or(value);
    if rounded != 0.0 && !(1e-4..1e7).contains(&rounded.abs()) {
        format!("{rounded:e}")
    } else {
        // No minus zero.
        (rounded + 0.0).to_string()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_written_value_is_read_as_itself_to_five_digits(value in prop::num::f64::NORMAL) {
            let read: f64 = short(value).parse().unwrap();
            prop_assert!((read - value).abs() <= 5.001e-5 * value.abs());
            prop_assert!(short(value).len() <= 14);
        }
    }

    #[test]
    fn what_is_not_a_number_is_written_as_none_and_zero_has_no_sign() {
        for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            assert_eq!(short(value), "-");
        }
        assert_eq!(
            (short(-0.0), short(0.5)),
            ("0".to_owned(), "0.5".to_owned())
        );
    }
}
