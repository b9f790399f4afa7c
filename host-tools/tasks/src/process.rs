//! Running programs.

use std::path::PathBuf;
use std::process::Command;

use anyhow::{Context, Result, bail};

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
    let status = command.status();
    let status = status.with_context(|| format!("cannot run {}", name(command)))?;
    let code = status.code().and_then(|code| u8::try_from(code).ok());
    Ok(code.unwrap_or(1))
}

/// Runs `command` to its end; it prints to the screen.
///
/// # Errors
/// The program cannot be started, or ends with a failure.
pub fn run(command: &mut Command) -> Result<()> {
    let status = command.status();
    let status = status.with_context(|| format!("cannot run {}", name(command)))?;
    if !status.success() {
        let arguments: Vec<_> = command
            .get_args()
            .map(|word| word.to_string_lossy())
            .collect();
        bail!(
            "{} {} failed ({status}); see above",
            name(command),
            arguments.join(" ")
        );
    }
    Ok(())
}

/// The program of `command`, as the caller gave it.
pub fn name(command: &Command) -> String {
    command.get_program().to_string_lossy().into_owned()
}

/// The version that `program` prints after the word "version".
///
/// # Errors
/// It cannot be run, or prints none.
pub fn version(program: &PathBuf) -> Result<String> {
    let output = Command::new(program).arg("--version").output()?;
    let text = String::from_utf8_lossy(&output.stdout);
    let mut words = text
        .split_whitespace()
        .skip_while(|&word| word != "version");
    let version = words.nth(1);
    version
        .map(str::to_owned)
        .with_context(|| format!("{} tells no version", program.display()))
}

/// The file of `program` on the search path.
///
/// # Errors
/// It is not installed; `remedy` says how to.
pub fn find(program: &str, remedy: &str) -> Result<PathBuf> {
    let path = std::env::var_os("PATH").unwrap_or_default();
    std::env::split_paths(&path)
        .map(|folder| folder.join(program))
        .find(|file| file.is_file())
        .with_context(|| format!("{program} is not installed; install it: {remedy}"))
}

/// `file`, which a build has left.
///
/// # Errors
/// It is not there.
pub fn built(file: PathBuf) -> Result<PathBuf> {
    if !file.is_file() {
        bail!(
            "{}: the build succeeded and left no file here",
            file.display()
        );
    }
    Ok(file)
}
