//! What is played, and why not.
//!
//! A library is exchanged only while the output rests at mid-scale: the mute ramp takes it there first, and so it does where
//! the gain changes. Another texture or scene of the same library and gain takes over while playing goes on: the kernel's
//! director fades one out and the other in. The player says when to be mute; the safety stages say when the output has come to
//! rest.
//!
//! ```text
//!            play                      at rest
//!   Idle -----------> Starting -----------------------> Playing
//!    ^                   ^                                 |
//!    |  at rest          | at rest, another gain           | stop, play, activate
//!    +---------------- FadingOut <-------------------------+
//!    |                   | at rest, a library
//!    |   end             v
//!    +---------------- Activating
//! ```

use model_format::link::{
    ActivateError, Activity, MUTE_REASON_COUNT, MotionSource, MuteReason, MuteReasons, PlayRequest,
    StopError,
};

/// What the rest of the device tells the player.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Observed {
    /// The output is at mid-scale and muted: `safety::State::is_at_rest`, as the tick told it after it saw the present mute.
    pub at_rest: bool,
    /// The motion that is followed is too old.
    pub stale: bool,
    /// Nothing has been heard from the host for too long.
    pub link_lost: bool,
}

/// What the device has to do, at rest.
#[derive(Clone, Debug, PartialEq)]
pub enum Action {
    /// Take up what is asked for, which is there, from silence.
    Start(PlayRequest),
    /// Play nothing.
    Clear,
}

/// How a request is met.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Begin {
    /// When the output has come to rest: [`Action::Start`] says so.
    AtRest,
    /// Now, while what was played goes on until it has faded.
    Switch,
}

/// What comes after the fade.
#[derive(Clone, Debug, PartialEq)]
enum Then {
    Stop,
    Play(PlayRequest),
    Activate,
}

#[derive(Clone, Debug, PartialEq)]
enum Phase {
    Idle,
    Playing(PlayRequest),
    FadingOut(Then),
    Activating,
}

/// What is played, and the reasons for silence.
#[derive(Clone, Debug, PartialEq)]
pub struct Player {
    phase: Phase,
    mute: MuteReasons,
    counts: [u32; MUTE_REASON_COUNT],
}

impl Default for Player {
    fn default() -> Self {
        Self::new()
    }
}

impl Player {
    /// Idle and mute.
    pub const fn new() -> Self {
        Self {
            phase: Phase::Idle,
            mute: MuteReasons::NONE.set(MuteReason::NotPlaying, true),
            counts: [0; MUTE_REASON_COUNT],
        }
    }

    /// Plays `request`, whose texture or scene is there: at once if something is played with the same gain, else at the next
    /// [`Player::poll`] at rest, after what is played has faded out.
    ///
    /// # Errors
    /// A library is being activated, or is about to be.
    pub fn play(&mut self, request: PlayRequest) -> Result<Begin, Busy> {
        if self.is_activating() {
            return Err(Busy);
        }
        if let Phase::Playing(before) = &mut self.phase
            && before.gain == request.gain
        {
            *before = request;
            return Ok(Begin::Switch);
        }
        self.phase = Phase::FadingOut(Then::Play(request));
        self.set(MuteReason::Changing, true);
        self.set(MuteReason::NotPlaying, false);
        Ok(Begin::AtRest)
    }

    /// Fades out and stops.
    ///
    /// # Errors
    /// Nothing is played.
    pub fn stop(&mut self) -> Result<(), StopError> {
        match self.phase {
            Phase::Playing(_) | Phase::FadingOut(Then::Play(_)) => {
                self.phase = Phase::FadingOut(Then::Stop);
                self.set(MuteReason::NotPlaying, true);
                self.set(MuteReason::Changing, false);
                Ok(())
            }
            Phase::FadingOut(Then::Stop) => Ok(()),
            Phase::Idle | Phase::FadingOut(Then::Activate) | Phase::Activating => {
                Err(StopError::NotPlaying)
            }
        }
    }

    /// Fades out, stops, and lets a library be exchanged: when [`Player::may_exchange`] says so.
    ///
    /// # Errors
    /// Another activation is under way.
    pub fn begin_activation(&mut self) -> Result<(), ActivateError> {
        if self.is_activating() {
            return Err(ActivateError::Busy);
        }
        self.phase = Phase::FadingOut(Then::Activate);
        self.set(MuteReason::Changing, true);
        Ok(())
    }

    /// Whether the library may be exchanged now: nothing is played and the output is at rest.
    pub fn may_exchange(&self) -> bool {
        self.phase == Phase::Activating
    }

    /// The exchange is over, or was given up.
    pub fn end_activation(&mut self) {
        if self.is_activating() {
            self.phase = Phase::Idle;
            self.set(MuteReason::NotPlaying, true);
            self.set(MuteReason::Changing, false);
        }
    }

    /// A fault was found: mute until the device is restarted.
    pub fn fault(&mut self) {
        self.set(MuteReason::Fault, true);
    }

    /// Nothing was there to be started: idle, and muted as after a fault, because status must not say that it plays.
    pub fn not_started(&mut self) {
        self.phase = Phase::Idle;
        self.set(MuteReason::NotPlaying, true);
        self.fault();
    }

    /// Takes account of `observed`; what is to be done now. Called every millisecond or so, and after it the tick is to be
    /// told of [`Player::mute`].
    pub fn poll(&mut self, observed: Observed) -> Option<Action> {
        let playing = matches!(self.phase, Phase::Playing(_));
        // Whoever does not play needs no motion and no host.
        self.set(MuteReason::Stale, playing && observed.stale);
        self.set(MuteReason::LinkLost, playing && observed.link_lost);
        if !observed.at_rest {
            return None;
        }
        let phase = core::mem::replace(&mut self.phase, Phase::Idle);
        let (phase, action) = match phase {
            Phase::FadingOut(Then::Play(request)) => {
                self.set(MuteReason::Changing, false);
                // Its motion is judged from the next poll on; one that was never there must not be let through till then.
                self.set(MuteReason::Stale, observed.stale);
                self.set(MuteReason::LinkLost, observed.link_lost);
                (
                    Phase::Playing(request.clone()),
                    Some(Action::Start(request)),
                )
            }
            Phase::FadingOut(Then::Stop) => (Phase::Idle, Some(Action::Clear)),
            Phase::FadingOut(Then::Activate) => (Phase::Activating, Some(Action::Clear)),
            unchanged => (unchanged, None),
        };
        self.phase = phase;
        action
    }

    /// Why the output is mute; none if it is not.
    pub fn mute(&self) -> MuteReasons {
        self.mute
    }

    /// How often each reason began.
    pub fn mute_counts(&self) -> [u32; MUTE_REASON_COUNT] {
        self.counts
    }

    /// Whether something is played or about to be.
    pub fn is_playing(&self) -> bool {
        matches!(self.phase, Phase::Playing(_) | Phase::FadingOut(_))
    }

    /// Where the motion of what is played, or about to be, comes from.
    pub fn motion_source(&self) -> MotionSource {
        match &self.phase {
            Phase::Playing(request) | Phase::FadingOut(Then::Play(request)) => request.motion,
            _ => MotionSource::Sensors,
        }
    }

    /// For the status.
    pub fn activity(&self) -> Activity {
        match &self.phase {
            Phase::Idle => Activity::Idle,
            Phase::Playing(request) => Activity::Playing {
                selection: request.selection.clone(),
                motion: request.motion,
            },
            Phase::FadingOut(_) => Activity::FadingOut,
            Phase::Activating => Activity::Activating,
        }
    }

    fn is_activating(&self) -> bool {
        matches!(
            self.phase,
            Phase::Activating | Phase::FadingOut(Then::Activate)
        )
    }

    fn set(&mut self, reason: MuteReason, on: bool) {
        let begins = on && !self.mute.contains(reason);
        let count = &mut self.counts[reason as usize];
        *count = count.saturating_add(u32::from(begins));
        self.mute = self.mute.set(reason, on);
    }
}

/// A library is being activated.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Busy;
