//! State of a link apart from its frames: the number of broken frames, and the reason for the link's end.

use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, Ordering};

/// State of a link that its client does not report.
#[derive(Debug, Default)]
pub(super) struct Health {
    broken_frames: AtomicU64,
    ended: OnceLock<String>,
}

impl Health {
    /// Number of frames that arrived and could not be decoded.
    pub(super) fn broken_frames(&self) -> u64 {
        self.broken_frames.load(Ordering::Relaxed)
    }

    /// Counts a frame that could not be decoded.
    pub(super) fn count_broken(&self) {
        self.broken_frames.fetch_add(1, Ordering::Relaxed);
    }

    /// Reason for the end of the link.
    pub(super) fn why_ended(&self) -> &str {
        self.ended.get().map_or("it was closed", String::as_str)
    }

    /// Records the reason for the end of the link; a later reason does not replace the first.
    pub(super) fn end(&self, reason: &impl ToString) {
        self.ended.get_or_init(|| reason.to_string());
    }
}
