//! The parts that all pictures share: size, colours, lettering, heading, legend and axes.
//!
//! plotters draws at whole pixels, which is coarse for a curve, so pictures are drawn [`SCALE`] times as large as they
//! are shown.

use std::error::Error as StdError;
use std::ops::Range;

use plotters::coord::Shift;
use plotters::coord::types::RangedCoordf64;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::{Caption, Svg};
use crate::support::error::{Error, Result};
use crate::support::visible::visible;

/// Pixels drawn for a pixel shown.
const SCALE: u32 = 2;

/// The area that a picture is drawn on.
pub type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;

/// The result of drawing, which fails only where a picture is laid out wrongly.
pub type Drawn<T = ()> = std::result::Result<T, Box<dyn StdError>>;

/// Colours of Okabe and Ito, told apart with any colour vision, on white.
pub const BLUE: RGBColor = RGBColor(0, 114, 178);
/// See [`BLUE`].
pub const VERMILION: RGBColor = RGBColor(213, 94, 0);
/// See [`BLUE`].
pub const GREEN: RGBColor = RGBColor(0, 158, 115);
/// See [`BLUE`].
pub const PURPLE: RGBColor = RGBColor(204, 121, 167);
/// See [`BLUE`].
pub const ORANGE: RGBColor = RGBColor(230, 159, 0);
/// See [`BLUE`].
pub const SKY: RGBColor = RGBColor(86, 180, 233);
/// Text and axes.
pub const INK: RGBColor = RGBColor(40, 40, 40);
/// Lines of a mesh and what is not there.
pub const PALE: RGBColor = RGBColor(225, 225, 225);

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

/// About how wide `text` comes out in lettering `shown` pixels high, drawn pixels. The reader's font is not known.
pub fn text_width(text: &str, shown: u32) -> i32 {
    (text.chars().count() as f64 * f64::from(px(shown)) * 0.56) as i32
}

/// Makes a picture: its heading, and below it what `draw` draws.
///
/// # Errors
/// A picture that plotters cannot lay out.
pub fn picture(
    caption: &Caption<'_>,
    (width, height): (u32, u32),
    draw: impl FnOnce(&Area<'_>) -> Drawn,
) -> Result<Svg> {
    let mut drawn = String::new();
    let outcome = (|| -> Drawn {
        let root = SVGBackend::with_string(&mut drawn, (px(width), px(height))).into_drawing_area();
        root.fill(&WHITE)?;
        let (heading, below) = root.split_vertically(px(HEADING));
        heading.draw_text(caption.title, &bold(16, INK), (at(10), at(HEADING / 2 + 2)))?;
        if caption.simulated {
            let style = bold(14, VERMILION).pos(Pos::new(HPos::Right, VPos::Center));
            heading.draw_text("SIMULATED", &style, (at(width - 10), at(HEADING / 2 + 2)))?;
        }
        draw(&below)?;
        root.present()?;
        Ok(())
    })();
    outcome.map_err(|error| {
        Error::Request(format!(
            "the picture '{}' cannot be drawn: {error}",
            caption.title
        ))
    })?;
    let shown = shown_at_size(&drawn, width, height);
    // Only texts hold such characters, and a picture that holds them is not XML.
    Ok(Svg(visible(&shown).into_owned()))
}

/// Bold [`text`].
fn bold(shown: u32, colour: RGBColor) -> TextStyle<'static> {
    let mut style = text(shown, colour);
    style.font = style.font.style(FontStyle::Bold);
    style
}

/// Replaces the opening tag of a drawing by one that shows it at the size asked for.
fn shown_at_size(drawn: &str, width: u32, height: u32) -> String {
    let content = drawn
        .split_once(">\n")
        .map_or(drawn, |(_, content)| content);
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" \
         viewBox=\"0 0 {} {}\">\n{content}",
        px(width),
        px(height)
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
            Self::Corner => area.draw(&Polygon::new(corner, INK.filled()))?,
            Self::HollowCorner => {
                area.draw(&Polygon::new(corner, WHITE.filled()))?;
                area.draw(&PathElement::new(corner, line(INK, 2)))?;
            }
            Self::Dot => {
                let place = (right - size * 2 / 3, top + size * 2 / 3);
                area.draw(&Circle::new(place, size * 2 / 5, VERMILION.filled()))?;
            }
            Self::Ring => area.draw(&Circle::new(middle, at(5), line(INK, 3)))?,
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
    /// The quantity with its unit; empty where a neighbour's axis tells.
    pub quantity: &'a str,
    /// Ticks along it.
    pub ticks: Ticks<'a>,
}

/// The quantity along an axis.
pub enum Ticks<'a> {
    /// About so many numbers, at round values.
    Numbers(usize),
    /// About so many lines of the mesh, with nothing written.
    Blank(usize),
    /// A name at 0, at 1, and so on.
    Names(&'a [&'a str]),
}

impl Ticks<'_> {
    /// About how many there are to be; plotters takes the roundest step that does not give more.
    fn count(&self) -> usize {
        match self {
            Self::Numbers(count) | Self::Blank(count) => *count,
            Self::Names(names) => names.len() + 1,
        }
    }

    fn label(&self, value: f64, span: f64) -> String {
        match self {
            Self::Numbers(_) => number(value, span),
            Self::Blank(_) => String::new(),
            Self::Names(names) => {
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
    let text = format!("{value:.decimals$}");
    let text = if text.contains('.') {
        text.trim_end_matches('0').trim_end_matches('.')
    } else {
        &text
    };
    if text == "-0" {
        "0".to_owned()
    } else {
        text.to_owned()
    }
}

/// Draws the axes of a chart, which fills `area`.
pub fn axes<'a>(area: &Area<'a>, x: &Axis<'_>, y: &Axis<'_>) -> Drawn<Chart<'a>> {
    let bottom = if x.quantity.is_empty() { 10 } else { 44 };
    let mut chart = ChartBuilder::on(area)
        .margin_top(px(8))
        .margin_right(px(22))
        .margin_left(px(6))
        .margin_bottom(px(4))
        .x_label_area_size(px(bottom))
        .y_label_area_size(px(62))
        .build_cartesian_2d(x.range.clone(), y.range.clone())?;
    let span = |axis: &Axis<'_>| axis.range.end - axis.range.start;
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
        .x_desc(x.quantity)
        .y_desc(y.quantity)
        .draw()?;
    Ok(chart)
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

/// At most `MAX_POINTS` points that look like `points`, whose x rise: of each of equal shares, in their order, the
/// lowest and the highest. What is not finite is left out.
pub fn thinned(points: impl Iterator<Item = (f64, f64)>) -> Vec<(f64, f64)> {
    const MAX_POINTS: usize = 1500;
    let points: Vec<(f64, f64)> = points
        .filter(|(x, y)| x.is_finite() && y.is_finite())
        .collect();
    if points.len() <= MAX_POINTS {
        return points;
    }
    let share = points.len().div_ceil(MAX_POINTS / 2);
    let extremes = points.chunks(share).flat_map(|chunk| {
        let by_y = |a: &&(f64, f64), b: &&(f64, f64)| a.1.total_cmp(&b.1);
        let lowest = chunk.iter().min_by(by_y);
        let highest = chunk.iter().max_by(by_y);
        let mut both: Vec<(f64, f64)> = lowest.into_iter().chain(highest).copied().collect();
        both.sort_by(|a, b| a.0.total_cmp(&b.0));
        both
    });
    extremes.collect()
}

#[cfg(test)]
pub mod tests {
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
        let svg = picture(&caption, (300, 200), |_| Ok(())).unwrap();
        let opening = "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"300\" height=\"200\" viewBox=\"0 0 600 400\">";
        assert!(svg.as_str().starts_with(opening));
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
            |_| Ok(()),
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
            picture(&caption, (300, 200), |area| {
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
