//! Progress of long work, on standard error, shown only at a terminal.

use indicatif::{ProgressBar, ProgressStyle};

/// Creates a bar over `total` pieces of work, named by the `action`.
///
/// indicatif hides the bar if standard error is not a terminal.
pub fn bar(total: u64, action: &str) -> ProgressBar {
    let style = ProgressStyle::with_template("{msg:<24} {wide_bar} {pos}/{len}  {eta} left")
        .expect("the template is fixed");
    ProgressBar::new(total)
        .with_style(style)
        .with_message(action.to_owned())
}
