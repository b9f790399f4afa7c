//! The one change of settings that was proposed and not yet applied; see [`SettingsProposal`].

use model_format::link::{
    LinkId, PROPOSAL_VALID_MS, ProposalToken, SettingSet, SettingsChange, SettingsError, SettingsProposal,
};

use crate::TICKS_PER_MS;

/// Ticks for which a proposal can be applied.
const VALID_TICKS: u64 = PROPOSAL_VALID_MS as u64 * TICKS_PER_MS as u64;

/// A proposal, with the tick at which it was made.
#[derive(Clone, Debug, PartialEq)]
struct Waiting {
    proposal: SettingsProposal,
    since: u64,
}

impl Waiting {
    fn remaining_ticks(&self, now: u64) -> u64 {
        VALID_TICKS.saturating_sub(now.saturating_sub(self.since))
    }
}

/// The proposal that waits, if any.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Proposals {
    waiting: Option<Waiting>,
    /// Number of proposals since the start.
    count: u32,
}

impl Proposals {
    /// No proposal.
    pub const fn new() -> Self {
        Self {
            waiting: None,
            count: 0,
        }
    }

    /// Keeps `change` in place of any change proposed before. Its token is computed from `seed`, which differs from
    /// device to device.
    pub fn propose(
        &mut self,
        from: LinkId,
        change: SettingsChange,
        loosens: SettingSet,
        now: u64,
        seed: u64,
    ) -> SettingsProposal {
        self.count = self.count.wrapping_add(1);
        let proposal = SettingsProposal {
            token: ProposalToken(mixed(seed ^ (u64::from(self.count) << 32))),
            change,
            loosens,
            from,
            remaining_ms: PROPOSAL_VALID_MS,
        };
        self.waiting = Some(Waiting {
            proposal: proposal.clone(),
            since: now,
        });
        proposal
    }

    /// Returns the change that `from` has proposed with `token`, and ends the proposal.
    ///
    /// # Errors
    /// No proposal with this token waits, or the other link has made it. A waiting proposal is kept.
    pub fn take(&mut self, from: LinkId, token: ProposalToken, now: u64) -> Result<SettingsChange, SettingsError> {
        let matching = self.waiting.take_if(|waiting| {
            let proposal = &waiting.proposal;
            proposal.token == token && proposal.from == from && waiting.remaining_ticks(now) > 0
        });
        if let Some(waiting) = matching {
            return Ok(waiting.proposal.change);
        }
        match self.waiting(now) {
            Some(other) if other.token == token => Err(SettingsError::OtherLink { from: other.from }),
            _ => Err(SettingsError::NoProposal),
        }
    }

    /// Ends the proposal that waits.
    pub fn end(&mut self) {
        self.waiting = None;
    }

    /// The proposal that waits, for the status.
    pub fn waiting(&self, now: u64) -> Option<SettingsProposal> {
        let waiting = self.waiting.as_ref()?;
        let remaining = waiting.remaining_ticks(now);
        (remaining > 0).then(|| SettingsProposal {
            remaining_ms: remaining.div_ceil(u64::from(TICKS_PER_MS)) as u32,
            ..waiting.proposal.clone()
        })
    }
}

/// Mixes `seed` into 32 bits, each of which depends on all bits of `seed`, by the finaliser of MurmurHash3.
const fn mixed(seed: u64) -> u32 {
    let seed = (seed ^ (seed >> 33)).wrapping_mul(0xff51_afd7_ed55_8ccd);
    let seed = (seed ^ (seed >> 33)).wrapping_mul(0xc4ce_b9fe_1a85_ec53);
    (seed >> 32) as u32
}
