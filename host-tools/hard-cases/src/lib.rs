//! Hard cases: models and motions that break filters, and the player of a case.
//!
//! [`suite`] (feature `list`, for hosts) is the list. `stylus stress` and `stylus frontier` play its cases and judge
//! what they hear, emulated processors play them to the same bits as the host, and the kernel's tests take its models.
//! All of them move a [`Filter`] along a [`Path`] with a [`Player`].
#![no_std]

#[cfg(feature = "list")]
extern crate std;

#[cfg(feature = "list")]
mod float;
#[cfg(feature = "list")]
mod list;
#[cfg(feature = "list")]
mod models;
mod player;

#[cfg(feature = "list")]
pub use float::{Deviation, FloatLattice};
#[cfg(feature = "list")]
pub use list::{Case, Length, suite};
#[cfg(feature = "list")]
pub use models::{NamedModel, fixtures, resonance};
pub use player::{Drive, FORCES_N, Filter, Lattice, Path, Player, SPEEDS_MM_S, any_at_end, energy, full_scale};
