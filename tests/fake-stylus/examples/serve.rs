//! A fake stylus behind a TCP port for tests in another language: prints its link, and ends when standard input does.

use std::io::{Read, Write};

use fake_stylus::{FakeStylus, Hand};

fn main() -> std::io::Result<()> {
    let stylus = FakeStylus::start();
    // In motion and contact, so that what is played by the sensors is heard.
    stylus.set_hand(Hand {
        speed_mm_s: 120.0,
        force_n: 1.0,
        ..Hand::default()
    });
    let mut output = std::io::stdout();
    writeln!(output, "{}", stylus.link())?;
    output.flush()?;
    std::io::stdin().read_to_end(&mut Vec::new()).map(drop)
}
