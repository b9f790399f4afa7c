//! Progress of long work, on standard error, shown only at a terminal.

use std::sync::atomic::{AtomicBool, Ordering};

#[cfg(not(target_arch = "wasm32"))]
use indicatif::ProgressStyle;

#[cfg(not(target_arch = "wasm32"))]
pub use indicatif::ProgressBar;
#[cfg(target_arch = "wasm32")]
pub use on_a_page::{ProgressBar, listen};

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
#[cfg(not(target_arch = "wasm32"))]
pub fn bar(total: u64, action: &str) -> ProgressBar {
    let style =
        ProgressStyle::with_template("{msg:<24} {wide_bar} {pos}/{len}  {eta} left").expect("the template is fixed");
    shown(ProgressBar::new(total), style, action)
}

/// Creates a line with the state of work without a known end, such as playing. It is hidden like [`bar`].
#[cfg(not(target_arch = "wasm32"))]
pub fn line(what: &str) -> ProgressBar {
    let style = ProgressStyle::with_template("{spinner} {msg}").expect("the template is fixed");
    shown(ProgressBar::new_spinner(), style, what)
}

#[cfg(not(target_arch = "wasm32"))]
fn shown(bar: ProgressBar, style: ProgressStyle, what: &str) -> ProgressBar {
    if is_hidden() {
        return ProgressBar::hidden();
    }
    bar.with_style(style).with_message(what.to_owned())
}

/// Creates a bar over `total` steps of work, with the `action` as its name.
#[cfg(target_arch = "wasm32")]
pub fn bar(total: u64, action: &str) -> ProgressBar {
    ProgressBar::new(total, action)
}

/// Progress on a page, which has no terminal: whoever listens is told each step.
#[cfg(target_arch = "wasm32")]
mod on_a_page {
    use std::sync::Mutex;
    use std::sync::PoisonError;
    use std::sync::atomic::{AtomicU64, Ordering};

    /// Is told the action, the steps that are done, and the number of all steps.
    type Listener = fn(&str, u64, u64);

    static LISTENER: Mutex<Option<Listener>> = Mutex::new(None);

    /// Tells `listener` the progress of all work from now on.
    pub fn listen(listener: Listener) {
        *LISTENER.lock().unwrap_or_else(PoisonError::into_inner) = Some(listener);
    }

    /// Progress of one piece of work.
    pub struct ProgressBar {
        action: String,
        done: AtomicU64,
        total: u64,
    }

    impl ProgressBar {
        pub(super) fn new(total: u64, action: &str) -> Self {
            let bar = Self {
                action: action.to_owned(),
                done: AtomicU64::new(0),
                total,
            };
            bar.inc(0);
            bar
        }

        /// Counts `steps` as done.
        pub fn inc(&self, steps: u64) {
            let done = self.done.fetch_add(steps, Ordering::Relaxed) + steps;
            if let Some(listener) = *LISTENER.lock().unwrap_or_else(PoisonError::into_inner) {
                listener(&self.action, done, self.total);
            }
        }

        /// Returns the work's own steps, which are too many to be told one by one.
        pub fn wrap_iter<I: Iterator>(&self, steps: I) -> I {
            steps
        }

        /// Ends the work.
        pub fn finish_and_clear(&self) {}
    }
}
