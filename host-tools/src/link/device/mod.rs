//! One device: each request is a function that waits for the answer until a timeout.
//!
//! `connection` opens the link and carries requests; the other modules add the requests of one subject each to
//! [`Device`].

mod connection;
mod library;
mod playback;
mod recording;
mod requester;
mod self_test;
mod settings;
mod timeouts;
mod upload;

pub use connection::Device;
pub(super) use recording::Blocks;
pub use timeouts::Timeouts;
