//! Frames on their way to the device, in the order of their urgency.

use std::collections::VecDeque;
use std::sync::{Mutex, MutexGuard, PoisonError};

use tokio::sync::{Notify, OwnedSemaphorePermit};

use super::switchboard::Urgency;

/// Urgent frames in succession after which one of the others goes first, so that a device whose link has room for
/// motions only still answers.
const IN_SUCCESSION: u32 = 8;

/// A frame, with the permit of its client, which is free again once the frame is sent.
type Waiting = (Vec<u8>, Option<OwnedSemaphorePermit>);

/// The queues. Permits bound their lengths.
#[derive(Debug, Default)]
pub(super) struct Outgoing {
    queues: Mutex<Queues>,
    pushed: Notify,
}

#[derive(Debug, Default)]
struct Queues {
    commands: VecDeque<Waiting>,
    motions: VecDeque<Waiting>,
    others: VecDeque<Waiting>,
    /// Motions since the last of the others.
    in_succession: u32,
}

impl Queues {
    /// Takes the frame that goes next. A command goes before all; a motion waits for one other frame at most.
    fn take(&mut self) -> Option<Waiting> {
        if let Some(command) = self.commands.pop_front() {
            return Some(command);
        }
        let is_others_turn = self.in_succession >= IN_SUCCESSION && !self.others.is_empty();
        if !is_others_turn && let Some(motion) = self.motions.pop_front() {
            self.in_succession = self.in_succession.saturating_add(1);
            return Some(motion);
        }
        self.in_succession = 0;
        self.others.pop_front()
    }
}

impl Outgoing {
    /// Appends a frame to its queue.
    pub(super) fn push(
        &self,
        urgency: Urgency,
        frame: Vec<u8>,
        permit: Option<OwnedSemaphorePermit>,
    ) {
        let mut queues = self.lock();
        let queue = match urgency {
            Urgency::Command => &mut queues.commands,
            Urgency::Motion => &mut queues.motions,
            Urgency::Other => &mut queues.others,
        };
        queue.push_back((frame, permit));
        self.pushed.notify_one();
    }

    /// Waits for the frame that goes next.
    pub(super) async fn next(&self) -> Waiting {
        loop {
            let next = self.lock().take();
            match next {
                Some(next) => return next,
                None => self.pushed.notified().await,
            }
        }
    }

    fn lock(&self) -> MutexGuard<'_, Queues> {
        self.queues.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn urgency() -> impl Strategy<Value = Urgency> {
        prop_oneof![
            Just(Urgency::Command),
            Just(Urgency::Motion),
            Just(Urgency::Other)
        ]
    }

    proptest! {
        #[test]
        fn every_frame_goes_once_in_order_and_none_waits_for_more_than_one_less_urgent(
            schedule in prop::collection::vec(prop::option::of(urgency()), 1..300)
        ) {
            let mut queues = Queues::default();
            let (mut pushed, mut sent) = ([0u32; 3], [0u32; 3]);
            // Less urgent frames that went while the first one of this urgency waited.
            let mut before = [0u32; 3];
            let steps = schedule.iter().copied().chain([None; 300]);
            for step in steps {
                if let Some(urgency) = step {
                    let number = pushed[urgency as usize];
                    pushed[urgency as usize] += 1;
                    let frame = [&[urgency as u8][..], &number.to_le_bytes()].concat();
                    match urgency {
                        Urgency::Command => queues.commands.push_back((frame, None)),
                        Urgency::Motion => queues.motions.push_back((frame, None)),
                        Urgency::Other => queues.others.push_back((frame, None)),
                    }
                    continue;
                }
                let Some((frame, _)) = queues.take() else { continue };
                let urgency = usize::from(frame[0]);
                let number = u32::from_le_bytes(frame[1..].try_into().unwrap());
                prop_assert_eq!(number, sent[urgency]);
                sent[urgency] += 1;
                before[urgency] = 0;
                for more in 0..urgency {
                    let waits = sent[more] < pushed[more];
                    before[more] = if waits { before[more] + 1 } else { 0 };
                    prop_assert!(before[more] <= more as u32, "{} waits", more);
                }
            }
            prop_assert_eq!(pushed, sent);
        }
    }

    #[test]
    fn what_is_not_urgent_goes_on_under_motions_without_end() {
        let mut queues = Queues::default();
        queues.others.push_back((vec![9], None));
        let mut motions = 0;
        loop {
            queues.motions.push_back((vec![1], None));
            if queues.take().unwrap().0 == [9] {
                break;
            }
            motions += 1;
        }
        assert_eq!(motions, IN_SUCCESSION);
    }
}
