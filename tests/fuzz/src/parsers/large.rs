//! Large files: a small grammar, repeated up to 10 MB, is read by the target of its format. What is looked for are
//! readers whose time or memory grows faster than a file: with its columns, keys, chunks or depth.
//!
//! Bounds of time are otherwise no part of this project's tests. Here one is judged, of the processor's time, because
//! a fuzzer is the only one that tries what nobody has thought of.

use std::fs;
use std::path::Path;
use std::sync::OnceLock;

use host_tools::support::bounded_file::Format;

use super::target_of;
use crate::{Judge, targets};

/// Sizes of a large file, bytes: the first one that its format allows.
const SIZES: [usize; 2] = [10 << 20, 1 << 20];

/// Largest memory, bytes: 20 times the largest of [`SIZES`], and 4 times for the copy of 8 bytes per sample with which
/// a recording's target compares. A format that allows less is bounded by that, whatever it takes per byte.
const MOST_MEMORY: u64 = (20 + 4) * SIZES[0] as u64;

/// Longest time, in units of what [`ORDINARY`] takes. The command reads and judges that in 0.35 s of the processor, so
/// that this is 2 s of an optimised build; an instrumented one takes five times as long, for both alike.
const MOST_TIME: f64 = 6.0;

/// Byte of a piece that stands for a number, which is one higher each time.
const NUMBER: u8 = 0x1f;

/// A recording as loggers write it.
const ORDINARY: (Format, Grammar<'_>) = (
    Format::Table,
    Grammar {
        head: &[(0, b"\x01time_us,x,y,z\n")],
        repeated: &[(0, b"\x1f00,1.25,-0.5,9.81\n")],
        tail: &[],
    },
);

/// A piece of a file, after the power of two of its repetitions.
pub type Piece<'a> = (u8, &'a [u8]);

/// A file: its head, what is repeated until the file is full, and its tail.
pub struct Grammar<'a> {
    pub head: &'a [Piece<'a>],
    pub repeated: &'a [Piece<'a>],
    pub tail: &'a [Piece<'a>],
}

impl Grammar<'_> {
    /// Returns the input that [`judge`] reads as this grammar of a file of `format`.
    pub fn input(&self, format: Format) -> Vec<u8> {
        let number = Format::ALL.iter().position(|&one| one == format);
        let mut input = vec![number.expect("it is one of all") as u8];
        input.extend([self.head.len() as u8, self.repeated.len() as u8]);
        for (power, piece) in [self.head, self.repeated, self.tail].concat() {
            input.push(power);
            input.extend((piece.len() as u16).to_le_bytes());
            input.extend(piece);
        }
        input
    }

    /// Returns the file of at most `size` bytes.
    fn file(&self, size: usize) -> Vec<u8> {
        let mut file = Vec::with_capacity(size);
        let mut number = 0u64;
        let mut append = |pieces: &[Piece<'_>], most: usize| {
            let before = file.len();
            for (power, piece) in pieces {
                // As many numbers as a file has room for are enough.
                let (times, piece) = match piece.contains(&NUMBER) {
                    true => (1 << (power % 24), piece.to_vec()),
                    false => (1, piece.repeat((1 << (power % 24)).min(size / piece.len().max(1)))),
                };
                for _ in 0..times {
                    for (index, part) in piece.split(|&byte| byte == NUMBER).enumerate() {
                        file.extend((index > 0).then(|| number.to_string()).unwrap_or_default().bytes());
                        file.extend_from_slice(part);
                    }
                    number += 1;
                    if file.len() > most {
                        file.truncate(most);
                        return false;
                    }
                }
            }
            file.len() > before
        };
        append(self.head, size);
        while append(self.repeated, size - size / 16) {}
        append(self.tail, size);
        file
    }
}

/// Checks the time and the memory of the file whose grammar `input` is.
pub fn judge(input: &[u8]) {
    let Some((&[format, head, repeated], mut rest)) = input.split_first_chunk() else {
        return;
    };
    let format = Format::ALL[usize::from(format) % Format::ALL.len()];
    let mut pieces = Vec::new();
    while let Some((&[power, low, high], after)) = rest.split_first_chunk() {
        let length = usize::from(u16::from_le_bytes([low, high]));
        let (piece, after) = after.split_at(length.min(after.len()));
        pieces.push((power, piece));
        rest = after;
    }
    let (head, others) = pieces.split_at(usize::from(head).min(pieces.len()));
    let (repeated, tail) = others.split_at(usize::from(repeated).min(others.len()));
    let Some((time, memory)) = cost(format, &Grammar { head, repeated, tail }) else {
        return;
    };
    static UNIT: OnceLock<u64> = OnceLock::new();
    let unit = *UNIT.get_or_init(|| cost(ORDINARY.0, &ORDINARY.1).expect("it has a target").0);
    let times = time as f64 / unit as f64;
    assert!(
        times < MOST_TIME,
        "a {format:?} takes {times:.1} times the time of an ordinary recording"
    );
    assert!(memory < MOST_MEMORY, "a {format:?} takes {memory} bytes of memory");
}

/// Returns the processor's time of this thread, ns, and the memory, bytes, that a file of this grammar takes; `None` if
/// no target reads the format.
fn cost(format: Format, grammar: &Grammar<'_>) -> Option<(u64, u64)> {
    let name = target_of(format)?;
    let reader: Judge = targets().into_iter().find(|target| target.0 == name)?.1;
    let size = SIZES
        .into_iter()
        .find(|&size| format.admit(Path::new(""), size as u64).is_ok())?;
    let file = grammar.file(size);
    // From here on, the highest memory is counted anew.
    fs::write("/proc/self/clear_refs", "5").expect("Linux counts memory");
    let (memory, begin) = (status("VmRSS:"), processor_ns());
    reader(&file);
    let time = processor_ns() - begin;
    Some((time, status("VmHWM:").saturating_sub(memory)))
}

/// Returns the processor's time of this thread, ns.
fn processor_ns() -> u64 {
    let text = fs::read_to_string("/proc/thread-self/schedstat").expect("Linux counts time");
    let time = text.split(' ').next().and_then(|time| time.parse().ok());
    time.expect("the time is first")
}

/// Returns the value, bytes, of this process's status that has this name.
fn status(name: &str) -> u64 {
    let text = fs::read_to_string("/proc/self/status").expect("Linux counts memory");
    let value = text
        .lines()
        .find_map(|line| line.strip_prefix(name)?.strip_suffix("kB"));
    let kilobytes: Option<u64> = value.and_then(|value| value.trim().parse().ok());
    1024 * kilobytes.expect("it is in kB")
}
