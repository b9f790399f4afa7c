//! The device under test, with its clock and its counters, and the motions that keep it playing.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

use model_format::link::{Activity, MotionSample, MotionSource, PlayRequest, Selection, Status};
use model_format::{MillimetresPerSecond, Newton};
use stylus_link::link::play::{Drive, Driven, drive};
use stylus_link::link::{Device, LinkAddress};
use stylus_link::procedures::self_test::Line;
use stylus_signals::playing::motion::MotionPath;

use crate::board::Board;
use crate::report::{Error, Result};
use crate::report::{Report, Test};

/// Time between two readings of the status, by this computer's clock.
const POLL_INTERVAL: Duration = Duration::from_millis(5);

/// Rate of motions, Hz, by this computer's clock.
const MOTION_RATE_HZ: u32 = 200;

/// Speed of the host's motion, mm/s. No grid that the suite plays has a node there, so all four neighbours are mixed.
const SPEED_MM_S: f32 = 100.0;

/// Force of the host's motion, N.
const FORCE_N: f32 = 1.2;

/// Beginning of the virtual stylus's serial number: "VIRTUAL" in hexadecimal.
const VIRTUAL_SERIAL: &str = "5649525455414C";

/// Lengths of the tests.
#[derive(Clone, Copy, Debug)]
pub struct Lengths {
    /// Length of one playback, ms of the device.
    pub play_ms: u64,
    /// Length of the recording, ms of the device.
    pub record_ms: u64,
    /// Length of simultaneous upload, stream and playback, ms of the device.
    pub endurance_ms: u64,
    /// Shortest time from one upload to the next, ms of the device. Sectors of flash endure only 10 000 erases.
    pub between_uploads_ms: u64,
}

/// The device under test.
pub struct DeviceUnderTest {
    /// The link to the device.
    pub device: Device,
    /// Control of the board's reset and flashing.
    pub board: Board,
    /// The run's lengths.
    pub lengths: Lengths,
    /// True if the user states that no amplifier is connected, so that the self test may move the output.
    pub no_amplifier: bool,
    /// Set when the run has to end.
    pub interrupt: Arc<AtomicBool>,
    /// The report so far.
    pub report: Report,
    subject: &'static str,
    tell: fn(&Test),
}

impl DeviceUnderTest {
    /// Creates a bench that passes each test to `tell` when it is done.
    pub fn new(device: Device, board: Board, lengths: Lengths, interrupt: Arc<AtomicBool>, tell: fn(&Test)) -> Self {
        Self {
            device,
            board,
            lengths,
            no_amplifier: false,
            interrupt,
            report: Report::default(),
            subject: "",
            tell,
        }
    }

    /// Sets the subject of the next tests.
    pub fn begin(&mut self, subject: &'static str) {
        self.subject = subject;
    }

    /// Returns true if the device is emulated, as far as the link and the serial number show.
    pub fn is_emulated(&self) -> bool {
        let by_link = matches!(
            self.device.address(),
            LinkAddress::Tcp { .. } | LinkAddress::UsbVirtual { .. }
        );
        let serial = self.device.info().serial.to_uppercase();
        self.board.is_emulated() || by_link || serial.starts_with(VIRTUAL_SERIAL)
    }

    /// Returns true once the run has to end.
    pub fn is_interrupted(&self) -> bool {
        self.interrupt.load(Ordering::Relaxed)
    }

    /// Adds a test to the report.
    pub fn add(&mut self, line: Line) {
        let test = Test {
            subject: self.subject,
            line,
        };
        (self.tell)(&test);
        self.report.tests.push(test);
    }

    /// Adds lines of the product's self test. With an emulator, round trips are left out, because they depend on its
    /// computer.
    pub fn add_all(&mut self, lines: Vec<Line>) {
        for line in lines {
            if self.is_emulated() && line.name.contains("round trip") {
                self.leave_out(&line.name, "it is a matter of the computer that emulates");
            } else {
                self.add(line);
            }
        }
    }

    /// Adds a test that passes if `holds` is true. `value` and `limits` are shown in the report.
    pub fn judge(&mut self, name: &str, value: impl Into<String>, limits: impl Into<String>, holds: bool) {
        self.add(Line::judged(name, value, limits, holds, ""));
    }

    /// Adds a test that cannot run, with the reason.
    pub fn leave_out(&mut self, name: &str, reason: &str) {
        self.add(Line::not_measured(name, reason));
    }

    /// Reads the status.
    pub fn status(&self) -> Result<Status> {
        if self.is_interrupted() {
            return Err(Error::Interrupted);
        }
        Ok(self.device.status()?)
    }

    /// Reads the status until `reached` returns true for it.
    ///
    /// # Errors
    /// The errors of [`DeviceUnderTest::status`]; or `reached` stayed false for `ms` of the device's clock.
    pub fn wait_until(&self, what: &str, ms: u64, mut reached: impl FnMut(&Status) -> bool) -> Result<Status> {
        let begin = self.status()?;
        let mut status = begin.clone();
        loop {
            if reached(&status) {
                return Ok(status);
            }
            if is_restarted(&begin, &status) {
                let what = format!("the device has restarted: {what}");
                return Err(Error::NotReached { what, ms });
            }
            if status.uptime_ms - begin.uptime_ms >= ms {
                return Err(Error::NotReached {
                    what: what.to_owned(),
                    ms,
                });
            }
            thread::sleep(POLL_INTERVAL);
            status = self.status()?;
        }
    }

    /// Waits for `ms` of the device's clock.
    pub fn wait(&self, ms: u64) -> Result<Status> {
        let end = self.status()?.uptime_ms + ms;
        self.wait_until("the device's clock did not go on", ms + 1_000, |status| {
            status.uptime_ms >= end
        })
    }

    /// Waits until the device answers after a reset. The reset shows in the device's clock, which starts again.
    pub fn wait_for_restart(&mut self, before: &Status) -> Result<Status> {
        /// Number of attempts. Each takes as long as the link needs to return.
        const ATTEMPTS: u32 = 5;
        /// Time within which a requested reset occurs, ms of the device. The watchdog needs about 100 ms.
        const WITHIN_MS: u64 = 2_000;
        let mut attempts = 0;
        loop {
            match self.status() {
                Ok(status) if is_restarted(before, &status) => return Ok(status),
                Ok(status) if status.uptime_ms > before.uptime_ms + WITHIN_MS => {
                    return Err(Error::NotReached {
                        what: "the device did not start anew".to_owned(),
                        ms: WITHIN_MS,
                    });
                }
                Ok(_) => thread::sleep(POLL_INTERVAL),
                Err(Error::Link(_)) if attempts < ATTEMPTS => {
                    attempts += 1;
                    self.device.reconnect()?;
                }
                Err(error) => return Err(error),
            }
        }
    }

    /// Plays `selection` along the motion of `source` while `work` runs, and stops the device afterwards.
    ///
    /// # Errors
    /// The device refuses to play, `work` fails, the link fails, or the output does not come to rest.
    pub fn while_playing<T>(
        &self,
        selection: &Selection,
        source: MotionSource,
        work: impl FnOnce(&Self) -> Result<T>,
    ) -> Result<(T, Driven)> {
        let request = request(selection, source);
        self.device.play(&request)?;
        let goes_on = AtomicBool::new(true);
        let plan = Drive {
            // Without a motion, `drive` only keeps the link alive.
            motion: match source {
                MotionSource::Host => Some(motion()),
                MotionSource::Sensors => None,
            },
            rate_hz: MOTION_RATE_HZ,
            duration: None,
        };
        let (done, driven) = thread::scope(|scope| {
            let driving = scope.spawn(|| {
                let keep = || goes_on.load(Ordering::Relaxed) && !self.is_interrupted();
                drive(&self.device, &plan, keep, |_, _| ())
            });
            let done = work(self);
            goes_on.store(false, Ordering::Relaxed);
            (done, driving.join())
        });
        // The device is stopped whatever failed. The failure of `work` is told first, because it came first.
        let stopped = self.device.stop();
        let done = done?;
        let driven = driven.unwrap_or_else(|panic| std::panic::resume_unwind(panic))?;
        stopped?;
        Ok((done, driven))
    }

    /// Waits until the output is heard: it plays and is not muted.
    ///
    /// # Errors
    /// The errors of [`DeviceUnderTest::wait_until`]; the output stays muted for 2 s.
    pub fn wait_until_heard(&self) -> Result<Status> {
        self.wait_until("the output was not unmuted", 2_000, |status| {
            is_playing(status) && status.output.mute.is_empty()
        })
    }

    /// Sends motions until the output is heard. On return the device plays, and nothing keeps it playing. Returns the
    /// last status, whose request was the last frame sent.
    ///
    /// # Errors
    /// The errors of [`DeviceUnderTest::status`]; or the output stays muted.
    pub fn heard_with_motions(&self) -> Result<Status> {
        /// Largest number of motions that the output may need.
        const MOTIONS: u32 = 2_000;
        for _ in 0..MOTIONS {
            self.device.publish_motion(motion_sample())?;
            let status = self.status()?;
            if status.output.mute.is_empty() && !status.output.at_rest && is_playing(&status) {
                return Ok(status);
            }
        }
        Err(Error::NotReached {
            what: "the output was not unmuted".to_owned(),
            ms: MOTIONS.into(),
        })
    }
}

/// Returns true if the device has restarted.
fn is_restarted(before: &Status, now: &Status) -> bool {
    now.resets != before.resets || now.uptime_ms < before.uptime_ms
}

/// Returns true while something plays, muted or not.
pub fn is_playing(status: &Status) -> bool {
    matches!(status.output.activity, Activity::Playing { .. })
}

/// The request to play `selection` with its recorded gain.
pub fn request(selection: &Selection, motion: MotionSource) -> PlayRequest {
    PlayRequest {
        selection: selection.clone(),
        gain: 1.0,
        motion,
        seed: 1,
    }
}

/// The host's motion: constant, and within the grids of all textures that are played.
fn motion() -> MotionPath {
    MotionPath::constant(MillimetresPerSecond(SPEED_MM_S), Newton(FORCE_N)).expect("both are finite")
}

/// The host's motion as one message.
pub fn motion_sample() -> MotionSample {
    MotionSample {
        speed: MillimetresPerSecond(SPEED_MM_S),
        force: Newton(FORCE_N),
        position_mm: None,
        contact: None,
    }
}
