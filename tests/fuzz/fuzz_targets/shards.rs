//! Parsing of partial files of fits: see [`fuzz::shard`].
#![no_main]

libfuzzer_sys::fuzz_target!(|input: &[u8]| fuzz::shard::judge(input));
