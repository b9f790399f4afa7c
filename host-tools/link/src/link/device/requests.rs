//! Requests about the libraries in the device, playing, recordings, the self test and the settings.

use std::thread;
use std::time::{Duration, Instant};

use model_format::link::{
    ActivateEndpoint, Activated, Activity, CycleReport, CyclesEndpoint, KeepAliveTopic, ListEndpoint, ListRequest,
    ListSceneEndpoint, MotionSample, MotionTopic, OutputStatus, PlayEndpoint, PlayError, PlayRequest, Playing,
    RecordBlock, RecordBlockTopic, RecordStartEndpoint, RecordStarted, RecordStopEndpoint, RecordStopped, SceneInfo,
    SelfTestEndpoint, SelfTestRequest, SelfTestValues, SettingChange, Settings, SettingsApplyEndpoint, SettingsChange,
    SettingsGetEndpoint, SettingsProposal, SettingsProposeEndpoint, SlotId, SlotInfo, SlotState, Slots, SlotsEndpoint,
    StopEndpoint, StopError, TextureInfo,
};
use postcard_rpc::host_client::{MultiSubRxError, MultiSubscription};
use serde::Serialize;
use stylus_support::names::nearly;

use super::connection::{Device, POLL_INTERVAL};
use crate::link::error::{LinkError, Result};

impl Device {
    /// Reads the content of both slots.
    pub fn slots(&self) -> Result<Slots> {
        // The device may have to read and check a whole slot.
        self.request_flash::<SlotsEndpoint>("slot list", &())
    }

    /// The library that was uploaded last, with its slot; none if no slot holds a library.
    pub fn newest(&self) -> Result<Option<(SlotId, SlotInfo)>> {
        Ok(SlotId::ALL
            .into_iter()
            .zip(self.slots()?.slots)
            .filter_map(|(id, state)| match state {
                SlotState::Valid(library) => Some((id, library)),
                _ => None,
            })
            .max_by_key(|(_, library)| library.sequence))
    }

    /// Reads the list of textures in `slot`; an empty one if the slot holds no library.
    pub fn textures(&self, slot: SlotId) -> Result<Vec<TextureInfo>> {
        let count = match &self.slots()?.slots[slot.index()] {
            SlotState::Valid(library) => library.textures,
            _ => 0,
        };
        // An index has one byte: a library holds at most 256 textures.
        (0..=u8::MAX)
            .take(usize::from(count))
            .map(|index| {
                let request = ListRequest { slot, index };
                Ok(self.request_flash::<ListEndpoint>("texture list", &request)??)
            })
            .collect()
    }

    /// Reads the list of scenes in `slot`; an empty one if the slot holds no library.
    pub fn scenes(&self, slot: SlotId) -> Result<Vec<SceneInfo>> {
        let count = match &self.slots()?.slots[slot.index()] {
            SlotState::Valid(library) => library.scenes,
            _ => 0,
        };
        (0..count)
            .map(|index| {
                let request = ListRequest { slot, index };
                Ok(self.request_flash::<ListSceneEndpoint>("scene list", &request)??)
            })
            .collect()
    }

    /// Activates the library in `slot`, and confirms this by the status.
    ///
    /// # Errors
    /// A refusal, or a status that names another library as active.
    pub fn activate(&self, slot: SlotId) -> Result<Activated> {
        let activated = self.request_flash::<ActivateEndpoint>("activation", &slot)??;
        let mut limit = self.limit(self.timeouts().answer);
        loop {
            // Asked before the reading, so that an old reading does not decide after a pause of this computer.
            let is_last = limit.has_passed();
            let status = self.status()?;
            let crc32 = activated.library.crc32;
            if status.active == Some(slot) && status.library_crc32 == crc32 {
                return Ok(activated);
            }
            if is_last {
                return Err(self.not_verified(format!(
                    "slot {slot} was activated, but the status reports {} as active: activate it again",
                    status
                        .active
                        .map_or("no slot".to_owned(), |slot| format!("slot {slot}"))
                )));
            }
            thread::sleep(POLL_INTERVAL);
        }
    }
}

impl Device {
    /// Plays a texture or scene of the active library.
    ///
    /// # Errors
    /// A refusal, after which the device continues to play what it played before, or an answer that names another
    /// request. If the library lacks the requested name, the error lists the names that it has.
    pub fn play(&self, request: &PlayRequest) -> Result<Playing> {
        let answer = self.request::<PlayEndpoint>("play", request)?;
        let playing = answer.map_err(|refusal| self.with_names(refusal))?;
        if playing.request == *request {
            Ok(playing)
        } else {
            Err(self.not_verified(format!(
                "the device plays {} instead of {}: stop it, then play again",
                playing.request.selection, request.selection
            )))
        }
    }

    /// Returns the error for `refusal`. If the active library lacks the requested name, the error lists the names that
    /// it has.
    fn with_names(&self, refusal: PlayError) -> LinkError {
        let (what, other, name) = match &refusal {
            PlayError::NoSuchTexture { name } => ("texture", "scene", name.to_string()),
            PlayError::NoSuchScene { name } => ("scene", "texture", name.to_string()),
            _ => return refusal.into(),
        };
        let names = || -> Result<[Vec<String>; 2]> {
            let Some(slot) = self.status()?.active else {
                return Ok([Vec::new(), Vec::new()]);
            };
            let textures = self.textures(slot)?.into_iter();
            let scenes = self.scenes(slot)?.into_iter();
            let names = [
                textures.map(|texture| texture.name.to_string()).collect(),
                scenes.map(|scene| scene.name.to_string()).collect(),
            ];
            Ok(names)
        };
        match names() {
            Ok([textures, scenes]) => {
                let (there, others) = match what {
                    "texture" => (textures, scenes),
                    _ => (scenes, textures),
                };
                let hint = match nearly(&name, &others) {
                    Some(found) => format!("; '{found}' is a {other} of it"),
                    None => String::new(),
                };
                LinkError::Absent {
                    what,
                    name,
                    there,
                    hint,
                }
            }
            // The refusal is reported to the user, even if the link has failed since.
            Err(_) => refusal.into(),
        }
    }

    /// Stops the output, and waits until the status reports it at rest.
    ///
    /// Returns true if anything was played, and the output's status at rest.
    pub fn stop(&self) -> Result<(bool, OutputStatus)> {
        let was_playing = match self.request::<StopEndpoint>("stop", &())? {
            Ok(_) => true,
            Err(StopError::NotPlaying) => false,
        };
        let mut limit = self.limit(self.timeouts().answer);
        loop {
            // The output first falls to mid-scale by the ramp of `mute-ramp`. The limit is asked before the reading, so
            // that an old reading does not decide after a pause of this computer.
            let is_last = limit.has_passed();
            let output = self.status()?.output;
            if output.activity == Activity::Idle {
                return Ok((was_playing, output));
            }
            if is_last {
                return Err(self.not_verified(
                    "the device was stopped, but its output is not at rest: stop it again, or disconnect its power"
                        .to_owned(),
                ));
            }
            thread::sleep(POLL_INTERVAL);
        }
    }

    /// Reads the durations of tick and update since the previous call, and resets them.
    pub fn take_cycles(&self) -> Result<CycleReport> {
        self.request::<CyclesEndpoint>("cycles", &())
    }

    /// Sends a motion without waiting for an acknowledgement.
    pub fn publish_motion(&self, sample: MotionSample) -> Result<()> {
        self.runtime().block_on(self.requester.publish::<MotionTopic>(&sample))
    }

    /// Sends a keep-alive, which shows the device that the host still runs.
    pub fn keep_alive(&self) -> Result<()> {
        self.runtime().block_on(self.requester.publish::<KeepAliveTopic>(&()))
    }
}

/// Capacity of the queue of received blocks: half a minute.
const WAITING_BLOCKS: usize = 4096;

impl Device {
    /// Starts a recording, whose blocks are then queued in [`Blocks`].
    pub(in crate::link) fn record_start(&self) -> Result<(RecordStarted, Blocks)> {
        // The subscription precedes the request, because the first blocks may arrive before its answer.
        let client = &self.requester.client;
        let subscription = self
            .runtime()
            .block_on(client.subscribe_multi::<RecordBlockTopic>(WAITING_BLOCKS))
            .map_err(|_| self.requester.lost())?;
        let mut blocks = Blocks { subscription };
        // Blocks of an earlier recording may still be on the way.
        while blocks.next(self, Duration::ZERO)?.is_some() {}
        let started = self.request::<RecordStartEndpoint>("record start", &())??;
        Ok((started, blocks))
    }

    /// Stops a recording.
    pub fn record_stop(&self) -> Result<RecordStopped> {
        Ok(self.request::<RecordStopEndpoint>("record stop", &())??)
    }
}

/// Queue of the blocks of a recording, in the order of their arrival.
pub(in crate::link) struct Blocks {
    subscription: MultiSubscription<RecordBlock>,
}

impl Blocks {
    /// Returns the next block, or `None` if none arrives within `within`.
    pub(in crate::link) fn next(&mut self, device: &Device, within: Duration) -> Result<Option<RecordBlock>> {
        let next = async {
            loop {
                match self.subscription.recv().await {
                    Ok(block) => return Ok(block),
                    // The sequence numbers of later blocks show which blocks did not fit into the queue.
                    Err(MultiSubRxError::Lagged(_)) => {}
                    Err(MultiSubRxError::IoClosed) => return Err(device.requester.lost()),
                }
            }
        };
        let next = async { tokio::time::timeout(within, next).await };
        device.runtime().block_on(next).ok().transpose()
    }
}

impl Device {
    /// Makes the device take one measurement, which takes up to some seconds.
    pub fn self_test(&self, request: SelfTestRequest) -> Result<SelfTestValues> {
        Ok(self.request_flash::<SelfTestEndpoint>("self test", &request)??)
    }

    /// Duration of a request and its answer.
    pub fn round_trip(&self) -> Result<Duration> {
        let begin = Instant::now();
        self.status()?;
        Ok(begin.elapsed())
    }
}

impl Device {
    /// Reads the settings.
    pub fn settings(&self) -> Result<Settings> {
        Ok(self.request_flash::<SettingsGetEndpoint>("settings", &())??)
    }

    /// Proposes a change of settings, which [`Device::apply`] applies. Nothing changes yet.
    ///
    /// # Errors
    /// Values that the device refuses, a texture or scene that is playing, or an answer about another change.
    pub fn propose(&self, change: &SettingsChange) -> Result<SettingsProposal> {
        let proposal = self.request::<SettingsProposeEndpoint>("settings proposal", change)??;
        if proposal.change == *change {
            Ok(proposal)
        } else {
            Err(self.not_verified(
                "the device proposed another change of settings than this one: propose it again".to_owned(),
            ))
        }
    }

    /// Applies a change that was proposed over this link, and reads it back.
    pub fn apply(&self, proposal: &SettingsProposal) -> Result<Settings> {
        self.request_flash::<SettingsApplyEndpoint>("settings change", &proposal.token)??;
        let settings = self.settings()?;
        let wrong = match &proposal.change {
            SettingsChange::Set(values) => values
                .iter()
                // Settings are stored and sent as the same 32-bit floats, so equality is exact.
                .find(|change| settings.get(change.setting) != change.value)
                .map(|change| change.setting),
            SettingsChange::Reset => settings
                .iter()
                .find(|change| change.value != change.setting.spec().default)
                .map(|change| change.setting),
        };
        match wrong {
            None => Ok(settings),
            Some(setting) => Err(self.not_verified(format!(
                "settings were changed, but {setting} reads back {}: change them again",
                settings.get(setting)
            ))),
        }
    }

    /// Proposes and applies a change of one setting, and reads it back.
    pub fn set(&self, change: SettingChange) -> Result<Settings> {
        self.set_all(&[change])
    }

    /// Proposes and applies changes of settings, all or none, and reads them back.
    pub fn set_all(&self, changes: &[SettingChange]) -> Result<Settings> {
        self.apply(&self.propose(&SettingsChange::of(changes)?)?)
    }

    /// Proposes and applies a reset of every setting to its default, and reads the settings back.
    pub fn reset_settings(&self) -> Result<Settings> {
        self.apply(&self.propose(&SettingsChange::Reset)?)
    }
}

/// A slot with its content.
#[derive(Clone, Debug, Serialize)]
pub struct SlotContent {
    /// Name of the slot.
    #[serde(rename = "slot")]
    pub name: String,
    /// True if the slot is the one that is played.
    pub active: bool,
    /// State of the slot.
    pub state: SlotState,
    /// Textures of the slot's library; none unless it is valid.
    pub textures: Vec<TextureEntry>,
    /// Scenes of the slot's library.
    pub scenes: Vec<SceneInfo>,
}

/// A texture in the device, with its enums in words.
#[derive(Clone, Debug, Serialize)]
pub struct TextureEntry {
    /// Name.
    pub name: String,
    /// Origin of the texture's recordings.
    pub provenance: String,
    /// Sample rate, Hz.
    pub sample_rate_hz: u32,
    /// Highest order of its nodes.
    pub max_order: u16,
    /// Number of speeds of its grid.
    pub speeds: u8,
    /// Number of forces of its grid.
    pub forces: u8,
    /// Lowest and highest speed, mm/s.
    pub speed_range_mm_s: [f32; 2],
    /// Lowest and highest force, N.
    pub force_range_n: [f32; 2],
    /// Number of nodes that are silent.
    pub silent_nodes: u16,
    /// Number of nodes that were filled from neighbours.
    pub filled_nodes: u16,
    /// Number of nodes with a doubtful recording.
    pub doubtful_nodes: u16,
}

impl From<TextureInfo> for TextureEntry {
    fn from(info: TextureInfo) -> Self {
        Self {
            name: info.name.to_string(),
            provenance: info.provenance.to_string(),
            sample_rate_hz: info.sample_rate_hz,
            max_order: info.max_order,
            speeds: info.speeds,
            forces: info.forces,
            speed_range_mm_s: info.speed_range.map(|speed| speed.0),
            force_range_n: info.force_range.map(|force| force.0),
            silent_nodes: info.silent_nodes,
            filled_nodes: info.filled_nodes,
            doubtful_nodes: info.doubtful_nodes,
        }
    }
}

impl Device {
    /// Lists both slots with their textures and scenes.
    pub fn contents(&self) -> Result<Vec<SlotContent>> {
        let both = self.slots()?;
        let of_slot = |(id, state): (SlotId, SlotState)| {
            let (textures, scenes) = match &state {
                SlotState::Valid(_) => (self.textures(id)?, self.scenes(id)?),
                _ => (Vec::new(), Vec::new()),
            };
            Ok(SlotContent {
                name: id.to_string(),
                active: both.active == Some(id),
                state,
                textures: textures.into_iter().map(TextureEntry::from).collect(),
                scenes,
            })
        };
        SlotId::ALL.into_iter().zip(both.slots.clone()).map(of_slot).collect()
    }
}
