//! What the kernel promises whatever the texture and the motion, tested through its public interface only.

mod arithmetic;
mod direct;
mod grid;
mod hard;
mod lattice;
mod models;
mod reference;
mod silence;
mod synthesis;
#[cfg(feature = "variants")]
mod variants;
