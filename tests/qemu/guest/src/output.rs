//! Lines of output to the host.

use core::fmt::{self, Write};

use cortex_m_semihosting::hio::HostStream;
use kernel_vectors::report::{WORDS, WORDS_PER_LINE};

/// The emulator's standard output.
pub struct Output(HostStream);

impl Output {
    pub fn new(stream: HostStream) -> Self {
        Self(stream)
    }

    pub fn line(&mut self, line: fmt::Arguments<'_>) {
        self.0.write_fmt(line).expect("the emulator takes all output");
        self.text("\n");
    }

    fn text(&mut self, text: &str) {
        self.0.write_str(text).expect("the emulator takes all output");
    }
}

/// A buffer that collects words into lines, because each call to the host stops the emulator.
pub struct Words<'a> {
    output: &'a mut Output,
    gathered: [u32; WORDS_PER_LINE],
    len: usize,
}

impl<'a> Words<'a> {
    pub fn new(output: &'a mut Output) -> Self {
        Self {
            output,
            gathered: [0; WORDS_PER_LINE],
            len: 0,
        }
    }

    pub fn push(&mut self, word: u32) {
        self.gathered[self.len] = word;
        self.len += 1;
        if self.len == WORDS_PER_LINE {
            self.write();
        }
    }

    pub fn finish(mut self) {
        if self.len > 0 {
            self.write();
        }
    }

    fn write(&mut self) {
        const WORD_CHARACTERS: usize = 9;
        let mut line = [b' '; WORDS_PER_LINE * WORD_CHARACTERS];
        let used = &mut line[..self.len * WORD_CHARACTERS];
        for (place, word) in used.as_chunks_mut::<WORD_CHARACTERS>().0.iter_mut().zip(self.gathered) {
            for (nibble, character) in place.iter_mut().skip(1).enumerate() {
                let digit = word >> (28 - 4 * nibble) & 15;
                *character = b"0123456789abcdef"[digit as usize];
            }
        }
        let text = core::str::from_utf8(used).expect("digits and spaces");
        self.output.line(format_args!("{WORDS}{text}"));
        self.len = 0;
    }
}
