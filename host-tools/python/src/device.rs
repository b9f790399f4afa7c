//! A stylus on a link: what is in it, uploads, plays and settings.

use std::cell::Cell;
use std::collections::HashMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use host_tools::link::capture::{Calibration, Stream};
use host_tools::link::discovery;
use host_tools::link::play::{Drive, MAX_MOTION_RATE_HZ, MIN_MOTION_RATE_HZ, PlayCounts, drive};
use host_tools::link::settings::{self as described, Known, SettingRow, consequences};
use host_tools::link::upload::upload_over;
use host_tools::link::{Device as Linked, LinkAddress, LinkError, Timeouts};
use host_tools::support::{Error, Result};
use model_format::link::{
    Activity, DeviceInfo, MotionRefused, MotionSource, PlayRequest, Selection, SettingChange, SettingsChange, SlotId,
    Status, TextureName,
};
use model_format::scene::SceneName;
use pyo3::prelude::*;
use serde::Serialize;

use crate::convert::{plain, positive, table};
use crate::error::{link_raised, raised, refused};
use crate::motion::{Along, Asked, MotionLike, warn_of_motion};
use crate::playing::LibraryLike;
use crate::work::{self, AfterEnd};

/// Longest timeout, and longest play, s: a day, so that sums of durations do not overflow.
const LONGEST_TIMEOUT_S: f64 = 86_400.0;

// A literal below, so that `help` shows it.
const _: () = assert!(MAX_MOTION_RATE_HZ == 1000);

/// Interval between readings of the status while a recording is passed on.
const STATUS_INTERVAL: Duration = Duration::from_millis(250);

/// A link, which is none once it is closed.
type Shared = Arc<Mutex<Option<Linked>>>;

/// A stylus on a link, for as long as it is open. Use it in a `with` statement, or close it.
///
/// `link` is usb, usb:SERIAL, serial:PATH, tcp:HOST:PORT or usb-virtual:HOST:PORT; None takes the only stylus that is
/// attached. `timeout_s` is that of an answer, s (default 1); requests that write flash have 16 times as long. The link
/// is open for this program alone; another program may use the stylus's other link.
#[pyclass(frozen, module = "stylus_haptics")]
pub struct Device {
    shared: Shared,
    link: String,
    info: DeviceInfo,
}

/// The status, as `stylus status --json` has it.
#[derive(Serialize)]
struct StatusReport<'a> {
    link: &'a str,
    device: &'a DeviceInfo,
    muted: Vec<String>,
    status: &'a Status,
}

impl Device {
    /// Makes requests without the interpreter's lock.
    fn ask<T: Send>(
        &self,
        py: Python<'_>,
        request: impl FnOnce(&Linked) -> std::result::Result<T, LinkError> + Send,
    ) -> PyResult<T> {
        py.detach(|| open(&mut locked(&self.shared)).map(|device| request(device)))
            .map_err(raised)?
            .map_err(|failure| link_raised(&failure))
    }

    fn reported<'py>(&self, py: Python<'py>, status: &Status) -> PyResult<Bound<'py, PyAny>> {
        let reasons = status.output.mute.iter();
        let report = StatusReport {
            link: &self.link,
            device: &self.info,
            muted: reasons.map(|reason| reason.to_string()).collect(),
            status,
        };
        plain(py, &report)
    }
}

#[pymethods]
impl Device {
    #[new]
    #[pyo3(signature = (link = None, *, timeout_s = None))]
    fn new(py: Python<'_>, link: Option<&str>, timeout_s: Option<f64>) -> PyResult<Self> {
        let timeouts = match timeout_s {
            Some(seconds) => {
                let seconds = positive("timeout_s", seconds)?.min(LONGEST_TIMEOUT_S);
                Timeouts::scaled_to(Duration::from_secs_f64(seconds))
            }
            None => Timeouts::default(),
        };
        let address = link.map(address).transpose()?;
        let device = py
            .detach(|| {
                let address = match address {
                    Some(address) => address,
                    None => discovery::only()?.0,
                };
                Linked::connect(&address, timeouts)
            })
            .map_err(|failure| link_raised(&failure))?;
        Ok(Self {
            link: device.address().to_string(),
            info: device.info().clone(),
            shared: Arc::new(Mutex::new(Some(device))),
        })
    }

    /// The link.
    #[getter]
    fn link(&self) -> &str {
        &self.link
    }

    /// True for an emulated stylus, whose recordings are simulated.
    #[getter]
    fn is_emulated(&self) -> bool {
        address(&self.link).is_ok_and(|link| link.is_of_an_emulator())
    }

    /// The device's identity as plain objects: product, serial number, versions.
    #[getter]
    fn info<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        plain(py, &self.info)
    }

    /// The status as plain objects: that of `stylus status --json`.
    fn status<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        self.reported(py, &self.ask(py, Linked::status)?)
    }

    /// The slots with their textures and scenes as plain objects: those of `stylus slots --json`.
    fn slots<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        plain(py, &self.ask(py, Linked::contents)?)
    }

    /// Uploads a library to the slot that is not active, resumes where a broken link left off, reads it back, and with
    /// `activate` makes it the one that is played. Returns the slot, 'A' or 'B'.
    ///
    /// `replace_last` allows the upload to erase the last library that the device can read. `progress(done, total)`
    /// counts bytes.
    #[pyo3(signature = (library, *, activate = false, replace_last = false, progress = None))]
    fn upload<'py>(
        &self,
        py: Python<'py>,
        library: LibraryLike<'py>,
        activate: bool,
        replace_last: bool,
        progress: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<String> {
        let library = library.library(py)?;
        let bytes = library.get().bytes().clone();
        let total = bytes.len() as u64;
        let device = self.shared.clone();
        // The caller waits, so that after Ctrl-C the link is free again when the exception is raised.
        let slot = work::run_until(py, total, progress, AfterEnd::Waits, move |steps| {
            let mut device = locked(&device);
            let device = open(&mut device)?;
            let uploaded = device.check_library_format().and_then(|()| {
                upload_over(device, &bytes, replace_last, |there| {
                    steps.set_done(there as u64);
                    steps.between();
                })
            });
            // A failure of the link is passed on as a value, so that its exception is of the kind "link".
            Ok(uploaded.and_then(|uploaded| {
                if activate {
                    device.activate(uploaded.slot)?;
                }
                Ok(uploaded.slot)
            }))
        })?;
        Ok(slot.map_err(|failure| link_raised(&failure))?.to_string())
    }

    /// Makes the library in `slot`, 'A' or 'B', the one that is played; the newest if None. Returns the slot.
    #[pyo3(signature = (slot = None))]
    fn activate(&self, py: Python<'_>, slot: Option<&str>) -> PyResult<String> {
        let slot = match slot {
            None => None,
            Some(name) => {
                let mut slots = SlotId::ALL.into_iter();
                let found = slots.find(|slot| slot.to_string().eq_ignore_ascii_case(name));
                let absent = || refused(format!("slot is '{name}': it must be 'A' or 'B'"));
                Some(found.ok_or_else(absent)?)
            }
        };
        let activated = self.ask(py, |device| {
            let slot = match slot {
                Some(slot) => Some(slot),
                None => device.newest()?.map(|(slot, _)| slot),
            };
            slot.map(|slot| device.activate(slot)).transpose()
        })?;
        let none = || refused("no slot holds a library: upload one");
        Ok(activated.ok_or_else(none)?.slot.to_string())
    }

    /// Plays a texture or a scene of the active library until `seconds` are over or the motion ends, then stops it and
    /// reads that back. Returns counts as plain objects: motions, keep-alives, mutes, missed ticks.
    ///
    /// The motion is that of the sensors, a constant `speed_mm_s` and `force_n`, or `motion`, a `Motion` or the path of
    /// a table; `rate_hz` motions are sent per second. `gain` is a factor on the amplitude. `progress(done, total)`
    /// counts milliseconds. Ctrl-C stops the output before it is raised.
    ///
    /// Raises `StylusError` for a play that was muted throughout, or that another program or the device has stopped.
    #[pyo3(signature = (
        *, texture = None, scene = None, speed_mm_s = None, force_n = None, motion = None, seconds = None, gain = 1.0,
        rate_hz = 1000, seed = 1, progress = None
    ))]
    #[expect(clippy::too_many_arguments, reason = "they are keywords")]
    fn play<'py>(
        &self,
        py: Python<'py>,
        texture: Option<&str>,
        scene: Option<&str>,
        speed_mm_s: Option<f64>,
        force_n: Option<f64>,
        motion: Option<MotionLike<'py>>,
        seconds: Option<f64>,
        gain: f32,
        rate_hz: u32,
        seed: u64,
        progress: Option<&Bound<'py, PyAny>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let selection = selection(texture, scene)?;
        let asked = Asked {
            speed_mm_s,
            force_n,
            motion,
            seconds,
        };
        let along = asked.along()?;
        if !(MIN_MOTION_RATE_HZ..=MAX_MOTION_RATE_HZ).contains(&rate_hz) {
            return Err(refused(format!(
                "rate_hz is {rate_hz}: it must be {MIN_MOTION_RATE_HZ} to {MAX_MOTION_RATE_HZ}"
            )));
        }
        let (motion, seconds) = match along {
            Some(Along { path, seconds }) => (Some(path), seconds),
            None => (None, seconds),
        };
        if let (Some(motion), Some(_)) = (&motion, texture) {
            warn_of_motion(py, motion)?;
        }
        let Some(seconds) = seconds else {
            return Err(refused("a motion without an end: give seconds"));
        };
        let request = PlayRequest {
            selection,
            gain,
            motion: match motion {
                Some(_) => MotionSource::Host,
                None => MotionSource::Sensors,
            },
            seed,
        };
        let plan = Drive {
            motion,
            rate_hz,
            // A duration beyond its range would panic.
            duration: Some(Duration::from_secs_f64(seconds.min(LONGEST_TIMEOUT_S))),
        };
        let device = self.shared.clone();
        let total = (seconds * 1000.0).ceil() as u64;
        let played = work::run_until(py, total, progress, AfterEnd::Waits, move |steps| {
            let mut device = locked(&device);
            let device = open(&mut device)?;
            Ok(played(device, &plan, &request, steps))
        })?;
        plain(py, &played?)
    }

    /// Records, and passes on what arrives until `heard` returns True. Returns the losses as plain objects.
    ///
    /// `heard(first_tick, samples)` gets each block: `samples` is an array of the shape (32, 5), float64, of the
    /// accelerations along x, y and z, m/s², the path since the sample before, mm, and the force, N; what is torn is
    /// NaN. Ticks are 200 µs long by the device's clock and count from its start. `told(status, asked_s)` gets the
    /// status four times per second, and the time since it was asked for, s. Both must not use this `Device`.
    fn record<'py>(&self, py: Python<'py>, heard: Py<PyAny>, told: Py<PyAny>) -> PyResult<Bound<'py, PyAny>> {
        let loss = py.detach(|| {
            let broken = |failure: LinkError| link_raised(&failure);
            let mut device = locked(&self.shared);
            let device: &Linked = open(&mut device).map_err(raised)?;
            let calibration = Calibration::new(&device.settings().map_err(broken)?, None);
            let mut stream = Stream::start(device).map_err(broken)?;
            let (mut asked, mut ends) = (Instant::now(), false);
            while !ends {
                let arrival = stream.wait().map_err(broken)?;
                let rows = arrival
                    .samples
                    .iter()
                    .zip(arrival.whole)
                    .flat_map(|(sample, is_whole)| {
                        // The encoder's step is right in a torn sample, too.
                        let known = |value| if is_whole { value } else { f64::NAN };
                        let [x, y, z] = calibration.acceleration(sample).map(known);
                        let path_mm = f64::from(sample.encoder_delta) * calibration.mm_per_count;
                        [x, y, z, path_mm, known(calibration.force(sample))]
                    });
                ends = Python::attach(|py| {
                    // While the interpreter's lock is released, Ctrl-C is only noted; here it is raised.
                    py.check_signals()?;
                    let block = table(py, rows.collect(), arrival.samples.len())?;
                    heard.bind(py).call1((arrival.first_tick, block))?.is_truthy()
                })?;
                if asked.elapsed() >= STATUS_INTERVAL {
                    asked = Instant::now();
                    let status = device.status().map_err(broken)?;
                    Python::attach(|py| {
                        let status = self.reported(py, &status)?;
                        told.call1(py, (status, asked.elapsed().as_secs_f64()))
                    })?;
                }
            }
            stream.stop().map_err(broken)
        })?;
        plain(py, &loss)
    }

    /// Stops what is played or recorded, also what another program plays, and reads that back. Returns True if
    /// anything was played.
    fn stop(&self, py: Python<'_>) -> PyResult<bool> {
        Ok(self.ask(py, Linked::stop)?.0)
    }

    /// The settings as plain objects: those of `stylus settings --json`, with value, unit and range.
    fn settings<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        let (settings, state) = self.ask(py, |device| Ok((device.settings()?, device.status()?.settings)))?;
        let rows = settings.iter().map(|change| SettingRow::new(change, &state));
        plain(py, &rows.collect::<Vec<_>>())
    }

    /// Changes settings, given by name and value in the setting's unit, all or none, and reads them back.
    ///
    /// A change that protects coil and hand less than before is refused, with what it would allow in volts and watts,
    /// unless `accept` is True.
    #[pyo3(signature = (values, *, accept = false))]
    fn change_settings(&self, py: Python<'_>, values: HashMap<String, f32>, accept: bool) -> PyResult<()> {
        let changes: Vec<SettingChange> = values
            .iter()
            .map(|(name, &value)| {
                let setting = described::named(name)?;
                Ok(SettingChange { setting, value })
            })
            .collect::<Result<_>>()
            .map_err(raised)?;
        let change = SettingsChange::of(&changes).map_err(|error| refused(error.to_string()))?;
        let told = self.ask(py, |device| {
            let (before, state) = (device.settings()?, device.status()?.settings);
            let proposal = device.propose(&change)?;
            if !proposal.loosens.is_empty() && !accept {
                let after = change.applied_to(before)?;
                let known = Known::of(&before, &state);
                let after = known.after(&change, &after);
                return Ok(Some(consequences(known, after, proposal.loosens)));
            }
            device.apply(&proposal).map(|_| None)
        })?;
        let Some(lines) = told else {
            return Ok(());
        };
        let lines: Vec<&str> = lines.iter().map(|line| line.trim()).collect();
        Err(refused(format!(
            "nothing was changed, because this loosens limits or gives them their first values: {}: give accept=True \
             if you mean it",
            lines.join("; ")
        )))
    }

    /// Closes the link. What is played goes on only as long as the device allows without a host.
    fn close(&self, py: Python<'_>) {
        // Another thread may hold the device and wait for the lock of the interpreter.
        py.detach(|| drop(locked(&self.shared).take()));
    }

    fn __enter__(slf: PyRef<'_, Self>) -> PyRef<'_, Self> {
        slf
    }

    #[pyo3(signature = (*_exception))]
    fn __exit__(&self, py: Python<'_>, _exception: &Bound<'_, pyo3::types::PyTuple>) {
        self.close(py);
    }

    fn __repr__(&self) -> String {
        format!("Device({:?}, serial {})", self.link, self.info.serial)
    }
}

/// Counts of a play, as `stylus play --json` has them.
#[derive(Serialize)]
struct Played {
    #[serde(flatten)]
    driven: host_tools::link::play::Driven,
    saturations: u32,
    mutes: u32,
    muted_share: Option<f64>,
    missed_ticks: u32,
}

/// Plays, and stops the output whatever comes.
fn played(device: &Linked, plan: &Drive, request: &PlayRequest, steps: &work::Steps) -> PyResult<Played> {
    let failed = |problem: String| refused(format!("{}: {problem}", device.address()));
    let broken = |failure: LinkError| link_raised(&failure);
    let mut heard = PlayCounts::since(&device.status().map_err(broken)?);
    device.play(request).map_err(broken)?;
    // One function that `drive` calls sets it and the other reads it, so both borrow it.
    let ended = Cell::new(false);
    let driven = drive(
        device,
        plan,
        || !ended.get() && !steps.is_ended(),
        |driven, status| {
            heard.hear(driven, status);
            steps.set_done((driven.seconds * 1000.0) as u64);
            // Only idle means stopped, because the output may still fade out of the previous play.
            ended.set(status.output.activity == Activity::Idle);
        },
    );
    let over = || failed("stopped over the stylus's other link, or by the device: Device.status says why".into());
    let is_refused = matches!(driven, Err(LinkError::Motion(MotionRefused::Held { .. })));
    // A stop now could end what another program plays over the other link since.
    if ended.get() || is_refused {
        return Err(over());
    }
    // The output is switched off after a failure, too; the first failure is the one that is reported.
    let stopped = device.stop();
    let driven = driven.map_err(broken)?;
    let (was_playing, status) = stopped.map_err(broken)?;
    if !was_playing {
        return Err(over());
    }
    if let Some(failure) = heard.failure(&driven) {
        return Err(failed(failure));
    }
    Ok(Played {
        driven,
        saturations: status.saturations,
        mutes: heard.mutes,
        muted_share: heard.muted_share(),
        missed_ticks: heard.missed_ticks,
    })
}

fn selection(texture: Option<&str>, scene: Option<&str>) -> PyResult<Selection> {
    let too_long = |what: &str, name: &str| {
        refused(format!(
            "'{name}' is longer than the name of any {what}: Device.slots lists the names"
        ))
    };
    match (texture, scene) {
        (Some(name), None) => TextureName::try_from(name)
            .map(Selection::Texture)
            .map_err(|_| too_long("texture", name)),
        (None, Some(name)) => SceneName::try_from(name)
            .map(Selection::Scene)
            .map_err(|_| too_long("scene", name)),
        _ => Err(refused("give one of texture and scene")),
    }
}

/// The device, also after work on it was ended by unwinding: a request that lost its answer is told from later ones by
/// its number.
fn locked(device: &Shared) -> MutexGuard<'_, Option<Linked>> {
    device.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The device of an open link.
fn open(device: &mut Option<Linked>) -> Result<&mut Linked> {
    let closed = || Error::Request("the link to the stylus is closed: open it again".into());
    device.as_mut().ok_or_else(closed)
}

fn address(link: &str) -> PyResult<LinkAddress> {
    link.parse()
        .map_err(|problem| refused(format!("link is '{link}': it {problem}")))
}

/// Lists the styluses and serial ports that are attached as plain objects: those of `stylus devices --json`. `link` of
/// each is what `Device` takes.
#[pyfunction]
pub fn devices(py: Python<'_>) -> PyResult<Bound<'_, PyAny>> {
    let found = py.detach(discovery::rows);
    plain(py, &found.map_err(|failure| link_raised(&failure))?)
}
