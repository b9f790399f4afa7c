//! The promises of the library's format, tested through its public interface only.
//!
//! [`bytes`] writes the format a second time, from its description in `README.md`, so that the decoder meets bytes that
//! the encoder would never write.

mod bytes;
mod damage;
mod faults;
mod faults_of_parts;
mod fed;
mod limits;
mod round_trip;
mod scenes;
mod size;
mod walk;
