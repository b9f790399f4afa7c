//! The failures of counting, with remedies.

/// A count that failed.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file is no image of a program.
    #[error("the image cannot be read: {0}")]
    Image(String),
    /// The image has no function to count of that name, or more than one.
    #[error("the image has {found} functions whose names contain '{name}', and it must have one")]
    Function {
        /// The part of the name.
        name: String,
        /// The number of such functions.
        found: usize,
    },
    /// A line of the emulator's log is none of a trace.
    #[error("the emulator's log has the line '{0}', which is none of a trace")]
    Line(String),
    /// The emulator took back an instruction that was not the last one.
    #[error(
        "the emulator took back the instruction at {taken_back:#010x}, and the last was at {last:#010x}"
    )]
    TakenBack {
        /// The address in the log.
        taken_back: u32,
        /// The address before it.
        last: u32,
    },
    /// An executed address has no code.
    #[error("{0:#010x} was executed, and the image has no code there")]
    NoCode(u32),
    /// A counted function was entered without a call.
    #[error(
        "a counted function was entered at {0:#010x} without a call, so that its end is not known"
    )]
    NoCall(u32),
    /// The trace ends within a counted function.
    #[error("the trace ends within the function at {0:#010x}")]
    Cut(u32),
    /// The disassembler failed.
    #[error("the disassembler failed: {0}")]
    Disassembler(#[from] capstone::Error),
}

/// The result of counting.
pub type Result<T> = std::result::Result<T, Error>;
