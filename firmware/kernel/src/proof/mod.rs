//! Proof that a direct form is stable at every point of its grid, in integers: the same verdict on host and device.
//!
//! # Statement
//! At a point of a cell the kernel plays 1/A with A = Σ w(k) A(k) + r: a weighted mean of the cell's up to four nodes,
//! and the rounding r of each coefficient by at most half a step. A proof that ends without a [`Refusal`] shows that
//! 1/A is stable at every point of every cell, and that |A| is at least the certificate's margin of the cell on the
//! whole unit circle. Only resting coefficients are meant: while they change, a direct form's state can grow although
//! it is stable at every point.
//!
//! # Proof
//! 1. **A half-plane per interval of frequency.** The half circle is cut into intervals. For each a direction u is
//!    given, and for every node of the cell Re(ū A(k)) ≥ |u| m on the whole interval. Weights are not negative and add
//!    up to one, so Re(ū A) ≥ |u| (m - |r|) for every mean: |A| ≥ m - |r|, and m is chosen so that this is the margin.
//!    No mean has a zero on the circle. This is the zero exclusion principle for a polytope of polynomials (B. R.
//!    Barmish, *New Tools for Robustness of Linear Systems*, 1994, chapter 7); any u will do, so that the search for it
//!    needs no trust.
//! 2. **One turn count.** A(z) has as many zeros outside the circle as its value turns around 0 on the way around
//!    (argument principle); the upper half circle does half of it, by symmetry. Within an interval the value is less
//!    than a quarter turn from u, and neighbouring intervals share a value, so the turn is the sum of the angles
//!    between successive u, each below half a turn (`turn`). It is the same for all means of a cell, because none
//!    passes 0; and for all cells of a row, because neighbours share nodes. Each row is counted in its first cell.
//!
//! Stability of the nodes follows: each is a mean of a cell. A step-down recursion would prove nodes alone. It divides
//! by 1 - k² at each order, so that its rounding grows without a bound known beforehand; here it does not.
//!
//! # The values on an interval
//! For a(0) = 1, a(i) = -h(i) and c = ⌈order / 2⌉, A is turned by e^(jωc), the same for all nodes, which makes the
//! highest frequency in it c: Re = Σ s(n) cos nω, Im = Σ d(n) sin nω, with s(n) = a(c+n) + a(c-n), d(n) = a(c-n) -
//! a(c+n), s(0) = a(c). A stable A then turns by exactly c half-turns on the half circle.
//!
//! On an interval ω = ω(c) + t π/(2N), |t| ≤ 1, both are Taylor polynomials in t of `TERMS` terms
//! (`expansion::Expansion`). In a part of the interval they are projected on u, moved to the part's middle by
//! repeated synthetic division (Horner), and Re(ū A) is at least the first coefficient less the magnitudes of the
//! others (`half_plane`). Parts are halved until that suffices.
//!
//! # Rounding
//! All values are in units of 2^(E-41), where E is the texture's [`exponent`]: stored coefficients are whole numbers of
//! units. Σ|h| < 2^(E+1), so Σ|s| and Σ|d| are at most S = 3 · 2⁴¹ units. With x = 200 π/512 = 1.2272, the largest n
//! π/(2N), each of real and imaginary part is off by at most:
//!
//! | from | at most, units |
//! |---|---|
//! | cosines, to 2⁻³¹ each: S 2⁻³¹ e^x | 10 483 |
//! | factors (π/2)^m/m!, to 2⁻³¹ each: S 2⁻³¹ Σ (200/256)^m | 14 044 |
//! | products, rounded down: 201 · 2.6 · e^(π/2) + `TERMS` | 2 529 |
//! | terms left out: S x¹⁴/14! · 1/(1 - x/15) | 1 449 |
//!
//! which is below 2¹⁵; the projection is off by at most √2 · 2¹⁵ · |u|. Projection and synthetic division round at most
//! 14 + 91 times, each time by a unit of a term that is not above one on the part; magnitudes are rounded up. That is
//! at most 128 units more, because |u| is at least 2¹⁷ in steps of which the projection has 2⁻¹⁷. Together:
//! `EVALUATION_UNITS`. Kernel coefficients have steps of 2^(E-31), so |r| ≤ order · 2⁹ units.
//!
//! # Effort
//! [`Proof::step`] expands one node in one interval or tries one part. The number of parts is bounded by a row's cells
//! and order ([`checks_per_cell`]), and by what a library has to spare ([`SPARE_CHECKS`]); a proof that needs more ends
//! with a refusal. Nothing is allocated.

mod claim;
mod expansion;
mod half_plane;
mod refusal;
mod row;
mod table;
mod turn;
mod units;

use model_format::{Certificate, Library, Structure, Texture};

pub use claim::{claimed_units, margin_byte};
pub use refusal::{Cause, Refusal};
use row::{Aim, Geometry, Row};
pub use row::{CellProof, SPARE_CHECKS, checks_per_cell};
pub use units::UNIT_BITS;

#[cfg(doc)]
use crate::direct::exponent;

/// Version of the proof. It changes when a direct form could be refused or accepted that was not before, so that a
/// stored verdict of another version does not count.
pub const PROOF_VERSION: u16 = 1;

/// Most instructions of a step that expands a node, on a Cortex-M.
pub const EXPANSION_INSTRUCTIONS: u64 = 110_000;

/// Most instructions of a step that tries a part of an interval, on a Cortex-M.
pub const PART_INSTRUCTIONS: u64 = 20_000;

/// Proof of all direct forms of a library, in bounded steps.
///
/// ```
/// use model_format::Library;
/// use stylus_kernel::proof::{Proof, Refusal};
///
/// fn prove(library: Library<'_>) -> Result<(), Refusal> {
///     let mut proof = Proof::new(library);
///     while proof.step()? {
///         // A device does something else here.
///     }
///     Ok(())
/// }
/// ```
pub struct Proof<'a> {
    library: Library<'a>,
    /// Index of the next texture.
    next: usize,
    at: Option<At<'a>>,
    done: u32,
    total: u32,
    /// Parts that may be tried beyond those of the rows.
    spare: u32,
}

/// Texture under proof.
struct At<'a> {
    index: usize,
    texture: Texture<'a>,
    geometry: Geometry,
    margins: &'a [u8],
    /// Speed index of the row's cells.
    speed: usize,
    row: Row<'a>,
}

/// Returns whether `library` has a texture that needs a proof: a direct form.
pub fn is_needed(library: &Library<'_>) -> bool {
    library.textures().any(|texture| is_direct(&texture))
}

fn is_direct(texture: &Texture<'_>) -> bool {
    match texture.structure() {
        Structure::NormalisedLattice => false,
        Structure::DirectForm16 | Structure::DirectForm32 => true,
    }
}

impl<'a> Proof<'a> {
    /// A proof of `library` that has not begun. It reads the header of each texture, and the record of each node.
    pub fn new(library: Library<'a>) -> Self {
        let direct = library.textures().filter(is_direct);
        let parts = direct.map(|texture| {
            let (speeds, forces) = texture.cell_counts();
            speeds * forces * Geometry::intervals_of(texture.max_order())
        });
        Self {
            library,
            next: 0,
            at: None,
            done: 0,
            total: parts.sum::<usize>() as u32,
            spare: SPARE_CHECKS,
        }
    }

    /// Goes on by a bounded step, and returns true while there is more to prove.
    ///
    /// The longest step expands a node of order 400; none takes more than [`EXPANSION_INSTRUCTIONS`].
    ///
    /// # Errors
    /// A cell that could not be proved, with its place. The proof has ended then.
    pub fn step(&mut self) -> Result<bool, Refusal> {
        if let Some(at) = &mut self.at {
            let index = at.index;
            let stepped = at.row.step(&mut self.spare);
            let more = stepped.map_err(|failure| failure.at(index))?;
            self.done += u32::from(at.row.take_ended_interval());
            if !more && !at.next_row() {
                self.at = None;
            }
            return Ok(true);
        }
        let Some(texture) = self.library.textures().nth(self.next) else {
            return Ok(false);
        };
        let index = self.next;
        self.next += 1;
        if is_direct(&texture) {
            // Without a certificate nothing is claimed beyond stability.
            let margins = match texture.certificate() {
                Certificate::DirectForm { cell_margins } => cell_margins,
                Certificate::None | Certificate::Lattice { .. } => &[],
            };
            let geometry = Geometry::of(&texture);
            self.at = Some(At {
                index,
                texture,
                geometry,
                margins,
                speed: 0,
                row: At::row(texture, geometry, margins, 0),
            });
        }
        Ok(true)
    }

    /// Share of the proof that is done, ‰.
    pub fn permille(&self) -> u16 {
        let (done, total) = (u64::from(self.done), u64::from(self.total.max(1)));
        (done * 1000 / total) as u16
    }
}

impl<'a> At<'a> {
    fn row(texture: Texture<'a>, geometry: Geometry, margins: &'a [u8], speed: usize) -> Row<'a> {
        let (_, forces) = texture.cell_counts();
        let claims = margins.get(speed * forces..).unwrap_or(&[]);
        Row::new(texture, geometry, Aim::Claims(claims), speed, 0..forces)
    }

    /// Goes on to the next row; returns false if there is none.
    fn next_row(&mut self) -> bool {
        self.speed += 1;
        if self.speed == self.texture.cell_counts().0 {
            return false;
        }
        self.row = Self::row(self.texture, self.geometry, self.margins, self.speed);
        true
    }
}
