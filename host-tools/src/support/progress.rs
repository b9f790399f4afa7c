//! Progress of long work, on standard error, for a person who waits; nothing where no person looks.

use indicatif::{ProgressBar, ProgressStyle};

/// A bar over `total` pieces of work, named by what is done to them.
///
/// indicatif hides it when standard error is not a terminal.
pub fn bar(total: u64, what: &str) -> ProgressBar {
    let style = ProgressStyle::with_template("{msg:<24} {wide_bar} {pos}/{len}  {eta} left")
        .expect("the template is fixed");
    ProgressBar::new(total)
        .with_style(style)
        .with_message(what.to_owned())
}
