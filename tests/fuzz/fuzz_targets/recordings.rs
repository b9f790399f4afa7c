//! Parsing of recordings, as WAV and as CSV: see [`fuzz::recording`].
#![no_main]

libfuzzer_sys::fuzz_target!(|input: &[u8]| fuzz::recording::judge(input));
