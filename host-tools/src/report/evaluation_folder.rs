//! An evaluation as a folder: one page, with its pictures beside it as files of their own.

use std::path::{Path, PathBuf};

use model_format::{Library, Texture};

use super::html::Page;
use super::sections::Sections;
use crate::evaluation::evaluate::{Evaluation, Options, texture_named};
use crate::recording::RecordingSet;
use crate::support::error::{Error, Result};
use crate::support::file_name::Stems;
use crate::support::progress;

/// The page's name in its folder.
const PAGE: &str = "index.html";

/// Writes the report on an evaluation of `set` into `folder`. Returns the page's path.
///
/// # Errors
/// A folder that cannot be written to, or a recording that cannot be used any more.
pub fn write(
    set: &RecordingSet,
    library: &Library<'_>,
    evaluation: &Evaluation,
    options: &Options,
    folder: &Path,
) -> Result<PathBuf> {
    std::fs::create_dir_all(folder).map_err(Error::io("create", folder))?;
    let mut sections = Sections {
        set,
        library,
        evaluation,
        options,
        pictures: Some(folder),
        stems: Stems::default(),
        page: Page::new("Recordings and what the stylus plays"),
    };
    let bar = progress::bar(evaluation.textures.len() as u64 + 1, "reporting");
    sections.overview();
    sections.orders()?;
    bar.inc(1);
    for summary in &evaluation.textures {
        write_texture(&mut sections, texture_named(library, &summary.texture)?)?;
        bar.inc(1);
    }
    bar.finish_and_clear();
    let page = folder.join(PAGE);
    sections.page.write(&page)?;
    Ok(page)
}

fn write_texture(sections: &mut Sections<'_>, texture: Texture<'_>) -> Result<()> {
    sections.page.section(texture.name());
    sections.cost_map(&texture)?;
    let Some(example) = sections.example(texture)? else {
        sections.page.paragraph("Silent in every trial.");
        return Ok(());
    };
    sections.time_and_frequency(&example)?;
    sections.waveforms(&example)?;
    sections.bands(&example)
}
