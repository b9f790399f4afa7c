//! The map of what `stylus certify` finds in each cell of a texture's grid.
//!
//! Speeds are in mm/s, forces in N, places in drawn pixels, [`at`] per shown pixel.

use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};

use super::canvas::{
    Area, BAR, Drawn, FORCE, INK, Mark, ON_PALE, Quantity, SPEED, Swatch, TEXT, at, centred,
    colour_bar, draw_upwards, grid_value, legend, picture, text_width,
};
use super::figure::{AxisData, Panel, Series};
use super::grid::{is_dark, labels_apart, mixed};
use super::labels::Frame;
use super::{Caption, Svg};
use crate::support::error::{Error, Result};
use crate::texture::certificate::{Cell, Certification, Finding};

const WHITISH: RGBColor = RGBColor(247, 247, 247);
const DARK: RGBColor = RGBColor(8, 48, 107);

/// A cell that fails. No line has this colour, so that it is the same on a dark screen.
const FAILS: RGBColor = RGBColor(190, 76, 0);

/// Decades of 1 - radius over the scale: palest at a radius of 0, darkest from 1 - 10⁻⁵ on.
const DECADES: f64 = 5.0;

/// Draws a map of the cells of `report`.
///
/// A cell shows the largest sampled pole radius (direct form) or the largest reflection coefficient |k| (lattice). It
/// is darker the nearer that value is to one. It is red if it fails: a sampled pole at radius 1 or more, or no
/// proof. In a direct form a cross marks the sampled point of the largest radius. The figure is left out where it does
/// not fit. All cells have one size; the values of an axis stand at the borders of the cells.
///
/// `report.cells` must fill the grid, speed-major, with findings of one structure.
///
/// # Errors
/// A report without cells, or a picture that cannot be laid out.
pub fn certificate_map(caption: &Caption<'_>, report: &Certification) -> Result<Svg> {
    let direct = |cell: &Cell| matches!(cell.finding, Finding::Direct { .. });
    let Some(first) = report.cells.first() else {
        return Err(Error::Request("a map needs a cell to show".to_owned()));
    };
    let quantity = if direct(first) {
        Quantity::new("largest pole radius", "")
    } else {
        Quantity::new("largest reflection |k|", "")
    };
    let mut entries = vec![(Swatch::Box(colour(0.99)), "holds")];
    if report.cells.iter().any(|cell| !cell.holds()) {
        entries.push((Swatch::Box(FAILS), "fails"));
    }
    if direct(first) {
        entries.push((Swatch::Mark(Mark::Cross), "worst point sampled"));
    }
    let layout = Layout::new(report);
    let height = (140 + 34 * layout.rows as u32).clamp(280, 700);
    picture(caption, (960, height), |area, panels| {
        let below = legend(area, &entries)?;
        let (chart, bar) = below.split_horizontally(at(960 - BAR));
        for (index, cell) in report.cells.iter().enumerate() {
            let (speed, force) = (index / layout.rows, index % layout.rows);
            draw_cell(&chart, layout.cell(&chart, speed, force), cell)?;
        }
        layout.draw_axes(&chart, report)?;
        panels.push(panel(report, quantity, &layout, &chart));
        let ends = (at(16), bar.dim_in_pixel().1 as i32 - at(56));
        let radius = |share: f64| 1.0 - 10f64.powf(-share * DECADES);
        let values = (0..=DECADES as usize).map(|decade| {
            let share = decade as f64 / DECADES;
            (share, format!("{:.decade$}", radius(share)))
        });
        let values: Vec<(f64, String)> = values.collect();
        colour_bar(&bar, ends, |share| colour(radius(share)), &values, quantity)
    })
}

/// The data of the map: a cell stands between two speeds and two forces.
fn panel(
    report: &Certification,
    quantity: Quantity<'_>,
    layout: &Layout,
    area: &Area<'_>,
) -> Panel {
    let names = |axis: &[f32]| -> Vec<String> {
        let value = |value: f32| grid_value(f64::from(value));
        match axis {
            [only] => vec![value(*only)],
            _ => axis
                .windows(2)
                .map(|ends| format!("{} to {}", value(ends[0]), value(ends[1])))
                .collect(),
        }
    };
    let (left, top) = area.get_base_pixel();
    let frame = Frame {
        left: left + layout.column(area, 0),
        top: top + layout.row(area, layout.rows),
        right: left + layout.column(area, layout.columns),
        bottom: top + layout.row(area, 0),
    };
    let x = AxisData::of_cells(SPEED, names(&report.speeds_mm_s));
    let y = AxisData::of_cells(FORCE, names(&report.forces_n));
    let verdict = |cell: &Cell| if cell.holds() { "holds" } else { "fails" };
    let mut panel = Panel::new("", frame, x, y);
    panel.series.push(Series::cells(
        quantity,
        (layout.columns, layout.rows),
        report.cells.iter().map(value).collect(),
        report
            .cells
            .iter()
            .map(|cell| verdict(cell).to_owned())
            .collect(),
    ));
    panel
}

/// The radius or coefficient that stands for a cell.
fn value(cell: &Cell) -> f64 {
    match &cell.finding {
        Finding::Lattice { largest_reflection } => *largest_reflection,
        Finding::Direct { worst, .. } => worst.pole_radius,
    }
}

fn colour(radius: f64) -> RGBColor {
    let decades = -(1.0 - radius).max(1e-9).log10();
    mixed(WHITISH, DARK, (decades / DECADES).clamp(0.0, 1.0))
}

fn draw_cell(area: &Area<'_>, place: [(i32, i32); 2], cell: &Cell) -> Drawn {
    let [(left, top), (right, bottom)] = place;
    let colour = if cell.holds() {
        colour(value(cell))
    } else {
        FAILS
    };
    area.draw(&Rectangle::new(place, colour.filled()))?;
    let ink = if is_dark(colour) { WHITE } else { ON_PALE };
    if let Finding::Direct { worst, .. } = &cell.finding {
        let share = |value: f64, [low, high]: [f32; 2]| {
            if low < high {
                (value - f64::from(low)) / f64::from(high - low)
            } else {
                0.5
            }
        };
        // Kept 8 % off the border, because a cross on a border would belong to two cells.
        let along = |from: i32, to: i32, share: f64| {
            from + (f64::from(to - from) * (0.08 + 0.84 * share)).round() as i32
        };
        let x = along(left, right, share(worst.speed_mm_s, cell.speeds_mm_s));
        let y = along(bottom, top, share(worst.force_n, cell.forces_n));
        area.draw(&Cross::new((x, y), at(3), ink.stroke_width(2)))?;
    }
    let written = format!("{:.5}", value(cell));
    let short = format!("{:.3}", value(cell));
    let fits = |text: &str| text_width(text, TEXT) < right - left && at(TEXT) < bottom - top;
    if let Some(text) = [written, short].into_iter().find(|text| fits(text)) {
        let middle = (i32::midpoint(left, right), i32::midpoint(top, bottom));
        area.draw_text(&text, &centred(TEXT, ink), middle)?;
    }
    Ok(())
}

/// Places of cells, in drawn pixels.
struct Layout {
    columns: usize,
    rows: usize,
}

impl Layout {
    fn new(report: &Certification) -> Self {
        let cells = |axis: &[f32]| (axis.len() - 1).max(1);
        Self {
            columns: cells(&report.speeds_mm_s),
            rows: cells(&report.forces_n),
        }
    }

    /// Returns the left edge of a column. The index after the last column gives the right edge of the map.
    fn column(&self, area: &Area<'_>, column: usize) -> i32 {
        let (left, right) = (at(64), area.dim_in_pixel().0 as i32 - at(30));
        left + (right - left) * column as i32 / self.columns as i32
    }

    /// Lower edge of a row, the lowest force at the bottom.
    fn row(&self, area: &Area<'_>, row: usize) -> i32 {
        let (top, bottom) = (at(10), area.dim_in_pixel().1 as i32 - at(48));
        bottom - (bottom - top) * row as i32 / self.rows as i32
    }

    /// Returns the upper left and the lower right corner of a cell, with a gap to its neighbours.
    fn cell(&self, area: &Area<'_>, speed: usize, force: usize) -> [(i32, i32); 2] {
        [
            (self.column(area, speed), self.row(area, force + 1)),
            (self.column(area, speed + 1) - 2, self.row(area, force) - 2),
        ]
    }

    fn draw_axes(&self, area: &Area<'_>, report: &Certification) -> Drawn {
        let small = centred(TEXT, INK);
        // The only value of an axis stands in the middle of the axis.
        let between = |low: i32, high: i32, alone: bool| {
            if alone { i32::midpoint(low, high) } else { low }
        };
        let (width, height) = area.dim_in_pixel();
        let speeds = &report.speeds_mm_s;
        let widest = speeds
            .iter()
            .map(|v| text_width(&grid_value(f64::from(*v)), TEXT))
            .max();
        let cell = self.column(area, 1) - self.column(area, 0);
        for (index, value) in speeds
            .iter()
            .enumerate()
            .step_by(labels_apart(widest.unwrap_or(0) + at(8), cell))
        {
            let (from, to) = (self.column(area, index), self.column(area, self.columns));
            let x = between(from, to, speeds.len() == 1);
            let written = grid_value(f64::from(*value));
            area.draw_text(&written, &small, (x, self.row(area, 0) + at(12)))?;
        }
        let forces = &report.forces_n;
        let cell = self.row(area, 0) - self.row(area, 1);
        for (index, value) in forces
            .iter()
            .enumerate()
            .step_by(labels_apart(at(TEXT + 3), cell))
        {
            let (from, to) = (self.row(area, index), self.row(area, self.rows));
            let y = between(from, to, forces.len() == 1);
            let style = small.pos(Pos::new(HPos::Right, VPos::Center));
            area.draw_text(&grid_value(f64::from(*value)), &style, (at(56), y))?;
        }
        let below = (width as i32 / 2, height as i32 - at(14));
        area.draw_text(&SPEED.label(), &small, below)?;
        let length = self.row(area, 0) - self.row(area, self.rows);
        draw_upwards(area, FORCE, (at(14), height as i32 / 2), length)
    }
}

#[cfg(test)]
mod tests {
    use super::super::canvas::tests::assert_drawn_within;
    use super::*;
    use crate::texture::certificate::{Point, Stored};

    fn report(columns: usize, rows: usize, finding: impl Fn(usize) -> Finding) -> Certification {
        let axis = |cells: usize| -> Vec<f32> { (0..=cells).map(|v| v as f32 * 20.0).collect() };
        let (speeds_mm_s, forces_n) = (axis(columns), axis(rows));
        let cells = (0..columns * rows).map(|index| Cell {
            speeds_mm_s: [speeds_mm_s[index / rows], speeds_mm_s[index / rows + 1]],
            forces_n: [forces_n[index % rows], forces_n[index % rows + 1]],
            finding: finding(index),
        });
        Certification {
            texture: "test".to_owned(),
            structure: "direct form".to_owned(),
            simulated: true,
            cells: cells.collect(),
            speeds_mm_s,
            forces_n,
            holds: false,
            stored: Stored::Missing,
        }
    }

    const CAPTION: Caption<'_> = Caption {
        title: "test",
        simulated: true,
    };

    fn direct(pole_radius: f64) -> Finding {
        Finding::Direct {
            proved_margin: (pole_radius < 1.0).then_some(0.1),
            critical_frequency_hz: None,
            stored_margin: 14,
            worst: Point {
                speed_mm_s: 5.0,
                force_n: 12.0,
                pole_radius,
            },
        }
    }

    #[test]
    fn cells_that_fail_are_told_by_colour_legend_and_value() {
        let svg = certificate_map(&CAPTION, &report(2, 1, |i| direct([0.98, 1.0243][i]))).unwrap();
        assert_drawn_within(&svg, 960, 280);
        for text in ["0.98000", "1.02430", "fails", "SIMULATED"] {
            assert!(svg.as_str().contains(text), "{text}");
        }
        let svg = certificate_map(&CAPTION, &report(2, 1, |_| direct(0.98))).unwrap();
        assert!(!svg.as_str().contains("fails"));
    }

    #[test]
    fn grids_of_any_size_can_be_drawn() {
        for (columns, rows) in [(1, 1), (63, 1), (1, 63), (63, 63), (14, 7)] {
            let lattice = |_| Finding::Lattice {
                largest_reflection: 0.99,
            };
            let svg = certificate_map(&CAPTION, &report(columns, rows, lattice)).unwrap();
            assert_drawn_within(&svg, 960, (140 + 34 * rows as u32).clamp(280, 700));
        }
    }
}
