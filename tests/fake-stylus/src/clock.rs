//! The clock of a device behind a TCP port, which no load of the computer disturbs.
//!
//! The clock follows real time only as far as the host keeps up. Each frame of the host grants the device some time,
//! and at the end of that time the clock waits for the next frame, as if the device had not noticed that the host was
//! late. A play is therefore never muted because this computer did not run the host in time. Time that the device's own
//! thread has lost is not made up for, so that no recording comes in a burst.
//!
//! What needs no host goes on freely: a recording, a job of the storage, and a device that nobody is connected to. A
//! test that is about a silent host, such as the end of a lease, lets time pass by
//! [`FakeStylus::pass`](crate::FakeStylus::pass).

use std::time::{Duration, Instant};

use model_format::link::{Activity, LINK_LOST_AFTER_MS, LinkId, MotionSource, STALE_AFTER_MS, Status};

/// Longest step of the clock, even if the device's thread was not run for longer.
const LONGEST_STEP: Duration = Duration::from_millis(5);

/// Time that a motion grants. With it and [`OTHER`] for a status after each, there are more than 60 motions per second
/// of the clock, the least that a play may have.
const MOTION: Duration = Duration::from_millis(14);

/// Time that a keep-alive grants a device that plays without motions of the host. A host sends several of them in this
/// time, each when it has received blocks of a recording.
const KEEP_ALIVE: Duration = Duration::from_millis(40);

/// Time that a keep-alive grants while motions are due: the interval in which a host sends keep-alives.
const KEEP_ALIVE_WITHOUT_MOTION: Duration = Duration::from_millis(10);

/// Time that any other frame grants while a host holds the lease. It is short, because such a frame renews nothing.
const OTHER: Duration = Duration::from_millis(2);

/// Time that a frame grants a device at which no host holds the lease.
const IDLE: Duration = Duration::from_millis(10);

const _: () =
    assert!(MOTION.as_millis() < STALE_AFTER_MS as u128 && KEEP_ALIVE.as_millis() < LINK_LOST_AFTER_MS as u128);

/// The clock.
pub struct Clock {
    /// Time since the device's start.
    time: Duration,
    /// Instant at which the clock was last set.
    set_at: Instant,
    /// End of the time that the host's frames have granted.
    granted: Duration,
    /// Link whose present connection was the last that asked to play. A lease of an earlier connection is not waited
    /// for.
    player: Option<LinkId>,
}

impl Clock {
    /// Creates a clock that shows `time`.
    pub fn new(time: Duration) -> Self {
        Self {
            time,
            set_at: Instant::now(),
            granted: time,
            player: None,
        }
    }

    /// Time since the device's start.
    pub fn time(&self) -> Duration {
        self.time
    }

    /// Begins a connection on the link `id`, whose host has not said anything yet.
    pub fn connect(&mut self, id: LinkId) {
        self.granted = self.time;
        self.end(id);
    }

    /// Ends the connection on the link `id`.
    pub fn end(&mut self, id: LinkId) {
        self.player.take_if(|player| *player == id);
    }

    /// Grants the time that belongs to a frame for `path` on the link `id`, which has left the device with `status`.
    pub fn hear(&mut self, id: LinkId, path: &str, status: &Status) {
        if matches!(path, "stylus/play" | "stylus/probe/start") {
            self.player = Some(id);
        }
        let follows_host = matches!(
            status.output.activity,
            Activity::Playing {
                motion: MotionSource::Host,
                ..
            }
        );
        let grant = match path {
            _ if !self.is_held(status) => IDLE,
            "stylus/motion" | "stylus/motion/live" => MOTION,
            "stylus/play" | "stylus/keep-alive" if follows_host => KEEP_ALIVE_WITHOUT_MOTION,
            "stylus/play" | "stylus/probe/start" | "stylus/keep-alive" => KEEP_ALIVE,
            _ => OTHER,
        };
        self.granted = self.granted.max(self.time + grant);
    }

    /// Returns true while a connected host holds the lease.
    fn is_held(&self, status: &Status) -> bool {
        self.player.is_some() && status.lease.is_alive
    }

    /// Lets the clock go on with real time. Unless the device `is_free` of its host, the clock waits at the end of the
    /// granted time while the host holds the lease, or while nothing is recorded.
    pub fn follow(&mut self, status: &Status, is_free: bool) {
        let now = Instant::now();
        let step = (now - std::mem::replace(&mut self.set_at, now)).min(LONGEST_STEP);
        let next = self.time + step;
        let waits = !is_free && (self.is_held(status) || !status.record.recording);
        self.time = if waits {
            next.min(self.granted).max(self.time)
        } else {
            next
        };
    }

    /// Lets up to `time` pass, whatever the host does. Returns how much has passed.
    pub fn pass(&mut self, time: Duration) -> Duration {
        let step = time.min(LONGEST_STEP);
        self.time += step;
        step
    }
}
