//! Tests that run as long as requested: attacks, and long use.
//!
//! Attacks are fuzzers, model checks, tests by random cases, and hostile libraries. Each round has a seed that
//! determines everything in it, so that the seed suffices to reproduce a failure.
//!
//! Long use is simulated on the virtual stylus: two hosts act at random for hours of the device's time, with random
//! faults. The test is `tests/image/soak`.

use std::hash::{BuildHasher, RandomState};
use std::process::Command;
use std::time::{Duration, Instant};

use anyhow::{Context, Result};

use crate::toolchain::Toolchain;
use crate::{process, virtual_stylus, workspace};

/// Factor on the number of cases of a model check. Without a factor, as in `tests/run`, the tests divide the number by
/// ten, so a round has forty times as many cases.
const FACTOR: &str = "4";

/// Number of cases of each property that sets none of its own, four times proptest's default, and number of cases that
/// may be rejected.
const PROPERTY_CASES: &str = "1024";
const PROPERTY_REJECTS: &str = "4096";

/// Number of random hostile libraries per round.
const HOSTILE_LIBRARIES: &str = "1000";

/// Runs of each fuzzer per round; a quarter of them for a parser of the host.
const FUZZ_RUNS: u64 = 1_000_000;

/// Longest round of a fuzzer whose seed is given, s; a quarter of it for a parser of the host.
const FUZZ_LIMIT_S: u64 = 24 * 3600;

/// The only target that is not a test: the fuzzers of `tests/fuzz`.
const FUZZ: &str = "fuzz";

/// Targets with the arguments for `cargo test`. [`FUZZ`] has none.
const TARGETS: [(&str, &str); 8] = [
    (FUZZ, ""),
    ("boots", "-p stylus-app --test app -- boots::"),
    ("requests", "-p stylus-app --test app -- interleavings::"),
    ("settings", "-p stylus-app --test app -- settings::histories::"),
    ("hosts", "-p stylus-app --test app -- hosts::"),
    ("safety", "-p stylus-app --test app -- safety::"),
    (
        "properties",
        "-p model-format -p stylus-kernel -p stylus-app -p stylus-support -p stylus-dsp -p stylus-signals \
         -p stylus-fit -p stylus-link -p stylus-evaluation -p stylus-report --lib \
         --test library --test kernel --test app",
    ),
    ("bounds", "-p qemu-tests --test emulated -- bounds::"),
];

/// Options of `cargo tasks attack`.
#[derive(clap::Args)]
pub struct Arguments {
    /// The targets [default: all, in turn]
    #[arg(value_parser = TARGETS.map(|(name, _)| name))]
    targets: Vec<String>,
    /// Time after which no round begins: a number with s, m or h
    #[arg(long = "for", value_name = "TIME", value_parser = duration, default_value = "10m")]
    time: Duration,
    /// One round with this seed, which a failure has named
    #[arg(long, conflicts_with = "time")]
    seed: Option<u64>,
}

/// Parses a number with its unit: s, m or h.
pub fn duration(text: &str) -> std::result::Result<Duration, String> {
    let units = [('s', 1), ('m', 60), ('h', 3600)];
    let mut parsed = units.iter().filter_map(|&(unit, seconds)| {
        let number: u32 = text.strip_suffix(unit)?.parse().ok()?;
        Some(Duration::from_secs(seconds) * number)
    });
    let wrong = || format!("'{text}' is no time; give a number with s, m or h, such as 10m");
    parsed.next().ok_or_else(wrong)
}

/// Returns the command for one round. It ends within `limit` if the target supports that.
fn round(name: &str, tests: &str, seed: u64, limit: Option<Duration>) -> Command {
    if name == FUZZ {
        let mut smoke = Command::new(workspace::root().join("tests/fuzz/smoke"));
        // To libFuzzer a limit of 0 s is none.
        let seconds = limit.map_or(FUZZ_LIMIT_S, |limit| limit.as_secs().max(1));
        // libFuzzer accepts seeds of 32 bits, and treats 0 as no seed.
        let seed = (seed as u32).max(1);
        smoke.args([FUZZ_RUNS, seconds, seed.into()].map(|number| number.to_string()));
        return smoke;
    }
    let mut test = Command::new("cargo");
    test.current_dir(workspace::root());
    test.args(["test", "--quiet", "--locked"]);
    test.args(tests.split(' '));
    test.env("STYLUS_ATTACK_SEED", seed.to_string());
    test.env("STYLUS_ATTACK_FACTOR", FACTOR);
    test.env("STYLUS_HOSTILE_LIBRARIES", HOSTILE_LIBRARIES);
    test.env("PROPTEST_RNG_SEED", seed.to_string());
    test.env("PROPTEST_CASES", PROPERTY_CASES);
    test.env("PROPTEST_MAX_GLOBAL_REJECTS", PROPERTY_REJECTS);
    test
}

/// Attacks the targets in turn until the time has elapsed, or each once with the given seed.
///
/// # Errors
/// The first failure, with its seed.
pub fn run(arguments: &Arguments) -> Result<()> {
    let is_asked = |name| arguments.targets.is_empty() || arguments.targets.iter().any(|target| target == name);
    let begin = Instant::now();
    let (mut rounds, mut targets) = (0, Vec::from(TARGETS));
    targets.retain(|(name, _)| is_asked(*name));
    for (name, tests) in targets.iter().cycle() {
        // A seed repeats one round of each target.
        if arguments.seed.is_some() && rounds == targets.len() {
            break;
        }
        let limit = match arguments.seed {
            Some(_) => None,
            None => match arguments.time.checked_sub(begin.elapsed()) {
                None => break,
                left => left,
            },
        };
        // A new `RandomState` hashes by random keys, so its hash of any number is a random one.
        let fresh = || RandomState::new().hash_one(rounds);
        let seed = arguments.seed.unwrap_or_else(fresh);
        println!("attack {name}, seed {seed}");
        let again = || format!("to see it again: cargo tasks attack {name} --seed {seed}");
        process::run(&mut round(name, tests, seed, limit)).with_context(again)?;
        rounds += 1;
    }
    println!("{rounds} rounds found nothing");
    Ok(())
}

/// Options of `cargo tasks soak`.
#[derive(clap::Args)]
pub struct SoakArguments {
    /// Time of the device that the stylus is used: a number with s, m or h
    #[arg(long = "for", value_name = "TIME", value_parser = duration, default_value = "10m")]
    time: Duration,
    /// The seed from which all of it follows, which a failure has named [default: a fresh one]
    #[arg(long)]
    seed: Option<u64>,
}

/// Builds the images and runs the test as long as requested.
///
/// # Errors
/// A build fails, or an invariant does not hold. The message contains the seed.
pub fn soak(arguments: &SoakArguments) -> Result<()> {
    let toolchain = Toolchain::find()?;
    let seed = arguments.seed.unwrap_or_else(|| RandomState::new().hash_one(0));
    println!("soak, seed {seed}");
    let variables = [
        ("STYLUS_SOAK_SECONDS", arguments.time.as_secs()),
        ("STYLUS_SOAK_SEED", seed),
    ];
    let again = || format!("to see it again: cargo tasks soak --seed {seed}");
    virtual_stylus::soak(&toolchain, variables).with_context(again)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_time_has_a_number_and_a_unit() {
        assert_eq!(duration("10m"), Ok(Duration::from_mins(10)));
        for wrong in ["", "m", "10", "1d", "-1s", "10µ", "99999999999999999999h"] {
            assert!(duration(wrong).is_err(), "{wrong}");
        }
    }

    /// A missing module would match no test, and so would find nothing.
    #[test]
    fn the_modules_of_each_target_are_there() {
        for (_, tests) in TARGETS
            .iter()
            .filter(|(_, tests)| tests.contains("-p stylus-app --test app --"))
        {
            let words: Vec<&str> = tests.split(' ').collect();
            let modules = words.iter().filter_map(|word| word.strip_suffix("::"));
            for module in modules {
                let folder = workspace::root().join("firmware/app/tests").join(words[3]);
                let path = folder.join(module.replace("::", "/"));
                let is_there = path.is_dir() || path.with_extension("rs").is_file();
                assert!(is_there, "{}", path.display());
            }
        }
    }
}
