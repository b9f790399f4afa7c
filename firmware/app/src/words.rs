//! Text of bounded length.

use core::fmt::{self, Display, Write};

use heapless::String;

/// The part of a text that fits in `N` bytes.
struct Fitting<const N: usize>(String<N>);

impl<const N: usize> Write for Fitting<N> {
    /// Appends the characters that fit and drops the rest.
    fn write_str(&mut self, text: &str) -> fmt::Result {
        for character in text.chars() {
            if self.0.push(character).is_err() {
                break;
            }
        }
        Ok(())
    }
}

/// The text of `value`, cut to `N` bytes.
pub(crate) fn in_words<const N: usize>(value: &impl Display) -> String<N> {
    let mut words = Fitting(String::new());
    // Neither this writer nor the Display of a value in this program fails.
    let _ = write!(words, "{value}");
    words.0
}
