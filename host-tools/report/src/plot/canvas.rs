//! The elements of all pictures: sizes, lettering, heading, legend, axes, curves and the bar of a map's colours.
//!
//! plotters draws at whole pixels, which is coarse for a curve, so pictures are drawn [`SCALE`] times as large as they
//! are shown. Colours are those for light paper. Each picture contains the style rules by which a dark screen shows its
//! own colours; see [`colours`](super::colours).

use std::error::Error as StdError;
use std::ops::Range;

use plotters::coord::Shift;
use plotters::coord::types::RangedCoordf64;
use plotters::element::DashedPathElement;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use stylus_support::number::fixed;
use stylus_support::visible::{escaped, visible};
use stylus_support::{Error, Result};

use super::colours::{dark_scale_style, dark_style};
use super::figure::{AxisData, AxisScale, Frame, Kind, Panel, Quantity, Series, overlay, thinned};
use super::{Caption, Svg};

pub use super::colours::{ALERT, BLUE, INK, ON_PALE, PALE, SERIES, VERMILION};

/// Drawn pixels per shown pixel.
const SCALE: u32 = 2;

/// The area in which a picture is drawn.
pub type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;

/// The result of drawing. It fails only if a picture is laid out wrongly.
pub type Drawn<T = ()> = std::result::Result<T, Box<dyn StdError>>;

/// Height of the lettering on axes and in legends, shown pixels.
pub const TEXT: u32 = 13;

/// Height of a row of the legend, shown pixels.
const LEGEND_ROW: u32 = 20;

/// Thickness of a legend's lines, halves of a shown pixel.
const LEGEND_LINE: u32 = 4;

/// Height of the heading, shown pixels.
pub const HEADING: u32 = 32;

/// Converts shown pixels to drawn pixels.
pub const fn px(shown: u32) -> u32 {
    shown * SCALE
}

/// Converts shown pixels to a drawn coordinate.
pub const fn at(shown: u32) -> i32 {
    px(shown) as i32
}

/// A line `half_pixels` halves of a shown pixel wide.
pub fn line(colour: RGBColor, half_pixels: u32) -> ShapeStyle {
    colour.stroke_width(half_pixels * SCALE / 2)
}

/// Lettering `shown` pixels high, anchored at the middle of its left edge.
pub fn text(shown: u32, colour: RGBColor) -> TextStyle<'static> {
    // The backend divides the size by this factor.
    let size = f64::from(px(shown)) * 1.24;
    ("sans-serif", size)
        .into_font()
        .color(&colour)
        .pos(Pos::new(HPos::Left, VPos::Center))
}

/// Lettering anchored at its centre.
pub fn centred(shown: u32, colour: RGBColor) -> TextStyle<'static> {
    text(shown, colour).pos(Pos::new(HPos::Center, VPos::Center))
}

/// Estimates the width of `text` in lettering `shown` pixels high, drawn pixels. The reader's font is not known.
pub fn text_width(text: &str, shown: u32) -> i32 {
    (text.chars().count() as f64 * f64::from(px(shown)) * 0.56) as i32
}

/// Makes a picture: its heading, and below it the content that `draw` draws. `draw` returns the panels' data.
pub fn picture(
    caption: &Caption<'_>,
    (width, height): (u32, u32),
    draw: impl FnOnce(&Area<'_>) -> Drawn<Vec<Panel>>,
) -> Result<Svg> {
    let title = caption.title;
    let mut drawn = String::new();
    // plotters borrows the text until the drawing is dropped, at the end of this closure.
    let outcome = (|| -> Drawn<Vec<Panel>> {
        let root = SVGBackend::with_string(&mut drawn, (px(width), px(height))).into_drawing_area();
        root.fill(&WHITE)?;
        let (heading, below) = root.split_vertically(px(HEADING));
        heading.draw_text(title, &bold(16, INK), (at(10), at(HEADING / 2 + 2)))?;
        if caption.simulated {
            let style = bold(14, ALERT).pos(Pos::new(HPos::Right, VPos::Center));
            heading.draw_text("SIMULATED", &style, (at(width - 10), at(HEADING / 2 + 2)))?;
        }
        let panels = draw(&below)?;
        root.present()?;
        Ok(panels)
    })();
    let panels = outcome.map_err(|error| Error::Request(format!("the picture '{title}' cannot be drawn: {error}")))?;
    let mut series = panels.iter().flat_map(|panel| &panel.series);
    let is_map = series.any(|series| series.kind == Kind::Cells);
    // The rules for a map's shades are long, so other pictures go without them.
    let scale_style = is_map.then(dark_scale_style).unwrap_or_default();
    let origin = if caption.simulated { " (SIMULATED)" } else { "" };
    // plotters' drawing is nested in the picture's own element, because plotters gives its element neither a shown size
    // nor a name for readers who cannot see. Lettering that a page draws over the picture takes its font from here.
    let text = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" class=\"plot\" font-family=\"sans-serif\" \
         role=\"img\" aria-label=\"{name}\" \
         width=\"{width}\" height=\"{height}\" viewBox=\"0 0 {} {}\">\n\
         <style>{}{scale_style}</style>\n{drawn}{}</svg>\n",
        px(width),
        px(height),
        dark_style(),
        overlay(&panels),
        name = escaped(&format!("{title}{origin}")),
    );
    // Only texts can contain control characters, and a picture with them would not be valid XML.
    let text = visible(&text).into_owned();
    Ok(Svg { text, panels })
}

/// Makes a picture of one chart below its legend. `draw` draws in the chart.
pub fn chart(
    caption: &Caption<'_>,
    size: (u32, u32),
    entries: &[(Swatch, &str)],
    (x, y): (&Axis<'_>, &Axis<'_>),
    draw: impl FnOnce(&mut Plot<'_>) -> Drawn,
) -> Result<Svg> {
    picture(caption, size, |area| {
        let mut plot = axes(&legend(area, entries)?, "", x, y)?;
        draw(&mut plot)?;
        Ok(vec![plot.panel])
    })
}

/// Returns bold [`text`].
fn bold(shown: u32, colour: RGBColor) -> TextStyle<'static> {
    let mut style = text(shown, colour);
    style.font = style.font.style(FontStyle::Bold);
    style
}

/// The symbol of a legend's entry.
#[derive(Clone, Copy)]
pub enum Swatch {
    /// A short line, dashed or not. All legends use one width.
    Line(Stroke),
    /// A grid cell with a mark in it.
    Mark(Mark),
}

impl Swatch {
    /// A short line without gaps.
    pub fn line(colour: RGBColor) -> Self {
        Self::Line(Stroke::solid(colour, LEGEND_LINE))
    }
}

/// Marks at the edge of a cell, which leave its middle free.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Mark {
    /// A filled triangle in the upper left corner.
    Corner,
    /// The outline of a triangle in the upper left corner.
    HollowCorner,
    /// A dot in the upper right corner.
    Dot,
}

impl Mark {
    /// Draws the mark for a cell that extends from one corner to the other.
    pub fn draw(self, area: &Area<'_>, (left, top): (i32, i32), (right, bottom): (i32, i32)) -> Drawn {
        // In the small cells of a large grid the middle must stay free too.
        let size = at(8).min((right - left) / 2).min((bottom - top) / 2);
        let corner = [(left, top), (left + size, top), (left, top + size), (left, top)];
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
        }
        Ok(())
    }
}

/// Draws a legend in as many rows as it needs; without entries, nothing. Returns the area that is left below it.
pub fn legend<'a>(area: &Area<'a>, entries: &[(Swatch, &str)]) -> Drawn<Area<'a>> {
    if entries.is_empty() {
        return Ok(area.clone());
    }
    let width = area.dim_in_pixel().0 as i32;
    let (swatch_width, gap) = (at(24), at(6));
    let (mut left, mut row) = (at(14), 0);
    for (swatch, name) in entries {
        let needed = swatch_width + gap + text_width(name, TEXT) + at(14);
        // An entry that is wider than the picture is alone in its row.
        if left + needed > width && left > at(14) {
            (left, row) = (at(14), row + 1);
        }
        let (x, y) = (left, at(LEGEND_ROW) * row + at(LEGEND_ROW / 2));
        match *swatch {
            Swatch::Line(stroke) => {
                let ends = [(x, y), (x + swatch_width, y)];
                let style = line(stroke.colour, LEGEND_LINE);
                if stroke.dashed {
                    area.draw(&DashedPathElement::new(ends, at(6), at(4), style))?;
                } else {
                    area.draw(&PathElement::new(ends, style))?;
                }
            }
            Swatch::Mark(mark) => {
                let (from, to) = ((x + at(4), y - at(8)), (x + swatch_width, y + at(8)));
                area.draw(&Rectangle::new([from, to], PALE.filled()))?;
                mark.draw(area, from, to)?;
            }
        }
        area.draw_text(name, &text(TEXT, INK), (x + swatch_width + gap, y))?;
        left += needed;
    }
    Ok(area.split_vertically(at(LEGEND_ROW) * (row + 1)).1)
}

/// A chart over two ranges of numbers.
pub type Chart<'a> = ChartContext<'a, SVGBackend<'a>, Cartesian2d<RangedCoordf64, RangedCoordf64>>;

/// One axis of a chart.
pub struct Axis<'a> {
    /// Values at both ends of the axis.
    pub range: Range<f64>,
    /// The quantity along the axis.
    quantity: Quantity,
    /// Ticks along the axis.
    ticks: Ticks<'a>,
    /// True if the axis has mesh lines but no lettering, because a neighbour's axis has the numbers.
    is_blank: bool,
}

/// Smallest number of numbers along an axis. Fewer do not show its scale.
const FEWEST_TICKS: usize = 3;

/// Upper bound, not reached, of the number of numbers to which a request to plotters is raised.
const MOST_TICKS: usize = 16;

/// The ticks along an axis, with their numbers or names.
enum Ticks<'a> {
    /// About this number of ticks, at round values.
    Numbers(usize),
    /// Octaves: a name at 0, which stands for 2^`lowest`, one at 1, which stands for twice that, and so on.
    Octaves { lowest: f64, names: &'a [&'a str] },
}

impl<'a> Axis<'a> {
    /// Creates an axis with about `numbers` numbers, at round values.
    pub fn new(quantity: Quantity, range: Range<f64>, numbers: usize) -> Self {
        Self {
            range,
            quantity,
            ticks: Ticks::Numbers(numbers),
            is_blank: false,
        }
    }

    /// Creates an axis in octaves: a name at 0, which stands for 2^`lowest`, one at 1, which stands for twice that, and
    /// so on.
    pub fn of_octaves(quantity: Quantity, range: Range<f64>, lowest: f64, names: &'a [&'a str]) -> Self {
        Self {
            ticks: Ticks::Octaves { lowest, names },
            ..Self::new(quantity, range, 0)
        }
    }

    /// Returns the same axis, with mesh lines always and with lettering only if `is_told`.
    pub fn told_if(self, is_told: bool) -> Self {
        Self {
            is_blank: !is_told,
            ..self
        }
    }

    /// Returns the number of ticks to request. plotters takes the roundest step with no more ticks than requested, so
    /// the number is raised until there are [`FEWEST_TICKS`].
    fn count(&self) -> usize {
        match self.ticks {
            Ticks::Numbers(count) => {
                let along = RangedCoordf64::from(self.range.clone());
                let has_enough = |count: &usize| along.key_points(*count).len() >= FEWEST_TICKS;
                (count..MOST_TICKS).find(has_enough).unwrap_or(count)
            }
            Ticks::Octaves { names, .. } => names.len() + 1,
        }
    }

    fn label(&self, value: f64) -> String {
        match self.ticks {
            _ if self.is_blank => String::new(),
            Ticks::Numbers(_) => number(value, self.range.end - self.range.start),
            Ticks::Octaves { names, .. } => {
                let index = value.round();
                // plotters sums up steps, so its octaves are only approximately whole numbers.
                let is_there = index >= 0.0 && (value - index).abs() < 1e-6;
                is_there
                    .then(|| names.get(index as usize))
                    .flatten()
                    .copied()
                    .unwrap_or_default()
                    .to_owned()
            }
        }
    }

    /// Returns the data of the axis as it is drawn.
    fn data(&self) -> AxisData {
        let Range { start, end } = self.range;
        let (scale, from, to) = match self.ticks {
            Ticks::Numbers(_) => (AxisScale::Linear, start, end),
            Ticks::Octaves { lowest, .. } => {
                // The data have the values themselves, and the drawing has their octaves.
                let ends = ((start + lowest).exp2(), (end + lowest).exp2());
                (AxisScale::Log, ends.0, ends.1)
            }
        };
        AxisData {
            quantity: self.quantity,
            scale,
            from,
            to,
            names: Vec::new(),
        }
    }
}

/// Formats a value with the decimals that distinguish neighbouring numbers on an axis of length `span`.
fn number(value: f64, span: f64) -> String {
    // There are at least three numbers, so a step is at most half of the span. It may have a second digit, like 0.25.
    let decimals = (1.0 - (span / 2.0).log10().floor()).clamp(0.0, 9.0) as usize;
    without_idle_digits(fixed(value, decimals))
}

/// Formats a value of a grid's axis, with at most three decimals.
pub fn grid_value(value: f64) -> String {
    without_idle_digits(fixed(value, 3))
}

fn without_idle_digits(text: String) -> String {
    if text.contains('.') {
        text.trim_end_matches('0').trim_end_matches('.').to_owned()
    } else {
        text
    }
}

/// Width of the margin on the left of a chart, for the name and the numbers of its vertical axis, shown pixels.
pub const LEFT: u32 = 76;

/// The look of a curve.
#[derive(Clone, Copy)]
pub struct Stroke {
    /// Colour of the curve.
    pub colour: RGBColor,
    /// Thickness of the curve, halves of a shown pixel.
    pub half_pixels: u32,
    /// True if the curve is dashed.
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

/// A chart, and the data that is drawn in it.
pub struct Plot<'a> {
    /// The chart.
    pub chart: Chart<'a>,
    /// Data of the chart.
    pub panel: Panel,
}

impl Plot<'_> {
    /// Draws a curve with ascending x, thinned to what can be seen, and keeps all its points as data.
    pub fn curve(&mut self, name: &str, points: impl Iterator<Item = (f64, f64)>, stroke: Stroke) -> Drawn {
        let points: Vec<(f64, f64)> = points.collect();
        let series = Series::new(name, Kind::Line, stroke.colour, &points);
        self.panel.series.push(series);
        self.path(thinned(points.into_iter()), stroke)
    }

    /// Draws a line through places without adding it to the data.
    pub fn path(&mut self, places: Vec<(f64, f64)>, stroke: Stroke) -> Drawn {
        let style = line(stroke.colour, stroke.half_pixels);
        if stroke.dashed {
            self.chart
                .draw_series(DashedLineSeries::new(places, at(6), at(4), style))?;
        } else {
            self.chart.draw_series(LineSeries::new(places, style))?;
        }
        Ok(())
    }
}

/// Draws the axes of a chart that fills `area`, and starts the data of the panel called `name`.
pub fn axes<'a>(area: &Area<'a>, name: &str, x: &Axis<'_>, y: &Axis<'_>) -> Drawn<Plot<'a>> {
    let bottom = if x.is_blank { 10 } else { 44 };
    let x_label = if x.is_blank { String::new() } else { x.quantity.label() };
    let mut chart = ChartBuilder::on(area)
        .margin_top(px(8))
        .margin_right(px(22))
        .margin_left(px(6))
        .margin_bottom(px(4))
        .x_label_area_size(px(bottom))
        .y_label_area_size(px(LEFT))
        .build_cartesian_2d(x.range.clone(), y.range.clone())?;
    chart
        .configure_mesh()
        .axis_style(line(INK, 2))
        .bold_line_style(line(PALE, 2))
        .light_line_style(TRANSPARENT)
        .set_all_tick_mark_size(px(4))
        .label_style(text(TEXT, INK))
        .axis_desc_style(text(TEXT, INK))
        .x_labels(x.count())
        .y_labels(y.count())
        .x_label_formatter(&|value| x.label(*value))
        .y_label_formatter(&|value| y.label(*value))
        .x_desc(x_label)
        .draw()?;
    // plotters would write the name in one line, however short the axis is.
    let (columns, rows) = chart.plotting_area().get_pixel_range();
    let middle = i32::midpoint(rows.start, rows.end) - area.get_base_pixel().1;
    draw_upwards(area, y.quantity, (at(14), middle), rows.end - rows.start)?;
    let frame = Frame {
        left: columns.start,
        top: rows.start,
        right: columns.end,
        bottom: rows.end,
    };
    let panel = Panel::new(name, frame, x.data(), y.data());
    Ok(Plot { chart, panel })
}

/// Writes a quantity upwards, centred at a place: in one line, or in two if one would exceed `length` drawn pixels.
pub fn draw_upwards(area: &Area<'_>, quantity: Quantity, (x, y): (i32, i32), length: i32) -> Drawn {
    let label = quantity.label();
    let fits = quantity.unit.is_empty() || text_width(&label, TEXT) <= length;
    let lines = if fits {
        vec![label]
    } else {
        vec![format!("{},", quantity.name), quantity.unit.to_owned()]
    };
    let style = centred(TEXT, INK).transform(FontTransform::Rotate270);
    for (index, text) in lines.iter().enumerate() {
        area.draw_text(text, &style, (x + at(TEXT + 2) * index as i32, y))?;
    }
    Ok(())
}

/// Width of the column that holds a colour bar, shown pixels.
pub const BAR: u32 = 116;

/// Draws the scale beside a map, from `top` to `bottom`: its colours from 0 to 1, the `values` written at fractions of
/// it, and the quantity.
pub fn colour_bar(
    area: &Area<'_>,
    (top, bottom): (i32, i32),
    colour: impl Fn(f64) -> RGBColor,
    values: &[(f64, String)],
    quantity: Quantity,
) -> Drawn {
    const STEPS: i32 = 48;
    for step in 0..STEPS {
        let y = |step: i32| bottom - (bottom - top) * step / STEPS;
        let share = (f64::from(step) + 0.5) / f64::from(STEPS);
        // Each cell overlaps the one below, so that no gap shows between them.
        let cell = [(at(4), y(step + 1)), (at(20), (y(step) + at(2)).min(bottom))];
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

/// Returns a range that includes zero and all finite `values`, with a small margin; 0 to 1 if none differs from zero.
pub fn range_with_zero(values: impl IntoIterator<Item = f64>) -> Range<f64> {
    const ROOM: f64 = 1.06;
    let (mut low, mut high) = (0.0f64, 0.0f64);
    for value in values.into_iter().filter(|value| value.is_finite()) {
        (low, high) = (low.min(value), high.max(value));
    }
    if low < high { low * ROOM..high * ROOM } else { 0.0..1.0 }
}

/// Returns the range symmetric about zero that includes all finite `values`, with a small margin; -1 to 1 if none
/// differs from zero.
pub fn range_around_zero(values: impl IntoIterator<Item = f64>) -> Range<f64> {
    let most = range_with_zero(values.into_iter().map(f64::abs)).end;
    -most..most
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_written_without_idle_digits_and_tell_ticks_apart() {
        for (value, span, text) in [
            (0.0, 1.0, "0"),
            (-0.0, 1.0, "0"),
            (0.300_000_04, 1.0, "0.3"),
            (1000.0, 2500.0, "1000"),
            (0.25, 0.5, "0.25"),
            (0.0012, 0.003, "0.0012"),
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
            let mut finite = values.iter().filter(|value| value.is_finite());
            assert!(finite.all(|value| range.contains(value)));
        }
    }

    #[test]
    fn a_picture_has_the_size_and_the_heading_asked_for_and_nothing_that_ends_it_early() {
        let caption = Caption::new("a < b & \"c\"", true);
        let svg = picture(&caption, (300, 200), |_| Ok(Vec::new())).unwrap();
        let opening = "<svg xmlns=\"http://www.w3.org/2000/svg\" class=\"plot\" font-family=\"sans-serif\" \
             role=\"img\" \
             aria-label=\"a &lt; b &amp; &quot;c&quot; (SIMULATED)\" width=\"300\" height=\"200\" \
             viewBox=\"0 0 600 400\">";
        assert!(svg.as_str().starts_with(opening), "{}", svg.as_str());
        assert!(svg.as_str().trim_end().ends_with("</svg>"));
        for tag in ["<svg", "</svg>"] {
            assert_eq!(svg.as_str().matches(tag).count(), 2, "plotters' and the picture's own");
        }
    }
}
