//! A quantity over the grid of speeds and forces.

use model_format::NodeFlags;
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use stylus_support::number::fixed;
use stylus_support::{Error, Result};

use super::canvas::{
    Area, BAR, Drawn, INK, Mark, ON_PALE, PALE, Swatch, TEXT, at, centred, colour_bar, draw_upwards, grid_value,
    legend, picture, text_width,
};
use super::colours::{SHADES, shade};
use super::curves::NARROW;
use super::figure::{AxisData, FORCE, Frame, Panel, Quantity, SPEED, Series};
use super::{Caption, Svg};

/// A quantity over a texture's grid.
#[derive(Clone, Debug, PartialEq)]
pub struct GridMap<'a> {
    /// Name of the texture, whose nodes a page may play.
    pub texture: &'a str,
    /// Tangential speeds, mm/s, ascending.
    pub speeds_mm_s: &'a [f64],
    /// Normal forces, N, ascending.
    pub forces_n: &'a [f64],
    /// Cells of the map, speed-major: as many as speeds times forces.
    pub cells: &'a [GridCell],
    /// Quantity of the values.
    pub quantity: Quantity,
    /// Colours of the values. All maps that are compared share one scale.
    pub scale: Scale,
}

/// One node of a map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GridCell {
    /// The value, at least zero, if there is one.
    pub value: Option<f64>,
    /// Flags of the node, which the map marks.
    pub flags: NodeFlags,
}

/// Width of a map in a report, shown pixels.
pub const WIDE: u32 = 960;

/// Number of decimals of the values that are written.
const DECIMALS: usize = 1;

/// Flags with their marks and meanings.
const MARKS: [(NodeFlags, Mark, &str); 3] = [
    (NodeFlags::INTERPOLATED, Mark::Corner, "interpolated, not recorded"),
    (
        NodeFlags::EXTRAPOLATED,
        Mark::HollowCorner,
        "extrapolated, not recorded",
    ),
    (NodeFlags::DOUBTFUL, Mark::Dot, "doubtful recording"),
];

/// Draws a heat map `width` shown pixels wide. Values are written in the cells where they fit, and run from pale at
/// zero to dark at the largest. Marks show nodes that are not fitted to good recordings: interpolated, extrapolated or
/// doubtful. A silent node without a value has a word in place of a mark.
///
/// # Errors
/// The number of cells is not the number of nodes, or is zero, or the picture cannot be laid out.
pub fn grid_map(caption: &Caption<'_>, map: &GridMap<'_>, width: u32) -> Result<Svg> {
    let (columns, rows) = (map.speeds_mm_s.len(), map.forces_n.len());
    // The layout divides by the numbers of columns and rows.
    if map.cells.len() != columns * rows || map.cells.is_empty() {
        return Err(Error::Request(format!(
            "a map of {columns} speeds by {rows} forces cannot show {} cells",
            map.cells.len()
        )));
    }
    let marks: Vec<_> = MARKS
        .into_iter()
        .filter(|(flag, ..)| map.cells.iter().any(|cell| cell.flags.contains(*flag)))
        .collect();
    let entries: Vec<_> = marks
        .iter()
        .map(|&(_, mark, name)| (Swatch::Mark(mark), name))
        .collect();
    // Rows are high enough for a number, as far as the height fits a page.
    let height = (130 + 30 * rows as u32).clamp(280, 640);
    picture(caption, (width, height), |area| {
        let (chart, bar) = legend(area, &entries)?.split_horizontally(at(width - BAR));
        let layout = Layout::new(&chart, columns, rows);
        for (index, cell) in map.cells.iter().enumerate() {
            let place = layout.cell(index / rows, index % rows);
            draw_cell(&chart, place, cell, map.scale)?;
            for (_, mark, _) in marks.iter().filter(|(flag, ..)| cell.flags.contains(*flag)) {
                mark.draw(&chart, place[0], place[1])?;
            }
        }
        layout.draw_axes(&chart, map)?;
        map.scale.draw(&bar, map.quantity)?;
        Ok(vec![panel(map, layout.frame(&chart))])
    })
}

/// Draws axes without names and the bar of `scale`, for a map whose cells a page draws. The data has one cell, whose
/// value is the end of the scale.
pub fn map_axes(caption: &Caption<'_>, quantity: Quantity, scale: Scale) -> Result<Svg> {
    picture(caption, (NARROW, 340), |area| {
        let (chart, bar) = area.split_horizontally(at(NARROW - BAR));
        let layout = Layout::new(&chart, 1, 1);
        layout.draw_titles(&chart)?;
        let [x, y] = [SPEED, FORCE].map(|axis| AxisData::of_cells(axis, Vec::new()));
        let mut panel = Panel::new("", layout.frame(&chart), x, y);
        let end = Series::cells(quantity, (1, 1), vec![scale.end], Vec::new());
        panel.series.push(end);
        scale.draw(&bar, quantity)?;
        Ok(vec![panel])
    })
}

/// Returns the data of a map that is drawn in a frame.
fn panel(map: &GridMap<'_>, frame: Frame) -> Panel {
    let names = |values: &[f64]| values.iter().map(|value| grid_value(*value)).collect();
    let x = AxisData::of_cells(SPEED, names(map.speeds_mm_s));
    let y = AxisData::of_cells(FORCE, names(map.forces_n));
    let note = |cell: &GridCell| {
        // A silent node has a word in its cell and no mark, so it is not among `MARKS`.
        MARKS
            .map(|(flag, _, name)| (flag, name))
            .into_iter()
            .chain([(NodeFlags::SILENT, "silent")])
            .filter(|(flag, _)| cell.flags.contains(*flag))
            .map(|(_, name)| name)
            .collect::<Vec<&str>>()
            .join("; ")
    };
    let values = map.cells.iter().map(|cell| cell.value.unwrap_or(f64::NAN));
    let mut panel = Panel::new("", frame, x, y);
    panel.series.push(Series::cells(
        map.quantity,
        (map.speeds_mm_s.len(), map.forces_n.len()),
        values.collect(),
        map.cells.iter().map(note).collect(),
    ));
    panel.play = Some(map.texture.to_owned());
    panel
}

/// Draws one cell without its marks.
fn draw_cell(area: &Area<'_>, place: [(i32, i32); 2], cell: &GridCell, scale: Scale) -> Drawn {
    let [(left, top), (right, bottom)] = place;
    let value = cell.value.filter(|value| value.is_finite());
    let colour = value.map_or(PALE, |value| scale.colour(value));
    area.draw(&Rectangle::new(place, colour.filled()))?;
    let written = match value {
        Some(value) => fixed(value, DECIMALS),
        None if cell.flags.contains(NodeFlags::SILENT) => "silent".to_owned(),
        None => "–".to_owned(),
    };
    if text_width(&written, TEXT) < right - left && at(TEXT) < bottom - top {
        let ink = match value {
            Some(_) if luma(colour) < 140.0 => WHITE,
            Some(_) => ON_PALE,
            None => INK,
        };
        let middle = (i32::midpoint(left, right), i32::midpoint(top, bottom));
        area.draw_text(&written, &centred(TEXT, ink), middle)?;
    }
    Ok(())
}

/// Positions of the cells, in drawn pixels. All cells have one size, because the steps of an axis need not be equal.
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

    /// Returns the rectangle of all cells, relative to the whole picture.
    fn frame(&self, area: &Area<'_>) -> Frame {
        let (left, top) = area.get_base_pixel();
        Frame {
            left: left + self.left,
            top: top + self.top,
            right: left + self.right,
            bottom: top + self.bottom,
        }
    }

    /// Returns the left edge of a speed's column; for the number after the last speed, the right edge of the map.
    fn column(&self, speed: i32) -> i32 {
        // Multiplied first, so that the last column ends at the right edge.
        self.left + (self.right - self.left) * speed / self.columns
    }

    /// Returns the lower edge of a force's row. The lowest force is at the bottom.
    fn row(&self, force: i32) -> i32 {
        self.bottom - (self.bottom - self.top) * force / self.rows
    }

    /// Returns the upper left and the lower right corner of a cell, with a gap to its neighbours.
    fn cell(&self, speed: usize, force: usize) -> [(i32, i32); 2] {
        let (speed, force) = (speed as i32, force as i32);
        [
            (self.column(speed), self.row(force + 1)),
            (self.column(speed + 1) - 2, self.row(force) - 2),
        ]
    }

    fn draw_titles(&self, area: &Area<'_>) -> Drawn {
        let centre = (i32::midpoint(self.left, self.right), self.bottom + at(34));
        area.draw_text(&SPEED.label(), &centred(TEXT, INK), centre)?;
        let middle = (at(14), i32::midpoint(self.top, self.bottom));
        draw_upwards(area, FORCE, middle, self.bottom - self.top)
    }

    fn draw_axes(&self, area: &Area<'_>, map: &GridMap<'_>) -> Drawn {
        // Labels are some cells apart, so that no label touches the next.
        let apart = |needed: i32, cell: i32| (needed.max(1) as usize).div_ceil(cell.max(1) as usize);
        let small = centred(TEXT, INK);
        let labels: Vec<String> = map.speeds_mm_s.iter().map(|v| grid_value(*v)).collect();
        let widest = labels.iter().map(|label| text_width(label, TEXT)).max();
        let step = apart(widest.unwrap_or(0) + at(8), self.column(1) - self.left);
        for (speed, label) in labels.iter().enumerate().step_by(step) {
            let x = i32::midpoint(self.column(speed as i32), self.column(speed as i32 + 1));
            area.draw_text(label, &small, (x, self.bottom + at(12)))?;
        }
        let step = apart(at(TEXT + 3), self.bottom - self.row(1));
        for (force, value) in map.forces_n.iter().enumerate().step_by(step) {
            let y = i32::midpoint(self.row(force as i32), self.row(force as i32 + 1));
            let style = small.pos(Pos::new(HPos::Right, VPos::Center));
            area.draw_text(&grid_value(*value), &style, (self.left - at(8), y))?;
        }
        self.draw_titles(area)
    }
}

/// A scale from values, at least zero, to colours.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Scale {
    end: f64,
}

impl Scale {
    /// Creates the common scale of all maps that show `values`. Its end is rounded up, because it is written beside the
    /// map.
    pub fn of(values: impl Iterator<Item = f64>) -> Self {
        let most = values.filter(|value| value.is_finite()).fold(0.0, f64::max);
        // With half of the highest decade as the step, at most a third of the scale is without values.
        let step = 0.5 * 10f64.powf(most.log10().floor());
        let rounded = (most / step).ceil() * step;
        Self {
            // Without values the step is zero, and this is not a number.
            end: if rounded > 0.0 { rounded } else { 1.0 },
        }
    }

    /// Draws the bar that shows the scale's colours.
    fn draw(self, bar: &Area<'_>, quantity: Quantity) -> Drawn {
        let ends = (at(16), bar.dim_in_pixel().1 as i32 - at(56));
        let value = |share: f64| self.end * share;
        let values = [0.0, 0.5, 1.0].map(|share| (share, fixed(value(share), DECIMALS)));
        let colour = |share| self.colour(value(share));
        colour_bar(bar, ends, colour, &values, quantity)
    }

    /// Returns the colour of a value, one of [`SHADES`].
    fn colour(self, value: f64) -> RGBColor {
        let share = (value / self.end).clamp(0.0, 1.0);
        shade((share * (SHADES - 1) as f64).round() as usize)
    }
}

/// Returns the brightness of a colour, 0 to 255: the luma of ITU-R BT.601.
fn luma(RGBColor(red, green, blue): RGBColor) -> f64 {
    0.299 * f64::from(red) + 0.587 * f64::from(green) + 0.114 * f64::from(blue)
}

#[cfg(test)]
mod tests {
    use super::super::figure::COST;
    use super::*;

    const CAPTION: Caption<'_> = Caption::new("test", false);

    fn cell(value: f64) -> GridCell {
        GridCell {
            value: Some(value),
            flags: NodeFlags::NONE,
        }
    }

    fn drawn(speeds: &[f64], forces: &[f64], cells: &[GridCell], scale: Scale) -> Result<Svg> {
        let map = GridMap {
            texture: "test",
            speeds_mm_s: speeds,
            forces_n: forces,
            cells,
            quantity: COST,
            scale,
        };
        grid_map(&CAPTION, &map, WIDE)
    }

    #[test]
    fn values_are_written_at_their_speed_and_force() {
        let cells = [11.0, 12.0, 21.0, 22.0, 31.0, 32.0].map(cell);
        let scale = Scale::of([32.0].into_iter());
        let svg = drawn(&[20.0, 40.0, 60.0], &[0.2, 0.4], &cells, scale).unwrap();
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
            // Adjacent cells have a gap of one or two pixels.
            assert!((place(text).0 - place(speed).0).abs() <= 2, "{text}");
            assert!((place(text).1 - place(force).1).abs() <= 2, "{text}");
        }
    }

    #[test]
    fn nodes_without_a_good_recording_are_marked_and_the_marks_are_explained() {
        let scale = Scale::of([2.0].into_iter());
        let of = |flags| {
            let marked = GridCell { flags, ..cell(2.0) };
            drawn(&[20.0, 40.0], &[0.2], &[cell(1.0), marked], scale)
                .unwrap()
                .as_str()
                .split("<g class=\"axes\"")
                .next()
                .unwrap()
                .to_owned()
        };
        for (flag, _, name) in MARKS {
            assert!(!of(NodeFlags::NONE).contains(name));
            let svg = of(flag);
            assert!(svg.contains(name));
            // Once in the map and once in the legend.
            let marks = svg.matches("<polygon").count() + svg.matches("<circle").count();
            assert_eq!(marks, 2, "{name}");
        }
    }

    #[test]
    fn maps_of_one_scale_show_equal_values_in_equal_colours_and_with_equal_bars() {
        let scale = Scale::of([3.0, 4.0, 40.0].into_iter());
        let of = |values: [f64; 2]| drawn(&[20.0, 40.0], &[0.2], &values.map(cell), scale).unwrap();
        let RGBColor(red, green, blue) = scale.colour(4.0);
        let colour = format!("fill=\"#{red:02X}{green:02X}{blue:02X}\"");
        for svg in [of([3.0, 4.0]), of([4.0, 40.0])] {
            for value in ["0.0", "20.0", "40.0"] {
                assert!(svg.as_str().contains(&format!(">\n{value}\n<")), "{value}");
            }
            assert!(svg.as_str().contains(&colour));
        }
    }

    #[test]
    fn cells_that_do_not_fill_the_grid_are_refused() {
        let scale = Scale::of(std::iter::empty());
        assert!(drawn(&[20.0, 40.0], &[0.2, 0.4], &[cell(1.0); 3], scale).is_err());
        assert!(drawn(&[], &[], &[], scale).is_err());
    }
}
