//! Playing under control of the host: motions at a fixed rate, and keep-alives while there is no motion to send.

use std::collections::VecDeque;
use std::sync::mpsc::{self, Receiver, Sender, TryRecvError};
use std::thread;
use std::time::{Duration, Instant};

use model_format::link::{Activity, KEEP_ALIVE_MS, MotionSample, MotionSource, MuteReason, MuteReasons, Status};
use stylus_signals::playing::motion::MotionPath;

use super::Device;
use super::error::Result;

/// Highest rate of motions, Hz.
pub const MAX_MOTION_RATE_HZ: u32 = 1_000;

/// Lowest rate of motions, Hz. It gives three motions in the time after which a device considers its motion stale.
pub const MIN_MOTION_RATE_HZ: u32 = 60;

/// Number of motions per answer. Every 16th motion is sent as a request, so that the device's answers show whether it
/// keeps up.
const MOTIONS_PER_ANSWER: u64 = 16;

/// Largest number of outstanding answers. Further motions are skipped, because a link slower than their rate would
/// deliver them later and later.
const ANSWERS_DUE: usize = 2;

/// Interval between readings of the status.
const STATUS_INTERVAL: Duration = Duration::from_millis(200);

/// Source, rate and duration of the motion that keeps a texture or scene playing.
#[derive(Clone, Debug)]
pub struct Drive {
    /// The motion; `None` for the device's own sensors.
    pub motion: Option<MotionPath>,
    /// Rate of motions, Hz, from [`MIN_MOTION_RATE_HZ`] to [`MAX_MOTION_RATE_HZ`].
    pub rate_hz: u32,
    /// Duration; `None` to continue until the caller ends it.
    pub duration: Option<Duration>,
}

/// Counts of what was sent.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Driven {
    /// Motions that were sent.
    pub motions: u64,
    /// Motions that the device acknowledged. Only every 16th motion is a request, which it acknowledges.
    pub acknowledged: u64,
    /// Motions that were skipped because the link or this computer was too slow.
    pub skipped: u64,
    /// Keep-alives that were sent.
    pub keep_alives: u64,
    /// Elapsed time, s.
    pub seconds: f64,
}

/// Keeps the device playing until the plan's duration is over or `goes_on` returns false. Calls `heard` with the status
/// every 0.2 s.
///
/// Neither starts nor stops the output: see [`Device::play`] and [`Device::stop`].
pub fn drive(
    device: &Device,
    plan: &Drive,
    mut goes_on: impl FnMut() -> bool,
    mut heard: impl FnMut(&Driven, &Status),
) -> Result<Driven> {
    let period = match plan.motion {
        Some(_) => {
            let rate_hz = plan.rate_hz.clamp(MIN_MOTION_RATE_HZ, MAX_MOTION_RATE_HZ);
            Duration::from_secs(1) / rate_hz
        }
        None => Duration::from_millis(KEEP_ALIVE_MS.into()),
    };
    let mut driver = Driver::new(device);
    let begin = Instant::now();
    let mut slot = 0;
    while goes_on() {
        let elapsed = begin.elapsed();
        driver.driven.seconds = elapsed.as_secs_f64();
        if plan.duration.is_some_and(|duration| elapsed >= duration) {
            break;
        }
        driver.send(plan.motion.as_ref(), elapsed)?;
        driver.listen(&mut heard)?;
        // The time after sending decides, because sending itself may take longer than a period.
        let due = (begin.elapsed().as_nanos() / period.as_nanos()) as u64;
        let next = slot + 1;
        if plan.motion.is_some() {
            driver.driven.skipped += due.saturating_sub(next);
        }
        slot = next.max(due);
        // Each instant is computed from the begin, so that late wakings do not add up.
        let wake = period.mul_f64(slot as f64);
        thread::sleep(wake.saturating_sub(begin.elapsed()));
    }
    Ok(driver.driven)
}

struct Driver<'a> {
    device: &'a Device,
    driven: Driven,
    last_sent: Instant,
    last_requested: Instant,
    /// Outstanding answers to motions.
    motions: VecDeque<Receiver<Result<MotionSource>>>,
    statuses: (Sender<Result<Status>>, Receiver<Result<Status>>),
    is_status_due: bool,
}

impl<'a> Driver<'a> {
    fn new(device: &'a Device) -> Self {
        let now = Instant::now();
        Self {
            device,
            driven: Driven::default(),
            last_sent: now,
            last_requested: now,
            motions: VecDeque::new(),
            statuses: mpsc::channel(),
            is_status_due: false,
        }
    }

    /// Sends the motion at `elapsed` if there is one, or a keep-alive if one is due.
    fn send(&mut self, motion: Option<&MotionPath>, elapsed: Duration) -> Result<()> {
        self.acknowledge()?;
        if let Some(path) = motion {
            if self.motions.len() < ANSWERS_DUE {
                self.send_motion(path, elapsed)?;
                self.last_sent = Instant::now();
            } else {
                self.driven.skipped += 1;
            }
        }
        // While motions are skipped, keep-alives show the device that this program still runs.
        if self.last_sent.elapsed() >= Duration::from_millis(KEEP_ALIVE_MS.into()) || motion.is_none() {
            self.device.keep_alive()?;
            self.driven.keep_alives += 1;
            self.last_sent = Instant::now();
        }
        Ok(())
    }

    fn send_motion(&mut self, path: &MotionPath, elapsed: Duration) -> Result<()> {
        let time_s = elapsed.as_secs_f64();
        let (speed, force) = path.values_at(time_s);
        let position = path.position_mm_at(time_s) as f32;
        let sample = MotionSample {
            speed,
            force,
            // The position of an endless motion overflows single precision eventually.
            position_mm: position.is_finite().then_some(position),
            contact: path.contact_at(time_s),
        };
        if self.driven.motions.is_multiple_of(MOTIONS_PER_ANSWER) {
            let (requester, runtime) = self.device.requester();
            let (sender, receiver) = mpsc::channel();
            // The receiver may be gone when the answer arrives.
            runtime.spawn(async move { drop(sender.send(requester.motion(sample).await)) });
            self.motions.push_back(receiver);
        } else {
            self.device.publish_motion(sample)?;
        }
        self.driven.motions += 1;
        Ok(())
    }

    /// Counts the answers to motions that have arrived, and returns the first error among them.
    fn acknowledge(&mut self) -> Result<()> {
        while let Some(first) = self.motions.front() {
            match first.try_recv() {
                Ok(answer) => {
                    answer?;
                    self.driven.acknowledged += 1;
                }
                Err(TryRecvError::Empty) => return Ok(()),
                Err(TryRecvError::Disconnected) => {}
            }
            self.motions.pop_front();
        }
        Ok(())
    }

    /// Requests the status at its interval, and passes it on.
    fn listen(&mut self, heard: &mut impl FnMut(&Driven, &Status)) -> Result<()> {
        if let Ok(status) = self.statuses.1.try_recv() {
            self.is_status_due = false;
            heard(&self.driven, &status?);
        }
        if !self.is_status_due && self.last_requested.elapsed() >= STATUS_INTERVAL {
            let (requester, runtime) = self.device.requester();
            // The answer comes to a task of its own, so that a late one delays no motion.
            let sender = self.statuses.0.clone();
            runtime.spawn(async move { drop(sender.send(requester.status().await)) });
            self.is_status_due = true;
            self.last_requested = Instant::now();
        }
        Ok(())
    }
}

/// Least number of statuses from which a play is judged. One status may fall into the change at the play's begin.
const FEWEST_STATUSES: u32 = 2;

/// Summary of the statuses during a play.
#[derive(Clone, Copy, Debug)]
pub struct PlayCounts {
    /// Mutes since the play began, without those that belong to its begin and end.
    pub mutes: u32,
    /// Ticks that were missed since the play began.
    pub missed_ticks: u32,
    statuses: u32,
    muted: u32,
    /// Reasons of all mutes that were seen.
    reasons: MuteReasons,
    mutes_before: u32,
    missed_before: u32,
    /// Number of motions, and the device's uptime, ms, at the first and at the last status.
    paces: Option<[(u64, u64); 2]>,
    vibration: Vibration,
}

/// Level at the accelerometer, RMS of all axes over a second, m/s². It shows whether the output moves the stylus.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Vibration {
    /// The level before the play.
    pub before_m_s2: f64,
    /// The greatest level while the output was not muted.
    pub greatest_m_s2: f64,
}

impl PlayCounts {
    /// Creates an empty summary of a play that begins after the status `before`.
    pub fn since(before: &Status) -> Self {
        Self {
            mutes: 0,
            missed_ticks: 0,
            statuses: 0,
            muted: 0,
            reasons: MuteReasons::NONE,
            mutes_before: mutes(before),
            missed_before: before.tick.missed,
            paces: None,
            vibration: Vibration {
                before_m_s2: vibration_m_s2(before),
                greatest_m_s2: 0.0,
            },
        }
    }

    /// Adds a status, which was received when `driven` had been sent.
    pub fn hear(&mut self, driven: &Driven, status: &Status) {
        let pace = (driven.motions, status.uptime_ms);
        self.paces = Some([self.paces.map_or(pace, |[first, _]| first), pace]);
        self.mutes = mutes(status).saturating_sub(self.mutes_before);
        self.missed_ticks = status.tick.missed.saturating_sub(self.missed_before);
        // An output at rest is muted, too, and says nothing about the play.
        if !matches!(status.output.activity, Activity::Playing { .. }) {
            return;
        }
        self.statuses += 1;
        if status.output.mute.is_empty() {
            let level = vibration_m_s2(status);
            self.vibration.greatest_m_s2 = self.vibration.greatest_m_s2.max(level);
        } else {
            self.muted += 1;
            for reason in status.output.mute.iter() {
                self.reasons = self.reasons.set(reason, true);
            }
        }
    }

    /// The level at the accelerometer; none if no status without a mute reported one.
    pub fn vibration(&self) -> Option<Vibration> {
        (self.vibration.greatest_m_s2 > 0.0).then_some(self.vibration)
    }

    /// Fraction of the statuses in which the output was muted; none without statuses.
    pub fn muted_share(&self) -> Option<f64> {
        (self.statuses > 0).then(|| f64::from(self.muted) / f64::from(self.statuses))
    }

    /// Returns the reasons of all mutes that a status showed; none without a mute.
    pub fn reasons(&self) -> Option<MuteReasons> {
        (!self.reasons.is_empty()).then_some(self.reasons)
    }

    /// Returns why a play that has sent `driven` counts as failed, with the remedy.
    ///
    /// A play fails if it has at least two statuses and each shows the output muted. It also fails if less than half of
    /// its motions could be sent and their rate by the device's clock was below [`MIN_MOTION_RATE_HZ`], because the
    /// output then mutes between motions.
    pub fn failure(&self, driven: &Driven) -> Option<String> {
        let due = driven.motions + driven.skipped;
        let per_second = self.motions_per_second(driven);
        let is_slow = per_second < f64::from(MIN_MOTION_RATE_HZ);
        let motions = (driven.motions < due.div_ceil(2) && is_slow).then(|| {
            format!(
                "only {} of {due} motions could be sent, {per_second:.0} per second, but at least \
                 {MIN_MOTION_RATE_HZ} are needed: use a faster link, a less busy computer, or a lower --rate, down to \
                 {MIN_MOTION_RATE_HZ}",
                driven.motions
            )
        });
        let is_muted = self.statuses >= FEWEST_STATUSES && self.muted == self.statuses;
        let muted = is_muted.then(|| format!("the output was muted throughout ({})", self.reasons));
        match (muted, motions) {
            (None, motions) => motions,
            // Too few motions are the reason for the mute, so their remedy is the only one.
            (Some(muted), Some(motions)) => Some(format!("{muted}; {motions}")),
            (Some(muted), None) => Some(format!("{muted}: {}", self.remedy())),
        }
    }

    /// Returns the rate of motions by the device's clock, which for a virtual stylus is not this computer's; by this
    /// computer's clock before there are two statuses.
    fn motions_per_second(&self, driven: &Driven) -> f64 {
        match self.paces {
            Some([(sent, from_ms), (sent_last, to_ms)]) if to_ms > from_ms => {
                (sent_last - sent) as f64 * 1e3 / (to_ms - from_ms) as f64
            }
            _ => driven.motions as f64 / driven.seconds.max(f64::MIN_POSITIVE),
        }
    }

    fn remedy(&self) -> &'static str {
        if self.reasons.contains(MuteReason::ForceRail) {
            "connect the force sensor, or give a motion with --speed and --force"
        } else if self.reasons.contains(MuteReason::Fault) {
            "read `stylus status`, then restart the device"
        } else if [MuteReason::LinkLost, MuteReason::Stale]
            .into_iter()
            .any(|reason| self.reasons.contains(reason))
        {
            "this computer or the link was too late: close other programs that use the link or keep this computer \
             busy, then play again"
        } else {
            "read `stylus status`, close other programs that use the link, then play again"
        }
    }
}

/// Level at the accelerometer over the last whole second, RMS of all axes, m/s²; 0 before the first second is complete.
pub fn vibration_m_s2(status: &Status) -> f64 {
    if status.levels.samples == 0 {
        return 0.0;
    }
    // The level is in dB re 1 µm/s², and 1 µm/s² is 10^-6 m/s².
    10f64.powf(f64::from(status.levels.vibration_decibel) / 20.0 - 6.0)
}

/// Number of mutes since the device's start, without those that belong to the begin and the end of every play.
fn mutes(status: &Status) -> u32 {
    MuteReason::ALL
        .iter()
        .zip(status.output.mute_counts)
        .filter(|(reason, _)| !matches!(reason, MuteReason::NotPlaying | MuteReason::Changing))
        .map(|(_, count)| count)
        .sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// What was heard of a play at whose two statuses so many motions had been sent, after so many ms of the device.
    fn heard(paces: [(u64, u64); 2]) -> PlayCounts {
        PlayCounts {
            mutes: 0,
            missed_ticks: 0,
            statuses: 2,
            muted: 0,
            reasons: MuteReasons::NONE,
            mutes_before: 0,
            missed_before: 0,
            paces: Some(paces),
            vibration: Vibration {
                before_m_s2: 0.0,
                greatest_m_s2: 0.0,
            },
        }
    }

    #[test]
    fn a_play_fails_if_less_than_half_of_its_motions_are_sent_below_the_least_rate_of_the_devices_clock() {
        let driven = |motions, skipped| Driven {
            motions,
            skipped,
            acknowledged: 0,
            keep_alives: 0,
            seconds: 3.0,
        };
        let slow = heard([(0, 1_000), (48, 4_000)]);
        let failure = slow.failure(&driven(48, 252)).expect("16 per second");
        assert!(failure.starts_with("only 48 of 300 motions could be sent, 16 per second, but at least 60"));
        assert_eq!(slow.failure(&driven(151, 149)), None);
        // An emulated device's second may take ten of this computer's.
        let of_a_slow_device = heard([(0, 1_000), (48, 1_300)]);
        assert_eq!(of_a_slow_device.failure(&driven(48, 252)), None);
    }
}
