//! Progress of long work, on standard error, shown only at a terminal.

use std::sync::atomic::{AtomicBool, Ordering};

use indicatif::{ProgressBar, ProgressStyle};

/// True if this process shows no progress.
static IS_HIDDEN: AtomicBool = AtomicBool::new(false);

/// Hides the progress of all work that this process does after this call.
pub fn hide() {
    IS_HIDDEN.store(true, Ordering::Relaxed);
}

/// Returns true once [`hide`] was called.
pub fn is_hidden() -> bool {
    IS_HIDDEN.load(Ordering::Relaxed)
}

/// Creates a bar over `total` steps of work, with the `action` as its name.
///
/// indicatif hides the bar if standard error is not a terminal.
pub fn bar(total: u64, action: &str) -> ProgressBar {
    let style =
        ProgressStyle::with_template("{msg:<24} {wide_bar} {pos}/{len}  {eta} left").expect("the template is fixed");
    shown(ProgressBar::new(total), style, action)
}

/// Creates a line with the state of work without a known end, such as playing. It is hidden like [`bar`].
pub fn line(what: &str) -> ProgressBar {
    let style = ProgressStyle::with_template("{spinner} {msg}").expect("the template is fixed");
    shown(ProgressBar::new_spinner(), style, what)
}

fn shown(bar: ProgressBar, style: ProgressStyle, what: &str) -> ProgressBar {
    if is_hidden() {
        return ProgressBar::hidden();
    }
    bar.with_style(style).with_message(what.to_owned())
}
