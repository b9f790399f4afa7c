//! Parsing of settings' names and values: see [`fuzz::setting`].
#![no_main]

libfuzzer_sys::fuzz_target!(|input: &[u8]| fuzz::setting::judge(input));
