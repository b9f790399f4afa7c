//! Parsing of HaTT's model files: see [`fuzz::hatt`].
#![no_main]

libfuzzer_sys::fuzz_target!(|input: &[u8]| fuzz::hatt::judge(input));
