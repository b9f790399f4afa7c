//! A fake stylus behind a TCP port, for tests in another language. It prints its link, and ends when standard input
//! ends.
//!
//! With `--plant FILE` (or the name of a preset) a plant is at its output. `--plant-seed N` makes another specimen of
//! the plant, and `--log FILE` keeps the voltage at the pin, V, and the acceleration at the tip, m/s², as pairs of
//! `f32` at 40 kHz.

use std::collections::HashMap;
use std::error::Error;
use std::fs::File;
use std::io::{BufWriter, Read, Write};
use std::path::Path;

use fake_stylus::actuator::Actuator;
use fake_stylus::{FakeStylus, Hand};
use stylus_plant::Parameters;

fn main() -> Result<(), Box<dyn Error>> {
    let stylus = start()?;
    // The hand moves in contact, so that a texture played by the sensors is heard.
    stylus.set_hand(Hand::moving(120.0, 1.0));
    let mut output = std::io::stdout();
    writeln!(output, "{}", stylus.link())?;
    output.flush()?;
    std::io::stdin().read_to_end(&mut Vec::new())?;
    Ok(())
}

fn start() -> Result<FakeStylus, Box<dyn Error>> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let (pairs, rest) = words.as_chunks::<2>();
    let mut options: HashMap<&str, &str> = pairs.iter().map(|[name, value]| (&**name, &**value)).collect();
    let plant = options.remove("--plant");
    let seed = options.remove("--plant-seed").map(str::parse).transpose()?;
    let log = options.remove("--log").map(File::create).transpose()?;
    if !rest.is_empty() || !options.is_empty() {
        return Err("usage: serve [--plant FILE [--plant-seed N] [--log FILE]]".into());
    }
    let Some(plant) = plant else {
        return Ok(FakeStylus::start());
    };
    let design = Parameters::read(Path::new(plant))?;
    let parameters = seed.map_or_else(|| design.clone(), |seed| design.varied(seed));
    let log = log.map(|file| Box::new(BufWriter::new(file)) as Box<dyn Write + Send>);
    let actuator = Actuator::new(parameters, seed.unwrap_or_default(), log);
    Ok(FakeStylus::start_on(actuator))
}
