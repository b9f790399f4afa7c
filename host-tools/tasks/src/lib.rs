//! Tasks around the microcontroller's core that need more than one call of cargo: finding a toolchain that has the
//! target, building for it, and running the images on emulated processors. The check of the repository's layout
//! ([`house`]), tables of the pages, attacks and releases are here too.
//!
//! The tests in `tests/qemu` use this library; the command `cargo tasks` is a thin layer over it.

pub mod attack;
pub mod browser_module;
pub mod compare;
pub mod firmware;
pub mod hil;
pub mod house;
pub mod lint;
pub mod process;
pub mod qemu;
pub mod release;
pub mod tables;
pub mod toolchain;
pub mod virtual_stylus;
pub mod workspace;
