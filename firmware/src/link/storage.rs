//! The application, for both links: [`Control`] behind a lock that is never held across a wait, and [`Storage`] in a
//! task of its own, because requests that need flash may take seconds.
#![expect(
    unsafe_code,
    reason = "the only owners of the flash are created here, once"
)]

use core::cell::RefCell;

use embassy_executor::Spawner;
use embassy_sync::blocking_mutex::Mutex;
use embassy_sync::blocking_mutex::raw::ThreadModeRawMutex;
use embassy_sync::channel::Channel;
use embassy_sync::signal::Signal;
use embassy_time::{Duration, Instant, Ticker, Timer, with_timeout};
use heapless::Vec;
use model_format::link::{
    ActivateEndpoint, ActivateError, LinkId, ListEndpoint, ListRequest, ListSceneEndpoint,
    MAX_CHUNK_BYTES, ProposalToken, SelfTestEndpoint, SelfTestRequest, Settings,
    SettingsApplyEndpoint, SettingsChange, SettingsError, SettingsState, SlotId, SlotInfo,
    SlotsEndpoint, UPLOAD_WINDOW, UploadAbortEndpoint, UploadBegin, UploadBeginEndpoint,
    UploadChunk, UploadChunkEndpoint, UploadCommitEndpoint, UploadState,
};
use postcard_rpc::header::VarSeq;
use postcard_rpc::server::{Sender, WireTxErrorKind};
use static_cell::StaticCell;
use stylus_app::control::{Control, Device};
use stylus_app::player::Busy;
use stylus_app::settings::{SETTINGS_RANGE, SettingsStore};
use stylus_app::slots::SlotStore;
use stylus_app::storage::{LoadFault, Stage, Storage};

use crate::device::Hardware;
use crate::fault::heat;
use crate::flash::banks::{Bank2, SettingsFlash};
use crate::link::wire::Wire;
use crate::self_test::Measured;
use crate::tick;

static CONTROL: Mutex<ThreadModeRawMutex, RefCell<Option<Control<Hardware>>>> =
    Mutex::new(RefCell::new(None));

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

/// A request that needs the flash.
#[expect(
    clippy::large_enum_variant,
    reason = "the queue reserves a few, each for the largest"
)]
pub enum Job {
    /// `UploadBeginEndpoint`.
    UploadBegin(UploadBegin),
    /// `UploadChunkEndpoint`: offset and bytes.
    UploadChunk(u32, Vec<u8, MAX_CHUNK_BYTES>),
    /// `UploadCommitEndpoint`.
    UploadCommit,
    /// `UploadAbortEndpoint`.
    UploadAbort,
    /// `SlotsEndpoint`.
    Slots,
    /// `ListEndpoint`.
    List(ListRequest),
    /// `ListSceneEndpoint`.
    ListScene(ListRequest),
    /// `ActivateEndpoint`.
    Activate(SlotId),
    /// `SettingsApplyEndpoint`: the link, and the token.
    SettingsApply(LinkId, ProposalToken),
    /// `SelfTestEndpoint`.
    SelfTest(SelfTestRequest),
}

impl Job {
    /// A chunk of an upload; none if it is longer than [`MAX_CHUNK_BYTES`].
    pub fn chunk(offset: u32, data: &[u8]) -> Option<Self> {
        Vec::from_slice(data)
            .ok()
            .map(|data| Self::UploadChunk(offset, data))
    }
}

/// A job with the way of its answer.
struct QueuedJob {
    job: Job,
    to: Sender<Wire>,
    sequence: VarSeq,
}

/// Number of jobs that wait: those of an upload's window but the one that is done, and two of the other wire.
const QUEUED_JOBS: usize = UPLOAD_WINDOW + 1;

/// Jobs that wait. Of a host that sends the next request after the answer one waits at most.
static QUEUE: Channel<ThreadModeRawMutex, QueuedJob, QUEUED_JOBS> = Channel::new();

/// Queues `job`, to be done and answered; returns false if the queue is full.
pub fn queue(job: Job, to: Sender<Wire>, sequence: VarSeq) -> bool {
    QUEUE.try_send(QueuedJob { job, to, sequence }).is_ok()
}

type Stores = Storage<Bank2, SettingsFlash>;

#[unsafe(link_section = ".sram4.stores")]
static STORES: StaticCell<Stores> = StaticCell::new();

/// Longest wait for the newest library before the links open. It takes far less.
const LIBRARY_FIRST: Duration = Duration::from_millis(500);

static ACTIVATED: Signal<ThreadModeRawMutex, ()> = Signal::new();

/// Opens the stores, starts the tasks that poll and that serve jobs, and waits until the newest library is active, if
/// that does not take long.
pub async fn start(spawner: Spawner, hardware: Hardware) {
    // SAFETY: nothing else calls them, and this runs once.
    let (slots, settings) = unsafe { (Bank2::new(), SettingsFlash::new()) };
    let settings = SettingsStore::open(settings, SETTINGS_RANGE).await;
    let safe_mode = hardware.start_report().safe_mode;
    let control = Control::new(hardware, settings.settings(), settings.state());
    CONTROL.lock(|cell| *cell.borrow_mut() = Some(control));
    spawner.spawn(poll().unwrap());
    let stores = STORES.init(Storage::new(SlotStore::unread(slots), settings));
    spawner.spawn(serve(stores, safe_mode).unwrap());
    // A host whose request came before it would find no library.
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

/// Activates the newest library, then does the queued jobs, one after the other.
#[embassy_executor::task]
async fn serve(stores: &'static mut Stores, safe_mode: bool) -> ! {
    // What faulted may have been a slot. In safe mode the slots are read when a request needs them, so that the device
    // answers first, and a fault there ends one request and not every start.
    if !safe_mode {
        let active = stores.activate_newest(&mut ControlStage).await;
        defmt::info!("library active: {}", active.is_some());
    }
    ACTIVATED.signal(());
    loop {
        let QueuedJob { job, to, sequence } = QUEUE.receive().await;
        // The wire counts an answer that it cannot send. The host repeats its request.
        let _ = work(stores, job, &to, sequence).await;
    }
}

async fn work(
    stores: &mut Stores,
    job: Job,
    to: &Sender<Wire>,
    sequence: VarSeq,
) -> Result<(), WireTxErrorKind> {
    let stage = &mut ControlStage;
    match job {
        Job::UploadBegin(begin) => {
            let answer = stores.upload_begin(stage, begin).await;
            to.reply::<UploadBeginEndpoint>(sequence, &answer).await
        }
        Job::UploadChunk(offset, data) => {
            let answer = stores
                .upload_chunk(
                    stage,
                    UploadChunk {
                        offset,
                        data: &data,
                    },
                )
                .await;
            to.reply::<UploadChunkEndpoint>(sequence, &answer).await
        }
        Job::UploadCommit => {
            let answer = stores.upload_commit(stage).await;
            to.reply::<UploadCommitEndpoint>(sequence, &answer).await
        }
        Job::UploadAbort => {
            to.reply::<UploadAbortEndpoint>(sequence, &stores.upload_abort(stage))
                .await
        }
        Job::Slots => {
            let answer = stores.read_slots().await;
            to.reply::<SlotsEndpoint>(sequence, &answer).await
        }
        Job::List(request) => {
            let answer = stores.list(request).await;
            to.reply::<ListEndpoint>(sequence, &answer).await
        }
        Job::ListScene(request) => {
            let answer = stores.list_scene(request).await;
            to.reply::<ListSceneEndpoint>(sequence, &answer).await
        }
        Job::Activate(slot) => {
            let answer = stores.activate(stage, slot).await;
            to.reply::<ActivateEndpoint>(sequence, &answer).await
        }
        Job::SettingsApply(from, token) => {
            let answer = stores.settings_apply(stage, from, token).await;
            to.reply::<SettingsApplyEndpoint>(sequence, &answer).await
        }
        Job::SelfTest(request) => {
            let answer = stores.self_test(stage, &mut Measured, request).await;
            to.reply::<SelfTestEndpoint>(sequence, &answer).await
        }
    }
}

/// The rest of the device, as storage sees it.
struct ControlStage;

impl Stage for ControlStage {
    fn begin_activation(&mut self) -> Result<(), ActivateError> {
        with_control(Control::begin_activation)
    }

    fn may_exchange(&self) -> bool {
        with_control(|control| control.may_exchange())
    }

    fn begin_load(&mut self) {
        with_control(|control| control.device().begin_load());
    }

    fn load(&mut self, library: &[u8]) -> Result<bool, LoadFault> {
        with_control(|control| control.device().load(library))
    }

    fn end_activation(&mut self, active: Option<(SlotId, SlotInfo)>) {
        with_control(|control| control.end_activation(active));
    }

    fn take_proposal(
        &mut self,
        from: LinkId,
        token: ProposalToken,
    ) -> Result<SettingsChange, SettingsError> {
        with_control(|control| control.take_proposal(from, token))
    }

    fn begin_configuration(&mut self) -> Result<(), SettingsError> {
        with_control(Control::begin_configuration)
    }

    fn end_configuration(&mut self, settings: Settings, state: SettingsState) {
        with_control(|control| control.end_configuration(settings, state));
    }

    fn is_supply_low(&self) -> bool {
        with_control(|control| control.is_supply_low())
    }

    fn begin_self_test(&mut self) -> Result<(), Busy> {
        with_control(Control::begin_self_test)
    }

    fn end_self_test(&mut self) {
        with_control(Control::end_self_test);
    }

    fn set_upload(&mut self, upload: UploadState) {
        with_control(|control| control.set_upload(upload));
    }

    fn now_us(&self) -> u64 {
        Instant::now().as_micros()
    }

    async fn pause(&mut self) {
        Timer::after_millis(1).await;
    }
}
