//! Playing from the host: motions at a rate, and keep-alives where there is nothing else to say.

use std::collections::VecDeque;
use std::sync::mpsc::{self, Receiver, Sender, TryRecvError};
use std::thread;
use std::time::{Duration, Instant};

use model_format::link::{KEEP_ALIVE_MS, MotionSample, MotionSource, Status};

use super::Device;
use super::error::Result;
use crate::playing::motion::MotionPath;

/// Fastest rate of motions, Hz.
pub const MAX_MOTION_RATE_HZ: u32 = 1_000;

/// Slowest rate of motions, Hz: three in the time after which a device believes none.
pub const MIN_MOTION_RATE_HZ: u32 = 60;

/// One motion in so many is sent as a request, so that the device's answers tell how far it follows.
const MOTIONS_PER_ANSWER: u64 = 16;

/// Answers that may be due before motions wait: a link slower than the motions then slows them, instead of
/// carrying them later and later.
const ANSWERS_DUE: usize = 2;

/// How often the status is read.
const STATUS_INTERVAL: Duration = Duration::from_millis(200);

/// How to keep a texture or scene playing.
#[derive(Clone, Debug)]
pub struct Drive {
    /// What the hand does; the device's own sensors if none.
    pub motion: Option<MotionPath>,
    /// Motions a second, [`MIN_MOTION_RATE_HZ`] to [`MAX_MOTION_RATE_HZ`].
    pub rate_hz: u32,
    /// When to stop; else when the caller says so.
    pub duration: Option<Duration>,
}

/// What was sent.
#[derive(Clone, Copy, Debug, Default, PartialEq, serde::Serialize)]
pub struct Driven {
    /// Motions.
    pub motions: u64,
    /// Motions that the device acknowledged; every 16th asks for it.
    pub acknowledged: u64,
    /// Motions that were left out because the link or this computer was too slow.
    pub skipped: u64,
    /// Keep-alives.
    pub keep_alives: u64,
    /// For how long, s.
    pub seconds: f64,
}

/// Keeps the device playing until the time is over or `goes_on` says no; `heard` gets the status a few times a second.
///
/// Does not start to play, nor stop.
///
/// # Errors
/// A link that broke, a device that does not answer or does not follow.
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
        let due = (begin.elapsed().as_nanos() / period.as_nanos()) as u64;
        let next = slot + 1;
        if plan.motion.is_some() {
            driver.driven.skipped += due.saturating_sub(next);
        }
        slot = next.max(due);
        let wake = period.mul_f64(slot as f64);
        thread::sleep(wake.saturating_sub(begin.elapsed()));
    }
    Ok(driver.driven)
}

struct Driver<'a> {
    device: &'a Device,
    driven: Driven,
    last_sent: Instant,
    last_asked: Instant,
    /// Answers to motions that are due.
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
            last_asked: now,
            motions: VecDeque::new(),
            statuses: mpsc::channel(),
            is_status_due: false,
        }
    }

    /// Sends the motion of the moment, or what shows that the host is there.
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
        if self.last_sent.elapsed() >= Duration::from_millis(KEEP_ALIVE_MS.into())
            || (motion.is_none())
        {
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
            // A motion that goes on for ever leaves every path, and its place all numbers at last.
            position_mm: position.is_finite().then_some(position),
            contact: path.contact_at(time_s),
        };
        if self.driven.motions.is_multiple_of(MOTIONS_PER_ANSWER) {
            let (asker, runtime) = self.device.beside();
            let (sender, receiver) = mpsc::channel();
            // Whoever waited for the answer may have gone.
            runtime.spawn(async move { drop(sender.send(asker.motion(sample).await)) });
            self.motions.push_back(receiver);
        } else {
            self.device.tell_motion(sample)?;
        }
        self.driven.motions += 1;
        Ok(())
    }

    /// Takes the answers to motions that have come.
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

    /// Asks for the status from time to time, and passes it on.
    fn listen(&mut self, heard: &mut impl FnMut(&Driven, &Status)) -> Result<()> {
        if let Ok(status) = self.statuses.1.try_recv() {
            self.is_status_due = false;
            heard(&self.driven, &status?);
        }
        if !self.is_status_due && self.last_asked.elapsed() >= STATUS_INTERVAL {
            let (asker, runtime) = self.device.beside();
            let sender = self.statuses.0.clone();
            runtime.spawn(async move { drop(sender.send(asker.status().await)) });
            self.is_status_due = true;
            self.last_asked = Instant::now();
        }
        Ok(())
    }
}
