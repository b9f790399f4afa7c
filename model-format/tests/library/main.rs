//! The promises of the library's format, tested through its public interface only.
//!
//! [`bytes`] is a second writer of the format, written from its description in `README.md`. With it, the decoder is
//! tested on bytes that the encoder would never write.

mod bytes;
mod damage;
mod faults;
mod faults_of_parts;
mod fed;
mod round_trip;
mod scenes;
mod walk;
