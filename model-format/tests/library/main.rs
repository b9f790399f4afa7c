//! What the library's format promises, tested through its public interface only.
//!
//! [`bytes`] writes the format a second time, from its description in `wire.rs`, so that the decoder meets bytes that
//! the encoder would never write.

mod bytes;
mod damage;
mod faults;
mod limits;
mod round_trip;
mod scenes;
mod size;
mod walk;
