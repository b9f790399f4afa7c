//! A line on standard error that changes while a command works.

use indicatif::{ProgressBar, ProgressStyle};

/// A line that tells what goes on, on standard error, for as long as it takes; hidden where no person looks.
pub fn live_line(what: &'static str) -> ProgressBar {
    let style = ProgressStyle::with_template("{spinner} {msg}").expect("the template is fixed");
    ProgressBar::new_spinner()
        .with_style(style)
        .with_message(what)
}
