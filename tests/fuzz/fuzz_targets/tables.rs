//! Parsing of the other tables: see [`fuzz::table`].
#![no_main]

libfuzzer_sys::fuzz_target!(|input: &[u8]| fuzz::table::judge(input));
