//! Findings of a certification, and the bytes that a library stores of them.

use model_format::UNCERTIFIED_CELL;
use serde::Serialize;

/// The findings on a texture.
#[derive(Clone, Debug, Serialize)]
pub struct Certification {
    /// The texture's name.
    pub texture: String,
    /// Its structure.
    pub structure: String,
    /// True for a texture that comes from simulated recordings.
    pub simulated: bool,
    /// Values of the speed axis, mm/s.
    pub speeds_mm_s: Vec<f32>,
    /// Values of the force axis, N.
    pub forces_n: Vec<f32>,
    /// All cells, speed-major.
    pub cells: Vec<Cell>,
    /// True if every cell holds.
    pub holds: bool,
    /// The library's own certificate, compared with this one.
    pub stored: Stored,
}

/// The certificate that a library holds, beside the one just found.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Stored {
    /// There is none.
    Missing,
    /// It says what was found.
    Same,
    /// It does not.
    Different,
}

/// The area between neighbouring nodes.
#[derive(Clone, Debug, Serialize)]
pub struct Cell {
    /// Lowest and highest speed, mm/s; equal where the axis has one value.
    pub speeds_mm_s: [f32; 2],
    /// Lowest and highest force, N.
    pub forces_n: [f32; 2],
    /// The finding.
    pub finding: Finding,
}

/// The finding on a cell.
#[derive(Clone, Debug, Serialize)]
#[serde(untagged)]
pub enum Finding {
    /// Of a normalised lattice.
    Lattice {
        /// Largest reflection coefficient's magnitude of the cell's nodes, which no point between them exceeds.
        largest_reflection: f64,
    },
    /// Of a direct form.
    Direct {
        /// A proved lower bound, over the whole cell and the whole unit circle, of |A|: coefficients off by less, added
        /// up, would be stable too. `None` where the proof fails.
        proved_margin: Option<f64>,
        /// Frequency at which the proof ended, Hz.
        critical_frequency_hz: Option<f64>,
        /// The byte that a library stores of the proved margin.
        #[serde(skip)]
        stored_margin: u8,
        /// The sampled point of the largest pole radius.
        worst: Point,
    },
}

/// A point of the grid and the filter there.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Point {
    /// Tangential speed, mm/s.
    pub speed_mm_s: f64,
    /// Normal force, N.
    pub force_n: f64,
    /// Largest magnitude of a pole; 1/A is stable where it is below one.
    pub pole_radius: f64,
}

impl Cell {
    /// Returns whether every point of the cell is stable, by the proof and by the samples.
    pub fn holds(&self) -> bool {
        match &self.finding {
            Finding::Lattice { .. } => true,
            Finding::Direct {
                proved_margin,
                worst,
                ..
            } => proved_margin.is_some() && worst.pole_radius < 1.0,
        }
    }

    /// The byte that a library stores.
    fn stored_margin(&self) -> u8 {
        match self.finding {
            Finding::Direct { stored_margin, .. } if self.holds() => stored_margin,
            _ => UNCERTIFIED_CELL,
        }
    }
}

impl std::fmt::Display for Cell {
    /// Writes the place of the cell and the fault in it.
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let ([low_speed, high_speed], [low_force, high_force]) = (self.speeds_mm_s, self.forces_n);
        write!(
            f,
            "cell {low_speed} to {high_speed} mm/s, {low_force} to {high_force} N"
        )?;
        let Finding::Direct {
            critical_frequency_hz,
            worst,
            ..
        } = &self.finding
        else {
            return Ok(());
        };
        write!(
            f,
            ", worst at {:.4} mm/s, {:.4} N with pole radius {:.5}",
            worst.speed_mm_s, worst.force_n, worst.pole_radius
        )?;
        match critical_frequency_hz {
            Some(frequency) if worst.pole_radius < 1.0 => {
                write!(
                    f,
                    ", all samples stable, but no proof beyond {frequency:.1} Hz"
                )
            }
            _ => Ok(()),
        }
    }
}

impl Certification {
    /// The cells that do not hold, the one with the largest pole radius first.
    pub fn failures(&self) -> Vec<&Cell> {
        let mut failures: Vec<&Cell> = self.cells.iter().filter(|cell| !cell.holds()).collect();
        let radius = |cell: &Cell| match &cell.finding {
            Finding::Direct { worst, .. } => worst.pole_radius,
            Finding::Lattice { .. } => 0.0,
        };
        failures.sort_by(|a, b| radius(b).total_cmp(&radius(a)));
        failures
    }

    /// Returns the bytes that a library stores: one per cell of a direct form, none of a lattice.
    pub fn cell_margins(&self) -> Vec<u8> {
        let direct = |cell: &&Cell| matches!(cell.finding, Finding::Direct { .. });
        let direct = self.cells.iter().filter(direct);
        direct.map(Cell::stored_margin).collect()
    }
}
