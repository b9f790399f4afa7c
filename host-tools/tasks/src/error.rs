//! What can go wrong, with what to do about it.

use std::path::PathBuf;

use crate::target::{DEBIAN_PACKAGES, TARGET};

/// A task that failed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// No toolchain builds for the target.
    #[error(
        "no Rust toolchain here builds for {TARGET}; install it: `rustup target add {TARGET}`, or, where rustup has no such \
         target, on Debian 12 as root: `apt-get install {}`",
        DEBIAN_PACKAGES.join(" ")
    )]
    NoToolchain,
    /// A program that a task needs is missing.
    #[error(
        "{program} is not installed; install it, on Debian as root: `apt-get install {package}`"
    )]
    NoProgram {
        /// The program.
        program: &'static str,
        /// The Debian package that has it.
        package: &'static str,
    },
    /// A program could not be started or waited for.
    #[error("cannot run {program}: {source}")]
    Run {
        /// The program.
        program: String,
        /// Why not.
        source: std::io::Error,
    },
    /// A program ended with a failure; what it printed is on the screen already.
    #[error("{program} failed ({status}); see above")]
    Failed {
        /// The program with its arguments.
        program: String,
        /// How it ended.
        status: std::process::ExitStatus,
    },
    /// A build ended well and left no image.
    #[error("{path}: the build left no image here", path = .0.display())]
    NoImage(PathBuf),
    /// The image in the emulator failed.
    #[error("the image on {machine} failed ({status}); its last lines:\n{tail}")]
    Guest {
        /// The emulated machine.
        machine: &'static str,
        /// How the emulator ended.
        status: std::process::ExitStatus,
        /// What was printed last.
        tail: String,
    },
    /// The image in the emulator did not end.
    #[error(
        "the image on {machine} did not end within {seconds} s and was stopped; its last lines:\n{tail}"
    )]
    Timeout {
        /// The emulated machine.
        machine: &'static str,
        /// How long it was given.
        seconds: u64,
        /// What was printed last.
        tail: String,
    },
    /// A traced image that does not end.
    #[error("the image did not end within {0} lines of the emulator's log and was stopped")]
    Endless(u64),
    /// A job that the emulated memory has no room for.
    #[error("a job for the image takes more than the {0} bytes that it has for one")]
    LargeJob(usize),
    /// A job that cannot be written.
    #[error("a temporary file for the emulator: {0}")]
    JobFile(std::io::Error),
    /// Something that cannot be counted.
    #[error(transparent)]
    Count(#[from] qemu_tests::error::Error),
    /// A trace with other calls than the image was told to make.
    #[error("{processor}, {what}: {problem}")]
    Calls {
        /// The processor.
        processor: &'static str,
        /// What was played.
        what: String,
        /// What is wrong.
        problem: String,
    },
    /// A file or folder cannot be read.
    #[error("{path}: {source}", path = path.display())]
    Read {
        /// The file or folder.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// Code or pages depart from the drawn layout. The departures are on the screen already.
    #[error(
        "the house is not as drawn, in {0} places above; the rules are in host-tools/tasks/src/house"
    )]
    House(usize),
    /// A file that cannot be written.
    #[error("{path}: {source}", path = path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// Why not.
        source: std::io::Error,
    },
    /// The image printed something else than a report.
    #[error("line {line} of the image's report: {problem}")]
    Report {
        /// The line, from 1.
        line: usize,
        /// What is wrong with it.
        problem: String,
    },
    /// The emulated processor and the host played different samples.
    #[error("{processor}, {arithmetic}, {what}: {problem}")]
    Bits {
        /// The processor.
        processor: &'static str,
        /// How pairs of 16-bit numbers were multiplied.
        arithmetic: String,
        /// The texture, or what else was played.
        what: String,
        /// The first difference.
        problem: String,
    },
    /// A file that is no image of a program.
    #[error("the image cannot be read: {0}")]
    Elf(String),
    /// Something that the tick reaches is not where it must be.
    #[error("{0}: what the tick reaches must be in ITCM and DTCM, name it in firmware/tick.x")]
    Placement(String),
    /// The program that flashes is missing.
    #[error(
        "probe-rs is not installed; install it: https://probe.rs/docs/getting-started/installation"
    )]
    NoProbeRs,
    /// A sample cost too much, or its cost depends on the data.
    #[error("{processor}, {texture}: {problem}")]
    Cost {
        /// The processor.
        processor: &'static str,
        /// The texture.
        texture: String,
        /// What is wrong.
        problem: String,
    },
}

/// What tasks return.
pub type Result<T> = std::result::Result<T, Error>;
