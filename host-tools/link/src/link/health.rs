//! State of a link apart from its frames: the number of broken frames, the reason for the link's end, and what a broker
//! reports about other programs.

use std::collections::HashMap;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};

use postcard_rpc::Key;

/// State of a link that its client does not report.
#[derive(Debug, Default)]
pub(super) struct Health {
    broken_frames: AtomicU64,
    ended: OnceLock<String>,
    /// Texts of a broker's refusals, by the keys of the refused requests.
    refusals: Mutex<HashMap<[u8; 8], String>>,
    /// The program that has stopped what this program played or recorded.
    stopped_by: Mutex<Option<String>>,
    /// Number of blocks, and of lost blocks, that a recording of other programs had before this program joined it.
    before_joining: Mutex<(u32, u32)>,
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

    /// Removes and returns the text with which a broker has refused the request with this key.
    pub(super) fn take_refusal(&self, key: Key) -> Option<String> {
        lock(&self.refusals).remove(&key.to_bytes())
    }

    /// The program that has stopped what this program played or recorded, if any.
    pub(super) fn stopped_by(&self) -> Option<String> {
        lock(&self.stopped_by).clone()
    }

    /// Number of blocks, and of lost blocks, that a recording of other programs had before this program joined it.
    pub(super) fn before_joining(&self) -> (u32, u32) {
        *lock(&self.before_joining)
    }

    /// Forgets which program has stopped an earlier play or recording, and what was noted about a joined recording.
    pub(super) fn begin(&self) {
        *lock(&self.stopped_by) = None;
        *lock(&self.before_joining) = (0, 0);
    }
}

/// What a broker reports.
#[cfg(unix)]
impl Health {
    /// Sets the number of broken frames that the broker has counted.
    pub(super) fn set_broken(&self, frames: u64) {
        self.broken_frames.store(frames, Ordering::Relaxed);
    }

    /// Keeps the text of a refusal until the request is answered.
    pub(super) fn refuse(&self, key: [u8; 8], words: String) {
        lock(&self.refusals).insert(key, words);
    }

    /// Notes the program that has stopped what this program played or recorded.
    pub(super) fn stop(&self, by: String) {
        *lock(&self.stopped_by) = Some(by);
    }

    /// Notes how far a recording was before this program joined it.
    pub(super) fn join_recording(&self, blocks: u32, lost_blocks: u32) {
        *lock(&self.before_joining) = (blocks, lost_blocks);
    }
}

/// Locks the state. A panic elsewhere leaves it consistent, because each change is one step.
fn lock<T>(state: &Mutex<T>) -> MutexGuard<'_, T> {
    state.lock().unwrap_or_else(PoisonError::into_inner)
}
