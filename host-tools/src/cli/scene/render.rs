//! `stylus scene render`

use std::path::{Path, PathBuf};

use host_tools::playing::motion::MotionPath;
use host_tools::playing::render::{RenderSummary, Rendering, write_wav};
use host_tools::scene::{CompiledScene, SceneFile, scene_named};
use host_tools::support::error::{Error, Result};
use host_tools::texture::library::{decode_library, read_library};
use model_format::scene::{MotionOfScene, Scene};
use model_format::{Library, MillimetresPerSecond, Newton};

#[cfg(feature = "device")]
use crate::cli::files::PinArguments;
use crate::cli::files::WavFile;
use crate::cli::input::{force, speed};

#[derive(clap::Args)]
pub struct Arguments {
    #[command(flatten)]
    source: Source,
    #[command(flatten)]
    along: Along,
    #[command(flatten)]
    wav: WavFile,
    #[cfg(feature = "device")]
    #[command(flatten)]
    pin: PinArguments,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    (arguments.wav).check(&arguments.source.inputs(&arguments.along))?;
    let path = arguments.source.library_path()?;
    let bytes = read_library(path)?;
    let library = decode_library(path, &bytes)?;
    let compiled = arguments.source.compile(&library)?;
    let (motion, seconds) = arguments.along.motion(&compiled.scene)?;
    let plan = compiled.plan(&library)?;
    let mut rendering = Rendering::of_plan(plan, &motion, seconds, arguments.along.seed)?;
    let source = format!(
        "the scene '{}' ({})",
        compiled.scene.name,
        compiled.provenance(&library)
    );
    #[cfg(feature = "device")]
    if arguments.pin.is_asked() {
        return arguments
            .pin
            .render(&mut rendering, &arguments.wav, &source);
    }
    let rate_hz = rendering.sample_rate_hz();
    let wav = &arguments.wav;
    let written = write_wav(wav.path(), rate_hz, wav.format(), rendering.by_ref())?;
    let summary = RenderSummary {
        wav: written,
        saturations: rendering.saturations(),
    };
    wav.print(&source, rate_hz, summary)
}

/// The scene that a command works on.
#[derive(clap::Args)]
pub struct Source {
    /// Scene file, whose name ends in .toml, or a library with scenes
    #[arg(value_name = "SCENE.toml|LIB")]
    file: PathBuf,
    /// Library with the textures of a scene file
    #[arg(long, value_name = "LIB")]
    library: Option<PathBuf>,
    /// Name of the scene, if the library has several
    #[arg(long, value_name = "NAME")]
    scene: Option<String>,
}

impl Source {
    /// The files that are read for it and for the motion along it.
    pub fn inputs(&self, along: &Along) -> Vec<PathBuf> {
        let given = std::iter::once(&self.file).chain(&self.library);
        given.chain(&along.motion).cloned().collect()
    }

    /// Returns true for a scene file.
    fn is_text(&self) -> bool {
        is_text(&self.file)
    }

    /// Path of the library.
    ///
    /// # Errors
    /// A scene file without a library, or a library with another.
    pub fn library_path(&self) -> Result<&Path> {
        match (&self.library, self.is_text()) {
            (Some(library), true) => Ok(library),
            (None, false) => Ok(&self.file),
            (None, true) => Err(Error::Request(format!(
                "{}: give the library with its textures by --library",
                self.file.display()
            ))),
            (Some(_), false) => Err(Error::Request(format!(
                "{}: --library goes with a scene file, whose name ends in .toml",
                self.file.display()
            ))),
        }
    }

    /// Compiles the scene against `library`, which is the file at [`Source::library_path`].
    ///
    /// # Errors
    /// A text that does not compile, or a library without such a scene.
    pub fn compile(&self, library: &Library<'_>) -> Result<CompiledScene> {
        if self.is_text() {
            let compiled = SceneFile::read(&self.file)?.compile(library)?;
            let other = self.scene.as_deref();
            if let Some(other) = other.filter(|name| *name != compiled.scene.name.as_str()) {
                return Err(Error::file(
                    &self.file,
                    format!("holds the scene '{}', not '{other}'", compiled.scene.name),
                ));
            }
            return Ok(compiled);
        }
        scene_named(library, self.scene.as_deref(), &self.file)
    }
}

/// Returns true if the name of a file is that of a scene file.
pub fn is_text(path: &Path) -> bool {
    let extension = path.extension().unwrap_or_default();
    extension.eq_ignore_ascii_case("toml")
}

/// The motion along a scene.
#[derive(clap::Args)]
pub struct Along {
    /// Motion: CSV with time_s, speed_mm_s, force_n, and position_mm and contact if they do not follow from those
    #[arg(long, value_name = "CSV", conflicts_with_all = ["speed", "force"])]
    motion: Option<PathBuf>,
    /// Constant tangential speed instead, in mm/s
    #[arg(long, value_name = "MM_S", value_parser = speed, allow_negative_numbers = true, requires = "force")]
    speed: Option<f64>,
    /// Constant normal force, in newtons
    #[arg(long, value_name = "N", value_parser = force, allow_negative_numbers = true, requires = "speed")]
    force: Option<f64>,
    /// Duration, in seconds [default: the motion's]
    #[arg(long, value_name = "S", value_parser = crate::cli::input::positive)]
    seconds: Option<f64>,
    /// Seed of the noise: the same seed gives the same samples
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
}

impl Along {
    /// The motion and its duration, s. A scene of constant motion needs no other.
    ///
    /// # Errors
    /// A motion that cannot be read or is not given, or a constant one without a duration.
    pub fn motion(&self, scene: &Scene) -> Result<(MotionPath, f64)> {
        let constant = match (self.speed.zip(self.force), scene.motion) {
            (Some((speed, force)), _) => Some((speed as f32, force as f32)),
            (
                None,
                MotionOfScene::Constant {
                    speed_mm_s,
                    force_n,
                },
            ) => Some((speed_mm_s, force_n)),
            (None, MotionOfScene::Followed) => None,
        };
        let name = &scene.name;
        let motion = match (&self.motion, constant) {
            (Some(path), _) => MotionPath::from_csv(path)?,
            (None, Some((speed, force))) => {
                MotionPath::constant(MillimetresPerSecond(speed), Newton(force))?
            }
            (None, None) => {
                return Err(Error::Request(format!(
                    "scene '{name}' follows the hand; give --motion CSV, or --speed, --force and --seconds"
                )));
            }
        };
        let seconds = match (self.seconds, &self.motion) {
            (Some(seconds), _) => seconds,
            (None, Some(path)) => motion.end_s(path)?,
            (None, None) => {
                return Err(Error::Request(format!(
                    "scene '{name}': a constant motion has no end; give --seconds"
                )));
            }
        };
        Ok((motion, seconds))
    }
}
