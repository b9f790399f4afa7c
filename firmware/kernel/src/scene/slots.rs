//! Slots of voices: which surface sounds in which slot, and what each voice plays next.
//!
//! A **slot** holds a voice: two frames, of which one may be played while the other is computed, and a playback. A
//! surface that is to sound gets a slot and keeps it while it sounds; one that is no longer wanted fades within a
//! block. A slot's playback changes its texture only after a block in which the tick did not play the slot. There are
//! therefore never more than two voices, however far the tool jumps; a third surface waits up to two blocks for a slot.
//!
//! **A voice begins at its level**, in a stationary state. That state stays stationary at whatever motion it was left,
//! so that a slot which holds the texture already continues from it ([`crate::lattice::LatticeState::stationary`]).

use model_format::Texture;

use super::plan::Plan;
use super::playback::{Block, SLOTS, Stage, VoiceStage};
use super::stick_slip::StickSlipFrame;
use crate::arithmetic::Arithmetic;
use crate::excitation::hashed;
use crate::feed::Feed;
use crate::grid::Motion;
use crate::level::Levels;
use crate::lines::VoiceLines;
use crate::position::Passage;
use crate::synthesis::{Frame, Playback};

/// Storage of the voices. On a device it is shared with the tick; the director never asks for a part that the tick uses
/// at that time.
pub trait Voices {
    /// The arithmetic of frames.
    type Arithmetic: Arithmetic;

    /// Frame `buffer` of `slot`, which the block that is played does not use.
    fn frame(&mut self, slot: usize, buffer: usize) -> &mut Option<Frame>;

    /// The levels of frame `buffer` of `slot`, which the block that is played may use, when `left` samples of its ramps
    /// remain.
    fn levels(&self, slot: usize, buffer: usize, left: u32) -> Levels;

    /// The playback of `slot`, which the block that is played does not use.
    fn playback(&mut self, slot: usize) -> &mut Option<Playback>;
}

/// A surface that is to sound, and its gain in steps of 2⁻¹⁶, which is not 0.
#[derive(Clone, Copy, Debug)]
pub(super) struct Wanted {
    pub surface: u8,
    pub gain: u32,
}

/// The inputs of a block's decision.
#[derive(Clone, Copy)]
pub(super) struct Moment {
    pub motion: Motion,
    pub distance_mm: f32,
    /// Movement of the tool, for lines that are tied to position.
    pub passage: Passage,
    pub samples: u32,
    pub left: u32,
}

/// All slots, and the seed of their excitations.
#[derive(Clone, Debug)]
pub(super) struct Slots<'a> {
    slots: [Slot<'a>; SLOTS],
    seed: u64,
}

#[derive(Clone, Debug)]
struct Slot<'a> {
    /// The texture whose state the playback holds.
    texture: Option<Texture<'a>>,
    /// The excitation of fed textures.
    feed: Feed,
    /// The surface that sounds here, or the last one that did.
    surface: Option<u8>,
    /// Index of the frame that is played, or of the last one that was.
    buffer: usize,
    /// True for each frame that has been prepared for the texture.
    made: [bool; 2],
    /// The motion and gain of each frame's last update, if they are known.
    updated: [Option<(Motion, u32)>; 2],
    /// True if the block that is played uses the slot.
    played: bool,
    /// True if the frame began with that block; otherwise its ramps are at their ends.
    began: bool,
    /// The motion for which the frame was computed.
    motion: Option<Motion>,
    /// The gain at the end of the frame's ramp, in steps of 2⁻¹⁶.
    gain: u32,
    /// The stick-slip of the block that is played.
    stick_slip: Option<StickSlipFrame>,
    /// The lines of the texture, if it has any.
    lines: Option<VoiceLines>,
}

impl<'a> Slots<'a> {
    /// Slots that are all free.
    pub(super) fn new(seed: u64) -> Self {
        Self {
            slots: core::array::from_fn(|index| Slot::new(seed_of(seed, index))),
            seed,
        }
    }

    /// Returns whether any slot is audible at the end of the block that is played, of which `left` samples are not
    /// played.
    pub(super) fn sound(&self, left: u32) -> bool {
        self.slots.iter().any(|slot| slot.sounds(left))
    }

    /// Removes the surfaces from their slots. Playbacks keep their textures.
    pub(super) fn release(&mut self) {
        for slot in &mut self.slots {
            slot.surface = None;
        }
    }

    /// Gives `wanted` surfaces of `plan` their slots, and adds the stages of all voices that sound to `block`.
    pub(super) fn direct(
        &mut self,
        plan: &Plan<'a>,
        wanted: &[Option<Wanted>; SLOTS],
        moment: Moment,
        voices: &mut impl Voices,
        block: &mut Block,
    ) {
        for wanted_one in wanted.iter().flatten() {
            self.find(plan, *wanted_one, wanted, moment.left, voices);
        }
        let gains = self.gains(wanted);
        for (index, gain) in gains.into_iter().enumerate() {
            if let Some(stage) = self.direct_slot(plan, index, gain, moment, voices, block) {
                block.push(stage);
                if self.slots[index].lines.is_some() {
                    block.push(Stage::Lines(index as u8));
                }
            }
        }
    }

    /// The gains of both slots.
    fn gains(&self, wanted: &[Option<Wanted>; SLOTS]) -> [u32; SLOTS] {
        self.slots.each_ref().map(|slot| {
            let mut all = wanted.iter().flatten();
            let one = all.find(|one| Some(one.surface) == slot.surface);
            one.map_or(0, |one| one.gain)
        })
    }

    /// Gives the surface of `one` a slot, unless it has one. A slot is free if it is silent and no other wanted surface
    /// has it. A free slot whose playback holds the same texture is preferred, then one that the tick does not use.
    /// Does nothing if none is free.
    fn find(
        &mut self,
        plan: &Plan<'a>,
        one: Wanted,
        wanted: &[Option<Wanted>; SLOTS],
        left: u32,
        voices: &mut impl Voices,
    ) {
        let surface = Some(one.surface);
        if self.slots.iter().any(|slot| slot.surface == surface) {
            return;
        }
        let planned = plan.surfaces.get(usize::from(one.surface));
        let Some(texture) = planned.and_then(|planned| planned.texture) else {
            return;
        };
        let silent = |slot: &Slot<'_>| {
            let mut all = wanted.iter().flatten();
            !slot.sounds(left) && !all.any(|other| Some(other.surface) == slot.surface)
        };
        let holds = |slot: &Slot<'_>| slot.texture.is_some_and(|held| is_same(&held, &texture));
        let same = |slot: &Slot<'_>| silent(slot) && holds(slot);
        let idle = |slot: &Slot<'_>| silent(slot) && !slot.played;
        let slots = &self.slots;
        let Some(index) = slots.iter().position(same).or_else(|| slots.iter().position(idle)) else {
            return;
        };
        let slot = &mut self.slots[index];
        slot.surface = surface;
        // The amount of sticking was that of the surface before.
        slot.stick_slip = None;
        if holds(slot) {
            return;
        }
        (slot.texture, slot.made, slot.motion) = (Some(texture), [false; 2], None);
        slot.updated = [None; 2];
        slot.lines = VoiceLines::new(&texture);
        let playback = voices.playback(index);
        if let Some(playback) = playback {
            playback.restart(&texture, &mut slot.feed);
        } else {
            let new = playback.insert(Playback::new(&texture, seed_of(self.seed, index)));
            new.begin_feed(&mut slot.feed);
        }
    }

    /// Brings slot `index` to `gain`, and returns its stage if it is to be played.
    fn direct_slot<V: Voices>(
        &mut self,
        plan: &Plan<'a>,
        index: usize,
        gain: u32,
        moment: Moment,
        voices: &mut V,
        block: &mut Block,
    ) -> Option<Stage> {
        let Moment { samples, left, .. } = moment;
        let slot = &mut self.slots[index];
        let texture = slot.texture?;
        if gain == 0 && !slot.sounds(left) {
            (slot.played, slot.stick_slip) = (false, None);
            return None;
        }
        // A voice that fades out keeps its coefficients.
        let motion = if gain == 0 {
            slot.motion.unwrap_or(moment.motion)
        } else {
            moment.motion
        };
        let left_of_frame = slot.left(left);
        if let Some(lines) = &mut slot.lines {
            // Lines of a slot that was not played have no ramp that was cut.
            let left = if slot.played { left } else { 0 };
            let frame = lines.follow(&texture, motion, gain, moment.passage, samples, left);
            block.lines[index].clone_from(frame);
        }
        let goes_on = slot.played && left_of_frame == 0;
        // A frame of a fed texture holds the excitation of one block. Another one is played on without an update if
        // motion and gain stay and its ramps have ended.
        let begins = texture.is_fed() || !(goes_on && slot.gain == gain && slot.motion == Some(motion));
        if begins {
            (slot.motion, slot.gain) = (Some(motion), gain);
            slot.begin_frame(index, left_of_frame, samples, voices)?;
        }
        let voice = VoiceStage {
            slot: index as u8,
            buffer: slot.buffer as u8,
            begins,
        };
        let planned = slot.surface.and_then(|surface| plan.surfaces.get(usize::from(surface)));
        let from = slot.stick_slip.map_or(0, |frame| frame.amount(left));
        slot.stick_slip = planned
            .and_then(|planned| planned.stick_slip)
            .map(|window| window.frame(motion, moment.distance_mm, from, samples))
            .filter(|frame| from > 0 || frame.amount(0) > 0);
        (slot.played, slot.began) = (true, begins);
        Some(match slot.stick_slip {
            Some(frame) => Stage::StickSlip(voice, frame),
            None => Stage::Voice(voice),
        })
    }
}

/// Creates a frame. Not inlined, because it takes kilobytes of the stack; the image creates its frames before it plays.
#[cold]
#[inline(never)]
fn make(place: &mut Option<Frame>) {
    *place = Some(Frame::empty());
}

impl Slot<'_> {
    /// A free slot with the noise of `seed`.
    fn new(seed: u64) -> Self {
        Self {
            texture: None,
            feed: Feed::new(seed),
            surface: None,
            buffer: 0,
            made: [false; 2],
            updated: [None; 2],
            played: false,
            began: false,
            motion: None,
            gain: 0,
            stick_slip: None,
            lines: None,
        }
    }

    /// Computes the slot's other frame for its motion and gain, from the levels of the present frame, of whose ramps
    /// `left` samples are not played. Returns none without a texture or motion.
    fn begin_frame<V: Voices>(&mut self, index: usize, left: u32, samples: u32, voices: &mut V) -> Option<()> {
        let (texture, motion, gain) = (self.texture?, self.motion?, self.gain);
        let from = if self.made[self.buffer] {
            voices.levels(index, self.buffer, left)
        } else {
            Levels::SILENT
        };
        self.buffer = 1 - self.buffer;
        let place = voices.frame(index, self.buffer);
        if place.is_none() {
            make(place);
        }
        let frame = place.as_mut()?;
        if !core::mem::replace(&mut self.made[self.buffer], true) {
            // The buffer may hold another texture's frame, with its order and excitation.
            frame.silence(&texture);
        }
        if self.updated[self.buffer].replace((motion, gain)) == Some((motion, gain)) {
            frame.hold(from, samples);
        } else {
            frame.update_scaled::<V::Arithmetic>(&texture, motion, gain, from, samples);
        }
        if texture.is_fed() {
            frame.feed(&mut self.feed, &texture, motion, samples);
        }
        Some(())
    }

    /// Returns whether the slot is audible at the end of the block that is played, of which `left` samples are not
    /// played.
    fn sounds(&self, left: u32) -> bool {
        self.played && (self.gain > 0 || self.left(left) > 0)
    }

    /// Number of samples of the frame's ramps that are not played if `left` samples of the block are not.
    fn left(&self, left: u32) -> u32 {
        if self.played && self.began { left } else { 0 }
    }
}

/// The seed of a slot's own noise. The first slot has `seed` itself, the second its hash, with which no sum of related
/// seeds coincides.
fn seed_of(seed: u64, slot: usize) -> u64 {
    (0..slot).fold(seed, |seed, _| hashed(seed))
}

/// Returns whether both are the same texture of the same library: the same bytes at the same address.
fn is_same(one: &Texture<'_>, other: &Texture<'_>) -> bool {
    core::ptr::eq(one.name(), other.name())
}
