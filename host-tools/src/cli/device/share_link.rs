//! `stylus share-link`, which commands start to share a link; nobody types it.

use std::io::Write;

use host_tools::link::{BROKER_READY, BROKER_TAKEN, LinkAddress, Served, serve};
use host_tools::support::visible::visible_line;

#[derive(clap::Args)]
pub struct Arguments {
    /// Address of the stylus
    #[arg(long, value_name = "LINK")]
    link: LinkAddress,
}

/// Shares the link. The one line that it prints is for the command that has started it.
pub fn run(arguments: &Arguments) {
    match serve(&arguments.link, || say(BROKER_READY)) {
        Ok(Served::Ended) => {}
        Ok(Served::Taken) => say(BROKER_TAKEN),
        Err(failure) => say(&visible_line(&failure.to_string())),
    }
}

/// Prints a line, and lets it be if nobody reads: the command that has started this may be gone.
fn say(line: &str) {
    let mut output = std::io::stdout().lock();
    let _ = writeln!(output, "{line}").and_then(|()| output.flush());
}
