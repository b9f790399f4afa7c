//! Files that commands write: the rule for existing files, which is checked before the work; WAV files, with their
//! lines on standard output; and renderings at the stylus's pin.

use std::any::TypeId;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use clap::{ArgMatches, Command};
use stylus_fit::fit::inputs::{Input, files_behind};
use stylus_plant::Parameters;
use stylus_plant::Plant;
use stylus_signals::playing::pin::{PinSummary, RATE_HZ, render_pin_wav, render_tip_wav, settings};
use stylus_signals::playing::render::{Rendering, WavFormat, write_wav};
use stylus_support::number::counted;
use stylus_support::output;
use stylus_support::progress;
use stylus_support::{Error, Result};

use super::input::positive;
use super::output::{print, warn};

/// Flag that lets outputs be replaced.
#[derive(clap::Args)]
pub struct Overwrite {
    /// Replace an output that is there already [env: STYLUS_OVERWRITE]
    #[arg(long)]
    overwrite: bool,
}

impl Overwrite {
    /// Returns true if an existing output is to be replaced.
    pub fn is_asked(&self) -> bool {
        // The variable is not read by clap, because clap would count its value as a given option, in conflict with
        // options that exclude all others.
        let of_environment = std::env::var_os("STYLUS_OVERWRITE");
        let is_no = |value: &OsStr| ["", "0", "n", "no", "f", "false", "off"].iter().any(|no| value == *no);
        self.overwrite || of_environment.is_some_and(|value| !is_no(&value))
    }

    /// Checks a file that will be written.
    pub fn file(&self, path: &Path) -> Result<()> {
        output::check_file(path, self.is_asked(), &inputs(path))
    }

    /// Checks a file that will be written. It may be the input `own`, if that is extended in place.
    pub fn file_in_place(&self, path: &Path, own: &Path) -> Result<()> {
        let mut others = inputs(path);
        others.retain(|input| input != own);
        output::check_file(path, self.is_asked(), &others)
    }

    /// Checks a folder that will be written.
    pub fn folder(&self, path: &Path) -> Result<()> {
        output::check_folder(path, self.is_asked(), &inputs(path))
    }
}

/// Checks a file in a folder that grows. An earlier file is replaced without asking.
pub fn check_in_growing_folder(path: &Path) -> Result<()> {
    output::check_file(path, true, &inputs(path))
}

/// Names of the arguments with the path of an output. Every other path is an input, so that nothing needs to be added
/// here for the inputs of a new command.
const OUTPUTS: [&str; 5] = ["out", "json_out", "report", "record", "svg"];

/// The argument of `trials` that names the folder for which the list is written.
const UNLISTED: &str = "folder";

/// The inputs of this process's command.
static INPUTS: OnceLock<Vec<Input>> = OnceLock::new();

/// Stores the inputs among the arguments of `command`, for the checks of its outputs.
pub fn remember_inputs(command: &Command, matches: &ArgMatches) {
    // The arguments belong to the innermost command, such as `compile` of `scene`.
    let (mut command, mut matches) = (command, matches);
    while let Some((name, inner)) = matches.subcommand() {
        let Some(found) = command.find_subcommand(name) else {
            break;
        };
        (command, matches) = (found, inner);
    }
    let mut all = Vec::new();
    for argument in command.get_arguments() {
        let (id, kind) = (argument.get_id().as_str(), argument.get_value_parser());
        // By the type of the value, so that a new command's inputs are known without a word here.
        if kind.type_id() == TypeId::of::<PathBuf>() && !OUTPUTS.contains(&id) {
            let given = matches.get_many::<PathBuf>(id).into_iter().flatten();
            all.extend(given.map(|path| Input {
                path: path.clone(),
                is_unlisted: id == UNLISTED,
            }));
        }
    }
    // Each process runs one command.
    let _ = INPUTS.set(all);
}

/// Returns the files of the command's inputs, which `output` must not replace.
fn inputs(output: &Path) -> Vec<PathBuf> {
    files_behind(INPUTS.get().map_or(&[], Vec::as_slice), output)
}

/// The file that a rendering is written to: samples of the synthesis, or those at the pin or at the tip.
#[derive(clap::Args)]
pub struct RenderedFile {
    /// WAV file to write: 32-bit float, m/s²
    #[arg(long, value_name = "WAV")]
    out: PathBuf,
    #[command(flatten)]
    overwrite: Overwrite,
    /// Write 16-bit samples with this full scale in m/s² instead, for listening
    #[arg(long, value_name = "FULL_SCALE", value_parser = positive)]
    pcm16: Option<f64>,
    /// Write what the stylus puts out at its pin instead: volts above mid-scale, 32-bit float, at 40 kHz
    #[arg(long, conflicts_with = "pcm16")]
    pin: bool,
    /// Write what the pin makes of the tip instead, by an actuator model: m/s², 32-bit float, at 40 kHz; a TOML file,
    /// or haptuator or mark-ii-d
    #[arg(long, value_name = "FILE", conflicts_with_all = ["pin", "pcm16"])]
    plant: Option<PathBuf>,
    /// Setting of the stylus for --pin or --plant, such as output-gain=0.02 [default: the defaults]
    #[arg(long = "set", value_name = "NAME=VALUE", value_parser = setting)]
    settings: Vec<(String, f32)>,
}

impl RenderedFile {
    /// Checks that the file can be written.
    pub fn check(&self) -> Result<()> {
        self.overwrite.file(&self.out)
    }

    /// Writes `rendering` to the file, and prints what the file holds; `source` names what was rendered.
    pub fn render(&self, mut rendering: Rendering<'_>, source: &str) -> Result<()> {
        if self.pin || self.plant.is_some() {
            return self.write_pin(&mut rendering, source);
        }
        if !self.settings.is_empty() {
            return Err(Error::Request(
                "--set changes what leaves the pin: give --pin or --plant too".into(),
            ));
        }
        self.write(&mut rendering, source)
    }

    /// Returns the format of the file.
    fn format(&self) -> WavFormat {
        self.pcm16
            .map_or(WavFormat::Float32, |full_scale_m_s2| WavFormat::Pcm16 {
                full_scale_m_s2,
            })
    }

    /// Writes `rendering`, prints the number of samples of `source` in the file, and warns of clipped samples and of
    /// samples at full scale.
    fn write(&self, rendering: &mut Rendering<'_>, source: &str) -> Result<()> {
        let rate_hz = rendering.sample_rate_hz();
        let bar = progress::bar(rendering.len() as u64, "rendering");
        // By reference, because the rendering is asked for its saturations afterwards.
        let samples = bar.wrap_iter(rendering.by_ref());
        let written = write_wav(&self.out, rate_hz, self.format(), samples)?;
        bar.finish_and_clear();
        print(&format!(
            "{}: {} samples of {source} at {rate_hz} Hz",
            self.out.display(),
            written.samples,
        ))?;
        if written.clipped > 0 {
            warn(&format!(
                "clipped: {}; give --pcm16 a larger full scale",
                counted(written.clipped, "sample")
            ));
        }
        if rendering.saturations() > 0 {
            warn(&format!(
                "the synthesis was at full scale in {}",
                counted(rendering.saturations(), "sample")
            ));
        }
        Ok(())
    }

    /// Renders the voltage at the pin, or the acceleration of the tip behind it. Prints a description of the file, and
    /// what the safety stages changed.
    fn write_pin(&self, rendering: &mut Rendering<'_>, source: &str) -> Result<()> {
        let changes = self.settings.iter();
        let settings = settings(changes.map(|(name, value)| (name.as_str(), *value)))?;
        let Some(plant) = &self.plant else {
            let summary = render_pin_wav(rendering, &settings, &self.out)?;
            let shown = "as volts above mid-scale at the pin of a stylus";
            return self.report(source, summary, shown);
        };
        // The seed is of the accelerometer's noise, of which the tip has none.
        let mut plant = Plant::new(&read_plant(plant)?, 0);
        let summary = render_tip_wav(rendering, &settings, &mut plant, &self.out)?;
        let shown = "as m/s² at the tip, by an actuator model";
        self.report(source, summary, shown)
    }

    fn report(&self, source: &str, summary: PinSummary, shown: &str) -> Result<()> {
        print(&format!(
            "{}: {} codes of {source} at {RATE_HZ} Hz, {shown}",
            self.out.display(),
            summary.codes,
        ))?;
        let limited = summary.limited;
        for (what, samples) in [
            ("the synthesis was at full scale", summary.saturations),
            ("the hard limit cut the output", limited.hard),
            ("the slew limit held the output back", limited.slew),
            ("the thermal limiter attenuated the output", limited.thermal),
        ] {
            if samples > 0 {
                warn(&format!("{what} in {} of the kernel", counted(samples, "sample")));
            }
        }
        Ok(())
    }
}

/// Reads a plant's file, or the preset of this name.
///
/// # Errors
/// There is neither, or the file does not describe a plant.
pub fn read_plant(source: &Path) -> Result<Parameters> {
    Parameters::read(source).map_err(|error| Error::Request(error.to_string()))
}

/// Parses a setting's name and value.
fn setting(text: &str) -> std::result::Result<(String, f32), String> {
    let (name, value) = text.split_once('=').ok_or("must be NAME=VALUE")?;
    let value = value.trim().parse().map_err(|_| "the value must be a number")?;
    Ok((name.trim().to_owned(), value))
}
