//! Text of a bounded length.

use core::fmt::{self, Display, Write};

use heapless::String;

/// What fits of a text.
struct Fitting<const N: usize>(String<N>);

impl<const N: usize> Write for Fitting<N> {
    /// Takes what fits and drops the rest, character by character.
    fn write_str(&mut self, text: &str) -> fmt::Result {
        for character in text.chars() {
            if self.0.push(character).is_err() {
                break;
            }
        }
        Ok(())
    }
}

/// `told` as far as it fits in `N` bytes.
pub(crate) fn in_words<const N: usize>(told: &impl Display) -> String<N> {
    let mut words = Fitting(String::new());
    // Writing to it never fails, and the Display of what is told does not.
    let _ = write!(words, "{told}");
    words.0
}
