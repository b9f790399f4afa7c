//! Running an image on an emulated processor, and the image that plays the test vectors: `tests/qemu/guest`.

use std::io::{Read, Write};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::thread;
use std::time::Duration;

use anyhow::{Context, Result, bail};
use kernel_vectors::job::{self, ADDRESS, Job};
use kernel_vectors::report::WORDS;
use wait_timeout::ChildExt;

use crate::process;
use crate::toolchain::Toolchain;
use crate::workspace::{self, TARGET};

const QEMU: &str = "qemu-system-arm";

/// Longest run. The image needs a second or two; only a fault needs so long, on however busy a machine.
const TIME_LIMIT: Duration = Duration::from_mins(15);

/// Number of lines of output that a message quotes.
const TAIL_LINES: usize = 20;

/// Returns the emulator's file: the one on the search path, or the one that `tests/run` unpacked.
pub fn find() -> Result<PathBuf> {
    let unpacked = workspace::tools_folder().join("debian/programs").join(QEMU);
    process::find(
        QEMU,
        "`tests/run` unpacks it on Debian without root; as root, `apt-get install qemu-system-arm`",
    )
    .or_else(|missing| if unpacked.is_file() { Ok(unpacked) } else { Err(missing) })
}

/// Returns QEMU's version in the form that QEMU prints: numbers with points.
pub fn version() -> Result<String> {
    process::version(&find()?)
}

/// Runs `image` to its end, with `job` in its memory if given, and returns its output.
///
/// Virtual time advances by 256 ns per instruction, whatever the host does, so that the image's counts repeat exactly.
pub fn run(processor: Processor, image: &Path, job: Option<&Job<'_>>) -> Result<String> {
    let job = job.map(JobFile::write).transpose()?;
    let mut child = command(processor, image, job.as_ref())?
        .args(["-icount", "shift=8"])
        .spawn()?;
    // Both are read during the run, because a full pipe would block the emulator.
    let output = read_to_end(child.stdout.take());
    let errors = read_to_end(child.stderr.take());
    let status = child.wait_timeout(TIME_LIMIT)?;
    if status.is_none() {
        // The end of the emulator closes its pipes, so that their readers end, too.
        child.kill().and_then(|()| child.wait())?;
    }
    let output = output.join().unwrap_or_default();
    let errors = errors.join().unwrap_or_default();
    let tail = || tail(&format!("{output}{errors}"));
    let machine = processor.machine();
    match status {
        Some(status) if status.success() => Ok(output),
        Some(status) => bail!("the image on {machine} failed ({status}); its last lines:\n{}", tail()),
        None => bail!(
            "the image on {machine} did not end within {} s and was stopped; its last lines:\n{}",
            TIME_LIMIT.as_secs(),
            tail()
        ),
    }
}

/// Returns the command of the emulator with `image`. It prints only the image's output.
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
        // Within a value, QEMU reads two commas as one.
        let path = file.path().to_string_lossy().replace(',', ",,");
        command.args(["-device", &format!("loader,file={path},addr={ADDRESS:#x},force-raw=on")]);
    }
    Ok(command)
}

/// A job in a file for the emulator. The file is removed when this value is dropped.
struct JobFile(tempfile::NamedTempFile);

impl JobFile {
    fn write(job: &Job<'_>) -> Result<Self> {
        let too_large = || format!("a job takes more than the {} bytes of its room", job::CAPACITY);
        let bytes = job::write(job).with_context(too_large)?;
        let mut file = tempfile::NamedTempFile::new()?;
        file.write_all(&bytes)?;
        Ok(Self(file))
    }
}

/// Reads all of `stream` in a separate thread.
fn read_to_end(stream: Option<impl Read + Send + 'static>) -> thread::JoinHandle<String> {
    thread::spawn(move || {
        let mut bytes = Vec::new();
        if let Some(mut stream) = stream {
            // After an error, only the text so far can be shown.
            let _ = stream.read_to_end(&mut bytes);
        }
        String::from_utf8_lossy(&bytes).into_owned()
    })
}

/// Returns the last lines, without the lines of played words, which do not help a reader.
fn tail(text: &str) -> String {
    let told = |line: &&str| !line.starts_with(WORDS);
    let lines: Vec<_> = text.lines().filter(told).collect();
    lines[lines.len().saturating_sub(TAIL_LINES)..].join("\n")
}

/// A processor for which the kernel is built. QEMU emulates each on one of Arm's boards.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Processor {
    /// The processor of a small stylus.
    CortexM4,
    /// The processor of the product's board.
    CortexM7,
}

impl Processor {
    /// All processors.
    pub const ALL: [Self; 2] = [Self::CortexM4, Self::CortexM7];

    /// Returns the compiler's name of the processor.
    pub const fn name(self) -> &'static str {
        match self {
            Self::CortexM4 => "cortex-m4",
            Self::CortexM7 => "cortex-m7",
        }
    }

    /// Returns QEMU's name of the board.
    pub const fn machine(self) -> &'static str {
        match self {
            Self::CortexM4 => "mps2-an386",
            Self::CortexM7 => "mps2-an500",
        }
    }
}

/// Returns the folder of the guest's workspace.
pub fn guest_folder() -> PathBuf {
    workspace::root().join("tests/qemu/guest")
}

/// Returns flags for the compiler: the processor, cortex-m-rt's linker script, and segments without padding to pages.
pub fn guest_flags(processor: Processor) -> String {
    let name = processor.name();
    format!("-C target-cpu={name} -C link-arg=-Tlink.x -C link-arg=--nmagic")
}

/// Builds the guest, and returns its image.
pub fn build_guest(toolchain: &Toolchain, processor: Processor) -> Result<PathBuf> {
    let target_folder = workspace::target_folder(processor.name());
    let mut cargo = toolchain.cargo("build", &guest_folder(), &target_folder);
    cargo.args(["--release", "--quiet"]);
    cargo.env("RUSTFLAGS", guest_flags(processor));
    process::run(&mut cargo)?;
    process::built(target_folder.join(TARGET).join("release/kernel-guest"))
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
