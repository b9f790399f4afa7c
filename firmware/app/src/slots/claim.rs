//! The only way to any erasure: a [`Claim`], without which no sector of a slot is erased, and no word of it written but
//! copies of its header.
//!
//! A slot that holds a library can be claimed only while the other slot holds a library too, unless the claim may
//! replace the last one. The other library is read again for this, each word [`STEADY_READS`] times, because a word
//! that was being programmed when power was lost may read right now and wrongly at the next start. A slot that could
//! not be read is read again first, because it may be readable now.

use model_format::link::{SlotFault, SlotId, SlotInfo, SlotState};
use stylus_boot::record::is_newer;

use super::header::{HEADER_OFFSET, Header, STEADY_READS};
use super::{MappedFlash, SlotStore};

/// Number of times that a slot which could not be read is read again before it is claimed.
const SECOND_CHANCES: usize = 4;

impl<F: MappedFlash> SlotStore<F> {
    /// Claims `slot`, so that it can be erased. From then on the slot counts as holding no library.
    ///
    /// # Errors
    /// The slot holds a library, the other slot has none that reads the same every time, and `replaces_last` is false.
    /// The slot has not changed then.
    pub(crate) async fn claim(&mut self, slot: SlotId, replaces_last: bool) -> Result<Claim, LastLibrary> {
        self.give_second_chances(slot).await;
        if self.library(slot).is_some() && !replaces_last {
            self.give_second_chances(slot.other()).await;
            if !self.is_steady(slot.other()).await {
                return Err(LastLibrary { slot });
            }
        }
        // Before anything is erased, so that a call that is dropped half way leaves no library that is not there.
        self.set_unfinished(slot);
        Ok(Claim { slot })
    }

    /// Claims the slot for an upload: the slot that is not active. While none is active, this is the slot that is worth
    /// less.
    pub(crate) async fn claim_spare(&mut self, replaces_last: bool) -> Result<Claim, LastLibrary> {
        for slot in SlotId::ALL {
            self.give_second_chances(slot).await;
        }
        let spare = self.spare();
        if self.active().is_some() {
            return self.claim(spare, replaces_last).await;
        }
        match self.claim(spare, false).await {
            Ok(claim) => Ok(claim),
            // The other slot cannot be relied on, so it is claimed instead.
            Err(LastLibrary { slot }) => self.claim(slot.other(), replaces_last).await,
        }
    }

    /// Reads a slot that could not be read, until it can be or has failed [`SECOND_CHANCES`] times.
    async fn give_second_chances(&mut self, slot: SlotId) {
        for _ in 0..SECOND_CHANCES {
            if !matches!(self.state(slot), SlotState::Faulty(_)) {
                return;
            }
            self.scan(slot).await;
        }
    }

    /// The slot that is worth less: a slot that is not valid, otherwise the older one.
    pub(super) fn lesser(&self) -> SlotId {
        let worth = |slot: SlotId| match self.state(slot) {
            SlotState::Empty | SlotState::Receiving => 0,
            // What could not be read may be readable another time.
            SlotState::Faulty(SlotFault::Unreadable { .. } | SlotFault::Checksum { .. }) => 2,
            SlotState::Faulty(_) => 1,
            SlotState::Valid(_) => 3,
        };
        let [first, second] = SlotId::ALL;
        match self.newest() {
            Some(newest) if worth(first) == worth(second) => newest.other(),
            _ if worth(second) < worth(first) => second,
            _ => first,
        }
    }

    /// Returns true if `slot` holds a library whose words all read the same every time. If they do not, the slot counts
    /// as faulty from then on.
    async fn is_steady(&mut self, slot: SlotId) -> bool {
        let Some(info) = self.library(slot) else {
            return false;
        };
        match self.read_steadily(slot, info).await {
            Ok(()) => true,
            Err(fault) => {
                self.set_state(slot, SlotState::Faulty(fault));
                false
            }
        }
    }

    async fn read_steadily(&mut self, slot: SlotId, info: SlotInfo) -> Result<(), SlotFault> {
        let copies = self.copies(slot).await;
        let is_same = copies.header().is_some_and(|header| header.crc32 == info.crc32);
        if copies.whole == 0 || !is_same {
            let offset = HEADER_OFFSET;
            return Err(SlotFault::Unreadable { offset });
        }
        self.compare_bytes(slot, info.length, info.crc32, STEADY_READS).await
    }

    /// Notes a header that was read or written.
    pub(super) fn note_header(&mut self, header: Header) {
        let is_higher = self.highest.is_none_or(|highest| is_newer(header.sequence, highest));
        if is_higher {
            self.highest = Some(header.sequence);
        }
    }
}

/// Permission to erase and write a slot. Only `SlotStore::claim` grants it. It cannot be copied, so that nothing is
/// erased with a claim that has ended.
#[derive(Debug)]
pub(crate) struct Claim {
    pub(super) slot: SlotId,
}

impl Claim {
    /// The slot.
    pub(crate) const fn slot(&self) -> SlotId {
        self.slot
    }
}

/// Refusal of a claim, because the slot holds the last library that can be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct LastLibrary {
    /// The slot.
    pub(crate) slot: SlotId,
}
