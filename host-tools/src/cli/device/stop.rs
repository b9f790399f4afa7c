//! `stylus stop`

use host_tools::support::error::Result;
use serde::Serialize;

use super::connection::Link;
use crate::cli::output::{print, print_json};

#[derive(clap::Args)]
pub struct Arguments {
    /// Print the result as JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    link: Link,
}

#[derive(Serialize)]
struct StopReport {
    was_playing: bool,
    was_recording: bool,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let device = arguments.link.connect()?;
    let (was_playing, _) = device.stop()?;
    let was_recording = device.status()?.record.recording;
    if was_recording {
        device.record_stop()?;
    }
    if arguments.json {
        return print_json(&StopReport {
            was_playing,
            was_recording,
        });
    }
    let what = match (was_playing, was_recording) {
        (true, true) => "stopped playing and recording",
        (true, false) => "stopped playing",
        (false, true) => "stopped recording; nothing was played",
        (false, false) => "nothing was played or recorded",
    };
    print(&format!("{what}; the output is at rest"))
}
