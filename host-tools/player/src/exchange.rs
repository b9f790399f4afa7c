//! Exchange between the threads that move and choose and the one thread that fills buffers. No side waits.
//!
//! A [`Mailbox`] hands over the newest motion, from any number of threads. A writer draws a ticket, writes the slot of
//! that ticket, and seals it with a checksum over the ticket and the words. A reader looks for the newest ticket whose
//! slot holds its seal. So a motion is never a mixture of two, wherever a thread is interrupted, and no memory ordering
//! is relied on.
//!
//! A [`Handover`] has two slots: one takes a choice to the filler, and the other returns the choice that was replaced.
//! Each use is a single exchange of a pointer. The mover drops what is returned, because freeing memory takes a lock.
//! Returned choices form a chain, so that the filler never waits for a free place.

use std::sync::atomic::{AtomicU64, Ordering};

use crossbeam_utils::atomic::AtomicCell;

/// Number of slots for motions. A writer that is interrupted makes one slot invalid; the reader then finds the previous
/// motion.
const SLOTS: u64 = 16;

/// Words of a motion.
pub type Words<const N: usize> = [u64; N];

/// Motions of `N` words on their way.
pub struct Mailbox<const N: usize> {
    /// Number of tickets drawn.
    drawn: AtomicU64,
    slots: [Slot<N>; SLOTS as usize],
}

struct Slot<const N: usize> {
    words: [AtomicU64; N],
    seal: AtomicU64,
}

impl<const N: usize> Mailbox<N> {
    pub fn new() -> Self {
        Self {
            drawn: AtomicU64::new(0),
            slots: std::array::from_fn(|_| Slot {
                words: std::array::from_fn(|_| AtomicU64::new(0)),
                seal: AtomicU64::new(0),
            }),
        }
    }

    /// Puts a motion.
    pub fn put(&self, words: Words<N>) {
        // Tickets begin at 1, so that 0 stands for none.
        let ticket = self.drawn.fetch_add(1, Ordering::AcqRel) + 1;
        let slot = self.slot(ticket);
        for (place, word) in slot.words.iter().zip(words) {
            place.store(word, Ordering::Relaxed);
        }
        slot.seal.store(seal(ticket, words), Ordering::Release);
    }

    /// Returns the newest motion after the one with ticket `taken`, with its ticket. `taken` is 0 if none was read so
    /// far.
    pub fn newer_than(&self, taken: u64) -> Option<(u64, Words<N>)> {
        let newest = self.drawn.load(Ordering::Acquire);
        // Older tickets have lost their slots to newer ones.
        let oldest = newest.saturating_sub(SLOTS - 1).max(taken + 1);
        let tickets = (oldest..=newest).rev();
        tickets
            .map(|ticket| (ticket, self.slot(ticket)))
            .find_map(|(ticket, slot)| {
                let sealed = slot.seal.load(Ordering::Acquire);
                let words = std::array::from_fn(|at| slot.words[at].load(Ordering::Relaxed));
                (sealed == seal(ticket, words)).then_some((ticket, words))
            })
    }

    fn slot(&self, ticket: u64) -> &Slot<N> {
        &self.slots[(ticket % SLOTS) as usize]
    }
}

/// Returns a checksum of 64 bits. It is extremely unlikely to equal that of an empty slot.
fn seal<const N: usize>(ticket: u64, words: Words<N>) -> u64 {
    /// 2^64 divided by the golden ratio, an odd number whose bits are mixed.
    const MIX: u64 = 0x9E37_79B9_7F4A_7C15;
    let mixed = |seal: u64, word: u64| (seal.rotate_left(23) ^ word).wrapping_mul(MIX);
    words.into_iter().fold(ticket.wrapping_mul(MIX), mixed)
}

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

    #[test]
    fn the_newest_motion_is_taken_once() {
        let mailbox = Mailbox::<2>::new();
        assert_eq!(mailbox.newer_than(0), None);
        for word in 1..100 {
            mailbox.put([word, 2 * word]);
        }
        assert_eq!(mailbox.newer_than(0), Some((99, [99, 198])));
        assert_eq!(mailbox.newer_than(99), None);
    }

    #[test]
    fn a_motion_that_is_half_written_is_passed_over_for_the_one_before() {
        let mailbox = Mailbox::<2>::new();
        mailbox.put([1, 2]);
        mailbox.put([3, 4]);
        // A writer that drew a ticket and wrote one word.
        mailbox.drawn.fetch_add(1, Ordering::Relaxed);
        mailbox.slot(3).words[0].store(5, Ordering::Relaxed);
        assert_eq!(mailbox.newer_than(0), Some((2, [3, 4])));
        assert_eq!(mailbox.newer_than(2), None);
        // A writer that continued only after all slots had been used again.
        mailbox.put([7, 8]);
        mailbox.slot(4).words[1].store(6, Ordering::Relaxed);
        assert_eq!(mailbox.newer_than(0), Some((2, [3, 4])));
    }

    #[test]
    fn no_motion_is_mixed_of_two_while_many_threads_move() {
        let mailbox = Mailbox::<3>::new();
        let is_over = std::sync::atomic::AtomicBool::new(false);
        std::thread::scope(|threads| {
            for thread in 0..3u64 {
                let (mailbox, is_over) = (&mailbox, &is_over);
                threads.spawn(move || {
                    let mut word = thread << 32;
                    while !is_over.load(Ordering::Relaxed) {
                        mailbox.put([word, !word, word.wrapping_mul(3)]);
                        word += 1;
                    }
                });
            }
            let (mut taken, mut seen) = (0, 0);
            while seen < 20_000 {
                let Some((ticket, [word, inverse, triple])) = mailbox.newer_than(taken) else {
                    continue;
                };
                // The other threads end, whatever is found.
                is_over.store(seen == 19_999, Ordering::Relaxed);
                let is_whole = (inverse, triple) == (!word, word.wrapping_mul(3));
                if ticket <= taken || !is_whole {
                    is_over.store(true, Ordering::Relaxed);
                    panic!("{ticket} after {taken}: {word:x} {inverse:x} {triple:x}");
                }
                (taken, seen) = (ticket, seen + 1);
            }
        });
    }

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
