//! Paired comparisons of what the host's work takes: rendering by the kernel's plain arithmetic and by the host's own,
//! whole fits by NumPy with SciPy and by `stylus`, and whole commands of an older `stylus` and of this one.
//! `cargo tasks bench-host` runs it.
//!
//! Both sides of a pair run in turns, so that what else the computer does falls on both. Each turn gives a ratio of
//! times, before to after; shown are the median ratio and the quarters around it. Goals stand beside the ratios, and no
//! failure comes of them, because a ratio depends on the computer.

mod commands;
mod fits;
mod pairs;
mod rendering;

use std::path::PathBuf;

struct Arguments {
    /// Few and short turns, to see that it runs.
    is_quick: bool,
    /// An older `stylus`, whose commands are compared with this one's.
    before: Option<PathBuf>,
    /// The Python that fits with NumPy and SciPy.
    python: Option<PathBuf>,
}

impl Arguments {
    fn parse() -> Self {
        let mut arguments = std::env::args().skip(1);
        let mut parsed = Self {
            is_quick: false,
            before: None,
            python: None,
        };
        while let Some(argument) = arguments.next() {
            match argument.as_str() {
                "--quick" => parsed.is_quick = true,
                "--before" => parsed.before = arguments.next().map(PathBuf::from),
                "--python" => parsed.python = arguments.next().map(PathBuf::from),
                // Cargo's own.
                "--bench" => {}
                other => {
                    panic!("unknown argument {other}: give --quick, --before FILE or --python FILE")
                }
            }
        }
        parsed
    }
}

fn main() {
    let arguments = Arguments::parse();
    pairs::head();
    rendering::compare(arguments.is_quick);
    fits::compare(arguments.python.as_deref(), arguments.is_quick);
    commands::compare(arguments.before.as_deref(), arguments.is_quick);
}
