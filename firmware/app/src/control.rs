//! Requests that are answered at once: all except the jobs of [`crate::storage`].
//!
//! One [`Control`] serves all links. A method that "serves" an endpoint or topic takes and returns the types of
//! [`model_format::link`], so that a dispatcher only has to call it. The others are for the poll and the storage.

mod probe;

use core::sync::atomic::AtomicI16;

use model_format::link::{
    ActivateError, CycleReport, DeviceInfo, Fault, LinkCounters, LinkId, MAX_PLAY_GAIN, MAX_PROBE_SAMPLES, Marks,
    MotionRefused, MotionSample, MotionSource, MuteReason, OutputStatus, PlayError, PlayRequest, Playing,
    ProposalToken, RecordBlock, RecordCounters, RecordError, RecordStarted, RecordStopped, ResetReason, Response,
    Selection, Settings, SettingsChange, SettingsError, SettingsProposal, SettingsState, SlotId, SlotInfo, StartReport,
    Status, StopError, TextureName, TickCounters, TickHistogram, UploadState,
};
use model_format::scene::{Biquad, SceneError, SceneName};
use model_format::{Library, PlayRate};

use crate::TICKS_PER_MS;
use crate::inputs::Timed;
use crate::lease::{HeldBy, Lease};
use crate::levels::Sums;
use crate::player::{Action, Begin, Busy, Observed, Piece, Player};
use crate::proposals::Proposals;
use crate::safety::{Config, Counters, Heat};
use crate::words::in_words;
use stylus_kernel::scene::cost::OverBudget;
use stylus_kernel::scene::{Plan, Wave};

/// The hardware, as the application uses it. No method waits.
pub trait Device {
    /// A texture or scene that is ready to be played.
    type Plan;

    /// Identity of this device.
    fn info(&self) -> DeviceInfo;

    /// Number of ticks since the start.
    fn now(&self) -> u64;

    /// Counters and state of the tick.
    fn tick_report(&self) -> TickReport;

    /// Worst cases since the start.
    fn marks(&self) -> Marks;

    /// Sums of the sensors' samples over the last whole window.
    fn sensor_sums(&self) -> Sums;

    /// Durations of tick and update since the last call, or since the start.
    fn take_cycles(&mut self) -> CycleReport;

    /// Counters of the links: USB, serial.
    fn link_counters(&self) -> [LinkCounters; 2];

    /// Cause of the last reset.
    fn reset_report(&self) -> ResetReport;

    /// Report of the start, with the present state of the supply.
    fn start_report(&self) -> StartReport;

    /// Returns true if the output is at rest and the tick has seen the last [`Device::set_mute`].
    fn is_at_rest(&self) -> bool;

    /// Returns true if the motion that is followed was too old at the last update.
    fn is_motion_stale(&self) -> bool;

    /// Returns true if the motion is too old because the force was at a rail of its converter.
    fn is_force_railed(&self) -> bool;

    /// Mutes or unmutes the tick.
    fn set_mute(&mut self, muted: bool);

    /// Returns the plan of `selection`, which [`plan_of`] computes from the library in RAM, and its rate.
    fn plan(&self, selection: &Selection, response: Option<&Response>) -> Result<(Self::Plan, PlayRate), PlayError>;

    /// Memory of a probe's waveform, which only [`Control`] writes.
    fn waveform(&self) -> &'static Waveform;

    /// Returns the plan that plays a probe's `wave`, from [`Device::waveform`], at `rate` through the filters
    /// `sections`.
    fn plan_wave(&self, wave: Wave<'static>, rate: PlayRate, sections: &[Biquad]) -> Self::Plan;

    /// Keeps `plan` for [`Device::start`], and drops any plan that was prepared before. Whatever is being played
    /// continues.
    fn prepare(&mut self, plan: Self::Plan);

    /// Starts the prepared plan, which is the plan of `piece`, from silence, with `config`, which has the plan's rate.
    /// Called at rest.
    ///
    /// # Errors
    /// No plan was prepared; nothing is played then.
    fn start(&mut self, piece: &Piece, config: Config) -> Result<(), NotPrepared>;

    /// Plays `plan`, the plan of `request`, as soon as the director has faded out what is played. Called while
    /// something of the same library and rate is played.
    fn switch(&mut self, request: &PlayRequest, plan: Self::Plan);

    /// Plays nothing, and forgets the prepared plan. Called at rest.
    fn clear(&mut self);

    /// Sets the source of motion.
    fn set_motion_source(&mut self, source: MotionSource);

    /// Sets the host's motion.
    fn set_host_motion(&mut self, motion: Timed);

    /// Applies settings to the inputs and the safety stages. Called at rest.
    fn set_settings(&mut self, settings: &Settings);

    /// Heat of the coil that was kept over the last reset; none after power-on, or if the kept value is damaged.
    fn kept_heat(&self) -> Option<Heat>;

    /// Sets the heat of the coil. Called only before the amplifier is on for the first time.
    fn set_heat(&mut self, heat: Heat);

    /// A number that differs from device to device and from moment to moment.
    fn token_seed(&self) -> u64;

    /// Allows the amplifier to be on once the output is at mid-scale, or turns it off at once.
    fn set_amplifier(&mut self, on: bool);

    /// Forgets the library in RAM, so that [`Device::load`] can begin. Called while nothing is played.
    fn begin_load(&mut self);

    /// Does one bounded step of copying `library`, which is valid, to the RAM from which it is played, or of decoding
    /// the copy. Returns true after the last step; until then the RAM holds no library.
    ///
    /// # Errors
    /// The copy is not valid. The RAM holds no library then.
    fn load(&mut self, library: &[u8]) -> Result<bool, LoadFault>;

    /// Begins a recording.
    fn start_recording(&mut self) -> Result<RecordStarted, RecordError>;

    /// Ends the recording.
    fn stop_recording(&mut self) -> Result<RecordStopped, RecordError>;

    /// The next whole block of the recording, if there is one. The queue of samples is read also while nothing is
    /// recorded.
    fn next_block(&mut self) -> Option<RecordBlock>;

    /// Counters of the recorder.
    fn record_counters(&self) -> RecordCounters;
}

/// Samples of one period of a probe.
pub type Waveform = [AtomicI16; MAX_PROBE_SAMPLES];

/// Failure to copy a library to RAM.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LoadFault;

/// Failure to start, because no plan was prepared.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NotPrepared;

/// Counters and state of the tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TickReport {
    /// The tick's own counters.
    pub counters: TickCounters,
    /// Histogram of the ticks' durations.
    pub histogram: TickHistogram,
    /// Number of samples that reached full scale in the kernel since the last start from silence.
    pub saturations: u32,
    /// The safety stages' counters.
    pub safety: Counters,
    /// `safety::State::thermal_load_permille`.
    pub thermal_load_permille: u16,
    /// `safety::State::thermal_gain_permille`.
    pub thermal_gain_permille: u16,
    /// True while the amplifier is enabled.
    pub amplifier: bool,
}

/// Cause of the last reset.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ResetReport {
    /// Reason of the reset.
    pub reason: ResetReason,
    /// Number of resets since power-on.
    pub resets: u32,
    /// The last fault since power-on.
    pub fault: Option<Fault>,
}

/// The device as requests see it.
pub struct Control<D> {
    device: D,
    player: Player,
    settings: Settings,
    settings_state: SettingsState,
    active: Option<(SlotId, SlotInfo)>,
    upload: UploadState,
    lease: Lease,
    proposals: Proposals,
    /// The stored response of the actuator.
    response: Option<Response>,
    /// A proposed response, and the link that proposed it.
    proposed: Option<(LinkId, Response)>,
    /// The link that began the recording.
    listener: LinkId,
    /// True once the amplifier may have been on. From then on the coil's heat is followed, and no longer assumed.
    is_heat_known: bool,
}

impl<D: Device> Control<D> {
    /// A control that plays nothing and has no library.
    pub fn new(mut device: D, settings: Settings, settings_state: SettingsState, response: Option<Response>) -> Self {
        device.set_settings(&settings);
        device.set_mute(true);
        let mut player = Player::new();
        if device.start_report().safe_mode {
            player.safe_mode();
        }
        let mut control = Self {
            device,
            player,
            settings,
            settings_state,
            active: None,
            upload: UploadState::Idle,
            lease: Lease::new(),
            proposals: Proposals::new(),
            response,
            proposed: None,
            listener: LinkId::Serial,
            is_heat_known: false,
        };
        control.follow_settings();
        control
    }

    /// Sets the coil's heat to the kept one, or else to the assumed one, as long as the amplifier has not been on.
    /// Keeps the amplifier off while nothing may be played: in safe mode, and until the coil's settings are known.
    fn follow_settings(&mut self) {
        let known = self.settings_state.check_playable().is_ok();
        let safe_mode = self.player.mute().contains(MuteReason::SafeMode);
        if !self.is_heat_known {
            // The assumed heat is relative to the power limit in force, which may change until somebody sets the coil's
            // limit.
            let assumed = Config::new(&self.settings, 1.0).assumed_heat();
            let heat = self.device.kept_heat().unwrap_or(assumed);
            self.device.set_heat(heat);
        }
        let on = known && !safe_mode;
        self.is_heat_known |= on;
        self.device.set_amplifier(on);
    }

    /// Serves `KeepAliveTopic`: renews the lease, if `from` holds it.
    pub fn keep_alive(&mut self, from: LinkId) {
        self.lease.renew(from, self.device.now());
    }

    /// Advances the player by the state of the tick and the links. Called every millisecond.
    pub fn poll(&mut self) {
        let observed = Observed {
            at_rest: self.device.is_at_rest(),
            stale: self.device.is_motion_stale(),
            railed: self.device.is_force_railed(),
            link_lost: !self.lease.is_alive(self.device.now()),
        };
        let action = self.player.poll(observed);
        match action {
            Some(Action::Start(piece, rate)) => {
                let config = self.config(&piece, rate);
                if self.device.start(&piece, config).is_err() {
                    self.player.not_started();
                }
            }
            Some(Action::Clear) => self.device.clear(),
            None => {}
        }
        self.end_probe(observed.link_lost);
        // Last, because both the player's poll and the end of a probe change the reasons of the mute.
        self.tell_mute();
    }

    fn tell_mute(&mut self) {
        self.device.set_mute(!self.player.mute().is_empty());
    }

    /// Serves `InfoEndpoint`.
    pub fn info(&self) -> DeviceInfo {
        self.device.info()
    }

    /// Serves `StatusEndpoint`.
    pub fn status(&self) -> Status {
        let tick = self.device.tick_report();
        let [usb, serial] = self.device.link_counters();
        let ResetReport { reason, resets, fault } = self.device.reset_report();
        Status {
            // In safe mode, in which nothing counts ticks, the device computes them from a timer.
            uptime_ms: self.device.now() / u64::from(TICKS_PER_MS),
            output: self.output(&tick),
            tick: tick.counters,
            tick_histogram: tick.histogram,
            marks: self.device.marks(),
            levels: self.device.sensor_sums().levels(&self.settings),
            record: self.device.record_counters(),
            usb,
            serial,
            active: self.active.map(|(slot, _)| slot),
            library_crc32: self.active.map_or(0, |(_, library)| library.crc32),
            upload: self.upload,
            reset: reason,
            resets,
            fault,
            settings: self.settings_state,
            start: self.device.start_report(),
            proposal: self.proposals.waiting(self.device.now()),
            lease: self.lease.status(self.device.now()),
            limits: Config::new(&self.settings, 1.0).output_limits(&self.settings),
        }
    }

    /// Returns true while the supply is too low to write flash.
    pub fn is_supply_low(&self) -> bool {
        self.device.start_report().supply_low
    }

    /// Returns true if a new image may confirm itself: this start is not in safe mode, no tick was missed, and the
    /// output can be driven.
    pub fn is_healthy(&self) -> bool {
        let is_faulty = self.player.mute().contains(MuteReason::Fault);
        let missed = self.device.tick_report().counters.missed;
        !self.device.start_report().safe_mode && !is_faulty && missed == 0
    }

    fn output(&self, tick: &TickReport) -> OutputStatus {
        OutputStatus {
            activity: self.player.activity(),
            at_rest: self.device.is_at_rest(),
            mute: self.player.mute(),
            mute_counts: self.player.mute_counts(),
            saturations: tick.saturations,
            hard_limited: tick.safety.hard_limited,
            slew_limited: tick.safety.slew_limited,
            thermally_limited: tick.safety.thermally_limited,
            thermal_load_permille: tick.thermal_load_permille,
            thermal_gain_permille: tick.thermal_gain_permille,
            amplifier: tick.amplifier,
        }
    }

    /// Serves `CyclesEndpoint`.
    pub fn take_cycles(&mut self) -> CycleReport {
        self.device.take_cycles()
    }

    /// Serves `PlayEndpoint`, and gives the lease to `from`.
    ///
    /// # Errors
    /// The texture or scene cannot be played, for the reason in the error. Playing continues as before.
    pub fn play(&mut self, from: LinkId, request: PlayRequest) -> Result<Playing, PlayError> {
        let now = self.device.now();
        self.lease
            .check_play(from, now)
            .map_err(|HeldBy(by)| PlayError::Held { by })?;
        // Everything that can refuse the request comes before the first change, so that what is played goes on.
        let (plan, rate) = self.plan(&request)?;
        let begin = self.player.play(request.clone(), rate);
        let begin = begin.map_err(|_| PlayError::Busy)?;
        self.lease.give(from, now);
        self.proposals.end();
        self.device.set_motion_source(request.motion);
        match begin {
            // The player changes gain and rate only at rest, so the configuration of the safety stages stays.
            Begin::Switch => self.device.switch(&request, plan),
            Begin::AtRest => self.device.prepare(plan),
        }
        self.tell_mute();
        Ok(Playing {
            mute: self.player.mute(),
            request,
        })
    }

    fn plan(&self, request: &PlayRequest) -> Result<(D::Plan, PlayRate), PlayError> {
        // A comparison with NaN is false, so NaN is refused.
        if !(0.0..=MAX_PLAY_GAIN).contains(&request.gain) {
            return Err(PlayError::Gain { gain: request.gain });
        }
        self.check_playable()?;
        if self.active.is_none() {
            return Err(PlayError::NoLibrary);
        }
        (self.device).plan(&request.selection, self.response.as_ref())
    }

    /// Checks that something may begin to play.
    fn check_playable(&self) -> Result<(), PlayError> {
        let start = self.device.start_report();
        if start.safe_mode {
            return Err(PlayError::SafeMode {
                quick_faults: start.quick_faults,
            });
        }
        if self.player.mute().contains(MuteReason::Fault) {
            return Err(PlayError::Fault);
        }
        self.settings_state.check_playable()?;
        if self.player.is_busy() {
            // In the middle of an activation there is no library, or only a part of one.
            return Err(PlayError::Busy);
        }
        Ok(())
    }

    /// Serves `StopEndpoint` for either link, and ends the lease.
    pub fn stop(&mut self) -> Result<OutputStatus, StopError> {
        self.player.stop()?;
        self.lease.end();
        self.tell_mute();
        Ok(self.output(&self.device.tick_report()))
    }

    /// Serves `MotionEndpoint` and `MotionTopic`, and renews the lease, if `from` holds it. Returns the source of the
    /// motion that is followed.
    ///
    /// # Errors
    /// The other link holds the lease, even a lapsed one, or the motion is not finite. The previous motion stays in
    /// force.
    pub fn motion(&mut self, from: LinkId, sample: MotionSample) -> Result<MotionSource, MotionRefused> {
        let now = self.device.now();
        self.lease
            .check_motion(from)
            .map_err(|HeldBy(by)| MotionRefused::Held { by })?;
        self.lease.renew(from, now);
        let motion = Timed::from_host(sample, now)?;
        self.device.set_host_motion(motion);
        Ok(self.player.motion_source())
    }

    /// Serves `RecordStartEndpoint`. The blocks go to `from`.
    pub fn record_start(&mut self, from: LinkId) -> Result<RecordStarted, RecordError> {
        let started = self.device.start_recording()?;
        self.listener = from;
        Ok(started)
    }

    /// The next block of the recording, and the link that it goes to. Called at least every few milliseconds.
    pub fn next_block(&mut self) -> Option<(LinkId, RecordBlock)> {
        Some((self.listener, self.device.next_block()?))
    }

    /// Serves `RecordStopEndpoint`.
    pub fn record_stop(&mut self) -> Result<RecordStopped, RecordError> {
        self.device.stop_recording()
    }

    /// Serves `SettingsGetEndpoint`.
    pub fn settings(&self) -> Settings {
        self.settings
    }

    /// Serves `UploadProgressEndpoint`.
    pub fn upload(&self) -> UploadState {
        self.upload
    }

    /// Serves `SettingsProposeEndpoint`: keeps `change` until it is applied, in place of any change proposed before.
    ///
    /// # Errors
    /// A value is out of its range, a setting occurs twice, there is no setting, or something is played, activated or
    /// stored.
    pub fn propose(&mut self, from: LinkId, change: SettingsChange) -> Result<SettingsProposal, SettingsError> {
        change.check()?;
        if !self.player.is_idle() {
            return Err(SettingsError::Playing);
        }
        let loosens = change.loosens(&self.settings, &self.settings_state);
        let (now, seed) = (self.device.now(), self.device.token_seed());
        Ok(self.proposals.propose(from, change, loosens, now, seed))
    }

    /// Returns the change that `from` has proposed with `token`, and ends the proposal.
    pub fn take_proposal(&mut self, from: LinkId, token: ProposalToken) -> Result<SettingsChange, SettingsError> {
        self.proposals.take(from, token, self.device.now())
    }

    /// Prevents playing until [`Control::end_configuration`], while settings are stored.
    ///
    /// # Errors
    /// Something is played, a library is being activated, or a store or self test is under way already.
    pub fn begin_configuration(&mut self) -> Result<(), SettingsError> {
        let begun = self.player.begin_configuration();
        begun.map_err(|Busy| SettingsError::Playing)
    }

    /// Applies the settings of the store, and lets textures be played again.
    pub fn end_configuration(&mut self, settings: Settings, state: SettingsState, response: Option<Response>) {
        self.settings = settings;
        self.settings_state = state;
        self.response = response;
        // The proposed response was checked against the previous settings.
        self.proposed = None;
        self.device.set_settings(&settings);
        self.follow_settings();
        // What a proposal loosens was judged by the previous settings.
        self.proposals.end();
        self.player.end_configuration();
    }

    /// Prevents playing until [`Control::end_self_test`].
    ///
    /// # Errors
    /// Something is played, a library is being activated, or a store or self test is under way already.
    pub fn begin_self_test(&mut self) -> Result<(), Busy> {
        self.player.begin_configuration()
    }

    /// Ends what [`Control::begin_self_test`] began.
    pub fn end_self_test(&mut self) {
        self.player.end_configuration();
    }

    /// Sets the progress of the upload, for the status.
    pub fn set_upload(&mut self, upload: UploadState) {
        self.upload = upload;
    }

    /// Fades out and stops, so that the library can be exchanged once [`Control::may_exchange`] is true.
    ///
    /// # Errors
    /// Another activation, a store of settings or a self test is under way.
    pub fn begin_activation(&mut self) -> Result<(), ActivateError> {
        self.player.begin_activation()?;
        self.lease.end();
        self.tell_mute();
        Ok(())
    }

    /// Returns true if the library in RAM may be exchanged.
    pub fn may_exchange(&self) -> bool {
        self.player.may_exchange()
    }

    /// Ends the activation. `active` is the library that is now in RAM: the new one, none, or still the previous one.
    pub fn end_activation(&mut self, active: Option<(SlotId, SlotInfo)>) {
        self.active = active;
        self.player.end_activation();
        self.tell_mute();
    }

    /// The hardware.
    pub fn device(&mut self) -> &mut D {
        &mut self.device
    }
}

/// Returns the plan of `selection` from `library`, through the equaliser of `response`, and its rate. The plan takes at
/// most `budget` instructions per tick.
///
/// # Errors
/// The library lacks the texture or scene; no stylus plays its sample rate; the scene is invalid; the plan is over the
/// budget, with or without the equaliser.
pub fn plan_of<'l>(
    selection: &Selection,
    library: &Library<'l>,
    budget: u32,
    response: Option<&Response>,
) -> Result<(Plan<'l>, PlayRate), PlayError> {
    match selection {
        Selection::Texture(name) => plan_of_texture(name, library, budget, response),
        Selection::Scene(name) => plan_of_scene(name, library, budget, response),
    }
}

// The next two functions are not inlined, because plans and scenes take kilobytes, which would otherwise stay on the
// stack while the answer is written.
#[inline(never)]
fn plan_of_texture<'l>(
    name: &TextureName,
    library: &Library<'l>,
    budget: u32,
    response: Option<&Response>,
) -> Result<(Plan<'l>, PlayRate), PlayError> {
    let missing = || PlayError::NoSuchTexture { name: name.clone() };
    let mut plan = Plan::of_texture(library.texture(name).ok_or_else(missing)?);
    let rate = equalise(&mut plan, budget, response)?;
    Ok((plan, rate))
}

#[inline(never)]
fn plan_of_scene<'l>(
    name: &SceneName,
    library: &Library<'l>,
    budget: u32,
    response: Option<&Response>,
) -> Result<(Plan<'l>, PlayRate), PlayError> {
    let missing = || PlayError::NoSuchScene { name: name.clone() };
    let invalid = |error: &SceneError| PlayError::InvalidScene {
        reason: in_words(error),
    };
    // Scene and plan are used in place, because each move is a copy on the stack.
    let found = library.scene(name);
    let scene = found.as_ref().ok_or_else(missing)?;
    let mut made = Plan::new(scene, library);
    let plan = made.as_mut().map_err(|error| invalid(error))?;
    let rate = equalise(plan, budget, response)?;
    made.map(|plan| (plan, rate)).map_err(|error| invalid(&error))
}

/// Adds the equaliser of `response` to `plan`, checks the budget before and after, and returns the rate.
fn equalise(plan: &mut Plan<'_>, budget: u32, response: Option<&Response>) -> Result<PlayRate, PlayError> {
    let texture_hz = plan.sample_rate_hz();
    let rate = PlayRate::of(texture_hz).ok_or(PlayError::SampleRate { texture_hz })?;
    let refused = |OverBudget { cost, budget }| PlayError::OverBudget {
        instructions: cost.instructions(),
        budget,
        arithmetic: in_words(&cost),
    };
    // Checked without the equaliser first, so that the error names what is too much.
    plan.within(budget).map_err(refused)?;
    if let Some(response) = response {
        let sections = response.sections(rate).biquads();
        plan.append(&sections);
        let refused = |OverBudget { cost, budget }| PlayError::EqualiserOverBudget {
            instructions: cost.instructions(),
            budget,
            sections: sections.len() as u8,
        };
        plan.within(budget).map_err(refused)?;
    }
    Ok(rate)
}
