//! Two slots: one takes a choice to the filler, and the other returns the choice that was replaced.
//!
//! Each use is a single exchange of a pointer. The mover drops what is returned, because freeing memory takes a lock.
//! Returned choices form a chain, so that the filler never waits for a free place.

use crossbeam_utils::atomic::AtomicCell;

/// Exchange between the mover and the filler: a slot for the value that is given, and one for the values that come
/// back.
pub struct Handover<T> {
    given: AtomicCell<Option<Box<Given<T>>>>,
    returned: AtomicCell<Option<Box<Given<T>>>>,
}

/// A value on its way, and the chain of values that were returned before it.
pub struct Given<T> {
    pub it: T,
    before: Option<Box<Self>>,
}

impl<T> Handover<T> {
    pub fn new() -> Self {
        const {
            assert!(
                AtomicCell::<Option<Box<Given<T>>>>::is_lock_free(),
                "a pointer is exchanged without a lock"
            );
        }
        Self {
            given: AtomicCell::new(None),
            returned: AtomicCell::new(None),
        }
    }

    /// Gives `it` to the filler. Drops what was returned, and what was given before and not taken.
    pub fn give(&self, it: T) {
        let given = Box::new(Given { it, before: None });
        // One exchange, so that the filler never finds the slot empty in between.
        drop(self.given.swap(Some(given)));
        drop(self.returned.take());
    }

    /// Returns what was given last, only once. The filler calls this.
    pub fn take(&self) -> Option<Box<Given<T>>> {
        self.given.take()
    }

    /// Returns to the mover what was taken. The filler calls this in one thread at a time, so nothing else is put into
    /// the slot between the two exchanges.
    pub fn give_back(&self, mut taken: Box<Given<T>>) {
        taken.before = self.returned.take();
        // The slot is empty, so nothing is dropped here.
        self.returned.store(Some(taken));
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::thread::{self, ThreadId};

    use super::*;

    /// A value that reports the thread in which it is dropped.
    struct TellsItsEnd(std::sync::mpsc::Sender<ThreadId>);

    impl Drop for TellsItsEnd {
        fn drop(&mut self) {
            // Nobody listens after the test.
            let _ = self.0.send(thread::current().id());
        }
    }

    #[test]
    fn what_comes_back_is_dropped_by_the_side_that_gives() {
        let (sender, dropped) = std::sync::mpsc::channel();
        let handover = Arc::new(Handover::new());
        let theirs = Arc::clone(&handover);
        handover.give(TellsItsEnd(sender.clone()));
        // The filler returns several values before the mover gives the next one.
        thread::spawn(move || {
            for _ in 0..3 {
                if let Some(taken) = theirs.take() {
                    theirs.give_back(taken);
                }
                theirs.give_back(Box::new(Given {
                    it: TellsItsEnd(sender.clone()),
                    before: None,
                }));
            }
        })
        .join()
        .expect("it does not panic");
        assert_eq!(dropped.try_iter().count(), 0);
        let (unheard, _) = std::sync::mpsc::channel();
        handover.give(TellsItsEnd(unheard));
        let threads: Vec<ThreadId> = dropped.try_iter().collect();
        assert_eq!(threads, [thread::current().id(); 4]);
    }

    #[test]
    fn what_was_given_and_not_taken_is_replaced() {
        let handover = Handover::new();
        handover.give(1);
        handover.give(2);
        assert_eq!(handover.take().map(|given| given.it), Some(2));
        assert!(handover.take().is_none());
    }
}
