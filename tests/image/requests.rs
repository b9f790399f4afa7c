//! Requests of a host, and steps that many tests need.

use std::collections::VecDeque;
use std::ops::RangeBounds;

use fake_stylus::device::change;
pub use fake_stylus::library::announcement as announced;
use fake_stylus::library::chunks;
use model_format::link::{
    ActivateEndpoint, Activated, BLOCK_SAMPLES, ListEndpoint, ListRequest, MAX_CHUNK_BYTES, MotionSource, MuteReasons,
    PlayEndpoint, PlayRequest, RecordSample, RecordStartEndpoint, RecordStopEndpoint, RecordStopped, Selection,
    Setting, SettingChange, SettingSet, Settings, SettingsApplyEndpoint, SettingsChange, SettingsError,
    SettingsGetEndpoint, SettingsProposeEndpoint, SlotId, Slots, SlotsEndpoint, Status, StatusEndpoint, StopEndpoint,
    TextureInfo, TickCounters, UploadBeginEndpoint, UploadChunkEndpoint, UploadCommitEndpoint, UploadCommitted,
};
use postcard_rpc::Endpoint;
use virtual_stylus::ResetCause;
use virtual_stylus::model::dac::{Cause, Output};
use virtual_stylus::motion::Motion;
use virtual_stylus::sensors::FunctionPins;

use crate::device::{CODE_NS, Device, MID_SCALE, MS};

impl Device {
    pub fn settings(&mut self) -> Settings {
        self.request::<SettingsGetEndpoint>(&()).expect("settings are read")
    }

    /// Moves the tool at `speed`, mm/s, from now on.
    pub fn move_at(&mut self, speed: f64) {
        self.stylus.set_motion(Motion::steady(speed, 0.01));
    }

    /// Moves the tool along knots from now on: speeds in mm/s at instants in ms, with linear interpolation.
    pub fn move_along(&mut self, knots: &[(u64, f64)]) {
        let start = self.stylus.now_ns();
        let at = |&(ms, speed): &(u64, f64)| (start + ms * MS, speed);
        let speeds: Vec<_> = knots.iter().map(at).collect();
        let motion = Motion::linear(&speeds, 0.01).expect("instants that rise");
        self.stylus.set_motion(motion);
    }

    /// Puts `signal`, a function of channel and instant, on the converter's pins.
    pub fn set_pins(&mut self, signal: impl FnMut(u8, u64) -> u16 + Send + 'static) {
        self.stylus.set_pins(FunctionPins(signal));
    }

    /// Begins a recording.
    pub fn record(&mut self) {
        self.request::<RecordStartEndpoint>(&()).expect("nothing is recorded");
    }

    /// Ends the recording, and receives the blocks that are still under way.
    pub fn stop_recording(&mut self) -> RecordStopped {
        let stopped = self.request::<RecordStopEndpoint>(&());
        self.run_for(20 * MS);
        stopped.expect("it is recorded")
    }

    /// Stops the present play.
    pub fn stop(&mut self) {
        self.request::<StopEndpoint>(&()).expect("it plays");
    }

    /// The outputs whose codes were put out by the timer, with their instants.
    pub fn triggered(&mut self) -> Vec<Output> {
        self.dac()
            .iter()
            .filter(|output| output.cause == Cause::Trigger)
            .copied()
            .collect()
    }

    /// Checks that codes were put out every 25 µs, and that no tick, block, conversion or output was late.
    pub fn assert_undisturbed(&mut self) {
        assert_on_time(&self.status().tick);
        assert_even(&self.triggered());
    }

    /// Number of codes other than mid-scale that were put out at these instants, ns.
    pub fn sounds_in(&mut self, instants: impl RangeBounds<u64>) -> usize {
        let outputs = self.dac().iter().filter(|output| instants.contains(&output.at_ns));
        let sounds = |output: &&Output| output.code.is_some_and(|code| code != MID_SCALE);
        outputs.filter(sounds).count()
    }

    /// Causes of the resets so far.
    pub fn resets(&mut self) -> Vec<ResetCause> {
        self.stylus.resets().iter().map(|reset| reset.cause).collect()
    }

    /// Checks that the image requested nothing that a model leaves out.
    pub fn assert_models_sufficed(&mut self) {
        let mut told = self.stylus.report().told;
        // embassy selects a clock for the RTC, which is not used, and finds that a clock is selected already. The part
        // ignores a second write of the selection.
        told.retain(|told| !told.starts_with("RCC.BDCR: ") || !told.contains("RTCSEL can be written only one time"));
        assert!(told.is_empty(), "{told:?}");
    }

    /// Checks that the received blocks are in order and complete.
    pub fn assert_whole(&self) {
        for (number, block) in self.blocks.iter().enumerate() {
            assert_eq!(block.sequence as usize, number);
            let ticks = (number * BLOCK_SAMPLES) as u64;
            assert_eq!(block.first_tick, self.blocks[0].first_tick + ticks);
            assert_eq!(block.lost_blocks, 0);
        }
        assert_eq!(self.broken, 0);
    }

    /// The recorded samples.
    pub fn samples(&self) -> Vec<RecordSample> {
        self.blocks
            .iter()
            .flat_map(|block| block.samples)
            .map(Into::into)
            .collect()
    }

    /// Changes one setting.
    pub fn set(&mut self, setting: Setting, value: f32) -> Settings {
        self.change_settings(&[change(setting, value)])
            .expect("in range, and nothing is played")
    }

    pub fn status(&mut self) -> Status {
        self.request::<StatusEndpoint>(&())
    }

    pub fn slots(&mut self) -> Slots {
        self.request::<SlotsEndpoint>(&())
    }

    pub fn texture(&mut self, slot: SlotId, index: u8) -> TextureInfo {
        self.request::<ListEndpoint>(&ListRequest { slot, index })
            .expect("there is such a texture")
    }

    /// Begins an upload. Returns the offset of the first byte that the device lacks.
    pub fn begin_upload(&mut self, library: &[u8]) -> usize {
        self.request::<UploadBeginEndpoint>(&announced(library))
            .expect("the library fits a slot")
            .next_offset as usize
    }

    /// Sends chunks from byte `from` on, until byte `end` has been sent. Returns the offset of the next chunk.
    pub fn send_chunks(&mut self, library: &[u8], from: usize, end: usize) -> usize {
        let mut next = from;
        for chunk in chunks(library, from, MAX_CHUNK_BYTES) {
            if next >= end {
                break;
            }
            let progress = self.request::<UploadChunkEndpoint<'_>>(&chunk);
            next = progress.expect("the chunk that is due").next_offset as usize;
        }
        next
    }

    pub fn upload(&mut self, library: &[u8]) -> UploadCommitted {
        self.try_upload(library).expect("the link holds")
    }

    /// Goes on with an upload of `library` until it is committed. Returns `None` if the link breaks before.
    pub fn try_upload(&mut self, library: &[u8]) -> Option<UploadCommitted> {
        let begun = self
            .try_request::<UploadBeginEndpoint>(&announced(library))?
            .expect("the library fits a slot");
        for chunk in chunks(library, begun.next_offset as usize, MAX_CHUNK_BYTES) {
            self.try_request::<UploadChunkEndpoint<'_>>(&chunk)?
                .expect("the chunk that is due");
        }
        Some(self.try_request::<UploadCommitEndpoint>(&())?.expect("a valid library"))
    }

    /// Uploads with up to `window` chunks under way before the first of them is answered, like the product's client
    /// with [`UPLOAD_WINDOW`](model_format::link::UPLOAD_WINDOW).
    pub fn upload_ahead(&mut self, library: &[u8], window: usize) -> UploadCommitted {
        self.begin_upload(library);
        self.send_ahead(library, window);
        self.request::<UploadCommitEndpoint>(&()).expect("a valid library")
    }

    /// Sends all chunks of `bytes`, with up to `window` chunks under way before the first of them is answered.
    pub fn send_ahead(&mut self, bytes: &[u8], window: usize) {
        let mut chunks = chunks(bytes, 0, MAX_CHUNK_BYTES);
        let mut on_their_way = VecDeque::new();
        loop {
            while on_their_way.len() < window
                && let Some(chunk) = chunks.next()
            {
                let sequence = self.send_frame(UploadChunkEndpoint::REQ_KEY, &chunk);
                on_their_way.push_back(sequence);
            }
            let Some(first) = on_their_way.pop_front() else {
                break;
            };
            self.answer::<UploadChunkEndpoint<'_>>(first)
                .expect("the link holds")
                .expect("the chunk that is due");
        }
    }

    pub fn activate(&mut self, slot: SlotId) -> Activated {
        self.request::<ActivateEndpoint>(&slot).expect("a valid slot")
    }

    /// Sets the settings without which nothing plays, as the owner of the coil does. The values are those of
    /// `Settings::default`.
    pub fn set_coil(&mut self) {
        let values: Vec<SettingChange> = SettingSet::REQUIRED.iter().map(default_of).collect();
        self.change_settings(&values).expect("in range, and nothing is played");
    }

    /// Proposes new values of settings, and applies them.
    pub fn change_settings(&mut self, values: &[SettingChange]) -> Result<Settings, SettingsError> {
        self.propose_and_apply(&SettingsChange::of(values)?)
    }

    /// Proposes to reset the settings, and resets them.
    pub fn reset_settings(&mut self) -> Result<Settings, SettingsError> {
        self.propose_and_apply(&SettingsChange::Reset)
    }

    fn propose_and_apply(&mut self, change: &SettingsChange) -> Result<Settings, SettingsError> {
        let proposal = self.request::<SettingsProposeEndpoint>(change)?;
        self.request::<SettingsApplyEndpoint>(&proposal.token)
    }

    /// Starts a play, and sends keep-alives from then on.
    pub fn plays(&mut self, request: &PlayRequest) {
        self.keep_alive(true);
        self.request::<PlayEndpoint>(request).expect("it is in the library");
    }

    pub fn play(&mut self, texture: &str, seed: u64) {
        self.plays(&play_request(texture, seed));
    }

    pub fn play_scene(&mut self, scene: &str, seed: u64) {
        self.plays(&scene_request(scene, seed));
    }

    /// Plays a texture, and waits until nothing mutes the output.
    pub fn play_until_heard(&mut self, texture: &str) {
        self.play(texture, 9);
        self.wait_until_heard();
    }

    /// Runs until nothing mutes the output.
    pub fn wait_until_heard(&mut self) {
        for _ in 0..100 {
            self.run_for(5 * MS);
            if self.status().output.mute == MuteReasons::NONE {
                return;
            }
        }
        panic!("still muted: {:?}", self.status().output);
    }
}

/// Checks that no tick was missed, and no block, conversion or output was late.
pub fn assert_on_time(tick: &TickCounters) {
    let on_time = TickCounters {
        ticks: tick.ticks,
        ..TickCounters::default()
    };
    assert_eq!(*tick, on_time);
}

/// Checks that outputs are 25 µs apart.
pub fn assert_even(outputs: &[Output]) {
    let uneven = (outputs.windows(2)).find(|pair| pair[1].at_ns - pair[0].at_ns != CODE_NS);
    assert_eq!(uneven, None, "instants that are not 25 µs apart");
}

/// The change of `setting` to its default.
pub fn default_of(setting: Setting) -> SettingChange {
    change(setting, setting.spec().default)
}

/// A request to play a texture that follows the sensors.
pub fn play_request(texture: &str, seed: u64) -> PlayRequest {
    PlayRequest {
        selection: Selection::Texture(texture.try_into().expect("a texture's name fits")),
        gain: 1.0,
        motion: MotionSource::Sensors,
        seed,
    }
}

/// A request to play a scene that follows the sensors.
pub fn scene_request(scene: &str, seed: u64) -> PlayRequest {
    PlayRequest {
        selection: Selection::Scene(scene.try_into().expect("a scene's name fits")),
        ..play_request("", seed)
    }
}
