//! Proof of a row of cells: those between two neighbouring speeds.

use core::ops::Range;

use model_format::Texture;

use super::claim::claimed_units;
use super::expansion::{Expansion, Interval, MAX_INDEX};
use super::half_plane::{HalfPlane, MAX_DEPTH, Part, find};
use super::refusal::{Cause, Refusal};
use super::turn::Turn;
use super::units::EVALUATION_UNITS;
use crate::direct::exponent;

/// Parts that are tried for a cell of a texture of `order`, in the mean of a row: the most, but for a library's
/// [`SPARE_CHECKS`].
pub const fn checks_per_cell(order: usize) -> u32 {
    256 + 16 * order as u32
}

/// Parts of a library that are tried beyond [`checks_per_cell`]. A cell of a low order whose margin is small takes up
/// to ten times as many; one in 500 of random ones takes more at all.
pub const SPARE_CHECKS: u32 = 65_536;

/// The same of a cell by itself, so that a library has room for many such cells.
const SPARE_CHECKS_OF_CELL: u32 = 4_096;

/// Facts that all cells of a texture share.
#[derive(Clone, Copy)]
pub(super) struct Geometry {
    order: usize,
    exponent: u32,
    intervals: usize,
}

impl Geometry {
    pub fn of(texture: &Texture<'_>) -> Self {
        let order = texture.max_order();
        Self {
            order,
            exponent: exponent(texture),
            intervals: Self::intervals_of(order),
        }
    }

    /// Number of intervals of the half circle for polynomials of `order`: a power of two, at most 256.
    pub const fn intervals_of(order: usize) -> usize {
        let half = order.div_ceil(2);
        let mut intervals = 2;
        while half * 256 > MAX_INDEX * intervals {
            intervals *= 2;
        }
        intervals
    }

    fn interval(self, index: usize) -> Interval {
        Interval {
            index,
            stride: 256 / self.intervals,
            half_order: self.order.div_ceil(2),
        }
    }

    /// Bound on evaluation and on the rounding of the kernel's coefficients, units: half a step of 2^(E-31) per tap.
    fn allowance(self) -> i64 {
        EVALUATION_UNITS + ((self.order as i64) << 9)
    }
}

/// Margin that is to be shown of a row's cells.
#[derive(Clone, Copy)]
pub(super) enum Aim<'a> {
    /// As much as the certificate's bytes claim; stability where there are none.
    Claims(&'a [u8]),
    /// At least half of the distance of 0 in the middle of each part. Every part that serves this aim, or a larger one,
    /// serves claims of no more than the margin found: proving those takes no more effort.
    Half,
}

/// Failure of a row, without its texture.
#[derive(Clone, Copy)]
pub(super) struct Failure {
    speed: usize,
    force: usize,
    frequency: u32,
    cause: Cause,
}

impl Failure {
    pub fn at(self, texture: usize) -> Refusal {
        Refusal {
            texture,
            speed: self.speed,
            force: self.force,
            frequency: self.frequency,
            cause: self.cause,
        }
    }
}

/// Proof of the cells of a row, interval by interval, in each of them along the force axis.
pub(super) struct Row<'a> {
    texture: Texture<'a>,
    geometry: Geometry,
    aim: Aim<'a>,
    /// Speed index of the row, and the force indices of its cells.
    speed: usize,
    forces: Range<usize>,
    interval: usize,
    force: usize,
    /// Nodes of the cell: both speeds of the lower force, then both of the higher.
    corners: [Expansion; 4],
    /// Number of corners that are of this cell and interval.
    expanded: usize,
    part: Part,
    turn: Turn,
    checks_left: u32,
    /// Least distance found, less what may be off, units.
    margin: i64,
    ended_interval: bool,
}

impl<'a> Row<'a> {
    pub fn new(
        texture: Texture<'a>,
        geometry: Geometry,
        aim: Aim<'a>,
        speed: usize,
        forces: Range<usize>,
    ) -> Self {
        Self {
            texture,
            geometry,
            aim,
            speed,
            interval: 0,
            force: forces.start,
            corners: [Expansion::NONE; 4],
            expanded: 0,
            part: Part::WHOLE,
            turn: Turn::START,
            checks_left: checks_per_cell(geometry.order) * forces.len() as u32,
            margin: i64::MAX,
            ended_interval: false,
            forces,
        }
    }

    /// Expands a node or tries a part, one of `spare` if the row has none left; returns false once all cells are
    /// proved.
    pub fn step(&mut self, spare: &mut u32) -> Result<bool, Failure> {
        if self.expanded < self.corners.len() {
            self.expand();
            return Ok(true);
        }
        let left = if self.checks_left > 0 {
            &mut self.checks_left
        } else {
            spare
        };
        let Some(fewer) = left.checked_sub(1) else {
            return Err(self.failure(Cause::Effort));
        };
        *left = fewer;
        let allowance = self.geometry.allowance();
        let found = find(&self.corners, self.part);
        // The middle is in both halves, so that no halving brings more than it has. The directions tried have at least
        // seven eighths of the largest distance.
        let Some(HalfPlane {
            direction,
            distance,
            middle,
        }) = found.filter(|found| found.middle >= allowance / 2)
        else {
            return Err(self.failure(Cause::OnCircle));
        };
        let enough = match self.aim {
            Aim::Claims(claims) => {
                let claim = claims.get(self.force - self.forces.start);
                let units = |&byte: &u8| claimed_units(byte, self.geometry.exponent);
                distance >= allowance + claim.map_or(1, units)
            }
            Aim::Half => distance > allowance && distance >= middle / 2,
        };
        if !enough {
            let Some(half) = self.part.halved() else {
                let claimed = middle >= 2 * allowance;
                let cause = if claimed {
                    Cause::Margin
                } else {
                    Cause::OnCircle
                };
                return Err(self.failure(cause));
            };
            self.part = half;
            return Ok(true);
        }
        self.margin = self.margin.min(distance - allowance);
        if self.force == self.forces.start && !self.turn.add(direction) {
            return Err(self.failure(Cause::Outside));
        }
        if let Some(next) = self.part.next() {
            self.part = next;
            return Ok(true);
        }
        self.part = Part::WHOLE;
        self.next_cell()
    }

    /// Returns whether the last step ended an interval of a cell.
    pub fn take_ended_interval(&mut self) -> bool {
        core::mem::take(&mut self.ended_interval)
    }

    /// Goes on to the next cell of the row, or to the first of the next interval.
    fn next_cell(&mut self) -> Result<bool, Failure> {
        self.ended_interval = true;
        self.force += 1;
        if self.force < self.forces.end {
            // Neighbours share two nodes.
            self.corners.copy_within(2.., 0);
            self.expanded = 2;
            return Ok(true);
        }
        self.force = self.forces.start;
        self.expanded = 0;
        self.interval += 1;
        if self.interval < self.geometry.intervals {
            return Ok(true);
        }
        if self.turn.is(self.geometry.order.div_ceil(2)) {
            return Ok(false);
        }
        self.interval = 0;
        Err(Failure {
            frequency: 0,
            ..self.failure(Cause::Outside)
        })
    }

    fn expand(&mut self) {
        let (speeds, forces) = (self.texture.speed_axis(), self.texture.force_axis());
        let speed = (self.speed + self.expanded % 2).min(speeds.len() - 1);
        let force = (self.force + self.expanded / 2).min(forces.len() - 1);
        let coefficients = self.texture.node(speed, force).coefficients;
        let interval = self.geometry.interval(self.interval);
        self.corners[self.expanded] =
            Expansion::new(coefficients, self.geometry.exponent, interval);
        self.expanded += 1;
    }

    fn failure(&self, cause: Cause) -> Failure {
        // The interval begins at index / (2 · intervals) of the rate; its middle is at t = 0.
        let one = 1i64 << 30;
        let position = (2 * self.interval as i64 + 1) * one + i64::from(self.part.middle());
        Failure {
            speed: self.speed,
            force: self.force,
            frequency: (position / self.geometry.intervals as i64) as u32,
            cause,
        }
    }
}

/// Proof of a single cell, which finds its margin.
pub struct CellProof<'a> {
    row: Row<'a>,
    spare: u32,
}

impl<'a> CellProof<'a> {
    /// A proof of the cell at these indices, each below its [`Texture::cell_counts`], that has not begun.
    pub fn new(texture: Texture<'a>, speed: usize, force: usize) -> Self {
        let geometry = Geometry::of(&texture);
        Self {
            row: Row::new(texture, geometry, Aim::Half, speed, force..force + 1),
            spare: SPARE_CHECKS_OF_CELL,
        }
    }

    /// Does the whole proof. Returns a lower bound of |A| on the unit circle at every point of the cell, in units of
    /// 2^(E-41). It is at least 0.4 of the exact minimum, less twice what may be off, less 2^-17 of the largest |A| of
    /// a node there, which the digits of a direction cost.
    ///
    /// # Errors
    /// The cell could not be proved. The refusal's texture is 0.
    pub fn run(mut self) -> Result<i64, Refusal> {
        while self.step()? {}
        Ok(self.margin())
    }

    /// The margin that the proof has found so far, in units of 2^(E-41).
    pub fn margin(&self) -> i64 {
        self.row.margin
    }

    /// Number of parts that were tried until now.
    pub fn checks(&self) -> u32 {
        let own = checks_per_cell(self.row.geometry.order) - self.row.checks_left;
        own + SPARE_CHECKS_OF_CELL - self.spare
    }

    /// Goes on by one step; see [`super::Proof::step`].
    ///
    /// # Errors
    /// As [`CellProof::run`].
    pub fn step(&mut self) -> Result<bool, Refusal> {
        let stepped = self.row.step(&mut self.spare);
        stepped.map_err(|failure| failure.at(0))
    }
}

const _: () =
    assert!(Geometry::intervals_of(model_format::limits::MAX_ORDER) == 256 && MAX_DEPTH <= 30);
