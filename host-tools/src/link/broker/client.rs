//! Clients of a broker, and the programs that they are.

/// Number of a client, which no later one has.
pub(super) type ClientId = u64;

/// A program at the other end of the socket.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Program {
    /// Its command.
    pub(super) command: String,
    /// Number of its process, if the system tells it.
    pub(super) process: Option<i32>,
}

impl std::fmt::Display for Program {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "`stylus {}`", self.command)?;
        match self.process {
            Some(process) => write!(f, " (process {process})"),
            None => Ok(()),
        }
    }
}
