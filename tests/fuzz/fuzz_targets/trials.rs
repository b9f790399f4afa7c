//! Parsing of lists of trials: see [`fuzz::list`].
#![no_main]

libfuzzer_sys::fuzz_target!(|input: &[u8]| fuzz::list::judge(input));
