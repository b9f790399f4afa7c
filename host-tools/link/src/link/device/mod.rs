//! One device: each request is a function that waits for the answer until a timeout.
//!
//! `connection` opens the link and carries requests; the other modules add the requests to [`Device`].

mod connection;
mod requests;
mod response;
mod update;
mod upload;

pub use connection::{Device, Timeouts};
pub(super) use requests::Blocks;
pub use requests::{SlotContent, TextureEntry};
