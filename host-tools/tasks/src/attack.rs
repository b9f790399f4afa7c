//! Attacks that go on as long as asked: the fuzzers of `tests/fuzz`, the model checks of `firmware/app/tests/app`,
//! the tests by random cases, and the search of `tests/qemu` for the worst library.
//!
//! Each round has a seed, from which all of it follows, so that a failure is seen again by its seed alone.

use std::hash::{BuildHasher, RandomState};
use std::process::Command;
use std::time::{Duration, Instant};

use crate::error::{Error, Result};
use crate::{process, workspace};

/// Cases of a round, as a multiple of those of `tests/run`.
const FACTOR: u32 = 4;

/// Rounds of the search for the worst library, each of one run of the emulator.
const SEARCH_ROUNDS: u32 = 9 * FACTOR;

/// Packages whose tests draw random cases, besides those of the command and of emulators.
const PROPERTY_PACKAGES: [&str; 4] = ["model-format", "stylus-kernel", "stylus-app", "host-tools"];

/// Programs of tests that these packages have besides their modules.
const PROPERTY_PROGRAMS: [&str; 3] = ["library", "kernel", "app"];

/// Cases of a property in `tests/run`, and cases that it may reject there: the defaults of proptest.
const PROPERTY_CASES: u32 = 256;
const PROPERTY_REJECTS: u32 = 1024;

/// Runs of each fuzzer per round.
const FUZZ_RUNS: u64 = 1_000_000;

/// Longest round of a fuzzer whose seed was given, s.
const FUZZ_LIMIT_S: u64 = 24 * 3600;

/// A target of an attack.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum Target {
    /// Decoder and lattice under random input
    Fuzz,
    /// Starts after power cuts and damage of the flash
    Boots,
    /// Interleavings of two hosts' requests
    Requests,
    /// Changes of settings with power cuts and damage of the flash
    Settings,
    /// Leases and proposals of two hosts
    Hosts,
    /// Limits of the output under any input and settings
    Safety,
    /// Every property by random cases, of kernel, format, application and host
    Properties,
    /// Search for the library that takes most work, on QEMU
    Bounds,
}

/// Tests that a target runs.
struct Tests {
    package: &'static str,
    /// Name of the test's program.
    program: &'static str,
    /// Modules of it.
    modules: &'static [&'static str],
}

impl Tests {
    const fn of_app(program: &'static str, modules: &'static [&'static str]) -> Self {
        Self {
            package: "stylus-app",
            program,
            modules,
        }
    }

    fn round(&self, seed: u64) -> Command {
        let mut test = Command::new("cargo");
        test.current_dir(workspace::root());
        test.args(["test", "--quiet", "--locked", "--package", self.package]);
        test.args(["--test", self.program, "--"]);
        test.args(self.modules.iter().map(|module| format!("{module}::")));
        test.env("STYLUS_ATTACK_SEED", seed.to_string());
        test.env("STYLUS_ATTACK_FACTOR", FACTOR.to_string());
        test.env("STYLUS_SEARCH_ROUNDS", SEARCH_ROUNDS.to_string());
        test
    }
}

impl Target {
    const ALL: [Self; 8] = [
        Self::Fuzz,
        Self::Boots,
        Self::Requests,
        Self::Settings,
        Self::Hosts,
        Self::Safety,
        Self::Properties,
        Self::Bounds,
    ];

    const fn name(self) -> &'static str {
        match self {
            Self::Fuzz => "fuzz",
            Self::Boots => "boots",
            Self::Requests => "requests",
            Self::Settings => "settings",
            Self::Hosts => "hosts",
            Self::Safety => "safety",
            Self::Properties => "properties",
            Self::Bounds => "bounds",
        }
    }

    /// Its tests; none for the fuzzers and for the properties, which are of many programs.
    const fn tests(self) -> Option<Tests> {
        Some(match self {
            Self::Fuzz | Self::Properties => return None,
            Self::Boots => Tests::of_app("app", &["boots"]),
            Self::Requests => Tests::of_app("app", &["interleavings"]),
            Self::Settings => Tests::of_app("app", &["settings::histories"]),
            Self::Hosts => Tests::of_app("app", &["hosts"]),
            Self::Safety => Tests::of_app("app", &["safety"]),
            Self::Bounds => Tests {
                package: "qemu-tests",
                program: "bounds",
                modules: &[],
            },
        })
    }

    /// One round, which ends within `limit` if the target can.
    fn round(self, seed: u64, limit: Option<Duration>) -> Command {
        if let Some(tests) = self.tests() {
            return tests.round(seed);
        }
        if self == Self::Properties {
            return properties(seed);
        }
        let mut smoke = Command::new(workspace::root().join("tests/fuzz/smoke"));
        let seconds = limit.map_or(FUZZ_LIMIT_S, |limit| limit.as_secs().max(1));
        // libFuzzer takes a seed of 32 bits, and 0 for none.
        let seed = (seed as u32).max(1);
        smoke.args([FUZZ_RUNS, seconds, seed.into()].map(|number| number.to_string()));
        smoke
    }

    fn attack(self, seed: u64, limit: Option<Duration>) -> Result<()> {
        println!("attack {}, seed {seed}", self.name());
        process::run(&mut self.round(seed, limit)).map_err(|failure| Error::Attack {
            target: self.name(),
            seed,
            failure: Box::new(failure),
        })
    }
}

/// A round of every property. Those that set their own number of cases keep it.
fn properties(seed: u64) -> Command {
    let mut test = Command::new("cargo");
    test.current_dir(workspace::root());
    test.args(["test", "--quiet", "--locked"]);
    test.args(
        PROPERTY_PACKAGES
            .iter()
            .flat_map(|package| ["--package", package]),
    );
    test.arg("--lib");
    test.args(
        PROPERTY_PROGRAMS
            .iter()
            .flat_map(|program| ["--test", program]),
    );
    test.env("PROPTEST_RNG_SEED", seed.to_string());
    test.env("PROPTEST_CASES", (PROPERTY_CASES * FACTOR).to_string());
    test.env(
        "PROPTEST_MAX_GLOBAL_REJECTS",
        (PROPERTY_REJECTS * FACTOR).to_string(),
    );
    test
}

/// Options of `cargo tasks attack`.
#[derive(clap::Args)]
pub struct Arguments {
    /// The targets [default: all, in turn]
    targets: Vec<Target>,
    /// Time after which no round begins: a number with s, m or h
    #[arg(long = "for", value_name = "TIME", value_parser = duration, default_value = "10m")]
    time: Duration,
    /// One round with this seed, which a failure has named
    #[arg(long, conflicts_with = "time")]
    seed: Option<u64>,
}

/// A number with its unit: s, m or h.
fn duration(text: &str) -> std::result::Result<Duration, String> {
    let wrong = || format!("'{text}' is no time; give a number with s, m or h, such as 10m");
    let unit = text.chars().last().ok_or_else(wrong)?;
    let seconds = match unit {
        's' => 1,
        'm' => 60,
        'h' => 3600,
        _ => return Err(wrong()),
    };
    let number: u64 = text[..text.len() - 1].parse().map_err(|_| wrong())?;
    number
        .checked_mul(seconds)
        .map(Duration::from_secs)
        .ok_or_else(wrong)
}

/// Attacks the targets in turn until the time is over, or once with the given seed.
///
/// # Errors
/// The first failure, with its seed.
pub fn run(arguments: &Arguments) -> Result<()> {
    let targets = if arguments.targets.is_empty() {
        &Target::ALL
    } else {
        arguments.targets.as_slice()
    };
    if let Some(seed) = arguments.seed {
        return targets
            .iter()
            .try_for_each(|target| target.attack(seed, None));
    }
    let begin = Instant::now();
    let mut rounds = 0;
    while let Some(left) = arguments.time.checked_sub(begin.elapsed()) {
        let target = targets[rounds % targets.len()];
        target.attack(RandomState::new().hash_one(rounds), Some(left))?;
        rounds += 1;
    }
    println!("{rounds} rounds found nothing");
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_time_has_a_number_and_a_unit() {
        assert_eq!(duration("10m"), Ok(Duration::from_mins(10)));
        assert_eq!(duration("90s"), Ok(Duration::from_secs(90)));
        assert_eq!(duration("2h"), Ok(Duration::from_hours(2)));
        for wrong in ["", "m", "10", "1d", "-1s", "10µ", "99999999999999999999h"] {
            assert!(duration(wrong).is_err(), "{wrong}");
        }
    }

    /// A module that is not there would be no test at all, and so find nothing.
    #[test]
    fn the_tests_of_each_target_are_there_and_get_its_seed() {
        for tests in Target::ALL.iter().filter_map(|target| target.tests()) {
            let programs = match tests.package {
                "stylus-app" => "firmware/app/tests",
                _ => "tests/qemu/tests",
            };
            let program = workspace::root().join(programs).join(tests.program);
            for module in tests.modules {
                let path = program.join(module.replace("::", "/"));
                let is_there = path.is_dir() || path.with_extension("rs").is_file();
                assert!(is_there, "{}", path.display());
            }
            assert!(!tests.modules.is_empty() || program.with_extension("rs").is_file());
            let round = tests.round(7);
            let seed = round
                .get_envs()
                .find(|(name, _)| *name == "STYLUS_ATTACK_SEED");
            assert_eq!(seed.and_then(|(_, seed)| seed), Some("7".as_ref()));
        }
    }

    #[test]
    fn a_round_of_all_properties_begins_with_its_seed() {
        let round = Target::Properties.round(7, None);
        let seed = round
            .get_envs()
            .find(|(name, _)| *name == "PROPTEST_RNG_SEED");
        assert_eq!(seed.and_then(|(_, seed)| seed), Some("7".as_ref()));
    }

    #[test]
    fn a_round_of_a_fuzzer_ends_with_the_time_that_is_left_and_begins_with_its_seed() {
        let round = Target::Fuzz.round(7, Some(Duration::from_secs(30)));
        let arguments: Vec<_> = round.get_args().collect();
        assert_eq!(arguments, ["1000000", "30", "7"]);
    }
}
