//! Statuses that were heard of a play, and the reasons for which it counts as failed.

use model_format::link::{Activity, MuteReason, MuteReasons, Status};

use super::play::{Driven, MIN_MOTION_RATE_HZ};

/// Statuses of a play without which nothing is said about it: one may fall into the change to it.
const FEWEST_STATUSES: u32 = 2;

/// The statuses of a play.
#[derive(Clone, Copy, Debug)]
pub struct Heard {
    /// Mutes since the play began, but for those that belong to its begin and end.
    pub mutes: u32,
    /// Ticks that were missed since the play began.
    pub missed_ticks: u32,
    statuses: u32,
    muted: u32,
    /// Reasons of all mutes that were seen.
    reasons: MuteReasons,
    mutes_before: u32,
    missed_before: u32,
}

impl Heard {
    /// Nothing yet of a play that begins with this status.
    pub fn since(before: &Status) -> Self {
        Self {
            mutes: 0,
            missed_ticks: 0,
            statuses: 0,
            muted: 0,
            reasons: MuteReasons::NONE,
            mutes_before: mutes(before),
            missed_before: before.tick.missed,
        }
    }

    /// Hears a status.
    pub fn hear(&mut self, status: &Status) {
        self.mutes = mutes(status).saturating_sub(self.mutes_before);
        self.missed_ticks = status.tick.missed.saturating_sub(self.missed_before);
        if !matches!(status.output.activity, Activity::Playing { .. }) {
            return;
        }
        self.statuses += 1;
        if !status.output.mute.is_empty() {
            self.muted += 1;
            for reason in status.output.mute.iter() {
                self.reasons = self.reasons.set(reason, true);
            }
        }
    }

    /// Share of the statuses in which the output was muted; none without statuses.
    pub fn muted_share(&self) -> Option<f64> {
        (self.statuses > 0).then(|| f64::from(self.muted) / f64::from(self.statuses))
    }

    /// The reason for which a play that has sent `driven` counts as failed, in words with the remedy.
    ///
    /// It fails if every status shows it muted. It fails too if less than half of its motions could be sent and they
    /// were fewer than [`MIN_MOTION_RATE_HZ`], because the output then mutes between them.
    pub fn failure(&self, driven: &Driven) -> Option<String> {
        let due = driven.motions + driven.skipped;
        let per_second = driven.motions as f64 / driven.seconds.max(f64::MIN_POSITIVE);
        let is_slow = per_second < f64::from(MIN_MOTION_RATE_HZ);
        let motions = (driven.motions < due.div_ceil(2) && is_slow).then(|| {
            format!(
                "only {} of {due} motions could be sent, {per_second:.0} per second where at least \
                 {MIN_MOTION_RATE_HZ} are needed: use a faster link, a computer that has more time, or a lower --rate",
                driven.motions
            )
        });
        let is_muted = self.statuses >= FEWEST_STATUSES && self.muted == self.statuses;
        let muted = is_muted.then(|| format!("the output was muted throughout ({})", self.reasons));
        match (muted, motions) {
            (None, motions) => motions,
            (Some(muted), Some(motions)) => Some(format!("{muted}; {motions}")),
            (Some(muted), None) => Some(format!("{muted}: {}", self.remedy())),
        }
    }

    fn remedy(&self) -> &'static str {
        if self.reasons.contains(MuteReason::ForceRail) {
            "connect the force sensor, or give a motion with --speed and --force"
        } else if self.reasons.contains(MuteReason::Fault) {
            "read `stylus status`, then restart the device"
        } else {
            "read `stylus status`, close other programs that use the link, then play again"
        }
    }
}

/// Number of mutes since the start, but for those that belong to the begin and the end of every play.
fn mutes(status: &Status) -> u32 {
    let counts = MuteReason::ALL.iter().zip(status.output.mute_counts);
    counts
        .filter(|(reason, _)| !matches!(reason, MuteReason::NotPlaying | MuteReason::Changing))
        .map(|(_, count)| count)
        .sum()
}
