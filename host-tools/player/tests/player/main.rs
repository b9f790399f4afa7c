//! A player against `stylus render`, and what it does when something changes.

mod changes;
mod common;
mod same_bits;
mod threads;
mod timing;
