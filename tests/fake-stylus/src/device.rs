//! The application on fake hardware, in virtual time. [`Control`] is behind a lock that is never held across a wait,
//! and [`Storage`] works next to it, as `firmware/src/link/storage.rs` arranges them.

use std::cell::{Cell, RefCell, RefMut};
use std::ops::Deref;
use std::pin::pin;
use std::rc::Rc;
use std::task::{Context, Poll, Waker};

use embassy_futures::yield_now;
use model_format::link::{
    ActivateError, Activated, ChipValues, ClockValues, EncoderValues, ErrorCorrectionValues, LinkId, MAX_CHUNK_BYTES,
    MAX_COIL_POWER_WATT, MotionSample, MotionSource, OUTPUT_CODES, OptionByteValues, OutputValues, PlayError,
    PlayRequest, Playing, RESPONSE_BANDS, RecordBlock, Response, RestValues, Sections, Selection, SelfTestError,
    Setting, SettingChange, Settings, SettingsChange, SettingsError, SlotId, Status, UploadCommitted, UploadError,
    output_code,
};
use model_format::scene::Biquad;
use model_format::{DacCode, MillimetresPerSecond, Newton};
use stylus_app::control::{Control, Device};
use stylus_app::self_test::SelfTestHardware;
use stylus_app::settings::SettingsStore;
use stylus_app::slots::SlotStore;
use stylus_app::storage::{Stage, Storage};
use stylus_app::{SAMPLE_RATE_HZ, TICKS_PER_MS};

use crate::actuator::Actuator;
use crate::board::Board;
use crate::flash::{Memory, SECTOR_BYTES, SimulatedFlash};
use crate::hardware::Hardware;
use crate::library::{announcement, chunks};

/// Flash of the fake device.
pub type Flash = SimulatedFlash<'static>;

/// Slots and settings of the fake device.
pub type Stores = Storage<Flash, Flash>;

/// Settings of the coil, as the owner of the test's coil has measured them.
pub const COIL: [SettingChange; 3] = [
    change(Setting::CoilResistance, 8.0),
    change(Setting::AmplifierGain, 1.0),
    change(Setting::PowerLimit, 0.1),
];

/// A setting with a new value.
pub const fn change(setting: Setting, value: f32) -> SettingChange {
    SettingChange { setting, value }
}

/// The default settings with other values for some of them.
/// Panics if a setting may not have its value.
pub fn settings_with(values: &[(Setting, f32)]) -> Settings {
    values.iter().fold(Settings::default(), |settings, &(of, value)| {
        settings.with(change(of, value)).expect("in range")
    })
}

/// A response that a device with `settings` accepts. Its equaliser inverts the signal and halves it.
pub fn response_for(settings: &Settings) -> Response {
    let half = Biquad::from_f64([-0.5, 0.0, 0.0], [0.0, 0.0]).expect("in range");
    let sections = Sections::new(&[half]).expect("one is not too many");
    Response {
        sections_5khz: sections,
        sections_10khz: sections,
        measured_at: 1_700_000_000,
        worst_db: 1.5,
        rms_db: 0.5,
        resonance_hz: 80.0,
        damping_ratio: 0.2,
        delay_us: 412.5,
        axis: [0.0, 0.6, 0.8],
        level_m_s2_per_volt: 20.0,
        bands_centi_db: [2_600; RESPONSE_BANDS],
        trusted_bands: (1 << RESPONSE_BANDS) - 1,
        output_gain: 0.05,
        amplifier_gain: settings.get(Setting::AmplifierGain),
        coil_resistance: settings.get(Setting::CoilResistance),
        hard_limit: settings.get(Setting::HardLimit),
    }
}

/// A motion of 100 mm/s and 1 N from a host that sends no position.
pub const MOTION: MotionSample = MotionSample {
    speed: MillimetresPerSecond(100.0),
    force: Newton(1.0),
    position_mm: None,
    contact: None,
};

/// Number of waits after which a job of the storage counts as stuck: one hour, if the device runs 1 ms in each.
const JOB_LIMIT_MS: u32 = 3_600_000;

/// The application's [`Control`], shared by all parts that serve the device in one thread.
#[derive(Clone)]
pub struct SharedControl {
    control: Rc<RefCell<Control<Hardware>>>,
    /// Tick at which the storage continues, while it waits for time to pass.
    wakes_at: Rc<Cell<Option<u64>>>,
}

impl Deref for SharedControl {
    type Target = RefCell<Control<Hardware>>;

    fn deref(&self) -> &Self::Target {
        &self.control
    }
}

impl SharedControl {
    fn new(control: Control<Hardware>) -> Self {
        Self {
            control: Rc::new(RefCell::new(control)),
            wakes_at: Rc::default(),
        }
    }

    /// Returns true while the storage waits for time to pass, like for a timer.
    pub fn is_storage_waiting(&self) -> bool {
        self.wakes_at
            .get()
            .is_some_and(|at| self.borrow_mut().device().now() < at)
    }

    /// Runs the device for one millisecond, and then polls it. Returns the blocks that were recorded, each with its
    /// link; they are taken from the queue even when nobody records, because the queue would fill otherwise.
    pub fn millisecond(&self) -> Vec<(LinkId, RecordBlock)> {
        let mut control = self.borrow_mut();
        for _ in 0..TICKS_PER_MS {
            control.device().tick();
        }
        control.poll();
        std::iter::from_fn(|| control.next_block()).collect()
    }

    /// Runs the device for one millisecond, at the beginning of which a host sends [`MOTION`].
    pub fn millisecond_with_motion(&self) {
        let mut control = self.borrow_mut();
        control.keep_alive(LinkId::Serial);
        // The motion is refused while the other link plays.
        let _ = control.motion(LinkId::Serial, MOTION);
        drop(control);
        self.millisecond();
    }
}

impl Stage for SharedControl {
    type Device = Hardware;

    fn with_control<R>(&self, what: impl FnOnce(&mut Control<Hardware>) -> R) -> R {
        what(&mut self.borrow_mut())
    }

    fn now_us(&self) -> u64 {
        self.borrow_mut().device().now() * 1_000 / u64::from(TICKS_PER_MS)
    }

    /// Waits until the device has run for a millisecond. Another task must run it.
    async fn pause(&mut self) {
        let now = || self.borrow_mut().device().now();
        let end = now() + u64::from(TICKS_PER_MS);
        self.wakes_at.set(Some(end));
        while now() < end {
            yield_now().await;
        }
        self.wakes_at.set(None);
    }
}

/// A request to play the texture `texture`, with the motion of the host.
pub fn play_request(texture: &str) -> PlayRequest {
    PlayRequest {
        selection: Selection::Texture(texture.try_into().expect("it is short")),
        gain: 1.0,
        motion: MotionSource::Host,
        seed: 7,
    }
}

/// A whole device that a test steps by hand.
///
/// ```
/// use fake_stylus::device::{SteppedStylus, play_request};
/// use fake_stylus::library;
///
/// let mut stylus = SteppedStylus::boot();
/// stylus.set_coil();
/// let slot = stylus.upload(&library::library(1, 4, 1))?.slot;
/// stylus.activate(slot).expect("it is valid");
/// stylus.play(play_request("texture 0")).expect("it is there");
/// stylus.run(300);
/// assert!(stylus.sounds());
/// # Ok::<(), model_format::link::UploadError>(())
/// ```
pub struct SteppedStylus {
    /// Requests that are answered at once.
    pub control: SharedControl,
    /// Requests that read, erase or write flash.
    pub storage: Stores,
}

impl SteppedStylus {
    /// Boots on blank flash.
    pub fn boot() -> Self {
        Self::boot_from(SimulatedFlash::two_slots())
    }

    /// Boots on `slots`, with settings that were never written.
    pub fn boot_from(slots: Flash) -> Self {
        Self::boot_from_on(slots, Hardware::new())
    }

    /// Boots on `slots` and on `hardware`, with settings that were never written. The hardware's start may have been in
    /// safe mode.
    pub fn boot_from_on(slots: Flash, hardware: Hardware) -> Self {
        let flash = SimulatedFlash::new(Memory::blank(2 * SECTOR_BYTES));
        Self::boot_as(slots, flash, hardware)
    }

    /// Boots on `slots`, on the settings in `flash` (two sectors), and on `hardware`. As in the image, the settings are
    /// read first. In safe mode no library is activated.
    pub fn boot_as(slots: Flash, flash: Flash, hardware: Hardware) -> Self {
        let safe_mode = hardware.start.safe_mode;
        let range = 0..2 * SECTOR_BYTES as u32;
        let settings = embassy_futures::block_on(SettingsStore::open(flash, range));
        let control = Control::new(hardware, settings.settings(), settings.state(), settings.response());
        let mut stylus = Self {
            control: SharedControl::new(control),
            storage: Storage::new(SlotStore::unread(slots), settings),
        };
        if !safe_mode {
            stylus.request(async |storage, stage| storage.activate_newest(stage).await);
        }
        stylus
    }

    /// Returns a device that can play. Requests have set its coil and made `library` active.
    pub fn ready(library: &[u8]) -> Self {
        let mut stylus = Self::boot();
        stylus.set_coil();
        let committed = stylus.upload(library).expect("it is valid");
        stylus.activate(committed.slot).expect("it is valid");
        stylus
    }

    /// Uploads a library, or the rest of one whose upload has begun, like a host.
    pub fn upload(&mut self, bytes: &[u8]) -> Result<UploadCommitted, UploadError> {
        self.request(async |storage, stage| {
            let begun = storage.upload_begin(stage, announcement(bytes)).await?;
            for chunk in chunks(bytes, begun.next_offset as usize, MAX_CHUNK_BYTES) {
                storage.upload_chunk(stage, chunk).await?;
            }
            storage.upload_commit(stage).await
        })
    }

    /// Activates the library in `slot`.
    pub fn activate(&mut self, slot: SlotId) -> Result<Activated, ActivateError> {
        self.request(async |storage, stage| storage.activate(stage, slot).await)
    }

    /// Plays `request` for the host on the serial port.
    pub fn play(&self, request: PlayRequest) -> Result<Playing, PlayError> {
        self.control.borrow_mut().play(LinkId::Serial, request)
    }

    /// The device's status.
    pub fn status(&self) -> Status {
        self.control.borrow().status()
    }

    /// The hardware.
    pub fn hardware(&self) -> RefMut<'_, Hardware> {
        RefMut::map(self.control.borrow_mut(), Control::device)
    }

    /// Sets the settings that playing requires, by requests, like the owner of the coil.
    pub fn set_coil(&mut self) {
        let [one, two, three] = COIL;
        self.change_settings(&[one, two, three, change(Setting::EnableWired, 1.0)])
            .expect("they are in range, and nothing is played");
    }

    /// Connects `actuator` to the output, and sets what its owner knows of its coil and amplifier.
    pub fn set_actuator(&mut self, actuator: Actuator) {
        let (coil, amplifier) = (actuator.parameters.coil, actuator.parameters.amplifier);
        self.hardware().actuator = Some(actuator);
        self.change_settings(&[
            change(Setting::CoilResistance, coil.resistance_ohm as f32),
            change(Setting::AmplifierGain, amplifier.gain as f32),
            change(Setting::PowerLimit, (coil.rated_watts as f32).min(MAX_COIL_POWER_WATT)),
            change(Setting::EnableWired, 1.0),
        ])
        .expect("they are in range, and nothing is played");
    }

    /// Proposes new values of settings and applies them, like a host.
    pub fn change_settings(&mut self, values: &[SettingChange]) -> Result<Settings, SettingsError> {
        self.propose_and_apply(SettingsChange::of(values)?)
    }

    /// Proposes a reset of the settings and applies it, like a host.
    pub fn reset_settings(&mut self) -> Result<Settings, SettingsError> {
        self.propose_and_apply(SettingsChange::Reset)
    }

    fn propose_and_apply(&mut self, change: SettingsChange) -> Result<Settings, SettingsError> {
        let link = LinkId::Serial;
        let token = self.control.borrow_mut().propose(link, change)?.token;
        self.request(async |storage, stage| storage.settings_apply(stage, link, token).await)
    }

    /// Runs the device for `ms` milliseconds. In each, a host keeps its link alive and sends a motion.
    pub fn run(&self, ms: u32) {
        for _ in 0..ms {
            self.control.millisecond_with_motion();
        }
    }

    /// Does a job of the storage. Whenever the job waits, the device runs for a millisecond with motion from a host.
    pub fn request<R>(&mut self, job: impl AsyncFnOnce(&mut Stores, &mut SharedControl) -> R) -> R {
        self.request_meanwhile(job, SharedControl::millisecond_with_motion)
    }

    /// Does a job of the storage. Whenever the job waits, `meanwhile` is called; it has to run the device.
    pub fn request_meanwhile<R>(
        &mut self,
        job: impl AsyncFnOnce(&mut Stores, &mut SharedControl) -> R,
        mut meanwhile: impl FnMut(&SharedControl),
    ) -> R {
        let mut stage = self.control.clone();
        let mut job = pin!(job(&mut self.storage, &mut stage));
        // Nothing wakes the job: it is polled again after each call of `meanwhile`.
        let mut context = Context::from_waker(Waker::noop());
        for _ in 0..JOB_LIMIT_MS {
            if let Poll::Ready(result) = job.as_mut().poll(&mut context) {
                return result;
            }
            meanwhile(&self.control);
        }
        panic!("a job of the storage has not ended within {JOB_LIMIT_MS} ms");
    }

    /// True while the output is not at rest.
    pub fn sounds(&self) -> bool {
        self.control.borrow_mut().device().sounds()
    }
}

/// The board of a device, with its clock.
pub struct BoardOf {
    control: SharedControl,
    /// Time that operations of the flash have taken, µs.
    flash_us: Cell<u32>,
}

impl BoardOf {
    /// Returns the board of the device that `control` controls.
    pub fn new(control: SharedControl) -> Self {
        Self {
            control,
            flash_us: Cell::new(0),
        }
    }

    fn board(&self) -> Board {
        self.control.borrow_mut().device().board.clone()
    }
}

impl SelfTestHardware for BoardOf {
    fn chip(&self) -> ChipValues {
        self.board().chip
    }

    fn option_bytes(&self) -> OptionByteValues {
        self.board().option_bytes
    }

    fn error_correction(&self) -> ErrorCorrectionValues {
        self.board().error_correction
    }

    fn encoder(&self) -> EncoderValues {
        let stuck = self.board().stuck_line;
        let count = self.control.borrow_mut().device().encoder_count();
        // A Gray code of two lines: one of them changes at each count.
        let half = count >> 1;
        EncoderValues {
            count,
            levels: [stuck.unwrap_or((count ^ half) & 1 != 0), half & 1 != 0],
        }
    }

    async fn clocks(&mut self) -> ClockValues {
        self.board().clocks
    }

    async fn output(&mut self) -> Result<OutputValues, SelfTestError> {
        let codes = (0..OUTPUT_CODES)
            .map(output_code)
            .filter(|&code| code != DacCode::MID_SCALE.get());
        self.control.borrow_mut().device().test_codes += codes.count();
        self.board().output
    }

    async fn rest(&mut self) -> Result<RestValues, SelfTestError> {
        self.board().rest
    }

    /// Every call counts as one operation of the flash, because each reading precedes or follows an operation.
    fn now_us(&self) -> u32 {
        let before = self.flash_us.get();
        self.flash_us.set(before.wrapping_add(self.board().flash_us));
        let ticks = self.control.borrow_mut().device().now();
        before.wrapping_add(ticks as u32 * (1_000_000 / SAMPLE_RATE_HZ))
    }
}
