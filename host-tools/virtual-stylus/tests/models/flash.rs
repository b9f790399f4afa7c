//! The flash: contents that outlive a run, power cuts, and unreadable words.

use std::path::Path;
use std::process::Command;

use virtual_stylus::flash_file::FlashFile;
use virtual_stylus::model::flash::{BASE, BYTES, Contents, Kind, Moment, SECTOR_BYTES, Stalls, WORD_BYTES};
use virtual_stylus::{Error, Options, ResetCause};

use crate::bench::{MILLISECOND_NS, TICK_NS, ask, ready, words};

const BANK_2: u32 = 0x0810_0000;
const ERASED: u32 = u32::MAX;
/// Length of the image's report of a fault: `!`, the status of bank 2, and the number of the unreadable flash word in
/// its bank.
const FAULT_BYTES: usize = 1 + 4 + 4;

fn with(flash: Contents) -> Options {
    Options {
        flash,
        ..Options::default()
    }
}

/// The content of the flash if the power is cut at operation `number`. Each operation is requested by one `command`.
fn cut(flash: Contents, command: u8, number: u64, moment: Moment) -> Contents {
    let mut stylus = ready(with(flash));
    stylus.capture_power_cuts(vec![(number, moment)]);
    for _ in 0..number {
        ask(&mut stylus, command, 1);
    }
    let [cut] = <[_; 1]>::try_from(stylus.take_power_cuts()).expect("one cut");
    assert_eq!(cut.operation.number, number);
    cut.contents
}

#[test]
fn what_was_programmed_outlives_the_run_and_its_file() {
    let mut stylus = ready(Options::default());
    assert_eq!(words(&ask(&mut stylus, b'r', 16)), [ERASED; 4]);
    ask(&mut stylus, b'p', 1);
    ask(&mut stylus, b'p', 1);
    let file = Path::new(env!("CARGO_TARGET_TMPDIR")).join("kept.flash");
    stylus.flash().write(&file).unwrap();
    let mut stylus = ready(with(Contents::read(&file).unwrap()));
    assert_eq!(words(&ask(&mut stylus, b'r', 16)), [1, 2, ERASED, ERASED]);
    ask(&mut stylus, b'e', 1);
    assert_eq!(words(&ask(&mut stylus, b'r', 16)), [ERASED; 4]);
}

#[test]
fn a_read_of_a_bank_that_is_busy_waits_and_then_has_what_was_programmed() {
    let mut stylus = ready(Options::default());
    ask(&mut stylus, b'e', 1);
    ask(&mut stylus, b'p', 1);
    // A program that waits for the bank before it reads is not stalled.
    assert_eq!(stylus.flash_stalls(), Stalls::default());
    assert_eq!(words(&ask(&mut stylus, b'b', 4)), [2]);
    assert_eq!(words(&ask(&mut stylus, b'b', 4)), [3]);
    let stalls = stylus.flash_stalls();
    assert_eq!((stalls.fetches, stalls.reads), (0, 2));
    assert_eq!(words(&ask(&mut stylus, b'r', 16)), [1, 2, 3, ERASED]);
}

#[test]
fn code_in_a_bank_that_is_busy_stands_still_and_so_do_its_interrupts() {
    /// A lower bound of the time that an erasure takes according to the datasheet.
    const ERASING_NS: u64 = 500 * MILLISECOND_NS;
    let mut stylus = ready(Options::default());
    ask(&mut stylus, b'c', 2);
    stylus.take_ticks();
    let begun = stylus.now_ns();
    ask(&mut stylus, b'E', 1);
    let nanos = stylus.now_ns() - begun;
    assert!(nanos > ERASING_NS, "{nanos} ns");
    let stalls = stylus.flash_stalls();
    assert!(stalls.fetches >= 1 && stalls.reads == 0, "{stalls:?}");
    let ticks = stylus.take_ticks();
    assert!((ticks.len() as u64) < nanos / TICK_NS / 10, "{} ticks", ticks.len());
    // Time has continued, and the code runs on.
    ask(&mut stylus, b'c', 2);
    stylus.run_for(100 * TICK_NS);
    assert!(stylus.take_ticks().len() >= 99);
}

#[test]
fn code_outside_of_a_busy_bank_stands_still_too_if_it_may_fetch_ahead_from_it() {
    let mut stylus = ready(Options::default());
    ask(&mut stylus, b'M', 1);
    assert_eq!(stylus.flash_stalls(), Stalls::default());
    ask(&mut stylus, b'R', 1);
    let expected = Stalls {
        ahead: 1,
        ..Stalls::default()
    };
    assert_eq!(stylus.flash_stalls(), expected);
}

#[test]
fn every_program_and_erase_is_one_operation() {
    let mut stylus = ready(Options::default());
    for command in *b"epp" {
        ask(&mut stylus, command, 1);
    }
    let operations: Vec<Kind> = stylus.flash_operations().into_iter().map(|done| done.kind).collect();
    let word = |number: u32| {
        let bytes: Vec<u8> = std::iter::repeat_n(number.to_le_bytes(), 8).flatten().collect();
        bytes.try_into().unwrap()
    };
    let expected = [
        Kind::Erase(BANK_2..BANK_2 + SECTOR_BYTES),
        Kind::Program {
            address: BANK_2,
            word: word(1),
        },
        Kind::Program {
            address: BANK_2 + WORD_BYTES,
            word: word(2),
        },
    ];
    assert_eq!(operations, expected);
}

#[test]
fn a_word_torn_by_a_power_cut_is_a_bus_fault_with_its_place_when_read_until_its_sector_is_erased() {
    const DOUBLE_ERROR: u32 = 1 << 26;
    let flash = cut(Contents::default(), b'p', 3, Moment::During { seed: 7 });
    assert!(flash.unreadable.iter().eq(&[BANK_2 + 2 * WORD_BYTES]));
    let mut stylus = ready(with(flash));
    let answer = ask(&mut stylus, b'r', 2 * 4 + FAULT_BYTES);
    assert_eq!(words(&answer[..8]), [1, 2]);
    assert_eq!(answer[8], b'!', "a bus fault, which the image takes for a hard one");
    let told = words(&answer[9..]);
    assert_eq!((told[0] & DOUBLE_ERROR, told[1]), (DOUBLE_ERROR, 2));
    assert_eq!(stylus.failed_reads(), 1);
    stylus.run_for(crate::bench::READY_NS);
    let resets = stylus.resets();
    assert_eq!(resets.len(), 1);
    assert_eq!(resets[0].cause, ResetCause::Software);
    ask(&mut stylus, b'e', 1);
    assert_eq!(words(&ask(&mut stylus, b'r', 16)), [ERASED; 4]);
    assert!(stylus.flash().unreadable.is_empty());
}

#[test]
fn a_cut_before_or_after_an_operation_leaves_a_whole_word() {
    for (moment, second) in [(Moment::Before, ERASED), (Moment::After, 2)] {
        let mut stylus = ready(with(cut(Contents::default(), b'p', 2, moment)));
        let left = words(&ask(&mut stylus, b'r', 16));
        assert_eq!(left, [1, second, ERASED, ERASED]);
    }
}

#[test]
fn a_cut_erase_leaves_the_rest_of_the_flash_alone() {
    let mut flash = Contents::default();
    flash.place(u64::from(BANK_2), &vec![0; SECTOR_BYTES as usize]).unwrap();
    flash.place(u64::from(BANK_2 + SECTOR_BYTES), &[0; 64]).unwrap();
    let cut = cut(flash, b'e', 1, Moment::During { seed: 3 });
    let sector = BANK_2..BANK_2 + SECTOR_BYTES;
    let start = (BANK_2 - BASE) as usize;
    let end = start + SECTOR_BYTES as usize;
    assert!(cut.bytes[start..end].contains(&0) && cut.bytes[start..end].contains(&0xFF));
    assert!(!cut.unreadable.is_empty() && cut.unreadable.iter().all(|word| sector.contains(word)));
    assert!(cut.bytes[end..end + 64].iter().all(|&byte| byte == 0));
}

#[test]
fn a_word_programmed_twice_cannot_be_read() {
    let mut stylus = ready(Options::default());
    ask(&mut stylus, b'p', 1);
    ask(&mut stylus, b'P', 1);
    assert_eq!(ask(&mut stylus, b'r', FAULT_BYTES)[0], b'!');
}

/// An audit must be able to fail, so it must see that the ticks of this image execute from flash.
#[test]
fn an_audit_sees_code_in_flash_and_every_tick_is_followed() {
    let mut stylus = ready(Options::default());
    let audits = stylus.take_audits();
    let first = audits.first().expect("the first tick is always audited");
    // The handler of this image is in flash.
    assert_eq!(first.flash_fetches, first.instructions);
    assert!(!first.places.is_empty());
    // The image is ready after 100 periods of the tick, of which its start takes some.
    let ticks = stylus.take_ticks();
    assert!(ticks.len() > 90 && stylus.unfollowed_ticks() == 0);
    assert!((ticks.iter()).all(|tick| u64::from(tick.instructions) == first.instructions));
}

#[test]
fn a_file_with_marks_outside_of_the_flash_or_within_a_word_is_refused() {
    let path = Path::new(env!("CARGO_TARGET_TMPDIR")).join("marks.flash");
    let sound = Contents {
        unreadable: [BASE].into(),
        filled: [BASE + BYTES as u32 - WORD_BYTES].into(),
        ..Contents::default()
    };
    sound.write(&path).unwrap();
    assert_eq!(Contents::read(&path).unwrap(), sound);
    for mark in [0, BASE - WORD_BYTES, BASE + 2, BASE + BYTES as u32] {
        let foreign = Contents {
            unreadable: [mark].into(),
            ..Contents::default()
        };
        foreign.write(&path).unwrap();
        let refused = Contents::read(&path).unwrap_err().to_string();
        assert!(refused.contains("no word of the flash"), "{refused}");
    }
}

/// Runs the virtual stylus's program with its flash in `file` and without an image. Returns its exit code and its
/// messages.
fn start_with(file: &Path) -> (Option<i32>, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_virtual-stylus"))
        .args(["--image", "no-such-image", "--flash"])
        .arg(file)
        .output()
        .expect("the program starts");
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    (output.status.code(), said)
}

#[test]
fn a_second_run_with_the_same_flash_file_is_refused_by_its_name_until_the_first_ends() {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR"));
    let (file, link) = (folder.join("locked.flash"), folder.join("locked-link"));
    let _ = std::fs::remove_file(&file);
    let _ = std::fs::remove_file(&link);
    std::os::unix::fs::symlink(&file, &link).unwrap();
    let (mut held, contents) = FlashFile::open(&file).unwrap();
    held.write(&contents).unwrap();
    // The file is refused under another name, too, and from this process.
    for name in [&file, &link] {
        let refused = FlashFile::open(name);
        assert!(
            matches!(&refused, Err(Error::FlashFileInUse { path }) if path == name),
            "{refused:?}"
        );
        let (code, said) = start_with(name);
        assert_eq!(code, Some(2), "{said}");
        assert_eq!(said.trim_end().lines().count(), 1, "{said}");
        assert!(said.contains(&name.display().to_string()), "{said}");
        assert!(said.contains("end that one") && said.contains("--flash"), "{said}");
    }
    let kept = Contents::read(&file).unwrap();
    assert_eq!(kept.to_bytes(), contents.to_bytes(), "the refused ones changed nothing");
    drop(held);
    // The file is free now, so only the image is missing.
    let (code, said) = start_with(&file);
    assert!(code == Some(2) && said.contains("no-such-image"), "{said}");
}
