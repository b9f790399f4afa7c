//! Parsing of frames and messages of the link, at the host's side: see [`fuzz::frame`].
#![no_main]

libfuzzer_sys::fuzz_target!(|input: &[u8]| fuzz::frame::judge(input));
