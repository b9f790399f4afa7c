//! The lease of the link that plays, see [`LeaseStatus`].
//!
//! Hosts are distinguished only by their link, because a port is open to one program at a time. A request that a
//! program may send without playing, such as one for the status, therefore does not renew the lease. Otherwise the next
//! program on the same link would keep alive what a crashed program has begun.

use model_format::link::{LINK_LOST_AFTER_MS, LeaseStatus, LinkId};

use crate::TICKS_PER_MS;

/// Ticks after which a lease that nobody renews has lapsed.
const LAPSES_AFTER_TICKS: u64 = (LINK_LOST_AFTER_MS * TICKS_PER_MS) as u64;

/// Right of one link to play: its holder, the tick of its last renewal, and the count of refusals.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Lease {
    /// The holder, and the tick of its last renewal.
    held: Option<(LinkId, u64)>,
    refused: u32,
}

/// Refusal, because another link holds the lease.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HeldBy(pub LinkId);

impl Lease {
    /// A lease that nobody holds.
    pub const fn new() -> Self {
        Self { held: None, refused: 0 }
    }

    /// Gives the lease to `link` at the tick `now`.
    pub fn give(&mut self, link: LinkId, now: u64) {
        self.held = Some((link, now));
    }

    /// Renews the lease, if `link` holds it.
    pub fn renew(&mut self, link: LinkId, now: u64) {
        if let Some((holder, renewed)) = &mut self.held
            && *holder == link
        {
            *renewed = now;
        }
    }

    /// Ends the lease, whoever holds it.
    pub fn end(&mut self) {
        self.held = None;
    }

    /// Returns true if somebody holds the lease and has renewed it in time.
    pub fn is_alive(&self, now: u64) -> bool {
        self.held
            .is_some_and(|(_, renewed)| now.saturating_sub(renewed) <= LAPSES_AFTER_TICKS)
    }

    /// Checks that `link` may begin to play.
    ///
    /// # Errors
    /// The other link holds a lease that has not lapsed.
    pub fn check_play(&mut self, link: LinkId, now: u64) -> Result<(), HeldBy> {
        match self.held {
            Some((holder, _)) if holder != link && self.is_alive(now) => Err(self.refuse(holder)),
            _ => Ok(()),
        }
    }

    /// Checks that `link` may move what is played. Unlike a request to play, a motion is refused even after the other
    /// link's lease has lapsed, because what is played belongs to the other link.
    pub fn check_motion(&mut self, link: LinkId) -> Result<(), HeldBy> {
        match self.held {
            Some((holder, _)) if holder != link => Err(self.refuse(holder)),
            _ => Ok(()),
        }
    }

    fn refuse(&mut self, holder: LinkId) -> HeldBy {
        self.refused = self.refused.saturating_add(1);
        HeldBy(holder)
    }

    /// The state, for the status.
    pub fn status(&self, now: u64) -> LeaseStatus {
        LeaseStatus {
            holder: self.held.map(|(holder, _)| holder),
            is_alive: self.is_alive(now),
            refused: self.refused,
        }
    }
}
