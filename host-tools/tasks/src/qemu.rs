//! Running an image on an emulated processor.

use std::io::{BufRead, BufReader, Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::thread;
use std::time::Duration;

use anyhow::{Context, Result, bail};
use kernel_vectors::job::{self, ADDRESS, Job};
use kernel_vectors::report::WORDS;
use qemu_tests::trace::Trace;
use wait_timeout::ChildExt;

use crate::guest::Processor;
use crate::process;

const QEMU: &str = "qemu-system-arm";

/// The longest run. The image takes a second or two, and a machine that is a hundred times slower is out of order.
const TIME_LIMIT: Duration = Duration::from_mins(3);

/// The most lines of a log: some minutes' worth, and more than any traced job has. A longer run does not end at all.
const MOST_LINES: u64 = 200_000_000;

/// The lines of output that a message quotes.
const TAIL_LINES: usize = 20;

/// The emulator's file.
///
/// # Errors
/// QEMU is missing.
pub fn find() -> Result<PathBuf> {
    process::find(QEMU, "on Debian as root, `apt-get install qemu-system-arm`")
}

/// QEMU's version as it prints it: numbers with points.
///
/// # Errors
/// QEMU is missing or prints no version.
pub fn version() -> Result<String> {
    process::version(&find()?)
}

/// Runs `image` to its end, with `job` in its memory if there is one, and returns its output.
///
/// Virtual time advances by 256 ns per instruction, whatever the host does, so that the image's counts repeat exactly.
///
/// # Errors
/// QEMU is missing, the image fails, or it does not end in time.
pub fn run(processor: Processor, image: &Path, job: Option<&Job<'_>>) -> Result<String> {
    let job = job.map(JobFile::write).transpose()?;
    let mut child = command(processor, image, job.as_ref())?
        .args(["-icount", "shift=8"])
        .spawn()?;
    // Both are read while it runs, because a full pipe would stop it.
    let output = read_to_end(child.stdout.take());
    let errors = read_to_end(child.stderr.take());
    let status = child.wait_timeout(TIME_LIMIT)?;
    if status.is_none() {
        child.kill().and_then(|()| child.wait())?;
    }
    let output = output.join().unwrap_or_default();
    let errors = errors.join().unwrap_or_default();
    let tail = || tail(&format!("{output}{errors}"));
    let machine = processor.machine();
    match status {
        Some(status) if status.success() => Ok(output),
        Some(status) => bail!(
            "the image on {machine} failed ({status}); its last lines:\n{}",
            tail()
        ),
        None => bail!(
            "the image on {machine} did not end within {} s and was stopped; its last lines:\n{}",
            TIME_LIMIT.as_secs(),
            tail()
        ),
    }
}

/// Runs `image` to its end with `job` in its memory, and hands `executed` the address of each instruction, in order.
///
/// # Errors
/// QEMU is missing, the image fails or does not end, or `executed` refuses an instruction.
pub fn trace(
    processor: Processor,
    image: &Path,
    job: &Job<'_>,
    mut executed: impl FnMut(u32) -> qemu_tests::error::Result<()>,
) -> Result<()> {
    let mut trace = Trace::default();
    log(processor, image, job, &mut |line| {
        trace.take(line)?.map_or(Ok(()), &mut executed)
    })?;
    Ok(trace.end().map_or(Ok(()), executed)?)
}

/// Runs `image` to its end with `job` in its memory, one instruction per block, and hands `take` each line of the log.
fn log(
    processor: Processor,
    image: &Path,
    job: &Job<'_>,
    take: &mut dyn FnMut(&str) -> qemu_tests::error::Result<()>,
) -> Result<()> {
    let version = version()?;
    let job = JobFile::write(job)?;
    let mut child = command(processor, image, Some(&job))?
        .args(one_instruction_per_block(&version))
        .args(["-d", "exec,nochain"])
        .spawn()?;
    let output = read_to_end(child.stdout.take());
    let log = child.stderr.take();
    let log = log.map(|log| BufReader::with_capacity(1 << 20, log));
    let followed = log.map_or(Ok(Vec::new()), |log| follow(log, take));
    if followed.is_err() {
        // It may have ended already, and its status no longer matters.
        let _ = child.kill();
    }
    let status = child.wait()?;
    let output = output.join().unwrap_or_default();
    let rest = followed?;
    if !status.success() || !rest.is_empty() {
        let (machine, rest) = (processor.machine(), rest.join("\n"));
        bail!(
            "the image on {machine} failed ({status}); its last lines:\n{}",
            tail(&format!("{output}{rest}"))
        );
    }
    Ok(())
}

/// Hands on the lines of a trace, and returns the others, which are the emulator's messages.
fn follow(
    log: impl BufRead,
    take: &mut dyn FnMut(&str) -> qemu_tests::error::Result<()>,
) -> Result<Vec<String>> {
    let (mut rest, mut count) = (Vec::new(), 0u64);
    for line in log.lines() {
        match take(&line?) {
            Ok(()) => {
                count += 1;
                if count > MOST_LINES {
                    bail!("the image did not end within {MOST_LINES} lines of the emulator's log");
                }
            }
            Err(qemu_tests::error::Error::Line(line)) => rest.push(line),
            Err(error) => return Err(error.into()),
        }
    }
    Ok(rest)
}

/// The option that makes each block one instruction. QEMU 8.1 renamed it.
fn one_instruction_per_block(version: &str) -> &'static [&'static str] {
    let mut numbers = version
        .split('.')
        .map(|number| number.parse::<u32>().unwrap_or(0));
    if (numbers.next(), numbers.next()) < (Some(8), Some(1)) {
        &["-singlestep"]
    } else {
        &["-accel", "tcg,one-insn-per-tb=on"]
    }
}

/// The emulator with `image`. It prints nothing but the image's output.
fn command(processor: Processor, image: &Path, job: Option<&JobFile>) -> Result<Command> {
    let mut command = Command::new(find()?);
    command
        .args(["-machine", processor.machine()])
        .args(["-display", "none", "-monitor", "none", "-serial", "none"])
        .args(["-semihosting-config", "enable=on,target=native"])
        .arg("-kernel")
        .arg(image)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    if let Some(JobFile(file)) = job {
        // QEMU reads a doubled comma as one within a value.
        let path = file.path().to_string_lossy().replace(',', ",,");
        command.args([
            "-device",
            &format!("loader,file={path},addr={ADDRESS:#x},force-raw=on"),
        ]);
    }
    Ok(command)
}

/// A job in a file for the emulator. The file is removed with this value.
struct JobFile(tempfile::NamedTempFile);

impl JobFile {
    fn write(job: &Job<'_>) -> Result<Self> {
        let too_large = || {
            format!(
                "a job takes more than the {} bytes of its room",
                job::CAPACITY
            )
        };
        let bytes = job::write(job).with_context(too_large)?;
        let mut file = tempfile::NamedTempFile::new()?;
        file.write_all(&bytes)?;
        Ok(Self(file))
    }
}

/// Reads all of `stream` in a thread of its own.
fn read_to_end(stream: Option<impl Read + Send + 'static>) -> thread::JoinHandle<String> {
    thread::spawn(move || {
        let mut bytes = Vec::new();
        if let Some(mut stream) = stream {
            // After an error, the text so far is all there is to show.
            let _ = stream.read_to_end(&mut bytes);
        }
        String::from_utf8_lossy(&bytes).into_owned()
    })
}

/// The last lines without those of played words, which tell a reader nothing.
fn tail(text: &str) -> String {
    let told = |line: &&str| !line.starts_with(WORDS);
    let lines: Vec<_> = text.lines().filter(told).collect();
    lines[lines.len().saturating_sub(TAIL_LINES)..].join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_instruction_per_block_is_asked_for_by_the_name_that_the_version_knows() {
        for (version, option) in [
            ("7.2.22", "-singlestep"),
            ("8.0.5", "-singlestep"),
            ("8.1.0", "-accel"),
            ("10.0.2", "-accel"),
        ] {
            assert_eq!(one_instruction_per_block(version)[0], option, "{version}");
        }
    }

    #[test]
    fn what_the_emulator_says_beside_its_trace_is_kept_apart() {
        let log = "Trace 0: 0x1 [0/00000400/0/0] a\nqemu: no\nTrace 0: 0x1 [0/00000402/0/0] a\n";
        let (mut trace, mut executed) = (Trace::default(), Vec::new());
        let rest = follow(log.as_bytes(), &mut |line| {
            executed.extend(trace.take(line)?);
            Ok(())
        });
        executed.extend(trace.end());
        assert_eq!(rest.unwrap(), ["qemu: no"]);
        assert_eq!(executed, [0x400, 0x402]);
    }

    #[test]
    fn a_tail_is_the_last_lines_without_words() {
        let lines: Vec<_> = (0..100).map(|line| line.to_string()).collect();
        assert_eq!(tail(&lines.join("\n")), lines[80..].join("\n"));
        assert_eq!(tail("one\nwords 00000000"), "one");
    }
}
