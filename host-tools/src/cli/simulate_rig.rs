//! `stylus simulate-rig`

use std::path::PathBuf;

use stylus_signals::rig::{self, RigFile};
use stylus_support::Result;
use stylus_support::bounded_file::Format;

use crate::cli::files::Overwrite;
use crate::cli::output::print;

#[derive(clap::Args)]
pub struct Arguments {
    /// Rig file to simulate [default: the paper's protocol on paper, organza, vinyl and denim]
    #[arg(long, value_name = "RIG.toml")]
    rig: Option<PathBuf>,
    /// Folder to write the recordings to
    #[arg(long, value_name = "DIR", required_unless_present = "print_rig")]
    out: Option<PathBuf>,
    #[command(flatten)]
    overwrite: Overwrite,
    /// Seed of everything random: the same seed gives the same recordings
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Print the rig file, as a start for one's own, and simulate nothing
    #[arg(long)]
    print_rig: bool,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let overwrite = &arguments.overwrite;
    if let Some(out) = &arguments.out {
        overwrite.folder(out)?;
    }
    let rig = match &arguments.rig {
        None => RigFile::paper(),
        Some(path) => {
            let text = Format::Rig.read_text(path)?;
            RigFile::from_toml(path, &text)?
        }
    };
    let Some(out) = arguments.out.as_deref().filter(|_| !arguments.print_rig) else {
        return print(rig.text().trim_end());
    };
    let summary = rig::simulate_to_folder(&rig, arguments.seed, out, overwrite.is_asked())?;
    print(summary.to_string().trim_end())?;
    print(&format!("-> {}", out.display()))
}
