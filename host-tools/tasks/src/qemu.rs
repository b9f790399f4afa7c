//! Running an image on an emulated processor.

use std::io::Read;
use std::path::Path;
use std::process::{Command, Stdio};
use std::thread;
use std::time::Duration;

use kernel_vectors::report::WORDS;
use wait_timeout::ChildExt;

use crate::error::{Error, Result};
use crate::guest::Processor;
use crate::process;

const QEMU: &str = "qemu-system-arm";

/// The image takes a second or two; a machine that is a hundred times slower is out of order.
const TIME_LIMIT: Duration = Duration::from_mins(3);

/// How much of the output a message quotes.
const TAIL_LINES: usize = 20;

/// Checks that QEMU is there.
///
/// # Errors
/// It is not.
pub fn check() -> Result<()> {
    match process::find(QEMU) {
        Some(_) => Ok(()),
        None => Err(Error::NoProgram {
            program: QEMU,
            package: QEMU,
        }),
    }
}

/// Runs `image` to its end and gives what it printed.
///
/// Virtual time goes on by 256 ns with each instruction, whatever the host does, so that what the image counts repeats
/// exactly.
///
/// # Errors
/// QEMU is missing, the image fails, or it does not end in time.
pub fn run(processor: Processor, image: &Path) -> Result<String> {
    check()?;
    let machine = processor.machine();
    let failed = |source| Error::Run {
        program: QEMU.to_owned(),
        source,
    };
    let mut child = Command::new(QEMU)
        .args(["-machine", machine])
        .args(["-display", "none", "-monitor", "none", "-serial", "none"])
        .args(["-semihosting-config", "enable=on,target=native"])
        .args(["-icount", "shift=8"])
        .arg("-kernel")
        .arg(image)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .map_err(failed)?;
    // Both are read while it runs: a full pipe would stop it.
    let output = read_to_end(child.stdout.take());
    let errors = read_to_end(child.stderr.take());
    let status = child.wait_timeout(TIME_LIMIT).map_err(failed)?;
    if status.is_none() {
        child.kill().and_then(|()| child.wait()).map_err(failed)?;
    }
    let output = output.join().unwrap_or_default();
    let errors = errors.join().unwrap_or_default();
    let tail = || tail(&format!("{output}{errors}"));
    match status {
        Some(status) if status.success() => Ok(output),
        Some(status) => Err(Error::Guest {
            machine,
            status,
            tail: tail(),
        }),
        None => Err(Error::Timeout {
            machine,
            seconds: TIME_LIMIT.as_secs(),
            tail: tail(),
        }),
    }
}

/// Reads all of `stream` in a thread of its own.
fn read_to_end(stream: Option<impl Read + Send + 'static>) -> thread::JoinHandle<String> {
    thread::spawn(move || {
        let mut bytes = Vec::new();
        if let Some(mut stream) = stream {
            // What was read until an error is what there is to show.
            let _ = stream.read_to_end(&mut bytes);
        }
        String::from_utf8_lossy(&bytes).into_owned()
    })
}

/// The last lines that are not played words, which say nothing to a reader.
fn tail(text: &str) -> String {
    let told = |line: &&str| !line.starts_with(WORDS);
    let lines: Vec<_> = text.lines().filter(told).collect();
    lines[lines.len().saturating_sub(TAIL_LINES)..].join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tail_is_the_last_lines_without_words() {
        let lines: Vec<_> = (0..100).map(|line| line.to_string()).collect();
        assert_eq!(tail(&lines.join("\n")), lines[80..].join("\n"));
        assert_eq!(tail("one\nwords 00000000"), "one");
    }
}
