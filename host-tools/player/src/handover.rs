//! A slot through which a choice goes to the side that fills, and one through which what it replaced comes back.
//!
//! Both are single exchanges of a pointer. What comes back is dropped by the side that gives, because freeing memory
//! takes a lock; it comes back as a chain, so that the side that fills never waits for room.

use crossbeam_utils::atomic::AtomicCell;

/// A slot each way.
pub struct Handover<T> {
    given: AtomicCell<Option<Box<Given<T>>>>,
    returned: AtomicCell<Option<Box<Given<T>>>>,
}

/// A thing on its way, and what came back before it.
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

    /// Gives `it`, and drops what came back, and what was given before and not taken.
    pub fn give(&self, it: T) {
        let given = Box::new(Given { it, before: None });
        drop(self.given.swap(Some(given)));
        drop(self.returned.take());
    }

    /// Returns what was given last, once. For the side that fills.
    pub fn take(&self) -> Option<Box<Given<T>>> {
        self.given.take()
    }

    /// Gives back what was taken. For the side that fills, which is one thread at a time, so that nothing else is put
    /// here between the two exchanges.
    pub fn give_back(&self, mut taken: Box<Given<T>>) {
        taken.before = self.returned.take();
        // Nothing is replaced, and so nothing is dropped.
        self.returned.store(Some(taken));
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::thread::{self, ThreadId};

    use super::*;

    /// A thing that tells in which thread it is dropped.
    struct Told(std::sync::mpsc::Sender<ThreadId>);

    impl Drop for Told {
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
        handover.give(Told(sender.clone()));
        // The other side takes several between two gifts, whose side has not looked yet.
        thread::spawn(move || {
            for _ in 0..3 {
                if let Some(taken) = theirs.take() {
                    theirs.give_back(taken);
                }
                theirs.give_back(Box::new(Given {
                    it: Told(sender.clone()),
                    before: None,
                }));
            }
        })
        .join()
        .expect("it does not panic");
        assert_eq!(dropped.try_iter().count(), 0);
        let (unheard, _) = std::sync::mpsc::channel();
        handover.give(Told(unheard));
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
