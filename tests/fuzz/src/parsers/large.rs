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

/// Largest memory, bytes: 20 times the largest of [`SIZES`], and 8 times for the copy of 8 bytes per sample with which
/// a recording's target compares. A format that allows less is bounded by that, whatever it takes per byte.
const MOST_MEMORY: u64 = (20 + 8) * SIZES[0] as u64;

/// Longest time per byte, in units of what [`ORDINARY`] takes. The command reads that in 0.35 s of the processor, and
/// its target does twice. A target reads what it accepts up to three times, each within 2 s of an optimised build; an
/// instrumented one takes some five times as long, for all alike.
const MOST_TIME: f64 = 3.0 * 2.0 / (2.0 * 0.35);

/// Byte of a piece that stands for a number, which is one higher each time.
const NUMBER: u8 = 0x1f;

/// A recording as loggers write it.
const ORDINARY: Grammar<'_> = [&[(0, b"\x01time_us,x,y,z\n")], &[(0, b"\x1f00,1.25,-0.5,9.81\n")], &[]];

/// A piece of a file, after the power of two of its repetitions.
pub type Piece<'a> = (u8, &'a [u8]);

/// A file: its head, what is repeated until the file is full, and its tail.
pub type Grammar<'a> = [&'a [Piece<'a>]; 3];

/// Returns the input that [`judge`] reads as this grammar of a file of `format`.
pub fn input(format: Format, grammar: Grammar<'_>) -> Vec<u8> {
    let number = Format::ALL
        .iter()
        .position(|&one| one == format)
        .expect("it is one of all");
    let mut input = [number, grammar[0].len(), grammar[1].len()]
        .map(|number| number as u8)
        .to_vec();
    for (power, piece) in grammar.concat() {
        input.push(power);
        input.extend((piece.len() as u16).to_le_bytes());
        input.extend(piece);
    }
    input
}

/// Returns the file of at most `size` bytes.
fn file([head, repeated, tail]: Grammar<'_>, size: usize) -> Vec<u8> {
    let (mut file, mut number) = (Vec::with_capacity(size), 0u64);
    // Returns whether something was appended, and room is left.
    let mut append = |pieces: &[Piece<'_>], most: usize| {
        let before = file.len();
        for (power, piece) in pieces.iter().filter(|(_, piece)| !piece.is_empty()) {
            for _ in 0..1u32 << (power % 24) {
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
    append(head, size);
    while append(repeated, size - size / 16) {}
    append(tail, size);
    file
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
    let Some((time, memory)) = cost(format, [head, repeated, tail]) else {
        return;
    };
    static UNIT: OnceLock<f64> = OnceLock::new();
    let unit = *UNIT.get_or_init(|| cost(Format::Table, ORDINARY).expect("it has a target").0);
    let times = time / unit;
    assert!(
        times < MOST_TIME,
        "a {format:?} takes {times:.1} times the time of an ordinary recording"
    );
    assert!(memory < MOST_MEMORY, "a {format:?} takes {memory} bytes of memory");
}

/// Returns the processor's time, ns per byte, and the memory, bytes, that a file of this grammar takes; `None` if no
/// target reads the format.
fn cost(format: Format, grammar: Grammar<'_>) -> Option<(f64, u64)> {
    let name = target_of(format)?;
    let reader: Judge = targets().into_iter().find(|target| target.0 == name)?.1;
    let size = SIZES
        .into_iter()
        .find(|&size| format.admit(Path::new(""), size as u64).is_ok())?;
    let file = file(grammar, size);
    // From here on, the highest memory is counted anew.
    fs::write("/proc/self/clear_refs", "5").expect("Linux counts memory");
    let [memory, begin] = spent();
    reader(&file);
    let [highest, end] = spent();
    // Linux adds up what its processors count apart, so the highest may be some pages below what was counted before.
    Some(((end - begin) as f64 / size as f64, highest.saturating_sub(memory)))
}

/// Returns the highest memory of this process, bytes, and the processor's time of this thread, ns.
fn spent() -> [u64; 2] {
    let number = |path: &str, after: &str| {
        let text = fs::read_to_string(path).expect("Linux counts memory and time");
        let (_, rest) = text.split_once(after).expect("it is there");
        rest.split_whitespace()
            .next()
            .and_then(|number| number.parse::<u64>().ok())
            .expect("it is a number")
    };
    [
        1024 * number("/proc/self/status", "VmHWM:"),
        number("/proc/thread-self/schedstat", ""),
    ]
}
