//! Parsing of rigs' descriptions: see [`fuzz::rig`].
#![no_main]

libfuzzer_sys::fuzz_target!(|input: &[u8]| fuzz::rig::judge(input));
