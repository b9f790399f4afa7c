//! State of playing, and the reasons for silence.
//!
//! A library is exchanged only while the output rests at mid-scale, so the mute ramp goes there first. The same holds
//! for a change of gain or rate. Another texture or scene of the same library, gain and rate begins without a pause:
//! the kernel's director fades the old one out and the new one in. The player decides when to mute; the safety stages
//! report when the output is at rest.
//!
//! | request | phase before | phase after | at rest | at the end |
//! |---|---|---|---|---|
//! | play | Idle, Playing, FadingOut | FadingOut(Play), or Playing without a pause | Playing | |
//! | probe | Idle | FadingOut(Play) | Playing | |
//! | stop | Playing, FadingOut(Play) | FadingOut(Stop) | Idle | |
//! | activation | Idle, Playing, FadingOut | FadingOut(Activate) | Activating | Idle |
//! | configuration | Idle | Configuring | | Idle |
//!
//! An activation cannot be interrupted. While settings are stored, the self test measures, or an update is committed,
//! the player is Configuring instead of Idle, and nothing begins to play. Otherwise new settings could replace the gain
//! of something that began meanwhile.

use model_format::PlayRate;
use model_format::link::{
    ActivateError, Activity, MUTE_REASON_COUNT, MotionSource, MuteReason, MuteReasons, PlayRequest, StopError,
};

/// State of the rest of the device, as the player sees it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[expect(clippy::struct_excessive_bools, reason = "each is an observation of its own")]
pub struct Observed {
    /// The output is at mid-scale and muted: `safety::State::is_at_rest`, after the tick has seen the present mute.
    pub at_rest: bool,
    /// The motion that is followed is too old.
    pub stale: bool,
    /// The motion is too old because the force sensor is at a rail of its converter.
    pub railed: bool,
    /// The lease of the link that plays has lapsed.
    pub link_lost: bool,
}

/// A piece that is played.
#[derive(Clone, Debug, PartialEq)]
pub enum Piece {
    /// A texture or scene.
    Selected(PlayRequest),
    /// A probe, which follows no motion.
    Probe(Probe),
}

/// A probe that is played.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Probe {
    /// Tick after the probe's last sample, at which the probe ends.
    pub end_tick: u64,
    /// The setting `output-gain` with which the probe is played.
    pub output_gain: f32,
}

/// Action of the device, at rest.
#[derive(Clone, Debug, PartialEq)]
pub enum Action {
    /// Start the plan that was prepared for this piece, from silence, at this rate.
    Start(Piece, PlayRate),
    /// Play nothing.
    Clear,
}

/// Time at which a request takes effect.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Begin {
    /// Once the output is at rest, by [`Action::Start`].
    AtRest,
    /// At once: the director fades what is played.
    Switch,
}

/// Step after the fade-out.
#[derive(Clone, Debug, PartialEq)]
enum Then {
    Stop,
    Play(Piece, PlayRate),
    Activate,
}

#[derive(Clone, Debug, PartialEq)]
enum Phase {
    Idle,
    Playing(Piece, PlayRate),
    FadingOut(Then),
    Activating,
    Configuring,
}

/// State of playing, and the reasons for silence.
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
    /// A player that is idle and mute.
    pub const fn new() -> Self {
        Self {
            phase: Phase::Idle,
            mute: MuteReasons::NONE.set(MuteReason::NotPlaying, true),
            counts: [0; MUTE_REASON_COUNT],
        }
    }

    /// Plays `request`, whose texture or scene exists and has `rate`: at once if a texture or scene is played with the
    /// same gain at the same rate, otherwise at the next [`Player::poll`] at rest, after the fade-out.
    ///
    /// # Errors
    /// A library is being activated or about to be, or the player is configuring.
    pub fn play(&mut self, request: PlayRequest, rate: PlayRate) -> Result<Begin, Busy> {
        if self.is_busy() {
            return Err(Busy);
        }
        // Gain and rate belong to the safety stages, which the director's fade does not reach.
        if let Phase::Playing(Piece::Selected(before), rate_before) = &mut self.phase
            && before.gain == request.gain
            && *rate_before == rate
        {
            *before = request;
            return Ok(Begin::Switch);
        }
        self.begin(Piece::Selected(request), rate);
        Ok(Begin::AtRest)
    }

    /// Plays `probe` at `rate` at the next [`Player::poll`].
    ///
    /// # Errors
    /// Something is played, a library is being activated, or the player is configuring.
    pub fn probe(&mut self, probe: Probe, rate: PlayRate) -> Result<(), Busy> {
        if !self.is_idle() {
            return Err(Busy);
        }
        self.begin(Piece::Probe(probe), rate);
        Ok(())
    }

    /// The probe that is played or about to be.
    pub fn probing(&self) -> Option<Probe> {
        match self.phase {
            Phase::Playing(Piece::Probe(probe), _) | Phase::FadingOut(Then::Play(Piece::Probe(probe), _)) => {
                Some(probe)
            }
            _ => None,
        }
    }

    fn begin(&mut self, piece: Piece, rate: PlayRate) {
        self.phase = Phase::FadingOut(Then::Play(piece, rate));
        self.set(MuteReason::Changing, true);
        self.set(MuteReason::NotPlaying, false);
    }

    /// Fades out and stops.
    pub fn stop(&mut self) -> Result<(), StopError> {
        match self.phase {
            Phase::Playing(..) | Phase::FadingOut(Then::Play(..)) => {
                self.phase = Phase::FadingOut(Then::Stop);
                self.set(MuteReason::NotPlaying, true);
                self.set(MuteReason::Changing, false);
                Ok(())
            }
            Phase::FadingOut(Then::Stop) => Ok(()),
            Phase::Idle | Phase::FadingOut(Then::Activate) | Phase::Activating | Phase::Configuring => {
                Err(StopError::NotPlaying)
            }
        }
    }

    /// Fades out and stops, so that the library can be exchanged once [`Player::may_exchange`] is true.
    ///
    /// # Errors
    /// Another activation is under way, or the player is configuring.
    pub fn begin_activation(&mut self) -> Result<(), ActivateError> {
        if self.is_busy() {
            return Err(ActivateError::Busy);
        }
        self.phase = Phase::FadingOut(Then::Activate);
        self.set(MuteReason::Changing, true);
        Ok(())
    }

    /// Returns true if the library may be exchanged: nothing is played and the output is at rest.
    pub fn may_exchange(&self) -> bool {
        self.phase == Phase::Activating
    }

    /// Ends the activation, with or without an exchange.
    pub fn end_activation(&mut self) {
        if self.is_activating() {
            self.phase = Phase::Idle;
            self.set(MuteReason::NotPlaying, true);
            self.set(MuteReason::Changing, false);
        }
    }

    /// Prevents playing until [`Player::end_configuration`], so that settings can be exchanged or the output measured.
    ///
    /// # Errors
    /// Something is played, a library is being activated, or the player is configuring already.
    pub fn begin_configuration(&mut self) -> Result<(), Busy> {
        if self.phase != Phase::Idle {
            return Err(Busy);
        }
        self.phase = Phase::Configuring;
        Ok(())
    }

    /// Ends what [`Player::begin_configuration`] began.
    pub fn end_configuration(&mut self) {
        if self.phase == Phase::Configuring {
            self.phase = Phase::Idle;
        }
    }

    /// Mutes until the next start, because this start is in safe mode.
    pub fn safe_mode(&mut self) {
        self.set(MuteReason::SafeMode, true);
    }

    /// Becomes idle, and muted by a fault until the device is restarted. Called when there is no prepared plan to
    /// start, because the status must not report that something is played.
    pub fn not_started(&mut self) {
        self.phase = Phase::Idle;
        self.set(MuteReason::NotPlaying, true);
        self.set(MuteReason::Fault, true);
    }

    /// Advances the player by `observed` and returns the action that is due. Called about every millisecond; the caller
    /// then passes [`Player::mute`] to the tick.
    pub fn poll(&mut self, observed: Observed) -> Option<Action> {
        let playing = matches!(self.phase, Phase::Playing(..));
        let follows = matches!(self.phase, Phase::Playing(Piece::Selected(_), _));
        // Without playing, neither motion nor host is needed.
        self.set(MuteReason::Stale, follows && observed.stale);
        self.set(MuteReason::ForceRail, follows && observed.railed);
        self.set(MuteReason::LinkLost, playing && observed.link_lost);
        if !observed.at_rest {
            return None;
        }
        let phase = core::mem::replace(&mut self.phase, Phase::Idle);
        let (phase, action) = match phase {
            Phase::FadingOut(Then::Play(piece, rate)) => {
                self.set(MuteReason::Changing, false);
                // The next poll sets these again, but a stale motion or a lost link must mute until then, too.
                let follows = matches!(piece, Piece::Selected(_));
                self.set(MuteReason::Stale, follows && observed.stale);
                self.set(MuteReason::LinkLost, observed.link_lost);
                (Phase::Playing(piece.clone(), rate), Some(Action::Start(piece, rate)))
            }
            Phase::FadingOut(Then::Stop) => (Phase::Idle, Some(Action::Clear)),
            Phase::FadingOut(Then::Activate) => (Phase::Activating, Some(Action::Clear)),
            unchanged => (unchanged, None),
        };
        self.phase = phase;
        action
    }

    /// Reasons for which the output is mute; none if it is not.
    pub fn mute(&self) -> MuteReasons {
        self.mute
    }

    /// Number of times that each reason has begun.
    pub fn mute_counts(&self) -> [u32; MUTE_REASON_COUNT] {
        self.counts
    }

    /// Returns true if nothing is played, activated or stored.
    pub fn is_idle(&self) -> bool {
        self.phase == Phase::Idle
    }

    /// Source of motion for what is played or about to be.
    pub fn motion_source(&self) -> MotionSource {
        match &self.phase {
            Phase::Playing(Piece::Selected(request), _) | Phase::FadingOut(Then::Play(Piece::Selected(request), _)) => {
                request.motion
            }
            _ => MotionSource::Sensors,
        }
    }

    /// Activity, for the status.
    pub fn activity(&self) -> Activity {
        match &self.phase {
            Phase::Idle | Phase::Configuring => Activity::Idle,
            Phase::Playing(Piece::Selected(request), _) => Activity::Playing {
                selection: request.selection.clone(),
                motion: request.motion,
            },
            _ if self.probing().is_some() => Activity::Probing,
            Phase::Playing(..) | Phase::FadingOut(_) => Activity::FadingOut,
            Phase::Activating => Activity::Activating,
        }
    }

    /// Returns true while a library is being activated or about to be, or the player is configuring: nothing may begin
    /// to play.
    pub fn is_busy(&self) -> bool {
        self.is_activating() || self.phase == Phase::Configuring
    }

    fn is_activating(&self) -> bool {
        matches!(self.phase, Phase::Activating | Phase::FadingOut(Then::Activate))
    }

    fn set(&mut self, reason: MuteReason, on: bool) {
        // The poll sets the same reasons again every millisecond; only the first time counts.
        let begins = on && !self.mute.contains(reason);
        let count = &mut self.counts[reason as usize];
        *count = count.saturating_add(u32::from(begins));
        self.mute = self.mute.set(reason, on);
    }
}

/// Refusal because of what the player is doing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Busy;
