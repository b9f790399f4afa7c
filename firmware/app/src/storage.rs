//! Requests that read, erase or write flash, and the self test. They are served one after the other and may take
//! seconds.
//!
//! These requests belong in a task of their own, so that motion and status are served meanwhile. [`Stage`] is their
//! view of the rest of the device; the image implements it by its [`crate::control::Control`] behind a lock that is
//! never held across a wait. Whatever takes long is done in bounded steps, between which other tasks have their turn.

use embassy_futures::yield_now;
use embedded_storage_async::nor_flash::NorFlash;
use model_format::link::{
    ActivateError, Activated, LinkId, ListError, ListRequest, ProposalToken, ResponseChange, ResponseError,
    ResponseState, SceneInfo, Settings, SettingsChange, SettingsError, SlotId, SlotInfo, SlotState, Slots, TextureInfo,
    UploadBegin, UploadChunk, UploadCommitted, UploadError, UploadProgress, UploadState,
};

use crate::control::{Control, Device, LoadFault};
use crate::settings::SettingsStore;
use crate::slots::{MappedFlash, SlotStore};
use crate::update::Updates;
use crate::upload::Uploader;

/// The rest of the device, as requests and storage see it.
pub trait Stage {
    /// The hardware.
    type Device: Device;

    /// Calls `what` with the device's control, behind a lock that is never held across a wait.
    fn with_control<R>(&self, what: impl FnOnce(&mut Control<Self::Device>) -> R) -> R;

    /// The time since the start, µs.
    fn now_us(&self) -> u64;

    /// Waits for a millisecond.
    fn pause(&mut self) -> impl Future<Output = ()>;
}

/// Longest wait until the output is at rest, ms: many times the longest mute ramp.
const REST_TIMEOUT_MS: u32 = 500;

/// The two slots and the settings in flash.
pub struct Storage<F, S: NorFlash> {
    pub(crate) slots: SlotStore<F>,
    settings: SettingsStore<S>,
    pub(crate) uploader: Uploader,
    /// Updates of the image; none without a bootloader.
    pub(crate) updates: Option<Updates<S>>,
    /// The library in RAM.
    loaded: Option<(SlotId, SlotInfo)>,
}

impl<F: MappedFlash, S: NorFlash> Storage<F, S> {
    /// A storage over these slots and settings, with no library loaded.
    pub const fn new(slots: SlotStore<F>, settings: SettingsStore<S>) -> Self {
        Self {
            slots,
            settings,
            uploader: Uploader::new(),
            updates: None,
            loaded: None,
        }
    }

    /// Returns the flashes of slots and settings, and the flash of the record of updates, if there is one.
    pub fn into_flash(self) -> (F, S, Option<S>) {
        let records = self.updates.map(|updates| updates.store.into_flash());
        (self.slots.into_flash(), self.settings.into_flash(), records)
    }

    /// Reads the settings, which were [`SettingsStore::unread`].
    pub async fn read_settings(&mut self) -> &SettingsStore<S> {
        self.settings.read().await;
        &self.settings
    }

    /// The slots.
    pub(crate) fn slot_store(&mut self) -> &mut SlotStore<F> {
        &mut self.slots
    }

    /// Progress of the upload.
    pub(crate) fn upload(&self) -> UploadState {
        self.uploader.state()
    }

    /// Activates, at boot, the newest library that is valid and readable, or the other one if that fails for whatever
    /// reason. A boot without a library is no fault.
    pub async fn activate_newest(&mut self, stage: &mut impl Stage) -> Option<Activated> {
        self.slots.scan_once().await;
        let newest = self.slots.newest()?;
        for slot in [newest, newest.other()] {
            if let Ok(activated) = self.activate(stage, slot).await {
                return Some(activated);
            }
        }
        None
    }

    /// Serves `SlotsEndpoint`.
    pub async fn read_slots(&mut self) -> Slots {
        self.slots.scan_once().await;
        self.slots.slots()
    }

    /// The slots as they were read last.
    pub fn slots(&self) -> Slots {
        self.slots.slots()
    }

    /// Serves `ListEndpoint`.
    ///
    /// # Errors
    /// The slot has no library, or has a fault, or the library has fewer textures.
    pub async fn list(&mut self, request: ListRequest) -> Result<TextureInfo, ListError> {
        self.slots.scan_once().await;
        self.slots.texture(request.slot, request.index).await
    }

    /// Serves `ListSceneEndpoint`.
    ///
    /// # Errors
    /// The slot has no library, or has a fault, or the library has fewer scenes.
    pub async fn list_scene(&mut self, request: ListRequest) -> Result<SceneInfo, ListError> {
        self.slots.scan_once().await;
        self.slots.scene(request.slot, request.index).await
    }

    /// Serves `ActivateEndpoint`: fades out, copies the library to RAM, and makes its slot the active one.
    ///
    /// # Errors
    /// The library cannot be activated, for the reason in the error. The library in RAM stays unless the copy itself
    /// failed.
    pub async fn activate(&mut self, stage: &mut impl Stage, slot: SlotId) -> Result<Activated, ActivateError> {
        self.slots.scan_once().await;
        // A refusal comes before the fade-out, so that what is played goes on.
        let library = self.playable(slot)?;
        stage.with_control(Control::begin_activation)?;
        let result = self.exchange(stage, slot, library).await;
        stage.with_control(|control| control.end_activation(self.loaded));
        self.slots.set_active(self.loaded.map(|(slot, _)| slot));
        result
    }

    fn playable(&self, slot: SlotId) -> Result<SlotInfo, ActivateError> {
        match self.slots.state(slot) {
            SlotState::Valid(library) => Ok(*library),
            SlotState::Faulty(fault) => Err(ActivateError::Faulty {
                slot,
                fault: fault.clone(),
            }),
            SlotState::Empty | SlotState::Receiving => Err(ActivateError::NoLibrary { slot }),
        }
    }

    async fn exchange(
        &mut self,
        stage: &mut impl Stage,
        slot: SlotId,
        library: SlotInfo,
    ) -> Result<Activated, ActivateError> {
        // Everything in which the flash can fail comes before the RAM is touched.
        let faulty = |fault| ActivateError::Faulty { slot, fault };
        let bytes = self.slots.library_bytes(slot).await.map_err(faulty)?;
        let mut waited_ms = 0;
        while !stage.with_control(|control| control.may_exchange()) {
            if waited_ms == REST_TIMEOUT_MS {
                return Err(ActivateError::NotAtRest);
            }
            stage.pause().await;
            waited_ms += 1;
        }
        // From here on a failure leaves no library in RAM.
        self.loaded = None;
        stage.with_control(|control| control.device().begin_load());
        let not_copied = |LoadFault| ActivateError::NotCopied { slot };
        let load = || stage.with_control(|control| control.device().load(bytes));
        while !load().map_err(not_copied)? {
            // Until the end of the activation the player is busy, so that no request begins to play.
            yield_now().await;
        }
        self.loaded = Some((slot, library));
        Ok(Activated { slot, library })
    }

    /// Serves `UploadBeginEndpoint`.
    ///
    /// # Errors
    /// The errors of [`Uploader::begin`]; the supply is too low; or an update needs the slots.
    pub async fn upload_begin(
        &mut self,
        stage: &mut impl Stage,
        begin: UploadBegin,
    ) -> Result<UploadProgress, UploadError> {
        supplied(stage)?;
        if self.keeps_image().await {
            return Err(UploadError::Busy);
        }
        self.slots.scan_once().await;
        let result = self.uploader.begin(&mut self.slots, begin).await;
        stage.with_control(|control| control.set_upload(self.uploader.state()));
        result
    }

    /// Serves `UploadChunkEndpoint`.
    ///
    /// # Errors
    /// The errors of [`Uploader::chunk`]; or the supply is too low, after which the upload can be continued.
    pub async fn upload_chunk(
        &mut self,
        stage: &mut impl Stage,
        chunk: UploadChunk<'_>,
    ) -> Result<UploadProgress, UploadError> {
        supplied(stage)?;
        let result = self.uploader.chunk(&mut self.slots, chunk).await;
        stage.with_control(|control| control.set_upload(self.uploader.state()));
        result
    }

    /// Serves `UploadCommitEndpoint`.
    ///
    /// # Errors
    /// The errors of [`Uploader::commit`]; or the supply is too low, after which the upload can be continued.
    pub async fn upload_commit(&mut self, stage: &mut impl Stage) -> Result<UploadCommitted, UploadError> {
        supplied(stage)?;
        let result = self.uploader.commit(&mut self.slots).await;
        stage.with_control(|control| control.set_upload(self.uploader.state()));
        result
    }

    /// Serves `UploadAbortEndpoint`.
    ///
    /// # Errors
    /// None; the endpoint's type leaves room for one.
    pub fn upload_abort(&mut self, stage: &mut impl Stage) -> Result<UploadState, UploadError> {
        self.uploader.abort(&mut self.slots);
        stage.with_control(|control| control.set_upload(self.uploader.state()));
        Ok(self.uploader.state())
    }

    /// Serves `SettingsApplyEndpoint`: applies the change that `from` has proposed with `token`.
    ///
    /// # Errors
    /// No such proposal waits, or the other link has made it; something is played; the supply is too low; the flash
    /// fails.
    pub async fn settings_apply(
        &mut self,
        stage: &mut impl Stage,
        from: LinkId,
        token: ProposalToken,
    ) -> Result<Settings, SettingsError> {
        // Checked before the proposal is taken, so that it can be applied once the supply is back.
        if stage.with_control(|control| control.is_supply_low()) {
            return Err(SettingsError::SupplyLow);
        }
        let change = stage.with_control(|control| control.take_proposal(from, token))?;
        // This comes before the first wait, because a texture that began to play during the wait would be given
        // settings without its gain.
        stage.with_control(Control::begin_configuration)?;
        let result = match change {
            SettingsChange::Set(changes) => self.settings.set_all(&changes).await,
            SettingsChange::Reset => self.settings.reset().await,
        };
        // The settings are applied also after an error, because a reset that failed half way has changed some of them.
        self.end_configuration(stage);
        result
    }

    /// Serves `ResponseSetEndpoint`: stores the response that `from` has proposed, with the setting that belongs to it,
    /// or removes the stored response.
    ///
    /// # Errors
    /// No such response, or the other link has proposed it; something is played; the supply is too low; the flash
    /// fails.
    pub async fn response_set(
        &mut self,
        stage: &mut impl Stage,
        from: LinkId,
        change: ResponseChange,
    ) -> Result<ResponseState, ResponseError> {
        if stage.with_control(|control| control.is_supply_low()) {
            return Err(SettingsError::SupplyLow.into());
        }
        let response = stage.with_control(|control| control.begin_response(from, change))?;
        let result = self.settings.set_response(response.as_ref()).await;
        self.end_configuration(stage);
        result?;
        Ok(stage.with_control(|control| control.response()))
    }

    fn end_configuration(&self, stage: &impl Stage) {
        let store = &self.settings;
        let (settings, state, response) = (store.settings(), store.state(), store.response());
        stage.with_control(|control| control.end_configuration(settings, state, response));
    }
}

/// Refuses an upload's write while the supply is too low, before the upload changes.
pub(crate) fn supplied(stage: &impl Stage) -> Result<(), UploadError> {
    if stage.with_control(|control| control.is_supply_low()) {
        return Err(UploadError::SupplyLow);
    }
    Ok(())
}
