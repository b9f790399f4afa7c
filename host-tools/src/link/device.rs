//! One device, each of its requests a function that waits for the answer, but not for ever.

use std::sync::Arc;
use std::thread;
use std::time::{Duration, Instant};

use model_format::link::{
    ANSWER_TIMEOUT_MS, ActivateEndpoint, Activated, Activity, DeviceInfo, FLASH_TIMEOUT_MS,
    InfoEndpoint, KeepAliveTopic, ListEndpoint, ListRequest, ListSceneEndpoint, MotionEndpoint,
    MotionSample, MotionSource, MotionTopic, OutputStatus, PlayEndpoint, PlayRequest, Playing,
    RecordBlock, RecordBlockTopic, RecordStartEndpoint, RecordStarted, RecordStopEndpoint,
    RecordStopped, SceneInfo, SettingChange, Settings, SettingsGetEndpoint, SettingsResetEndpoint,
    SettingsSetEndpoint, SlotId, SlotState, Slots, SlotsEndpoint, Status, StatusEndpoint,
    StopEndpoint, StopError, TextureInfo, UploadAbortEndpoint, UploadBegin, UploadBeginEndpoint,
    UploadChunk, UploadChunkEndpoint, UploadCommitEndpoint, UploadCommitted, UploadProgress,
    UploadProgressEndpoint, UploadState,
};
use postcard_rpc::host_client::{HostErr, MultiSubRxError, MultiSubscription};
use postcard_rpc::standard_icd::WireError;
use postcard_rpc::{Endpoint, Topic};
use postcard_schema::Schema;
use serde::{Serialize, de::DeserializeOwned};
use tokio::runtime::Runtime;

use super::error::{LinkError, Result};
use super::open::{self, Client};
use super::wire::Health;
use super::{LinkAddress, Mismatch};

/// How often a broken link is tried again.
const RECONNECT_INTERVAL: Duration = Duration::from_millis(250);

/// How often a device whose flash is busy is asked again.
const BUSY_INTERVAL: Duration = Duration::from_millis(50);

/// How often the status is read while something is waited for.
const POLL_INTERVAL: Duration = Duration::from_millis(10);

/// Blocks of a recording that may wait: half a minute.
const WAITING_BLOCKS: usize = 4096;

/// How long to wait for answers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Patience {
    /// For an answer that takes no flash.
    pub answer: Duration,
    /// For an answer that erases or writes flash.
    pub flash: Duration,
    /// For a broken link to come back.
    pub reconnect: Duration,
}

impl Default for Patience {
    fn default() -> Self {
        Self {
            answer: Duration::from_millis(ANSWER_TIMEOUT_MS.into()),
            flash: Duration::from_millis(FLASH_TIMEOUT_MS.into()),
            reconnect: Duration::from_secs(10),
        }
    }
}

impl Patience {
    /// With `answer` for an answer, and the rest in the proportion of the default.
    pub fn scaled_to(answer: Duration) -> Self {
        let default = Self::default();
        let factor = answer.as_secs_f64() / default.answer.as_secs_f64();
        Self {
            answer,
            flash: default.flash.mul_f64(factor),
            reconnect: default.reconnect.mul_f64(factor),
        }
    }
}

/// What asks, for tasks beside the one that owns the device.
#[derive(Clone)]
pub(super) struct Asker {
    client: Client,
    health: Arc<Health>,
    link: Arc<str>,
    patience: Patience,
}

impl Asker {
    async fn ask<E>(
        &self,
        what: &'static str,
        patience: Duration,
        request: &E::Request,
    ) -> Result<E::Response>
    where
        E: Endpoint,
        E::Request: Serialize + Schema,
        E::Response: DeserializeOwned + Schema,
    {
        let link = || self.link.to_string();
        let answer = tokio::time::timeout(patience, self.client.send_resp::<E>(request)).await;
        match answer {
            Ok(Ok(response)) => Ok(response),
            Ok(Err(HostErr::Closed)) => Err(self.lost()),
            Ok(Err(HostErr::Wire(error))) => Err(LinkError::Frame {
                link: link(),
                request: what,
                error,
            }),
            Ok(Err(HostErr::BadResponse | HostErr::Postcard(_))) => Err(LinkError::Answer {
                link: link(),
                request: what,
            }),
            Err(_) => Err(LinkError::NoAnswer {
                link: link(),
                request: what,
                after: patience,
            }),
        }
    }

    async fn tell<T>(&self, message: &T::Message) -> Result<()>
    where
        T: Topic,
        T::Message: Serialize,
    {
        // A topic has no answer to match.
        let sent = self.client.publish::<T>(0u16.into(), message);
        match tokio::time::timeout(self.patience.answer, sent).await {
            Ok(Ok(())) => Ok(()),
            Ok(Err(_)) => Err(self.lost()),
            Err(_) => Err(LinkError::NoAnswer {
                link: self.link.to_string(),
                request: "what is sent to it",
                after: self.patience.answer,
            }),
        }
    }

    fn lost(&self) -> LinkError {
        LinkError::Lost {
            link: self.link.to_string(),
            reason: self.health.why_ended().to_owned(),
        }
    }

    /// Everything that the device counts.
    pub(super) async fn status(&self) -> Result<Status> {
        self.ask::<StatusEndpoint>("the status", self.patience.answer, &())
            .await
    }

    /// Gives a motion and waits for its acknowledgement.
    pub(super) async fn motion(&self, sample: MotionSample) -> Result<MotionSource> {
        let answer = self.ask::<MotionEndpoint>("a motion", self.patience.answer, &sample);
        Ok(answer.await??)
    }
}

/// A stylus at the other end of a link.
pub struct Device {
    // Dropped first, which ends the tasks that use the runtime.
    asker: Asker,
    address: LinkAddress,
    info: DeviceInfo,
    runtime: Option<Runtime>,
}

impl Device {
    /// Opens the link and asks the device what it is.
    ///
    /// # Errors
    /// A link that cannot be opened, a device that does not answer or speaks another protocol.
    pub fn connect(address: &LinkAddress, patience: Patience) -> Result<Self> {
        let runtime = tokio::runtime::Builder::new_multi_thread()
            .worker_threads(1)
            .thread_name("stylus-link")
            .enable_all()
            .build()
            .map_err(LinkError::Host)?;
        let (asker, info) = runtime.block_on(Self::greet(address, patience))?;
        Ok(Self {
            asker,
            address: address.clone(),
            info,
            runtime: Some(runtime),
        })
    }

    async fn greet(address: &LinkAddress, patience: Patience) -> Result<(Asker, DeviceInfo)> {
        let health = Arc::new(Health::default());
        let asker = Asker {
            client: open::open(address, &health).await?,
            health,
            link: address.to_string().into(),
            patience,
        };
        let info = asker
            .ask::<InfoEndpoint>("who it is", patience.answer, &())
            .await
            .inspect_err(|_| asker.client.close())?;
        match Mismatch::of_protocol(&info) {
            None => Ok((asker, info)),
            Some(mismatch) => {
                asker.client.close();
                Err(LinkError::Version {
                    link: address.to_string(),
                    mismatch,
                })
            }
        }
    }

    /// Opens the link anew, trying until it is there again or patience ends.
    ///
    /// # Errors
    /// Why the last try failed, and that another device answers.
    pub fn reconnect(&mut self) -> Result<()> {
        self.asker.client.close();
        let patience = self.asker.patience;
        let begin = Instant::now();
        loop {
            match self
                .runtime()
                .block_on(Self::greet(&self.address, patience))
            {
                Ok((asker, info)) if info.serial == self.info.serial => {
                    (self.asker, self.info) = (asker, info);
                    return Ok(());
                }
                Ok((asker, info)) => {
                    asker.client.close();
                    return Err(self.not_verified(format!(
                        "another device answers (serial number {} instead of {}): begin again",
                        info.serial, self.info.serial
                    )));
                }
                Err(failure @ LinkError::Version { .. }) => return Err(failure),
                Err(failure) if begin.elapsed() >= patience.reconnect => return Err(failure),
                Err(_) => thread::sleep(RECONNECT_INTERVAL),
            }
        }
    }

    fn runtime(&self) -> &Runtime {
        self.runtime.as_ref().expect("it lives until the drop")
    }

    fn ask<E>(
        &self,
        what: &'static str,
        patience: Duration,
        request: &E::Request,
    ) -> Result<E::Response>
    where
        E: Endpoint,
        E::Request: Serialize + Schema,
        E::Response: DeserializeOwned + Schema,
    {
        self.runtime()
            .block_on(self.asker.ask::<E>(what, patience, request))
    }

    /// An answer that takes no flash.
    fn quick<E>(&self, what: &'static str, request: &E::Request) -> Result<E::Response>
    where
        E: Endpoint,
        E::Request: Serialize + Schema,
        E::Response: DeserializeOwned + Schema,
    {
        self.ask::<E>(what, self.asker.patience.answer, request)
    }

    /// An answer that may erase or write flash; a device whose flash is busy with an earlier request is asked again.
    fn slow<E>(&self, what: &'static str, request: &E::Request) -> Result<E::Response>
    where
        E: Endpoint,
        E::Request: Serialize + Schema,
        E::Response: DeserializeOwned + Schema,
    {
        let patience = self.asker.patience.flash;
        let begin = Instant::now();
        loop {
            match self.ask::<E>(what, patience, request) {
                Err(LinkError::Frame {
                    error: WireError::FailedToSpawn,
                    ..
                }) if begin.elapsed() < patience => thread::sleep(BUSY_INTERVAL),
                answer => return answer,
            }
        }
    }

    /// That the device says something else than it was told.
    pub(super) fn not_verified(&self, what: String) -> LinkError {
        LinkError::NotVerified {
            link: self.address.to_string(),
            what,
        }
    }

    /// What asks beside this, and the runtime for it.
    pub(super) fn beside(&self) -> (Asker, tokio::runtime::Handle) {
        (self.asker.clone(), self.runtime().handle().clone())
    }

    /// Where the device is.
    pub fn address(&self) -> &LinkAddress {
        &self.address
    }

    /// What the device said it is when the link was opened.
    pub fn info(&self) -> &DeviceInfo {
        &self.info
    }

    /// How long answers are waited for.
    pub fn patience(&self) -> Patience {
        self.asker.patience
    }

    /// Frames that arrived and could not be decoded since the link was opened.
    pub fn broken_frames(&self) -> u64 {
        self.asker.health.broken_frames()
    }

    /// That the device plays libraries of the format that this program writes.
    ///
    /// # Errors
    /// Which side is the older one, if it does not.
    pub fn check_library_format(&self) -> Result<()> {
        match Mismatch::of_library_format(&self.info) {
            None => Ok(()),
            Some(mismatch) => Err(LinkError::Version {
                link: self.address.to_string(),
                mismatch,
            }),
        }
    }

    /// Everything that the device counts.
    ///
    /// # Errors
    /// A link that broke or an answer that did not come.
    pub fn status(&self) -> Result<Status> {
        self.runtime().block_on(self.asker.status())
    }

    /// What is in both slots.
    ///
    /// # Errors
    /// A link that broke or an answer that did not come.
    pub fn slots(&self) -> Result<Slots> {
        // A slot may have to be read and checked as a whole.
        self.slow::<SlotsEndpoint>("its slots", &())
    }

    /// The textures in `slot`, none if it holds no library.
    ///
    /// # Errors
    /// A link that broke, an answer that did not come, a texture that the device cannot list.
    pub fn textures(&self, slot: SlotId) -> Result<Vec<TextureInfo>> {
        let count = match &self.slots()?.slots[slot.index()] {
            SlotState::Valid(library) => library.textures,
            _ => 0,
        };
        (0..count)
            .map(|index| {
                let request = ListRequest { slot, index };
                Ok(self.slow::<ListEndpoint>("a texture", &request)??)
            })
            .collect()
    }

    /// The scenes in `slot`, none if it holds no library.
    ///
    /// # Errors
    /// A link that broke, an answer that did not come, a scene that the device cannot list.
    pub fn scenes(&self, slot: SlotId) -> Result<Vec<SceneInfo>> {
        let count = match &self.slots()?.slots[slot.index()] {
            SlotState::Valid(library) => library.scenes,
            _ => 0,
        };
        (0..count)
            .map(|index| {
                let request = ListRequest { slot, index };
                Ok(self.slow::<ListSceneEndpoint>("a scene", &request)??)
            })
            .collect()
    }

    /// Makes the library in `slot` the one that is played, and reads back that it is.
    ///
    /// # Errors
    /// A refusal, or a status that tells otherwise.
    pub fn activate(&self, slot: SlotId) -> Result<Activated> {
        let activated = self.slow::<ActivateEndpoint>("an activation", &slot)??;
        let begin = Instant::now();
        loop {
            let status = self.status()?;
            let crc32 = activated.library.crc32;
            if status.active == Some(slot) && status.library_crc32 == crc32 {
                return Ok(activated);
            }
            if begin.elapsed() >= self.asker.patience.answer {
                return Err(self.not_verified(format!(
                    "slot {slot} was activated, but the status says {}: activate again",
                    status
                        .active
                        .map_or("none".to_owned(), |slot| format!("slot {slot}"))
                )));
            }
            thread::sleep(POLL_INTERVAL);
        }
    }

    /// Plays a texture or scene of the active library.
    ///
    /// # Errors
    /// A refusal; what was played before goes on then.
    pub fn play(&self, request: &PlayRequest) -> Result<Playing> {
        let playing = self.quick::<PlayEndpoint>("what to play", request)??;
        if playing.request == *request {
            Ok(playing)
        } else {
            Err(self.not_verified(format!(
                "the device plays {} where {} was asked for: stop it, then play again",
                playing.request.selection, request.selection
            )))
        }
    }

    /// Stops what is played, and reads back that the output is at rest. Whether anything was played.
    ///
    /// # Errors
    /// A link that broke, or an output that does not come to rest.
    pub fn stop(&self) -> Result<(bool, OutputStatus)> {
        let was_playing = match self.quick::<StopEndpoint>("the stop", &())? {
            Ok(_) => true,
            Err(StopError::NotPlaying) => false,
        };
        let begin = Instant::now();
        loop {
            let output = self.status()?.output;
            if output.activity == Activity::Idle {
                return Ok((was_playing, output));
            }
            if begin.elapsed() >= self.asker.patience.answer {
                return Err(self.not_verified(
                    "it was told to stop, but its output is not at rest: stop again, or take its power away"
                        .to_owned(),
                ));
            }
            thread::sleep(POLL_INTERVAL);
        }
    }

    /// Gives a motion without waiting for anything.
    ///
    /// # Errors
    /// A link that broke or takes nothing more.
    pub fn tell_motion(&self, sample: MotionSample) -> Result<()> {
        self.runtime()
            .block_on(self.asker.tell::<MotionTopic>(&sample))
    }

    /// Tells the device that the host is there.
    ///
    /// # Errors
    /// A link that broke or takes nothing more.
    pub fn keep_alive(&self) -> Result<()> {
        self.runtime()
            .block_on(self.asker.tell::<KeepAliveTopic>(&()))
    }

    /// The settings.
    ///
    /// # Errors
    /// A link that broke or an answer that did not come.
    pub fn settings(&self) -> Result<Settings> {
        Ok(self.slow::<SettingsGetEndpoint>("its settings", &())??)
    }

    /// Changes a setting, and reads back that it holds.
    ///
    /// # Errors
    /// A value that the device refuses, or settings that read back otherwise.
    pub fn set(&self, change: SettingChange) -> Result<Settings> {
        self.slow::<SettingsSetEndpoint>("a setting", &change)??;
        let settings = self.settings()?;
        let found = settings.get(change.setting);
        if found == change.value {
            Ok(settings)
        } else {
            Err(self.not_verified(format!(
                "{} was set to {} and reads back {found}: set it again",
                change.setting, change.value
            )))
        }
    }

    /// Gives every setting its default, and reads back that it has it.
    ///
    /// # Errors
    /// A refusal, or settings that read back otherwise.
    pub fn reset_settings(&self) -> Result<Settings> {
        self.slow::<SettingsResetEndpoint>("the reset of its settings", &())??;
        let settings = self.settings()?;
        if settings == Settings::default() {
            Ok(settings)
        } else {
            Err(self.not_verified(
                "settings were reset and do not read back as the defaults: reset them again"
                    .to_owned(),
            ))
        }
    }

    /// Asks to receive a library; the answer says where to go on.
    ///
    /// # Errors
    /// A refusal, a link that broke or an answer that did not come.
    pub fn upload_begin(&self, upload: UploadBegin) -> Result<UploadProgress> {
        Ok(self.slow::<UploadBeginEndpoint>("an upload", &upload)??)
    }

    /// Sends a chunk.
    ///
    /// # Errors
    /// A refusal, a link that broke or an answer that did not come.
    pub fn upload_chunk(&self, chunk: &UploadChunk<'_>) -> Result<UploadProgress> {
        Ok(self.slow::<UploadChunkEndpoint<'_>>("a chunk of the upload", chunk)??)
    }

    /// Ends an upload: from here on the library is there.
    ///
    /// # Errors
    /// A refusal, a link that broke or an answer that did not come.
    pub fn upload_commit(&self) -> Result<UploadCommitted> {
        Ok(self.slow::<UploadCommitEndpoint>("the end of the upload", &())??)
    }

    /// Gives an upload up.
    ///
    /// # Errors
    /// A refusal, a link that broke or an answer that did not come.
    pub fn upload_abort(&self) -> Result<UploadState> {
        Ok(self.slow::<UploadAbortEndpoint>("the upload's abort", &())??)
    }

    /// How far an upload is.
    ///
    /// # Errors
    /// A link that broke or an answer that did not come.
    pub fn upload_progress(&self) -> Result<UploadState> {
        self.slow::<UploadProgressEndpoint>("the upload's progress", &())
    }

    /// Starts a recording, whose blocks then wait in [`Blocks`].
    ///
    /// # Errors
    /// A refusal, a link that broke or an answer that did not come.
    pub(super) fn record_start(&self) -> Result<(RecordStarted, Blocks)> {
        let client = &self.asker.client;
        let subscription = self
            .runtime()
            .block_on(client.subscribe_multi::<RecordBlockTopic>(WAITING_BLOCKS))
            .map_err(|_| self.asker.lost())?;
        let mut blocks = Blocks { subscription };
        while blocks.next(self, Duration::ZERO)?.is_some() {}
        let started = self.quick::<RecordStartEndpoint>("the start of a recording", &())??;
        Ok((started, blocks))
    }

    /// Stops a recording.
    ///
    /// # Errors
    /// That there is none, a link that broke or an answer that did not come.
    pub fn record_stop(&self) -> Result<RecordStopped> {
        Ok(self.quick::<RecordStopEndpoint>("the end of a recording", &())??)
    }
}

impl Drop for Device {
    fn drop(&mut self) {
        self.asker.client.close();
        if let Some(runtime) = self.runtime.take() {
            // What still waits for the operating system is not waited for.
            runtime.shutdown_background();
        }
    }
}

/// Blocks of a recording, as they arrive.
pub(super) struct Blocks {
    subscription: MultiSubscription<RecordBlock>,
}

impl Blocks {
    /// The next block; none if none came in time.
    pub(super) fn next(
        &mut self,
        device: &Device,
        within: Duration,
    ) -> Result<Option<RecordBlock>> {
        let next = async {
            loop {
                match self.subscription.recv().await {
                    Ok(block) => return Ok(block),
                    // The blocks that we were too slow for are seen from the numbers of those that follow.
                    Err(MultiSubRxError::Lagged(_)) => {}
                    Err(MultiSubRxError::IoClosed) => return Err(device.asker.lost()),
                }
            }
        };
        let next = async { tokio::time::timeout(within, next).await };
        device.runtime().block_on(next).ok().transpose()
    }
}
