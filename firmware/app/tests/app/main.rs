//! Tests of the application on the host, through its public interface, on flash that can lose power.
//!
//! `boots`, `interleavings`, `hosts`, `probe`, `recorder`, `settings::histories`, `slot_faults` and `safety` choose
//! their cases at random from a seed: few in an ordinary run, more with other seeds while `cargo tasks attack` runs.
#![expect(clippy::result_large_err, reason = "errors carry their reason as text")]

mod boots;
mod hosts;
mod inputs;
mod interleavings;
mod lines;
mod probe;
mod recorder;
mod requests;
mod safety;
mod self_test;
mod settings;
mod slot_faults;
mod slots;
mod speed;
mod start;
mod update;
mod upload;

/// Seed and number of cases of an attack, of the model checks and of the application's tests by random cases.
mod budget {
    use std::env;
    use std::str::FromStr;

    use proptest::test_runner::{Config, RngSeed};

    /// Seed of a run; without the variable, the seed of `tests/run`.
    pub fn seed() -> u64 {
        number("STYLUS_ATTACK_SEED").unwrap_or(1)
    }

    /// `cases` times the factor that was asked for, or a tenth of them, so that a run of all tests takes seconds.
    pub fn cases(cases: u32) -> u32 {
        let factor = number::<u32>("STYLUS_ATTACK_FACTOR");
        factor.map_or(cases.div_ceil(10), |factor| cases * factor)
    }

    fn number<T: FromStr>(name: &str) -> Option<T> {
        let text = env::var(name).ok()?;
        let number = text.parse().ok();
        assert!(number.is_some(), "{name}={text} is not a whole number");
        number
    }

    /// Configuration of a property's tests: `count` random cases, scaled by [`cases`], all derived from the seed.
    pub fn config(count: u32) -> Config {
        Config {
            cases: cases(count),
            rng_seed: RngSeed::Fixed(seed()),
            ..Config::default()
        }
    }

    /// Random choices by a generator of 64 bits (xorshift of Marsaglia).
    pub struct Chance(u64);

    impl Chance {
        /// The random choices with number `stream` of `seed`.
        pub fn new(seed: u64, stream: u64) -> Self {
            let mixed = (seed ^ stream.wrapping_mul(0x9E37_79B9_7F4A_7C15)).wrapping_mul(0xD129_0DE5);
            let mut chance = Self(mixed | 1);
            for _ in 0..8 {
                chance.below(2);
            }
            chance
        }

        /// A number below `bound`.
        pub fn below(&mut self, bound: usize) -> usize {
            self.0 ^= self.0 << 13;
            self.0 ^= self.0 >> 7;
            self.0 ^= self.0 << 17;
            ((self.0 >> 11) % bound as u64) as usize
        }
    }
}
