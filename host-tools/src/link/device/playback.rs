//! Requests about what is played.

use std::thread;
use std::time::Instant;

use model_format::link::{
    Activity, CycleReport, CyclesEndpoint, KeepAliveTopic, MotionSample, MotionTopic, OutputStatus,
    PlayEndpoint, PlayError, PlayRequest, Playing, StopEndpoint, StopError,
};

use super::connection::{Device, POLL_INTERVAL};
use crate::link::error::{LinkError, Result};

impl Device {
    /// Plays a texture or scene of the active library.
    ///
    /// # Errors
    /// A refusal, after which the device goes on with what it played before; one of a name that is not there lists
    /// those that are. An answer that names another request.
    pub fn play(&self, request: &PlayRequest) -> Result<Playing> {
        self.requester.health.begin();
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

    /// `refusal`, with the names of the active library if it lacks the one that was asked for.
    fn with_names(&self, refusal: PlayError) -> LinkError {
        let (what, name) = match &refusal {
            PlayError::NoSuchTexture { name } => ("texture", name.to_string()),
            PlayError::NoSuchScene { name } => ("scene", name.to_string()),
            _ => return refusal.into(),
        };
        let names = || -> Result<Vec<String>> {
            let Some(slot) = self.status()?.active else {
                return Ok(Vec::new());
            };
            Ok(if what == "texture" {
                let textures = self.textures(slot)?.into_iter();
                textures.map(|texture| texture.name.to_string()).collect()
            } else {
                let scenes = self.scenes(slot)?.into_iter();
                scenes.map(|scene| scene.name.to_string()).collect()
            })
        };
        match names() {
            Ok(there) => LinkError::Absent { what, name, there },
            // The refusal is what the user asked about, whatever became of the link since.
            Err(_) => refusal.into(),
        }
    }

    /// Stops the output, and waits until the status reports it at rest.
    ///
    /// Returns true if anything was played, and the output's status at rest.
    ///
    /// # Errors
    /// A lost link, or an output that does not come to rest.
    pub fn stop(&self) -> Result<(bool, OutputStatus)> {
        let was_playing = match self.request::<StopEndpoint>("stop", &())? {
            Ok(_) => true,
            Err(StopError::NotPlaying) => false,
        };
        let begin = Instant::now();
        loop {
            let output = self.status()?.output;
            if output.activity == Activity::Idle {
                return Ok((was_playing, output));
            }
            if begin.elapsed() >= self.timeouts().answer {
                return Err(self.not_verified(
                    "the device was stopped, but its output is not at rest: stop it again, or disconnect its power"
                        .to_owned(),
                ));
            }
            thread::sleep(POLL_INTERVAL);
        }
    }

    /// Reads the durations of tick and update since the call before, and begins them anew.
    ///
    /// # Errors
    /// A lost link or a missing answer.
    pub fn take_cycles(&self) -> Result<CycleReport> {
        self.request::<CyclesEndpoint>("cycles", &())
    }

    /// Sends a motion without waiting for an acknowledgement.
    ///
    /// # Errors
    /// A lost link, or one that accepts no more frames.
    pub fn publish_motion(&self, sample: MotionSample) -> Result<()> {
        self.runtime()
            .block_on(self.requester.publish::<MotionTopic>(&sample))
    }

    /// Sends a keep-alive, which shows the device that the host still runs.
    ///
    /// # Errors
    /// A lost link, or one that accepts no more frames.
    pub fn keep_alive(&self) -> Result<()> {
        self.runtime()
            .block_on(self.requester.publish::<KeepAliveTopic>(&()))
    }
}
