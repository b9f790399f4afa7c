//! The parts that all pictures share: size, colours, lettering, heading, legend and axes.
//!
//! plotters draws at whole pixels, which is coarse for a curve, so pictures are drawn [`SCALE`] times as large as they
//! are shown. Colours are those for light paper; each picture carries the rules by which a dark screen shows its own,
//! see [`colours`](super::colours).

use std::error::Error as StdError;
use std::ops::Range;

use plotters::coord::Shift;
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::colours::dark_style;
use super::figure::{AxisData, AxisScale, Figure, Kind, Panel, Series, overlay};
use super::labels::Frame;
use super::{Caption, Svg};
use crate::support::decimal::fixed;
use crate::support::error::{Error, Result};
use crate::support::visible::{escaped, visible};

pub use super::quantity::{
    ACCELERATION, COST, FORCE, FREQUENCY, ORDER, POWER_DENSITY, Quantity, SPEED, TIME_MS, TIME_S,
};
use super::thinned::thinned;

pub use super::colours::{ALERT, BLUE, GREEN, INK, ON_PALE, ORANGE, PALE, PURPLE, SKY, VERMILION};

/// Pixels drawn for a pixel shown.
const SCALE: u32 = 2;

/// The area that a picture is drawn on.
pub type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;

/// The result of drawing, which fails only where a picture is laid out wrongly.
pub type Drawn<T = ()> = std::result::Result<T, Box<dyn StdError>>;

/// Lettering on axes and in legends, shown pixels.
pub const TEXT: u32 = 13;

/// Height of a row of the legend, shown pixels.
const LEGEND_ROW: u32 = 20;

/// Height of the heading, shown pixels.
const HEADING: u32 = 32;

/// Shown pixels as drawn.
pub const fn px(shown: u32) -> u32 {
    shown * SCALE
}

/// Shown pixels as a drawn coordinate.
pub const fn at(shown: u32) -> i32 {
    px(shown) as i32
}

/// A line as wide as `shown` halves of a shown pixel.
pub fn line(colour: RGBColor, half_pixels: u32) -> ShapeStyle {
    colour.stroke_width(half_pixels * SCALE / 2)
}

/// Lettering `shown` pixels high, anchored at its left and middle.
pub fn text(shown: u32, colour: RGBColor) -> TextStyle<'static> {
    // The backend divides by this factor again.
    let size = f64::from(px(shown)) * 1.24;
    ("sans-serif", size)
        .into_font()
        .color(&colour)
        .pos(Pos::new(HPos::Left, VPos::Center))
}

/// Lettering anchored at its middle.
pub fn centred(shown: u32, colour: RGBColor) -> TextStyle<'static> {
    text(shown, colour).pos(Pos::new(HPos::Center, VPos::Center))
}

/// Lettering that runs upwards, anchored at its middle.
pub fn upwards(shown: u32, colour: RGBColor) -> TextStyle<'static> {
    centred(shown, colour).transform(FontTransform::Rotate270)
}

/// About how wide `text` comes out in lettering `shown` pixels high, drawn pixels. The reader's font is not known.
pub fn text_width(text: &str, shown: u32) -> i32 {
    (text.chars().count() as f64 * f64::from(px(shown)) * 0.56) as i32
}

/// Makes a picture: its heading, and below it what `draw` draws, with the data of the panels that it gives.
///
/// # Errors
/// A picture that plotters cannot lay out.
pub fn picture(
    caption: &Caption<'_>,
    (width, height): (u32, u32),
    draw: impl FnOnce(&Area<'_>, &mut Vec<Panel>) -> Drawn,
) -> Result<Svg> {
    let mut drawn = String::new();
    let mut panels = Vec::new();
    let outcome = (|| -> Drawn {
        let root = SVGBackend::with_string(&mut drawn, (px(width), px(height))).into_drawing_area();
        root.fill(&WHITE)?;
        let (heading, below) = root.split_vertically(px(HEADING));
        heading.draw_text(caption.title, &bold(16, INK), (at(10), at(HEADING / 2 + 2)))?;
        if caption.simulated {
            let style = bold(14, ALERT).pos(Pos::new(HPos::Right, VPos::Center));
            heading.draw_text("SIMULATED", &style, (at(width - 10), at(HEADING / 2 + 2)))?;
        }
        draw(&below, &mut panels)?;
        root.present()?;
        Ok(())
    })();
    outcome.map_err(|error| {
        Error::Request(format!(
            "the picture '{}' cannot be drawn: {error}",
            caption.title
        ))
    })?;
    let figure = Figure {
        title: caption.title.to_owned(),
        simulated: caption.simulated,
        panels,
    };
    let mut shown = shown_at_size(&drawn, caption, width, height);
    shown.insert_str(
        shown.rfind("</svg>").unwrap_or(shown.len()),
        &overlay(&figure),
    );
    // Only texts hold such characters, and a picture that holds them is not XML.
    let text = visible(&shown).into_owned();
    Ok(Svg { text, figure })
}

/// Bold [`text`].
fn bold(shown: u32, colour: RGBColor) -> TextStyle<'static> {
    let mut style = text(shown, colour);
    style.font = style.font.style(FontStyle::Bold);
    style
}

/// Replaces the opening tag of a drawing by one that shows it at the size asked for, names it for those who do not see
/// it, and is followed by its colours on a dark screen.
fn shown_at_size(drawn: &str, caption: &Caption<'_>, width: u32, height: u32) -> String {
    let content = drawn
        .split_once(">\n")
        .map_or(drawn, |(_, content)| content);
    let simulated = if caption.simulated {
        " (SIMULATED)"
    } else {
        ""
    };
    let name = escaped(&format!("{}{simulated}", caption.title));
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" class=\"plot\" role=\"img\" aria-label=\"{name}\" width=\"{width}\" \
         height=\"{height}\" viewBox=\"0 0 {} {}\">\n<style>{}</style>\n{content}",
        px(width),
        px(height),
        dark_style()
    )
}

/// The symbol of a legend's entry.
#[derive(Clone, Copy)]
pub enum Swatch {
    /// A piece of line, dashed or not.
    Line {
        /// Of this colour.
        colour: RGBColor,
        /// With gaps.
        dashed: bool,
    },
    /// A filled box.
    Box(RGBColor),
    /// A filled circle.
    #[cfg(feature = "spectrograms")]
    Disc(RGBColor),
    /// A cell of a grid with a mark in it.
    Mark(Mark),
}

/// Marks at the edge of something, which leave its middle free.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Mark {
    /// A filled triangle in the upper left corner.
    Corner,
    /// The outline of one.
    HollowCorner,
    /// A dot in the upper right corner.
    Dot,
    /// A ring around a point.
    Ring,
    /// A square around a point.
    Square,
    /// A cross on a point.
    Cross,
}

impl Mark {
    /// Draws the mark for something that reaches from one point to another.
    pub fn draw(
        self,
        area: &Area<'_>,
        (left, top): (i32, i32),
        (right, bottom): (i32, i32),
    ) -> Drawn {
        let size = at(8).min((right - left) / 2).min((bottom - top) / 2);
        let middle = (i32::midpoint(left, right), i32::midpoint(top, bottom));
        let corner = [
            (left, top),
            (left + size, top),
            (left, top + size),
            (left, top),
        ];
        match self {
            Self::Corner => area.draw(&Polygon::new(corner, ON_PALE.filled()))?,
            Self::HollowCorner => {
                area.draw(&Polygon::new(corner, WHITE.filled()))?;
                area.draw(&PathElement::new(corner, line(ON_PALE, 2)))?;
            }
            Self::Dot => {
                let place = (right - size * 2 / 3, top + size * 2 / 3);
                area.draw(&Circle::new(place, size * 2 / 5, VERMILION.filled()))?;
            }
            Self::Ring => area.draw(&Circle::new(middle, at(6), line(INK, 3)))?,
            Self::Square => {
                let ((x, y), half) = (middle, at(7));
                let corners = [(-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1)];
                let path = corners.map(|(dx, dy)| (x + dx * half, y + dy * half));
                area.draw(&PathElement::new(path, line(INK, 3)))?;
            }
            Self::Cross => area.draw(&Cross::new(middle, at(4), line(INK, 3)))?,
        }
        Ok(())
    }
}

/// Draws a legend in as many rows as it needs, and gives what is left below it.
pub fn legend<'a>(area: &Area<'a>, entries: &[(Swatch, &str)]) -> Drawn<Area<'a>> {
    let width = area.dim_in_pixel().0 as i32;
    let (swatch_width, gap) = (at(24), at(6));
    let mut places = Vec::new();
    let (mut x, mut row) = (at(14), 0);
    for (_, name) in entries {
        let needed = swatch_width + gap + text_width(name, TEXT) + at(14);
        if x + needed > width && x > at(14) {
            (x, row) = (at(14), row + 1);
        }
        places.push((x, at(LEGEND_ROW) * row + at(LEGEND_ROW / 2)));
        x += needed;
    }
    for ((swatch, name), (x, y)) in entries.iter().zip(places) {
        match *swatch {
            Swatch::Line { colour, dashed } => {
                let ends = [(x, y), (x + swatch_width, y)];
                if dashed {
                    let dashes = plotters::element::DashedPathElement::new(
                        ends,
                        at(6),
                        at(4),
                        line(colour, 4),
                    );
                    area.draw(&dashes)?;
                } else {
                    area.draw(&PathElement::new(ends, line(colour, 4)))?;
                }
            }
            Swatch::Box(colour) => {
                let corners = [(x + at(4), y - at(6)), (x + swatch_width, y + at(6))];
                area.draw(&Rectangle::new(corners, colour.filled()))?;
            }
            #[cfg(feature = "spectrograms")]
            Swatch::Disc(colour) => {
                let middle = (x + swatch_width / 2, y);
                area.draw(&Circle::new(middle, at(6), colour.filled()))?;
            }
            Swatch::Mark(mark) => {
                let (from, to) = ((x + at(4), y - at(8)), (x + swatch_width, y + at(8)));
                if matches!(mark, Mark::Corner | Mark::HollowCorner | Mark::Dot) {
                    area.draw(&Rectangle::new([from, to], PALE.filled()))?;
                }
                mark.draw(area, from, to)?;
            }
        }
        area.draw_text(name, &text(TEXT, INK), (x + swatch_width + gap, y))?;
    }
    Ok(area.split_vertically(at(LEGEND_ROW) * (row + 1)).1)
}

/// A chart over two ranges of numbers.
pub type Chart<'a> = ChartContext<'a, SVGBackend<'a>, Cartesian2d<RangedCoordf64, RangedCoordf64>>;

/// One axis of a chart.
pub struct Axis<'a> {
    /// From where to where.
    pub range: Range<f64>,
    /// The quantity, which is written unless the ticks are blank, as where a neighbour's axis tells.
    pub quantity: Quantity<'a>,
    /// Ticks along it.
    pub ticks: Ticks<'a>,
}

/// The ticks along an axis, with their numbers or names.
pub enum Ticks<'a> {
    /// About so many numbers, at round values.
    Numbers(usize),
    /// About so many lines of the mesh, with nothing written, not even the quantity.
    Blank(usize),
    /// A name at 0, at 1, and so on.
    Names(&'a [&'a str]),
    /// Octaves: a name at 0, which is 2^`lowest`, at 1, which is twice that, and so on.
    Octaves {
        /// Logarithm to base 2 of the value at 0.
        lowest: f64,
        /// Names of the octaves' ends.
        names: &'a [&'a str],
    },
}

impl Ticks<'_> {
    /// About how many there are to be; plotters takes the roundest step that does not give more.
    fn count(&self) -> usize {
        match self {
            Self::Numbers(count) | Self::Blank(count) => *count,
            Self::Names(names) | Self::Octaves { names, .. } => names.len() + 1,
        }
    }

    fn label(&self, value: f64, span: f64) -> String {
        match self {
            Self::Numbers(_) => number(value, span),
            Self::Blank(_) => String::new(),
            Self::Names(names) | Self::Octaves { names, .. } => {
                let index = value.round();
                let name = (index >= 0.0).then(|| names.get(index as usize)).flatten();
                name.filter(|_| (value - index).abs() < 1e-6)
                    .copied()
                    .unwrap_or_default()
                    .to_owned()
            }
        }
    }
}

/// A value with the decimals that tell it from its neighbours on an axis that spans `span`.
fn number(value: f64, span: f64) -> String {
    let decimals = (1.0 - (span / 2.0).log10().floor()).clamp(0.0, 9.0) as usize;
    let text = fixed(value, decimals);
    if text.contains('.') {
        text.trim_end_matches('0').trim_end_matches('.').to_owned()
    } else {
        text
    }
}

/// Room on the left of a chart for the names and the numbers of its vertical axis, shown pixels.
pub const LEFT: u32 = 76;

/// A value of a grid's axis, with three decimals at most.
pub fn grid_value(value: f64) -> String {
    let text = fixed(value, 3);
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

/// A curve's look.
#[derive(Clone, Copy)]
pub struct Stroke {
    /// Its colour.
    pub colour: RGBColor,
    /// Its width, halves of a shown pixel.
    pub half_pixels: u32,
    /// With gaps.
    pub dashed: bool,
}

impl Stroke {
    /// A line without gaps.
    pub fn solid(colour: RGBColor, half_pixels: u32) -> Self {
        Self {
            colour,
            half_pixels,
            dashed: false,
        }
    }
}

/// A chart with the data that are drawn in it.
pub struct Plot<'a> {
    /// The chart.
    pub chart: Chart<'a>,
    /// Its data.
    pub panel: Panel,
}

impl Plot<'_> {
    /// Draws a curve, whose x rises, thinned to what can be seen, and keeps all of it.
    pub fn curve(
        &mut self,
        name: &str,
        points: impl Iterator<Item = (f64, f64)>,
        stroke: Stroke,
    ) -> Drawn {
        let points: Vec<(f64, f64)> = points.collect();
        let series = Series::new(name, Kind::Line, stroke.colour, &points);
        self.panel.series.push(series);
        let Stroke {
            colour,
            half_pixels,
            dashed,
        } = stroke;
        let shown = thinned(points.into_iter());
        let style = line(colour, half_pixels);
        if dashed {
            self.chart
                .draw_series(DashedLineSeries::new(shown, at(6), at(4), style))?;
        } else {
            self.chart.draw_series(LineSeries::new(shown, style))?;
        }
        Ok(())
    }
}

/// Draws the axes of a chart, which fills `area`, and begins the data of the panel called `name`.
pub fn axes<'a>(area: &Area<'a>, name: &str, x: &Axis<'_>, y: &Axis<'_>) -> Drawn<Plot<'a>> {
    let is_blank = |axis: &Axis<'_>| matches!(axis.ticks, Ticks::Blank(_));
    let bottom = if is_blank(x) { 10 } else { 44 };
    let mut chart = ChartBuilder::on(area)
        .margin_top(px(8))
        .margin_right(px(22))
        .margin_left(px(6))
        .margin_bottom(px(4))
        .x_label_area_size(px(bottom))
        .y_label_area_size(px(LEFT))
        .build_cartesian_2d(x.range.clone(), y.range.clone())?;
    let span = |axis: &Axis<'_>| axis.range.end - axis.range.start;
    let x_label = if is_blank(x) {
        String::new()
    } else {
        x.quantity.label()
    };
    chart
        .configure_mesh()
        .axis_style(line(INK, 2))
        .bold_line_style(line(PALE, 2))
        .light_line_style(TRANSPARENT)
        .set_all_tick_mark_size(px(4))
        .label_style(text(TEXT, INK))
        .axis_desc_style(text(TEXT, INK))
        .x_labels(x.ticks.count())
        .y_labels(y.ticks.count())
        .x_label_formatter(&|value| x.ticks.label(*value, span(x)))
        .y_label_formatter(&|value| y.ticks.label(*value, span(y)))
        .x_desc(x_label)
        .draw()?;
    let (columns, rows) = chart.plotting_area().get_pixel_range();
    if !is_blank(y) {
        let top = area.get_base_pixel().1;
        let middle = i32::midpoint(rows.start, rows.end) - top;
        let length = rows.end - rows.start;
        draw_upwards(area, y.quantity, (at(14), middle), length)?;
    }
    let frame = Frame {
        left: columns.start,
        top: rows.start,
        right: columns.end,
        bottom: rows.end,
    };
    let panel = Panel::new(name, frame, axis_data(x), axis_data(y));
    Ok(Plot { chart, panel })
}

/// The data of an axis as it is drawn.
fn axis_data(axis: &Axis<'_>) -> AxisData {
    let (mut from, mut to) = (axis.range.start, axis.range.end);
    let mut names = Vec::new();
    let scale = match axis.ticks {
        Ticks::Numbers(_) | Ticks::Blank(_) => AxisScale::Linear,
        Ticks::Names(written) => {
            names = written.iter().map(ToString::to_string).collect();
            AxisScale::Names
        }
        Ticks::Octaves { lowest, .. } => {
            (from, to) = ((from + lowest).exp2(), (to + lowest).exp2());
            AxisScale::Log
        }
    };
    AxisData {
        quantity: axis.quantity.name().to_owned(),
        unit: axis.quantity.unit().to_owned(),
        scale,
        from,
        to,
        names,
    }
}

/// Name and unit in one line, or in one each where they are too long for `length` drawn pixels.
fn lines_of(quantity: Quantity<'_>, length: i32) -> Vec<String> {
    let label = quantity.label();
    if quantity.unit().is_empty() || text_width(&label, TEXT) <= length {
        vec![label]
    } else {
        vec![format!("{},", quantity.name()), quantity.unit().to_owned()]
    }
}

/// Writes a quantity upwards around a place, in two lines where one is longer than `length` drawn pixels.
pub fn draw_upwards(
    area: &Area<'_>,
    quantity: Quantity<'_>,
    (x, y): (i32, i32),
    length: i32,
) -> Drawn {
    for (index, text) in lines_of(quantity, length).iter().enumerate() {
        let x = x + at(TEXT + 2) * index as i32;
        area.draw_text(text, &upwards(TEXT, INK), (x, y))?;
    }
    Ok(())
}

/// Width of the column with a colour bar, shown pixels.
pub const BAR: u32 = 116;

/// Draws the scale of a map beside it, from `top` to `bottom`: its colours from 0 to 1, values written at shares of it,
/// and the quantity.
pub fn colour_bar(
    area: &Area<'_>,
    (top, bottom): (i32, i32),
    colour: impl Fn(f64) -> RGBColor,
    values: &[(f64, String)],
    quantity: Quantity<'_>,
) -> Drawn {
    const STEPS: i32 = 48;
    for step in 0..STEPS {
        let y = |step: i32| bottom - (bottom - top) * step / STEPS;
        let share = (f64::from(step) + 0.5) / f64::from(STEPS);
        // Each reaches into the one below, so that no light shows between them.
        let cell = [
            (at(4), y(step + 1)),
            (at(20), (y(step) + at(2)).min(bottom)),
        ];
        area.draw(&Rectangle::new(cell, colour(share).filled()))?;
    }
    for (share, value) in values {
        let y = bottom - (f64::from(bottom - top) * share).round() as i32;
        area.draw(&PathElement::new([(at(20), y), (at(24), y)], line(INK, 2)))?;
        area.draw_text(value, &text(TEXT, INK), (at(28), y))?;
    }
    let middle = (at(BAR - 30), i32::midpoint(top, bottom));
    draw_upwards(area, quantity, middle, bottom - top)
}

/// A range that holds zero and all finite `values` with a little room; 0 to 1 where there are none.
pub fn range_with_zero(values: impl IntoIterator<Item = f64>) -> Range<f64> {
    const ROOM: f64 = 1.06;
    let (mut low, mut high) = (0.0f64, 0.0f64);
    for value in values.into_iter().filter(|value| value.is_finite()) {
        (low, high) = (low.min(value), high.max(value));
    }
    if low < high {
        low * ROOM..high * ROOM
    } else {
        0.0..1.0
    }
}

/// The largest magnitude of values that are finite, if that is above zero.
pub fn highest_of(values: impl IntoIterator<Item = f64>) -> Option<f64> {
    let finite = values.into_iter().filter(|value| value.is_finite());
    finite
        .map(f64::abs)
        .reduce(f64::max)
        .filter(|highest| *highest > 0.0)
}

#[cfg(test)]
pub mod tests {
    use super::super::labels::Frame;
    use super::*;
    use proptest::prelude::*;

    /// Checks that nothing in a picture is placed outside of it, and that every number in it is one.
    pub fn assert_drawn_within(svg: &Svg, width: u32, height: u32) {
        let (_, content) = svg.as_str().split_once('\n').unwrap();
        for element in content.split('<') {
            for attribute in element.split("=\"").collect::<Vec<_>>().windows(2) {
                let name = attribute[0].rsplit([' ', '"']).next().unwrap();
                let value = attribute[1].split('"').next().unwrap();
                let within = |value: &str, most: u32| {
                    let value: i64 = value
                        .parse()
                        .unwrap_or_else(|_| panic!("{name} is {value} in <{element}"));
                    assert!(
                        (0..=i64::from(px(most))).contains(&value),
                        "{name} is {value} in <{element}"
                    );
                };
                match name {
                    "x" | "x1" | "x2" | "cx" => within(value, width),
                    "y" | "y1" | "y2" | "cy" => within(value, height),
                    "points" => {
                        for (x, y) in value
                            .split_whitespace()
                            .map(|point| point.split_once(',').unwrap())
                        {
                            within(x, width);
                            within(y, height);
                        }
                    }
                    _ => {}
                }
            }
        }
    }

    /// A text of a picture.
    #[derive(Clone, Debug)]
    pub struct Text {
        /// Its characters.
        pub words: String,
        /// The frame that it fills, about.
        pub frame: Frame,
        /// True if it runs upwards.
        pub runs_up: bool,
    }

    /// Returns all texts of a picture, by the sizes that the layout reckons with.
    pub fn texts(svg: &Svg) -> Vec<Text> {
        let elements = svg.as_str().split("<text ").skip(1);
        let text = |element: &str| {
            let (attributes, rest) = element.split_once('>').unwrap();
            let text = rest.split('<').next().unwrap().trim().to_owned();
            let attribute = |name: &str| {
                let (_, rest) = attributes.split_once(&format!("{name}=\"")).unwrap();
                rest.split('"').next().unwrap()
            };
            let number = |name| attribute(name).parse::<f64>().unwrap();
            let (x, y, size) = (number("x") as i32, number("y") as i32, number("font-size"));
            let width = (text.chars().count() as f64 * size * 0.56) as i32;
            let height = size as i32;
            let runs_up = attributes.contains("rotate(270");
            let shift = match attribute("text-anchor") {
                "start" => width / 2,
                "end" => -width / 2,
                _ => 0,
            };
            let lift = match attribute("dy") {
                "0.76em" => height / 2,
                "-0.5ex" => -height / 2,
                _ => 0,
            };
            let frame = if runs_up {
                Frame::around((x + lift, y - shift), (height, width))
            } else {
                Frame::around((x + shift, y + lift), (width, height))
            };
            Text {
                words: text,
                frame,
                runs_up,
            }
        };
        elements.map(text).collect()
    }

    proptest! {
        #[test]
        fn thinning_keeps_the_extremes_and_the_order(
            values in prop::collection::vec(-1e6..1e6f64, 1..20_000),
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
        fn a_written_number_is_near_enough_to_tell_ticks_apart(
            value in -1e4..1e4f64, span in prop::sample::select(vec![0.003, 0.05, 0.7, 1.0, 9.0, 30.0, 2500.0]),
        ) {
            let written: f64 = number(value, span).parse().unwrap();
            prop_assert!((written - value).abs() <= span / 30.0);
        }
    }

    #[test]
    fn numbers_are_written_without_idle_digits() {
        for (value, span, text) in [
            (0.0, 1.0, "0"),
            (-0.0, 1.0, "0"),
            (0.300_000_04, 1.0, "0.3"),
            (1000.0, 2500.0, "1000"),
            (0.25, 0.5, "0.25"),
        ] {
            assert_eq!(number(value, span), text);
        }
    }

    #[test]
    fn a_range_is_never_empty_or_infinite() {
        for values in [
            vec![],
            vec![0.0, 0.0],
            vec![f64::NAN, f64::INFINITY],
            vec![-3.0],
            vec![2.0, 5.0],
        ] {
            let range = range_with_zero(values.iter().copied());
            assert!(range.start < range.end && range.start.is_finite() && range.end.is_finite());
            assert!(range.start <= 0.0 && range.end >= 0.0);
            assert!(
                values
                    .iter()
                    .filter(|value| value.is_finite())
                    .all(|value| range.contains(value))
            );
        }
    }

    #[test]
    fn a_picture_has_the_size_and_the_heading_asked_for_and_nothing_that_ends_it_early() {
        let caption = Caption {
            title: "a < b & \"c\"",
            simulated: true,
        };
        let svg = picture(&caption, (300, 200), |_, _| Ok(())).unwrap();
        let opening = "<svg xmlns=\"http://www.w3.org/2000/svg\" class=\"plot\" role=\"img\" \
             aria-label=\"a &lt; b &amp; &quot;c&quot; (SIMULATED)\" width=\"300\" height=\"200\" \
             viewBox=\"0 0 600 400\">";
        assert!(svg.as_str().starts_with(opening), "{}", svg.as_str());
        assert!(svg.as_str().trim_end().ends_with("</svg>"));
        assert_eq!(svg.as_str().matches("<svg").count(), 1);
        assert!(svg.as_str().contains("a &lt; b &amp; &quot;c&quot;"));
        assert!(svg.as_str().contains("SIMULATED"));
        let recorded = picture(
            &Caption {
                simulated: false,
                ..caption
            },
            (300, 200),
            |_, _| Ok(()),
        )
        .unwrap();
        assert!(!recorded.as_str().contains("SIMULATED"));
    }

    #[test]
    fn a_legend_that_is_too_long_for_a_row_takes_more() {
        let below = |names: &[&str]| {
            let mut left = 0;
            let entries: Vec<(Swatch, &str)> = names
                .iter()
                .map(|name| (Swatch::Box(BLUE), *name))
                .collect();
            let caption = Caption {
                title: "",
                simulated: false,
            };
            picture(&caption, (300, 200), |area, _| {
                left = legend(area, &entries)?.dim_in_pixel().1;
                Ok(())
            })
            .unwrap();
            left
        };
        let one = below(&["short"]);
        assert_eq!(below(&["short", "short"]), one);
        assert_eq!(
            below(&["short", "a name that fills most of a row"]),
            one - px(LEGEND_ROW)
        );
    }
}
