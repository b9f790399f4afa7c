//! All targets in one program, which is built and linked only once. `STYLUS_FUZZ_TARGET` names the target to run. If
//! `STYLUS_FUZZ_SEEDS` is set, the program writes the seeds of all targets below that folder instead, and ends.
#![no_main]

use std::env;
use std::path::Path;
use std::process::exit;
use std::sync::OnceLock;

use fuzz::{Judge, targets};

static TARGET: OnceLock<Judge> = OnceLock::new();

fn prepare() {
    if let Some(folder) = env::var_os("STYLUS_FUZZ_SEEDS") {
        fuzz::seeds::write(Path::new(&folder)).expect("the folder can be written");
        exit(0);
    }
    let name = env::var("STYLUS_FUZZ_TARGET").unwrap_or_default();
    let targets = targets();
    let target = targets.iter().find(|target| target.0 == name);
    let Some((_, judge)) = target else {
        let names: Vec<&str> = targets.iter().map(|target| target.0).collect();
        let names = names.join(", ");
        eprintln!("set STYLUS_FUZZ_TARGET to one of {names}");
        exit(2);
    };
    TARGET.get_or_init(|| *judge);
}

libfuzzer_sys::fuzz_target!(init: prepare(), |input: &[u8]| {
    (TARGET.get().expect("it was prepared"))(input);
});
