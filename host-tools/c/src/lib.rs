#![doc = include_str!("../README.md")]

mod exports;
mod handle;
mod status;

pub use exports::*;
pub use handle::{LibraryHandle, PlayerHandle};
pub use status::Status;
