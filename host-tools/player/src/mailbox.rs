//! Hands the newest motion from any number of threads to the one thread that fills buffers.
//!
//! Neither side waits. A writer draws a ticket, writes the slot of that ticket, and seals it with a checksum over the
//! ticket and the words. A reader looks for the newest ticket whose slot holds its seal. So a motion is never a mixture
//! of two, wherever a thread is interrupted, and no memory ordering is relied on.

use std::sync::atomic::{AtomicU64, Ordering};

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

#[cfg(test)]
mod tests {
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
}
