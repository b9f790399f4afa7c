//! The failures of tasks, with remedies.

use std::path::PathBuf;

use crate::target::{DEBIAN_PACKAGES, TARGET};

/// A task that failed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// No toolchain builds for the target.
    #[error(
        "no Rust toolchain here builds for {TARGET}; install it: `rustup target add {TARGET}`, or, where rustup has no \
         such target, on Debian 12 as root: `apt-get install {}`",
        DEBIAN_PACKAGES.join(" ")
    )]
    NoToolchain,
    /// No toolchain builds for pages.
    #[error(
        "the Rust toolchain here does not build for {target}; install it: `rustup target add {target}`. Pages take the \
         module that is kept, which nothing holds against its sources meanwhile"
    )]
    NoPageTarget {
        /// The target.
        target: &'static str,
    },
    /// The kept module is not what its sources give.
    #[error(
        "{path}: {problem}; if the kernel or the format has changed on purpose, `cargo tasks browser-module` writes it \
         anew",
        path = path.display()
    )]
    KeptModule {
        /// The file.
        path: PathBuf,
        /// The difference.
        problem: String,
    },
    /// A needed program is missing.
    #[error(
        "{program} is not installed; install it, on Debian as root: `apt-get install {package}`"
    )]
    NoProgram {
        /// The program.
        program: &'static str,
        /// The Debian package that has it.
        package: &'static str,
    },
    /// A program could not be started, or its end could not be awaited.
    #[error("cannot run {program}: {source}")]
    Run {
        /// The program.
        program: String,
        /// The system's reason.
        source: std::io::Error,
    },
    /// A program ended with a failure. Its output is on the screen already.
    #[error("{program} failed ({status}); see above")]
    Failed {
        /// The program with its arguments.
        program: String,
        /// The exit status.
        status: std::process::ExitStatus,
    },
    /// A build ended well and left no image.
    #[error("{path}: the build succeeded and left no image here", path = .0.display())]
    NoImage(PathBuf),
    /// A page has another table than its command writes.
    #[error(transparent)]
    Page(#[from] crate::tables::page::PageError),
    /// A name is that of no table.
    #[error("no command writes a table '{name}'; there are {known}")]
    NoTable {
        /// The name.
        name: String,
        /// The names of all tables.
        known: String,
    },
    /// The emulated image failed.
    #[error("the image on {machine} failed ({status}); its last lines:\n{tail}")]
    Guest {
        /// The emulated machine.
        machine: &'static str,
        /// The emulator's exit status.
        status: std::process::ExitStatus,
        /// The last printed lines.
        tail: String,
    },
    /// The emulated image did not end.
    #[error(
        "the image on {machine} did not end within {seconds} s and was stopped; its last lines:\n{tail}"
    )]
    Timeout {
        /// The emulated machine.
        machine: &'static str,
        /// The time that it was given, s.
        seconds: u64,
        /// The last printed lines.
        tail: String,
    },
    /// A traced image did not end.
    #[error("the image did not end within {0} lines of the emulator's log and was stopped")]
    Endless(u64),
    /// A job is larger than the emulated memory's room for it.
    #[error("a job for the image takes more than the {0} bytes of its room")]
    LargeJob(usize),
    /// The file of a job cannot be written.
    #[error("cannot write a temporary file for the emulator: {0}")]
    JobFile(std::io::Error),
    /// A count failed.
    #[error(transparent)]
    Count(#[from] qemu_tests::error::Error),
    /// A trace has other calls than the image's job.
    #[error("{processor}, {what}: {problem}")]
    Calls {
        /// The processor.
        processor: &'static str,
        /// The played structure, order and number of nodes.
        what: String,
        /// The difference.
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
    /// An attack found something.
    #[error("{failure}\nto see it again: cargo tasks attack {target} --seed {seed}")]
    Attack {
        /// The attack.
        target: &'static str,
        /// Its seed.
        seed: u64,
        /// The failure of the program that ran it.
        failure: Box<Error>,
    },
    /// A file cannot be written.
    #[error("{path}: {source}", path = path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// The image printed something else than a report.
    #[error("line {line} of the image's report: {problem}")]
    Report {
        /// The line, from 1.
        line: usize,
        /// The line's fault.
        problem: String,
    },
    /// The emulated processor and the host played different samples.
    #[error("{processor}, {arithmetic}, {what}: {problem}")]
    Bits {
        /// The processor.
        processor: &'static str,
        /// The multiplication of pairs of 16-bit numbers: a keyword.
        arithmetic: String,
        /// The texture, or the edges of arithmetic.
        what: String,
        /// The first difference.
        problem: String,
    },
    /// A file is no image of a program.
    #[error("the image cannot be read: {0}")]
    Elf(String),
    /// Code or data that the tick reaches is in flash.
    #[error("{0}: all that the tick reaches must be in ITCM or DTCM; name it in firmware/tick.x")]
    Placement(String),
    /// The image takes more of a memory than it may.
    #[error("the image takes {used} bytes of {name}, and may take {limit}")]
    LargeImage {
        /// The memory.
        name: &'static str,
        /// Taken bytes.
        used: u64,
        /// The limit, bytes.
        limit: u64,
    },
    /// The image depends on where it is built.
    #[error("{0}: see --remap-path-prefix in host-tools/tasks/src/firmware/mod.rs")]
    Reproducible(String),
    /// The table of costs cannot be read.
    #[error("{path}: {problem}; write it again with `cargo tasks costs`", path = path.display())]
    Costs {
        /// The file.
        path: PathBuf,
        /// The problem.
        problem: String,
    },
    /// A file is none of measured cycles.
    #[error("{path}: {problem}; `cargo tasks hil --cycles` writes such a file", path = path.display())]
    Cycles {
        /// The file.
        path: PathBuf,
        /// The problem.
        problem: String,
    },
    /// The flashing program is missing.
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
        /// The excess or the variation.
        problem: String,
    },
}

/// The result of a task.
pub type Result<T> = std::result::Result<T, Error>;
