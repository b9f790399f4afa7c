//! `stylus scene`: check, compile, render and fit-tap. Here are the commands, and `render` with the arguments that name
//! a scene.

mod check;
mod fit_tap;

use std::path::{Path, PathBuf};

use clap::Subcommand;
use model_format::Library;
use model_format::scene::MotionOfScene;
use stylus_fit::scene::{CompiledScene, SceneFile, scene_named};
use stylus_fit::texture::library::{decode_library, read_library};
use stylus_signals::playing::render::Rendering;
use stylus_support::{Error, Result};

use super::files::RenderedFile;
use super::input::Along;

#[derive(clap::Args)]
pub struct Arguments {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Check a scene's cost per sample, with the arithmetic (the actuator: `stylus check`)
    Check(check::Arguments),
    /// Put scenes into a library, for upload
    Compile(check::CompileArguments),
    /// Render the stylus's output along a motion to a WAV file, sample for sample
    Render(RenderArguments),
    /// Fit a scene's tap transient to recordings of taps
    FitTap(fit_tap::Arguments),
}

pub fn run(arguments: &Arguments) -> Result<()> {
    match &arguments.command {
        Command::Check(arguments) => check::run(arguments),
        Command::Compile(arguments) => check::compile(arguments),
        Command::Render(arguments) => render(arguments),
        Command::FitTap(arguments) => fit_tap::run(arguments),
    }
}

#[derive(clap::Args)]
pub struct RenderArguments {
    #[command(flatten)]
    source: Source,
    #[command(flatten)]
    along: Along,
    #[command(flatten)]
    file: RenderedFile,
}

fn render(arguments: &RenderArguments) -> Result<()> {
    arguments.file.check()?;
    let path = arguments.source.library_path()?;
    let bytes = read_library(path)?;
    let library = decode_library(path, &bytes)?;
    let compiled = arguments.source.compile(&library)?;
    // A scene with a motion of its own plays at that, so it needs no given one.
    let constant = match compiled.scene.motion {
        MotionOfScene::Constant { speed_mm_s, force_n } => Some((speed_mm_s, force_n)),
        MotionOfScene::Followed => None,
    };
    let name = format!("scene '{}'", compiled.scene.name);
    let (motion, seconds) = arguments.along.motion(&name, constant)?;
    let plan = compiled.plan(&library)?;
    let rendering = Rendering::of_plan(plan, &motion, seconds, arguments.along.seed)?;
    let source = format!(
        "the scene '{}' ({})",
        compiled.scene.name,
        compiled.provenance(&library)
    );
    arguments.file.render(rendering, &source)
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
    /// Returns true if the source is a scene file.
    fn is_text(&self) -> bool {
        is_text(&self.file)
    }

    /// Returns the path of the library.
    ///
    /// # Errors
    /// A scene file was given without `--library`, or a library with `--library`.
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

    /// Compiles the scene with `library`, which was read from [`Source::library_path`].
    ///
    /// # Errors
    /// The scene file does not compile, or holds another scene than `--scene` names; or the library has no such scene,
    /// or has several and none is named.
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
    path.extension().unwrap_or_default().eq_ignore_ascii_case("toml")
}
