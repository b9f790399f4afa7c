//! `stylus render`

use stylus_signals::playing::render::Rendering;
use stylus_support::Result;

use super::files::RenderedFile;
use super::input::TextureAlong;

#[derive(clap::Args)]
pub struct Arguments {
    #[command(flatten)]
    source: TextureAlong,
    #[command(flatten)]
    file: RenderedFile,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    arguments.file.check()?;
    arguments.source.with(|texture, motion, seconds, seed| {
        let source = format!("'{}' ({})", texture.name(), texture.provenance());
        let rendering = Rendering::new(texture, motion, seconds, seed)?;
        arguments.file.render(rendering, &source)
    })
}
