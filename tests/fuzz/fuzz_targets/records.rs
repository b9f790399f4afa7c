//! Parsing of records of fits: see [`fuzz::record`].
#![no_main]

libfuzzer_sys::fuzz_target!(|input: &[u8]| fuzz::record::judge(input));
