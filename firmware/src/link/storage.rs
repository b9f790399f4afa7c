//! The application, for both links: [`Control`] behind a lock that is never held across a wait, and [`Storage`] in its
//! own task, because requests that need flash may take seconds.
#![expect(unsafe_code, reason = "the only owners of the flash are created here, once")]

use core::cell::RefCell;

use cortex_m::peripheral::SCB;
use embassy_executor::Spawner;
use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::ThreadModeRawMutex;
use embassy_sync::channel::Channel;
use embassy_sync::signal::Signal;
use embassy_time::{Duration, Instant, Ticker, Timer, with_timeout};
use model_format::link::ImageVersion;
use static_cell::{ConstStaticCell, StaticCell};
use stylus_app::control::{Control, Device};
use stylus_app::requests::{Frame, QUEUED_JOBS, QueuedJob, work};
use stylus_app::settings::{SETTINGS_RANGE, SettingsStore};
use stylus_app::slots::SlotStore;
use stylus_app::storage::{Stage, Storage};
use stylus_app::update::{Running, Updates};
use stylus_boot::map::{self, RECORDS};
use stylus_boot::record;

use crate::device::{Hardware, NAME};
use crate::fault::heat;
use crate::flash::banks::{Bank1, Bank2};
use crate::flash::errors::read_word;
use crate::link::wire::Wire;
use crate::self_test::BoardHardware;
use crate::tick;

static CONTROL: Mutex<ThreadModeRawMutex, RefCell<Option<Control<Hardware>>>> = Mutex::new(RefCell::new(None));

/// Calls `what` with the device's control, which never waits. It exists once [`start`] has returned.
pub fn with_control<R>(what: impl FnOnce(&mut Control<Hardware>) -> R) -> R {
    CONTROL.lock(|control| {
        if let Some(control) = control.borrow_mut().as_mut() {
            what(control)
        } else {
            defmt::unreachable!("links and polls begin after storage::start")
        }
    })
}

/// Jobs that wait. If a host sends its next request only after the answer, at most one of its jobs waits.
pub static QUEUE: Channel<ThreadModeRawMutex, QueuedJob, QUEUED_JOBS> = Channel::new();

type Stores = Storage<Bank2, Bank1>;

#[unsafe(link_section = ".sram4.stores")]
static STORES: StaticCell<Stores> = StaticCell::new();

/// Longest wait for the newest library before the links open. The library needs far less time.
const LIBRARY_FIRST: Duration = Duration::from_millis(500);

/// Interval between two checks for the end of a trial of a new image.
const TRIAL_POLL: Duration = Duration::from_secs(1);

/// Time for the last answer to be sent, and for the output to reach mid-scale.
const RESTART_AFTER: Duration = Duration::from_millis(100);

/// Key that an update must be signed with; `build.rs` writes it.
const KEY: [u8; 32] = include!(concat!(env!("OUT_DIR"), "/key.rs"));

static ACTIVATED: Signal<ThreadModeRawMutex, ()> = Signal::new();

/// Opens the stores, starts the tasks that poll and that serve jobs, and waits until the newest library is active, if
/// that does not take long.
pub async fn start(spawner: Spawner, hardware: Hardware, takes_unsigned: bool) {
    // SAFETY: nothing else calls these functions, and this runs once. The ranges lie behind the code.
    let (slots, settings, records) = unsafe { (Bank2::new(), Bank1::new(SETTINGS_RANGE), Bank1::new(RECORDS)) };
    let settings = SettingsStore::unread(settings, SETTINGS_RANGE);
    let mut records = record::Store::open(records, RECORDS).await;
    // A record that cannot be written now is tried again at the next start.
    let _ = records.settle().await;
    let stores = STORES.init(Storage::new(SlotStore::unread(slots), settings));
    if let Some(running) = running(takes_unsigned) {
        stores.set_updates(Updates::new(records, running));
    }
    let settings = stores.read_settings().await;
    let safe_mode = hardware.start_report().safe_mode;
    let (values, state) = (settings.settings(), settings.state());
    let control = Control::new(hardware, values, state, settings.response());
    CONTROL.lock(|cell| *cell.borrow_mut() = Some(control));
    spawner.spawn(poll().unwrap());
    spawner.spawn(serve(stores, safe_mode).unwrap());
    // A host whose request came before the library is active would find no library.
    let _ = with_timeout(LIBRARY_FIRST, ACTIVATED.wait()).await;
}

/// Polls the control, and keeps the coil's heat for the next start, every millisecond.
#[embassy_executor::task]
async fn poll() -> ! {
    let mut ticker = Ticker::every(Duration::from_millis(1));
    loop {
        with_control(Control::poll);
        if let Some(heat) = tick::heat() {
            heat::keep(heat);
        }
        ticker.next().await;
    }
}

/// Activates the newest library, then does the queued jobs one after another.
#[embassy_executor::task]
async fn serve(stores: &'static mut Stores, safe_mode: bool) -> ! {
    static ANSWER: ConstStaticCell<Frame> = ConstStaticCell::new([0; _]);
    // A slot may have caused the fault. In safe mode the slots are read when a request needs them, so that the device
    // answers first, and a fault there ends one request and not every start.
    if !safe_mode {
        let active = stores.activate_newest(&mut ControlStage).await;
        defmt::info!("library active: {}", active.is_some());
    }
    ACTIVATED.signal(());
    let answer = ANSWER.take();
    loop {
        stores.end_trial(&mut ControlStage).await;
        if stores.wants_restart() {
            restart().await;
        }
        // The wait ends regularly, to check for the end of a trial.
        let Ok(job) = with_timeout(TRIAL_POLL, QUEUE.receive()).await else {
            continue;
        };
        let wire = Wire::of(job.from);
        let length = work(stores, &mut ControlStage, &mut BoardHardware, job, answer).await;
        if let Some(length) = length {
            // The wire counts an answer that it cannot send. The host repeats its request.
            wire.send(&answer[..length]).await;
        }
    }
}

/// Returns the running image and the key that it trusts; none without a bootloader, for example if a debug probe has
/// started only the image.
fn running(takes_unsigned: bool) -> Option<Running> {
    let word = read_word(map::FLASH + map::BOOTLOADER_VERSION)?;
    let [magic, numbers @ ..] = word.first_chunk::<16>()?.as_chunks::<4>().0 else {
        return None;
    };
    (u32::from_le_bytes(*magic) == map::VERSION_MAGIC).then_some(Running {
        board: NAME,
        image: ImageVersion::read(env!("CARGO_PKG_VERSION")).unwrap_or_default(),
        bootloader: ImageVersion::new(core::array::from_fn(|index| u32::from_le_bytes(numbers[index]) as u16)),
        key: KEY,
        takes_unsigned,
    })
}

/// Restarts with the amplifier off, once the answer has been sent.
async fn restart() -> ! {
    with_control(|control| control.device().set_amplifier(false));
    Timer::after(RESTART_AFTER).await;
    SCB::sys_reset()
}

/// The rest of the device, as requests and storage see it.
pub struct ControlStage;

impl Stage for ControlStage {
    type Device = Hardware;

    fn with_control<R>(&self, what: impl FnOnce(&mut Control<Hardware>) -> R) -> R {
        with_control(what)
    }

    fn now_us(&self) -> u64 {
        Instant::now().as_micros()
    }

    async fn pause(&mut self) {
        Timer::after_millis(1).await;
    }
}
