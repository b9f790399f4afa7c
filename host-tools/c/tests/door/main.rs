//! The library as other languages use it.
#![expect(unsafe_code, reason = "the functions under test take addresses")]

mod allocation;
mod calls;
mod examples;
mod header;
