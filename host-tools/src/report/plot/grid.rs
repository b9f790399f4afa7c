//! A quantity over the grid of speeds and forces.

use model_format::NodeFlags;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::canvas::{
    Area, BAR, Drawn, FORCE, INK, Mark, ON_PALE, PALE, Quantity, SPEED, Swatch, TEXT, at, centred,
    colour_bar, draw_upwards, grid_value, legend, picture, text_width,
};
use super::figure::{AxisData, Panel, Series};
use super::labels::Frame;
use super::{Caption, Svg};
use crate::support::decimal::fixed;
use crate::support::error::{Error, Result};

/// A quantity over a texture's grid.
#[derive(Clone, Debug, PartialEq)]
pub struct GridMap<'a> {
    /// The texture, whose nodes a page may play.
    pub texture: &'a str,
    /// Tangential speeds, mm/s, ascending.
    pub speeds_mm_s: &'a [f64],
    /// Normal forces, N, ascending.
    pub forces_n: &'a [f64],
    /// Speed-major, as many as there are speeds times forces.
    pub cells: &'a [GridCell],
    /// The values' quantity.
    pub quantity: Quantity<'a>,
    /// Their colours: one scale for all maps that are compared.
    pub scale: Scale,
    /// Digits after the point of the values written.
    pub decimals: usize,
}

/// One node of a map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GridCell {
    /// The value, where there is one.
    pub value: Option<f64>,
    /// Flags of the node, which are marked.
    pub flags: NodeFlags,
}

/// A heat map with the values in its cells, where they fit, and marks at nodes that are not fitted to good recordings:
/// silent, interpolated, extrapolated or doubtful.
///
/// Values go from pale at zero to dark at the largest; where some are negative, blue is below zero and vermilion
/// above.
///
/// # Errors
/// Cells that are not as many as the grid has nodes, and that the picture cannot be laid out.
pub fn grid_map(caption: &Caption<'_>, map: &GridMap<'_>) -> Result<Svg> {
    grid_map_of_width(caption, map, 960)
}

/// A [`grid_map`] `width` shown pixels wide.
///
/// # Errors
/// As [`grid_map`].
pub(super) fn grid_map_of_width(
    caption: &Caption<'_>,
    map: &GridMap<'_>,
    width: u32,
) -> Result<Svg> {
    let (columns, rows) = (map.speeds_mm_s.len(), map.forces_n.len());
    if map.cells.len() != columns * rows || map.cells.is_empty() {
        return Err(Error::Request(format!(
            "a map of {columns} speeds by {rows} forces cannot show {} cells",
            map.cells.len()
        )));
    }
    let known = [
        (
            NodeFlags::INTERPOLATED,
            Mark::Corner,
            "interpolated, not recorded",
        ),
        (
            NodeFlags::EXTRAPOLATED,
            Mark::HollowCorner,
            "extrapolated, not recorded",
        ),
        (NodeFlags::DOUBTFUL, Mark::Dot, "doubtful recording"),
    ];
    let marks: Vec<_> = known
        .into_iter()
        .filter(|(flag, ..)| map.cells.iter().any(|cell| cell.flags.contains(*flag)))
        .collect();
    let entries: Vec<_> = marks
        .iter()
        .map(|&(_, mark, name)| (Swatch::Mark(mark), name))
        .collect();
    // Rows high enough for a number, within what fits a page.
    let height = (130 + 30 * rows as u32).clamp(280, 640);
    picture(caption, (width, height), |area, panels| {
        let below = if entries.is_empty() {
            area.clone()
        } else {
            legend(area, &entries)?
        };
        let (chart, bar) = below.split_horizontally(at(width - BAR));
        let layout = Layout::new(&chart, columns, rows);
        for (index, cell) in map.cells.iter().enumerate() {
            let place = layout.cell(index / rows, index % rows);
            draw_cell(&chart, place, cell, map.scale, map.decimals)?;
            for (flag, mark, _) in &marks {
                if cell.flags.contains(*flag) {
                    mark.draw(&chart, place[0], place[1])?;
                }
            }
        }
        layout.draw_axes(&chart, map)?;
        panels.push(panel(map, layout.frame(&chart)));
        draw_bar(&bar, map)
    })
}

/// The data of a map that is drawn in a frame.
fn panel(map: &GridMap<'_>, frame: Frame) -> Panel {
    let names = |values: &[f64]| values.iter().map(|value| grid_value(*value)).collect();
    let x = AxisData::of_cells(SPEED, names(map.speeds_mm_s));
    let y = AxisData::of_cells(FORCE, names(map.forces_n));
    let cells = map.cells.iter();
    let values = cells.clone().map(|cell| cell.value.unwrap_or(f64::NAN));
    let size = (map.speeds_mm_s.len(), map.forces_n.len());
    let series = Series::cells(
        map.quantity,
        size,
        values.collect(),
        cells.map(flags_in_words).collect(),
    );
    let mut panel = Panel::new("", frame, x, y);
    panel.series.push(series);
    panel.plays = Some(map.texture.to_owned());
    panel
}

fn flags_in_words(cell: &GridCell) -> String {
    let known = [
        (NodeFlags::SILENT, "silent"),
        (NodeFlags::INTERPOLATED, "interpolated"),
        (NodeFlags::EXTRAPOLATED, "extrapolated"),
        (NodeFlags::DOUBTFUL, "doubtful recording"),
    ];
    let set = known
        .iter()
        .filter(|(flag, _)| cell.flags.contains(*flag))
        .map(|(_, name)| *name);
    set.collect::<Vec<&str>>().join(", ")
}

/// Draws one cell without its marks.
fn draw_cell(
    area: &Area<'_>,
    place: [(i32, i32); 2],
    cell: &GridCell,
    scale: Scale,
    decimals: usize,
) -> Drawn {
    let [(left, top), (right, bottom)] = place;
    let value = cell.value.filter(|value| value.is_finite());
    let colour = value.map_or(PALE, |value| scale.colour(value));
    area.draw(&Rectangle::new(place, colour.filled()))?;
    let written = match value {
        Some(value) => fixed(value, decimals),
        None if cell.flags.contains(NodeFlags::SILENT) => "silent".to_owned(),
        None => "–".to_owned(),
    };
    let fits = text_width(&written, TEXT) < right - left && at(TEXT) < bottom - top;
    if fits {
        let ink = match value {
            Some(_) if is_dark(colour) => WHITE,
            Some(_) => ON_PALE,
            None => INK,
        };
        let middle = (i32::midpoint(left, right), i32::midpoint(top, bottom));
        area.draw_text(&written, &centred(TEXT, ink), middle)?;
    }
    Ok(())
}

/// Places of cells, in drawn pixels. All have one size, because axes need not have equal steps.
struct Layout {
    left: i32,
    top: i32,
    right: i32,
    bottom: i32,
    columns: i32,
    rows: i32,
}

impl Layout {
    fn new(area: &Area<'_>, columns: usize, rows: usize) -> Self {
        let (width, height) = area.dim_in_pixel();
        Self {
            left: at(64),
            top: at(8),
            right: width as i32 - at(10),
            bottom: height as i32 - at(48),
            columns: columns as i32,
            rows: rows as i32,
        }
    }

    /// The rectangle of all cells in the picture.
    fn frame(&self, area: &Area<'_>) -> Frame {
        let (left, top) = area.get_base_pixel();
        Frame {
            left: left + self.left,
            top: top + self.top,
            right: left + self.right,
            bottom: top + self.bottom,
        }
    }

    /// Left edge of a column; that of the one after the last is the right edge of all.
    fn column(&self, speed: i32) -> i32 {
        self.left + (self.right - self.left) * speed / self.columns
    }

    /// Lower edge of a row, the lowest force at the bottom.
    fn row(&self, force: i32) -> i32 {
        self.bottom - (self.bottom - self.top) * force / self.rows
    }

    /// Upper left and lower right corner, with a gap to the neighbours.
    fn cell(&self, speed: usize, force: usize) -> [(i32, i32); 2] {
        let (speed, force) = (speed as i32, force as i32);
        [
            (self.column(speed), self.row(force + 1)),
            (self.column(speed + 1) - 2, self.row(force) - 2),
        ]
    }

    fn draw_axes(&self, area: &Area<'_>, map: &GridMap<'_>) -> Drawn {
        let small = centred(TEXT, INK);
        let labels: Vec<String> = map.speeds_mm_s.iter().map(|v| grid_value(*v)).collect();
        let widest = labels
            .iter()
            .map(|label| text_width(label, TEXT))
            .max()
            .unwrap_or(0);
        let step = labels_apart(widest + at(8), (self.right - self.left) / self.columns);
        for (speed, label) in labels.iter().enumerate().step_by(step) {
            let x = i32::midpoint(self.column(speed as i32), self.column(speed as i32 + 1));
            area.draw_text(label, &small, (x, self.bottom + at(12)))?;
        }
        let step = labels_apart(at(TEXT + 3), (self.bottom - self.top) / self.rows);
        for (force, value) in map.forces_n.iter().enumerate().step_by(step) {
            let y = i32::midpoint(self.row(force as i32), self.row(force as i32 + 1));
            let style = small.pos(Pos::new(HPos::Right, VPos::Center));
            area.draw_text(&grid_value(*value), &style, (self.left - at(8), y))?;
        }
        let centre = (i32::midpoint(self.left, self.right), self.bottom + at(34));
        area.draw_text(&SPEED.label(), &small, centre)?;
        let middle = (at(14), i32::midpoint(self.top, self.bottom));
        draw_upwards(area, FORCE, middle, self.bottom - self.top)
    }
}

/// Every how many cells a label stands, so that none touches the next.
pub(super) fn labels_apart(needed: i32, cell: i32) -> usize {
    (needed.max(1) as usize).div_ceil(cell.max(1) as usize)
}

/// Draws what the colours stand for.
fn draw_bar(area: &Area<'_>, map: &GridMap<'_>) -> Drawn {
    let (_, height) = area.dim_in_pixel();
    let ends = (at(16), height as i32 - at(56));
    let Scale { start, end } = map.scale;
    let value = |share: f64| start + (end - start) * share;
    let values = [0.0, 0.5, 1.0].map(|share| (share, fixed(value(share), map.decimals)));
    let colour = |share| map.scale.colour(value(share));
    colour_bar(area, ends, colour, &values, map.quantity)
}

/// The next value with half a unit of the first digit, because the ends of a scale are written.
fn round_up(value: f64) -> f64 {
    let step = 0.5 * 10f64.powf(value.log10().floor());
    let rounded = (value / step).ceil() * step;
    if rounded.is_finite() { rounded } else { value }
}

/// From values to colours.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scale {
    start: f64,
    end: f64,
}

impl Scale {
    /// The scale of all maps that show `values` together.
    pub fn of(values: impl Iterator<Item = f64>) -> Self {
        let (mut low, mut high) = (0.0f64, 0.0f64);
        for value in values.filter(|value| value.is_finite()) {
            (low, high) = (low.min(value), high.max(value));
        }
        let (start, end) = if low < 0.0 {
            // Zero in the middle, so that equal errors of either sign are equally strong.
            let largest = round_up(high.max(-low));
            (-largest, largest)
        } else if high > 0.0 {
            (0.0, round_up(high))
        } else {
            (0.0, 1.0)
        };
        Self { start, end }
    }

    fn colour(self, value: f64) -> RGBColor {
        // Not those of lines, which a dark screen replaces.
        const BELOW: RGBColor = RGBColor(0, 113, 178);
        const ABOVE: RGBColor = RGBColor(212, 94, 0);
        const WHITISH: RGBColor = RGBColor(247, 247, 247);
        const DARK: RGBColor = RGBColor(8, 48, 107);
        if self.start < 0.0 {
            let strength = (value / self.end).clamp(-1.0, 1.0);
            let end = if strength < 0.0 { BELOW } else { ABOVE };
            return mixed(WHITISH, end, strength.abs());
        }
        let strength = (value / self.end).clamp(0.0, 1.0);
        // By way of the palette's blue the scale is even to the eye.
        if strength < 0.5 {
            mixed(WHITISH, RGBColor(91, 163, 207), 2.0 * strength)
        } else {
            mixed(RGBColor(91, 163, 207), DARK, 2.0 * strength - 1.0)
        }
    }
}

pub(super) fn mixed(from: RGBColor, to: RGBColor, part: f64) -> RGBColor {
    let mix = |from: u8, to: u8| {
        (f64::from(from) + (f64::from(to) - f64::from(from)) * part).round() as u8
    };
    RGBColor(mix(from.0, to.0), mix(from.1, to.1), mix(from.2, to.2))
}

/// Returns whether white is easier to read on a colour than ink.
pub(super) fn is_dark(colour: RGBColor) -> bool {
    luma(colour) < 140.0
}

/// Returns the brightness of a colour, 0 to 255: the luma of ITU-R BT.601.
fn luma(RGBColor(red, green, blue): RGBColor) -> f64 {
    0.299 * f64::from(red) + 0.587 * f64::from(green) + 0.114 * f64::from(blue)
}

#[cfg(test)]
mod tests {
    use super::super::canvas::COST;
    use super::super::canvas::tests::assert_drawn_within;
    use super::*;
    use proptest::prelude::*;

    const CAPTION: Caption<'_> = Caption {
        title: "test",
        simulated: false,
    };

    fn map<'a>(speeds_mm_s: &'a [f64], forces_n: &'a [f64], cells: &'a [GridCell]) -> GridMap<'a> {
        GridMap {
            texture: "test",
            speeds_mm_s,
            forces_n,
            cells,
            quantity: COST,
            scale: Scale::of(cells.iter().filter_map(|cell| cell.value)),
            decimals: 1,
        }
    }

    fn cell(value: f64) -> GridCell {
        GridCell {
            value: Some(value),
            flags: NodeFlags::NONE,
        }
    }

    #[test]
    fn values_are_written_at_their_speed_and_force() {
        let cells = [
            cell(11.0),
            cell(12.0),
            cell(21.0),
            cell(22.0),
            cell(31.0),
            cell(32.0),
        ];
        let svg = grid_map(&CAPTION, &map(&[20.0, 40.0, 60.0], &[0.2, 0.4], &cells)).unwrap();
        assert_drawn_within(&svg, 960, 280);
        let place = |text: &str| -> (i32, i32) {
            let (before, _) = svg.as_str().split_once(&format!(">\n{text}\n<")).unwrap();
            let element = before.rsplit('<').next().unwrap();
            let number = |name: &str| {
                let (_, value) = element.split_once(name).unwrap();
                value.split('"').next().unwrap().parse().unwrap()
            };
            (number(" x=\""), number(" y=\""))
        };
        for (text, speed, force) in [
            ("11.0", "20", "0.2"),
            ("12.0", "20", "0.4"),
            ("22.0", "40", "0.4"),
            ("31.0", "60", "0.2"),
        ] {
            // Cells leave a gap of a pixel or two to their neighbours.
            assert!((place(text).0 - place(speed).0).abs() <= 2, "{text}");
            assert!((place(text).1 - place(force).1).abs() <= 2, "{text}");
        }
    }

    #[test]
    fn nodes_without_a_good_recording_are_marked_and_the_marks_are_explained() {
        let plain = [cell(1.0), cell(2.0)];
        let of =
            |cells: &[GridCell]| grid_map(&CAPTION, &map(&[20.0, 40.0], &[0.2], cells)).unwrap();
        for (flags, name) in [
            (NodeFlags::INTERPOLATED, "interpolated, not recorded"),
            (NodeFlags::EXTRAPOLATED, "extrapolated, not recorded"),
            (NodeFlags::DOUBTFUL, "doubtful recording"),
        ] {
            assert!(!of(&plain).as_str().contains(name));
            let svg = of(&[plain[0], GridCell { flags, ..plain[1] }]);
            assert!(svg.as_str().contains(name));
            // In the map and in the legend.
            let marks =
                svg.as_str().matches("<polygon").count() + svg.as_str().matches("<circle").count();
            assert_eq!(marks, 2, "{name}");
        }
        let svg = of(&[
            plain[0],
            GridCell {
                value: None,
                flags: NodeFlags::SILENT,
            },
        ]);
        assert!(svg.as_str().contains("silent"));
    }

    #[test]
    fn maps_of_one_scale_show_equal_values_in_equal_colours_and_with_equal_bars() {
        let (quiet, loud) = ([cell(3.0), cell(4.0)], [cell(4.0), cell(40.0)]);
        let scale = Scale::of(quiet.iter().chain(&loud).filter_map(|cell| cell.value));
        let drawn = |cells: &[GridCell]| {
            let map = GridMap {
                scale,
                ..map(&[20.0, 40.0], &[0.2], cells)
            };
            grid_map(&CAPTION, &map).unwrap().as_str().to_owned()
        };
        let (quiet, loud) = (drawn(&quiet), drawn(&loud));
        let RGBColor(red, green, blue) = scale.colour(4.0);
        let colour = format!("fill=\"#{red:02X}{green:02X}{blue:02X}\"");
        for value in ["0.0", "20.0", "40.0"] {
            assert!(quiet.contains(&format!(">\n{value}\n<")), "{value}");
        }
        assert!(quiet.contains(&colour) && loud.contains(&colour));
    }

    #[test]
    fn no_value_is_minus_zero() {
        let cells = [cell(-0.001), cell(-2.0)];
        let svg = grid_map(&CAPTION, &map(&[20.0, 40.0], &[0.2], &cells)).unwrap();
        assert!(!svg.as_str().contains(">\n-0.0\n<"));
    }

    #[test]
    fn cells_that_do_not_fill_the_grid_are_refused() {
        let cells = [cell(1.0); 3];
        assert!(grid_map(&CAPTION, &map(&[20.0, 40.0], &[0.2, 0.4], &cells)).is_err());
        assert!(grid_map(&CAPTION, &map(&[], &[], &[])).is_err());
    }

    #[test]
    fn a_grid_of_any_size_and_values_can_be_drawn() {
        let axis: Vec<f64> = (1..=64).map(|step| f64::from(step) * 5.0).collect();
        let values = [0.0, -1e300, 1e300, f64::NAN, f64::INFINITY, 3.0];
        for (speeds, forces) in [(1, 1), (64, 1), (1, 64), (64, 64), (15, 8)] {
            let cells: Vec<GridCell> = (0..speeds * forces)
                .map(|index| cell(values[index % values.len()]))
                .collect();
            let svg = grid_map(&CAPTION, &map(&axis[..speeds], &axis[..forces], &cells)).unwrap();
            assert_drawn_within(&svg, 960, (130 + 30 * forces as u32).clamp(280, 640));
        }
    }

    proptest! {
        #[test]
        fn more_is_darker(a in 0.0..10.0f64, b in 0.0..10.0f64) {
            let scale = Scale::of([0.0, 10.0].into_iter());
            let (less, more) = (a.min(b), a.max(b));
            prop_assert!(luma(scale.colour(less)) >= luma(scale.colour(more)) - 1.0);
        }

        #[test]
        fn signs_are_told_apart(value in 1.0..10.0f64) {
            let scale = Scale::of([-3.0, 10.0].into_iter());
            let (below, above) = (scale.colour(-value), scale.colour(value));
            prop_assert!(below.2 > below.0 && above.0 > above.2);
        }
    }
}
