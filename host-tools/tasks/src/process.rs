//! Running programs.

use std::path::PathBuf;
use std::process::Command;

use anyhow::{Context, Result, bail};

/// Amount of output that a build shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Progress {
    /// Only its warnings and errors.
    Quiet,
    /// Each package as it is built.
    Shown,
}

impl Progress {
    /// Returns cargo's argument for this amount, if it needs one.
    pub fn argument(self) -> Option<&'static str> {
        (self == Self::Quiet).then_some("--quiet")
    }
}

/// Runs `command` to its end. Returns the exit code that this program has to return: that of `command`, or 1 if a
/// signal ended it.
pub fn become_like(command: &mut Command) -> Result<u8> {
    Ok(command
        .status()
        .with_context(|| format!("cannot run {}", name(command)))?
        .code()
        .and_then(|code| u8::try_from(code).ok())
        .unwrap_or(1))
}

/// Runs `command` to its end. Its output goes to the screen.
pub fn run(command: &mut Command) -> Result<()> {
    let status = command
        .status()
        .with_context(|| format!("cannot run {}", name(command)))?;
    if !status.success() {
        bail!("{} failed ({status}); see above", whole(command));
    }
    Ok(())
}

/// Runs `command` to its end, and returns its output without blanks around it.
///
/// # Errors
/// The program cannot be started, or fails. The error contains its message.
pub fn output(command: &mut Command) -> Result<String> {
    let output = command
        .output()
        .with_context(|| format!("cannot run {}", name(command)))?;
    if !output.status.success() {
        let told = String::from_utf8_lossy(&output.stderr);
        bail!("{} failed: {}", whole(command), told.trim());
    }
    Ok(String::from_utf8_lossy(&output.stdout).trim().to_owned())
}

fn whole(command: &Command) -> String {
    let arguments = command.get_args().map(|word| word.to_string_lossy());
    let words: Vec<_> = [name(command).into()].into_iter().chain(arguments).collect();
    words.join(" ")
}

/// Returns the program of `command`, as the caller gave it.
fn name(command: &Command) -> String {
    command.get_program().to_string_lossy().into_owned()
}

/// Returns the version that `program` prints after the word "version".
pub fn version(program: &PathBuf) -> Result<String> {
    let text = output(Command::new(program).arg("--version"))?;
    let mut words = text.split_whitespace().skip_while(|&word| word != "version");
    let version = words.nth(1);
    version
        .map(str::to_owned)
        .with_context(|| format!("{} tells no version", program.display()))
}

/// Returns the file of `program` on the search path.
///
/// # Errors
/// The program is not installed; `remedy` says how to install it.
pub fn find(program: &str, remedy: &str) -> Result<PathBuf> {
    let path = std::env::var_os("PATH").unwrap_or_default();
    std::env::split_paths(&path)
        .map(|folder| folder.join(program))
        .find(|file| file.is_file())
        .with_context(|| format!("{program} is not installed; install it: {remedy}"))
}

/// Returns `file`, which a build must have written.
pub fn built(file: PathBuf) -> Result<PathBuf> {
    if !file.is_file() {
        bail!("{}: the build succeeded and left no file here", file.display());
    }
    Ok(file)
}
