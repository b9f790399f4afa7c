//! An evaluation as a folder: one page, with its pictures beside it as files of their own, and their data.

use std::path::{Path, PathBuf};

use model_format::{Library, Texture};

use super::figures;
use super::sections::Sections;
use crate::evaluation::evaluate::{Evaluation, Options, texture_named};
use crate::recording::RecordingSet;
use crate::support::error::Result;
use crate::support::progress;

/// The page's name in its folder.
const PAGE: &str = "index.html";

/// Folder of the pictures' data in it.
pub const DATA: &str = "data";

/// Writes the report on an evaluation of `set` into `folder`, which is there. Returns the page's path.
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
    let mut sections = Sections::new(set, library, evaluation, options, std::iter::empty());
    sections.pictures = Some(folder);
    sections.data = Some(figures::Folder::new(&folder.join(DATA))?);
    sections.share_scales()?;
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
    sections.write(&page)?;
    Ok(page)
}

fn write_texture(sections: &mut Sections<'_>, texture: Texture<'_>) -> Result<()> {
    sections.page.section(texture.name());
    let Some(example) = sections.example(texture)? else {
        sections.page.paragraph("Silent in every trial.");
        return sections.cost_map(&texture);
    };
    sections.sounds(&example)?;
    sections.nodes(texture.name());
    sections.cost_map(&texture)?;
    sections.time_and_frequency(&example)?;
    sections.waveforms(&example)?;
    sections.bands(&example)
}
