//! Running programs.

use std::path::PathBuf;
use std::process::Command;

use crate::error::{Error, Result};

/// Amount that a build says while it goes on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Progress {
    /// Nothing but its warnings and errors.
    Quiet,
    /// Each package as it is built.
    Shown,
}

impl Progress {
    /// Cargo's argument for it, if it needs one.
    pub fn argument(self) -> Option<&'static str> {
        (self == Self::Quiet).then_some("--quiet")
    }
}

/// Runs `command` to its end, as if it were this program, and returns its exit code; 1 if a signal ended it.
///
/// # Errors
/// The program cannot be started.
pub fn become_like(command: &mut Command) -> Result<u8> {
    let status = command.status().map_err(|source| Error::Run {
        program: name(command),
        source,
    })?;
    let code = status.code().and_then(|code| u8::try_from(code).ok());
    Ok(code.unwrap_or(1))
}

/// Runs `command` to its end; it prints to the screen.
///
/// # Errors
/// The program cannot be started, or ends with a failure.
pub fn run(command: &mut Command) -> Result<()> {
    let status = command.status().map_err(|source| Error::Run {
        program: name(command),
        source,
    })?;
    if status.success() {
        Ok(())
    } else {
        let arguments = command
            .get_args()
            .map(|argument| argument.to_string_lossy());
        Err(Error::Failed {
            program: [name(command).into()]
                .into_iter()
                .chain(arguments)
                .collect::<Vec<_>>()
                .join(" "),
            status,
        })
    }
}

/// The program of `command`, as the caller gave it.
pub fn name(command: &Command) -> String {
    command.get_program().to_string_lossy().into_owned()
}

/// The file of `program` on the search path.
pub fn find(program: &str) -> Option<PathBuf> {
    let path = std::env::var_os("PATH")?;
    std::env::split_paths(&path)
        .map(|folder| folder.join(program))
        .find(|file| file.is_file())
}
