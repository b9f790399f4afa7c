//! A player compared with `stylus render`, and its behaviour when something changes.

mod changes;
mod common;
mod safety;
mod same_bits;
mod threads;
mod timing;
