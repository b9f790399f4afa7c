//! Permission to erase and write a slot, and its refusal.

use model_format::link::SlotId;

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
