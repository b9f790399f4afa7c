//! Parsing of configurations: see [`fuzz::configuration`].
#![no_main]

libfuzzer_sys::fuzz_target!(|input: &[u8]| fuzz::configuration::judge(input));
