//! Erasing and writing the flash.

use model_format::link::FlashValues;

use crate::link::self_test::line::Line;

/// Longest erasure of a sector of 128 KB, ms (DS12110, flash memory programming, parallelism of 8 bits).
const ERASE_MS: f64 = 4_000.0;

/// Longest writing of a word, µs: 1 ms of the tasks between two looks at the flash, on top of what DS12110 gives for a
/// parallelism of 8 bits.
const WRITE_US: f64 = 2_000.0;

const WORN: &str =
    "the flash is slow or worn: check the 3.3 V and test again; if it stays, replace the board";

/// Judges a sector's erasure and writing.
pub fn flash(values: &FlashValues) -> Vec<Line> {
    let slot = values.slot;
    let mean = f64::from(values.write_us) / f64::from(values.words.max(1));
    vec![
        Line::number(
            format!("slot {slot} sector erase"),
            f64::from(values.erase_us) / 1e3,
            (f64::NEG_INFINITY, ERASE_MS),
            ("ms", 1),
            WORN,
        ),
        Line::none(
            format!("slot {slot} bytes not erased"),
            values.not_erased,
            WORN,
        ),
        Line::number(
            format!("slot {slot} word write, mean"),
            mean,
            (f64::NEG_INFINITY, WRITE_US),
            ("µs", 0),
            WORN,
        ),
        Line::none(format!("slot {slot} bytes wrong"), values.wrong, WORN),
    ]
}
