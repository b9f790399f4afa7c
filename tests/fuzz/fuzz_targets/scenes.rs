//! Parsing of scenes' texts: see [`fuzz::scene`].
#![no_main]

libfuzzer_sys::fuzz_target!(|input: &[u8]| fuzz::scene::judge(input));
