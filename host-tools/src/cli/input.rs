//! Arguments that several commands share: recordings, motions, and numbers with a range.

use std::path::{Path, PathBuf};

use model_format::{MillimetresPerSecond, Newton, Texture};
use stylus_evaluation::evaluate::texture_named;
use stylus_fit::texture::grid::as_written;
use stylus_fit::texture::library::{decode_library, read_library, unknown_levels};
use stylus_signals::playing::motion::MotionPath;
use stylus_signals::recording::{Assumed, RecordingSet, texture_fault};
pub use stylus_support::number::{force, not_negative, positive, speed};
use stylus_support::{Error, Result};

use crate::cli::output::{note, warn};

/// Recordings, with the values that their files may lack.
#[derive(clap::Args)]
pub struct RecordingArguments {
    /// Folder with trials.csv, such a list, or WAV, CSV or LabVIEW recordings (each a texture named like the file)
    #[arg(required = true)]
    inputs: Vec<PathBuf>,
    #[command(flatten)]
    assumed: Assumed,
}

impl RecordingArguments {
    /// Returns the paths as they were given.
    pub fn inputs(&self) -> &[PathBuf] {
        &self.inputs
    }

    /// Returns the values to assume where the files lack them.
    pub fn assumed(&self) -> &Assumed {
        &self.assumed
    }

    /// Opens the set.
    pub fn open(&self) -> Result<RecordingSet> {
        RecordingSet::open_with(&self.inputs, &self.assumed)
    }

    /// Opens other takes of the same trials, if given. The same values are assumed where their files lack them.
    pub fn open_takes(&self, takes: Option<&PathBuf>) -> Result<Option<RecordingSet>> {
        let open = |path: &PathBuf| RecordingSet::open_with(std::slice::from_ref(path), &self.assumed);
        takes.map(open).transpose()
    }
}

/// Prints a note on speeds or forces that `set` has only because neither a list nor an option specifies them.
pub fn tell_nominal_motion(set: &RecordingSet, assumed: &Assumed) {
    assumed
        .nominal_motion()
        .filter(|_| !set.is_listed)
        .iter()
        .for_each(|text| note(text));
}

/// Parses the name of a texture for a list of trials.
pub fn texture_name(text: &str) -> std::result::Result<String, String> {
    texture_fault(text).map_or_else(|| Ok(text.to_owned()), Err)
}

/// Parses the speed of a trial that will be recorded, in mm/s.
pub fn trial_speed(text: &str) -> std::result::Result<f64, String> {
    // In a motion the sign of a speed is its direction, which a trial does not have.
    not_negative(text).and_then(|_| speed(text))
}

/// Parses the force of a trial that will be recorded, in N.
pub fn trial_force(text: &str) -> std::result::Result<f64, String> {
    // In a motion a negative force is no contact, of which there is nothing to record.
    not_negative(text).and_then(|_| force(text))
}

/// Returns the values of the `option`, one for all axes or one for each; `None` if it was not given.
pub fn of_axes(option: &str, given: &[f64]) -> Result<Option<[f64; 3]>> {
    match *given {
        [] => Ok(None),
        [all] => Ok(Some([all; 3])),
        [x, y, z] => Ok(Some([x, y, z])),
        _ => Err(Error::Request(format!(
            "{option} takes one value or three, not {}",
            given.len()
        ))),
    }
}

/// Warns if the level of some of `textures` is not known.
pub fn warn_of_unknown_levels<'a>(textures: impl IntoIterator<Item = Texture<'a>>) {
    if let Some(words) = unknown_levels(textures) {
        warn(&format!("the {words}"));
    }
}

/// Warns of a motion along which no texture is heard, or whose times are implausible for a hand.
pub fn warn_of_motion(motion: &MotionPath) {
    if !motion.sounds() {
        warn(
            "the motion never has a speed and a force above zero together, so that nothing is heard: a force at or \
             below zero is no contact",
        );
    }
    if let Some(doubt) = motion.doubt_of_times() {
        warn(&doubt);
    }
}

/// Relative amount by which a motion may exceed the grid without a warning.
const OFF_GRID: f64 = 0.05;

/// Warns of a motion that exceeds the speeds or forces at which a texture was recorded, or never reaches them.
pub fn warn_off_grid(motion: &MotionPath, texture: &Texture<'_>) {
    let (speed, force) = motion.largest();
    // A line's frequency is speed over wavelength, whatever the grid.
    let of_speed = (texture.lines().is_some()).then_some("; a tone that is tied to position follows the speed");
    for (what, value, axis, unit, tone) in [
        ("speed", speed, texture.speed_axis(), "mm/s", of_speed),
        ("force", force, texture.force_axis(), "N", None),
    ] {
        let name = texture.name();
        let (lowest, highest) = (
            // The axes have 32 bits; a message shows 0.2 and not 0.200000003.
            as_written(axis.value(0)),
            as_written(axis.value(axis.len() - 1)),
        );
        let tone = tone.unwrap_or_default();
        if value > highest * (1.0 + OFF_GRID) {
            warn(&format!(
                "the {what} reaches {value:.3} {unit}, and texture '{name}' was recorded up to {highest} {unit}: \
                 beyond, noise and level are those of {highest} {unit}{tone}"
            ));
        }
        // A motion without any speed or force has a warning of its own: nothing is heard.
        if value > 0.0 && value < lowest * (1.0 - OFF_GRID) {
            warn(&format!(
                "the {what} stays at or below {value:.3} {unit}, and texture '{name}' was recorded from {lowest} \
                 {unit} on: below, the noise is that of {lowest} {unit}, and its level falls with the {what}{tone}"
            ));
        }
    }
}

/// A constant motion, of a command that has `--motion` too.
#[derive(clap::Args)]
pub struct ConstantMotion {
    /// Constant tangential speed instead, in mm/s
    #[arg(long, value_name = "MM_S", value_parser = speed, allow_negative_numbers = true, requires = "force")]
    speed: Option<f64>,
    /// Constant normal force, in newtons
    #[arg(long, value_name = "N", value_parser = force, allow_negative_numbers = true, requires = "speed")]
    force: Option<f64>,
}

impl ConstantMotion {
    /// Returns the speed, mm/s, and the force, N, if they were given.
    fn given(&self) -> Option<(f32, f32)> {
        self.speed
            .zip(self.force)
            .map(|(speed, force)| (speed as f32, force as f32))
    }

    /// Returns the motion in the file `motion`; else the constant motion that was given; else one with the speed and
    /// force `own`.
    pub fn or_in(&self, motion: Option<&Path>, own: Option<(f32, f32)>) -> Result<Option<MotionPath>> {
        let constant = |(speed, force)| MotionPath::constant(MillimetresPerSecond(speed), Newton(force));
        match motion {
            Some(path) => MotionPath::from_csv(path).map(Some),
            None => self.given().or(own).map(constant).transpose(),
        }
    }
}

/// The motion that is rendered along.
#[derive(clap::Args)]
pub struct Along {
    /// Motion: CSV with time_s, speed_mm_s, force_n, and position_mm and contact if they do not follow from those
    #[arg(long, value_name = "CSV", conflicts_with_all = ["speed", "force"])]
    motion: Option<PathBuf>,
    #[command(flatten)]
    constant: ConstantMotion,
    /// Duration, in seconds [default: the motion's]
    #[arg(long, value_name = "S", value_parser = positive)]
    seconds: Option<f64>,
    /// Seed of the noise: the same seed gives the same samples
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
}

impl Along {
    /// Returns the motion and its duration, s, for the texture or scene `name`. A scene with its own constant speed,
    /// mm/s, and force, N, needs no given motion.
    ///
    /// # Errors
    /// The motion cannot be read, has no end or was not given, or a constant motion has no duration.
    pub fn motion(&self, name: &str, own: Option<(f32, f32)>) -> Result<(MotionPath, f64)> {
        let motion = self.constant.or_in(self.motion.as_deref(), own)?;
        let motion = motion.ok_or_else(|| {
            Error::Request(format!(
                "{name} follows the hand; give --motion CSV, or --speed, --force and --seconds"
            ))
        })?;
        let seconds = match (self.seconds, &self.motion) {
            (Some(seconds), _) => seconds,
            (None, Some(path)) => motion.end_s(path)?,
            (None, None) => {
                return Err(Error::Request(format!(
                    "{name}: a constant motion has no end; give --seconds"
                )));
            }
        };
        Ok((motion, seconds))
    }
}

/// A texture of a library, and the motion that it is rendered along.
#[derive(clap::Args)]
pub struct TextureAlong {
    /// Library with the texture
    library: PathBuf,
    /// Name of the texture
    #[arg(long, value_name = "NAME")]
    texture: String,
    #[command(flatten)]
    along: Along,
}

impl TextureAlong {
    /// Calls `render` with the texture, the motion, its duration, s, and the seed. Warnings about them are printed
    /// before.
    pub fn with(&self, render: impl FnOnce(Texture<'_>, &MotionPath, f64, u64) -> Result<()>) -> Result<()> {
        let bytes = read_library(&self.library)?;
        let library = decode_library(&self.library, &bytes)?;
        let texture = texture_named(&library, &self.texture)?;
        let name = format!("texture '{}'", texture.name());
        let (motion, seconds) = self.along.motion(&name, None)?;
        warn_of_motion(&motion);
        warn_off_grid(&motion, &texture);
        render(texture, &motion, seconds, self.along.seed)
    }
}
