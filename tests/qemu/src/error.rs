//! Why something cannot be counted.

/// A count that failed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file that is no image of a program.
    #[error("the image cannot be read: {0}")]
    Image(String),
    /// A function that is to be counted is not in the image, or more than one is.
    #[error(
        "the image has {found} functions whose names contain '{name}', and one is to be counted"
    )]
    Function {
        /// A part of its name.
        name: String,
        /// How many there are.
        found: usize,
    },
    /// A line of the emulator's log that is none of a trace's.
    #[error("the emulator's log has the line '{0}', which is none of a trace")]
    Line(String),
    /// An instruction taken back that was not the last one.
    #[error(
        "the emulator took back the instruction at {taken_back:#010x}, and the last was at {last:#010x}"
    )]
    TakenBack {
        /// The address in the log.
        taken_back: u32,
        /// The address before it.
        last: u32,
    },
    /// An address without code.
    #[error("{0:#010x} was executed, and the image has no code there")]
    NoCode(u32),
    /// An instruction of which the manual's tables, as they stand in `tests/qemu/src/thumb.rs`, say nothing.
    #[error(
        "the time of '{text}' at {address:#010x} is not known: add it to tests/qemu/src/thumb.rs with its source"
    )]
    Unknown {
        /// Where it is.
        address: u32,
        /// What it is, disassembled.
        text: String,
    },
    /// A counted function was reached by something else than a call.
    #[error("a counted function was entered at {0:#010x} by no call, so that its end is not known")]
    NoCall(u32),
    /// The trace ended within a counted function.
    #[error("the trace ends within the function at {0:#010x}")]
    Cut(u32),
    /// The disassembler failed.
    #[error("the disassembler: {0}")]
    Disassembler(#[from] capstone::Error),
    /// The table of costs cannot be read.
    #[error("tests/qemu/costs.json: {0}; make it anew with `cargo tasks costs`")]
    Costs(#[from] serde_json::Error),
}

/// What counting returns.
pub type Result<T> = std::result::Result<T, Error>;
