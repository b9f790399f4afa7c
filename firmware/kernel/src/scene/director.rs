//! The half of a scene that decides, once per block, below the tick.
//!
//! A **slot** holds a voice: two frames, of which one may be played while the other is computed, and a playback. A
//! surface that is to sound gets a slot and keeps it as long as it sounds; one that is no longer wanted fades within a
//! block. A slot's playback changes its texture only after a block in which the tick did not play the slot. There are
//! therefore never more than two voices, however far the tool jumps; a third surface waits one block for a slot.

use model_format::Texture;

use super::block::{Block, SLOTS, Stage, VoiceStage};
use super::interaction::Interaction;
use super::path::Located;
use super::plan::{Plan, PlannedTexture};
use super::playback::Ringing;
use super::stick_slip::StickSlipFrame;
use super::tap::{Resonance, Strike};
use crate::grid::{Motion, ONE};
use crate::level::{Levels, Ramp};
use crate::synthesis::{Frame, Playback};

/// Storage of the voices. On a device it is shared with the tick; the director never asks for a part that the tick uses
/// at that time.
pub trait Voices {
    /// Frame `buffer` of `slot`, which the block that is played does not use.
    fn frame(&mut self, slot: usize, buffer: usize) -> &mut Option<Frame>;

    /// The levels of frame `buffer` of `slot`, which the block that is played may use, with `left` samples of its
    /// ramps to come.
    fn levels(&self, slot: usize, buffer: usize, left: u32) -> Levels;

    /// The playback of `slot`, which the block that is played does not use.
    fn playback(&mut self, slot: usize) -> &mut Option<Playback>;
}

/// Decides the stages of each block.
#[derive(Clone, Debug)]
pub struct Director<'a> {
    plan: Plan<'a>,
    next_plan: Option<Plan<'a>>,
    /// Number of plans played, this one included.
    plans: u32,
    seed: u64,
    slots: [Slot<'a>; SLOTS],
    tap: Option<Resonance>,
    /// The contact that began with the block that is played, and whose tap is to be struck.
    touched: Option<Touch>,
    /// True if the block that is played begins with a strike, which `ringing` may not show yet.
    struck: bool,
    /// True if the block that is played feeds the equaliser.
    fed: bool,
    /// The fade of the block that is played.
    fading: Option<Ramp>,
    before: Option<Before>,
}

/// The interaction of the block before.
#[derive(Clone, Copy, Debug)]
struct Before {
    interaction: Interaction,
    samples: u32,
}

#[derive(Clone, Debug, Default)]
struct Slot<'a> {
    /// The texture whose state the playback holds.
    texture: Option<PlannedTexture<'a>>,
    /// The surface that sounds here, or last did.
    surface: Option<u8>,
    /// Index of the frame that is played, or last was.
    buffer: usize,
    /// True for each frame that was made for the texture.
    made: [bool; 2],
    /// True if the block that is played uses the slot.
    played: bool,
    /// True if the frame began with that block; otherwise its ramps are at their ends.
    began: bool,
    /// The motion that the frame was computed for.
    motion: Option<Motion>,
    /// The gain at the end of the frame's ramp, in steps of 2⁻¹⁶.
    gain: u32,
    /// The stick-slip of the block that is played.
    stick_slip: Option<StickSlipFrame>,
}

/// A contact whose tap is yet to be struck.
#[derive(Clone, Copy, Debug)]
struct Touch {
    /// Index of the surface.
    surface: usize,
    /// Rate of force of the block in which it began, N/s.
    rate_n_s: f32,
}

/// A surface that is to sound, with its gain in steps of 2⁻¹⁶, which is not 0.
#[derive(Clone, Copy, Debug)]
struct Wanted {
    surface: u8,
    gain: u32,
}

/// The inputs of a block's decision.
#[derive(Clone, Copy)]
struct Moment {
    motion: Motion,
    distance_mm: f32,
    samples: u32,
    left: u32,
}

impl<'a> Director<'a> {
    /// A director of `plan`. The same `seed` gives the same samples on every machine.
    pub fn new(plan: Plan<'a>, seed: u64) -> Self {
        Self {
            plan,
            next_plan: None,
            plans: 1,
            seed,
            slots: [Slot::default(), Slot::default()],
            tap: None,
            touched: None,
            struck: false,
            fed: false,
            fading: None,
            before: None,
        }
    }

    /// Changes to `plan` from the next block on, as soon as what sounds has faded. That takes one block, and one more
    /// if a voice needs a slot that was played until then.
    pub fn switch(&mut self, plan: Plan<'a>) {
        self.next_plan = Some(plan);
    }

    /// Returns whether a plan waits for what sounds to fade.
    pub fn is_switching(&self) -> bool {
        self.next_plan.is_some()
    }

    /// The plan that is played.
    pub fn plan(&self) -> &Plan<'a> {
        &self.plan
    }

    /// Decides the stages of the next block, of `samples` samples, writes them to `block`, and computes its frames.
    ///
    /// `ringing` is the value of [`super::ScenePlayback::ringing`] after the block that is played had begun. `left`
    /// is the number of samples of that block's ramps that will not be played: 0 if blocks are played to their end.
    ///
    /// The work is bounded: at most two [`Frame::update`]s and some thousand instructions.
    pub fn next_block(
        &mut self,
        interaction: Interaction,
        samples: u32,
        left: u32,
        ringing: Ringing,
        voices: &mut impl Voices,
        block: &mut Block,
    ) {
        let resets = self.take_up_next_plan(left, ringing);
        let ringing = if resets { Ringing::default() } else { ringing };
        block.stages.clear();
        (block.samples, block.resets) = (samples, resets);
        if block.equaliser_of != self.plans {
            block.equaliser.clone_from(&self.plan.equaliser);
            block.equaliser_of = self.plans;
        }
        let located = self.locate(&interaction);
        let moment = self.moment(&interaction, samples, left);
        self.direct_voices(&self.wanted(&located), moment, voices, block);
        let impact = self.impact(&interaction, &located);
        self.direct_tap(impact, ringing, block);
        self.direct_equaliser(ringing, block);
        self.direct_fade(moment, block);
        self.before = Some(Before {
            interaction,
            samples,
        });
    }

    /// Changes to the plan that waits, once nothing sounds. Returns true if it did, and what still rings is to be
    /// reset.
    fn take_up_next_plan(&mut self, left: u32, ringing: Ringing) -> bool {
        let faded = self.fading.is_some_and(|ramp| ramp.value(left) == 0);
        let feeds = self.fed && !self.plan.equaliser.is_empty();
        let rings = self.tap.is_some() || ringing.equaliser || feeds;
        let sounds = self.slots.iter().any(|slot| slot.sounds(left));
        if (sounds || rings) && !faded {
            return false;
        }
        let Some(plan) = self.next_plan.take() else {
            return false;
        };
        self.plan = plan;
        self.plans = self.plans.wrapping_add(1);
        for slot in &mut self.slots {
            slot.surface = None;
        }
        (self.tap, self.touched, self.fading) = (None, None, None);
        (self.struck, self.fed) = (false, false);
        true
    }

    /// The surfaces under the tool; none without contact, and none while a plan waits.
    fn locate(&self, interaction: &Interaction) -> heapless::Vec<Located, 2> {
        if interaction.contact && self.next_plan.is_none() {
            self.plan.path.locate(interaction.position_mm())
        } else {
            heapless::Vec::new()
        }
    }

    fn wanted(&self, located: &[Located]) -> [Option<Wanted>; SLOTS] {
        let mut wanted = [None; SLOTS];
        for (place, located) in wanted.iter_mut().zip(located) {
            let surface = located.surface;
            let Some(planned) = self.plan.surfaces.get(usize::from(surface)) else {
                continue;
            };
            let gain = (u64::from(planned.gain) * u64::from(located.weight)) / u64::from(ONE);
            if planned.texture.is_some() && gain > 0 {
                let gain = gain as u32;
                *place = Some(Wanted { surface, gain });
            }
        }
        wanted
    }

    fn moment(&self, interaction: &Interaction, samples: u32, left: u32) -> Moment {
        let rate = self.plan.sample_rate_hz as f32;
        let distance_mm = match (self.plan.constant_motion, &self.before) {
            (Some(motion), _) => motion.speed_mm_s() * samples as f32 / rate,
            (None, Some(before)) => {
                let gone = interaction.position_mm() - before.interaction.position_mm();
                gone.abs() * samples as f32 / before.samples.max(1) as f32
            }
            (None, None) => 0.0,
        };
        Moment {
            motion: self.plan.constant_motion.unwrap_or(interaction.motion),
            distance_mm,
            samples,
            left,
        }
    }

    /// The tap of an impact: a contact that was not there in the block before, on the surface of greater weight.
    /// Contact from the beginning is no impact.
    ///
    /// The tap is struck one block after contact, at the larger rate of force of the two blocks. Contact falls
    /// anywhere in a block, and a force that begins to rise at the block's end shows little of its rate in it.
    fn impact(
        &mut self,
        interaction: &Interaction,
        located: &[Located],
    ) -> Option<(Resonance, Strike)> {
        let before = self.before?;
        let seconds = before.samples.max(1) as f32 / self.plan.sample_rate_hz as f32;
        let rise = interaction.motion.force_n() - before.interaction.motion.force_n();
        let rate_n_s = rise / seconds;
        let touched = self.touched.take();
        if interaction.contact && !before.interaction.contact {
            // The surface at the position itself comes first, and never has the smaller weight.
            self.touched = located.first().map(|there| Touch {
                surface: usize::from(there.surface),
                rate_n_s,
            });
        }
        let touch = touched?;
        let planned = self.plan.surfaces.get(touch.surface)?.tap?;
        let strike = Strike::new(&planned.tap, touch.rate_n_s.max(rate_n_s));
        (!strike.is_silent()).then_some((planned.resonance, strike))
    }

    fn direct_voices(
        &mut self,
        wanted: &[Option<Wanted>; SLOTS],
        moment: Moment,
        voices: &mut impl Voices,
        block: &mut Block,
    ) {
        for wanted_one in wanted.iter().flatten() {
            self.find_slot(*wanted_one, wanted, moment.left, voices);
        }
        for index in 0..SLOTS {
            let surface = self.slots[index].surface;
            let mut all = wanted.iter().flatten();
            let gain = all
                .find(|wanted| Some(wanted.surface) == surface)
                .map_or(0, |wanted| wanted.gain);
            if let Some(stage) = self.direct_slot(index, gain, moment, voices) {
                push(block, stage);
            }
        }
    }

    /// Gives the surface of `one` a slot, if it has none and one is free: a slot that is silent, that no other wanted
    /// surface has, and whose playback holds the same texture or is not used by the tick.
    fn find_slot(
        &mut self,
        one: Wanted,
        wanted: &[Option<Wanted>; SLOTS],
        left: u32,
        voices: &mut impl Voices,
    ) {
        let surface = Some(one.surface);
        if self.slots.iter().any(|slot| slot.surface == surface) {
            return;
        }
        let planned = self.plan.surfaces.get(usize::from(one.surface));
        let Some(texture) = planned.and_then(|planned| planned.texture) else {
            return;
        };
        let silent = |slot: &Slot<'_>| {
            let mut all = wanted.iter().flatten();
            !slot.sounds(left) && !all.any(|other| Some(other.surface) == slot.surface)
        };
        let holds = |slot: &Slot<'_>| {
            slot.texture
                .is_some_and(|held| is_same(&held.texture, &texture.texture))
        };
        let same = |slot: &Slot<'_>| silent(slot) && holds(slot);
        let idle = |slot: &Slot<'_>| silent(slot) && !slot.played;
        let slots = &self.slots;
        let Some(index) = slots
            .iter()
            .position(same)
            .or_else(|| slots.iter().position(idle))
        else {
            return;
        };
        let slot = &mut self.slots[index];
        slot.surface = surface;
        slot.stick_slip = None;
        if holds(slot) {
            return;
        }
        (slot.texture, slot.made) = (Some(texture), [false; 2]);
        match voices.playback(index) {
            Some(playback) => playback.restart(&texture.texture),
            empty => *empty = Some(Playback::new(&texture.texture, seed_of(self.seed, index))),
        }
    }

    /// Takes slot `index` to `gain`, and returns its stage if it is to be played.
    fn direct_slot(
        &mut self,
        index: usize,
        gain: u32,
        moment: Moment,
        voices: &mut impl Voices,
    ) -> Option<Stage> {
        let Moment { samples, left, .. } = moment;
        let slot = &mut self.slots[index];
        let PlannedTexture { texture, scale } = slot.texture?;
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
        let goes_on = slot.played && left_of_frame == 0;
        let begins = !(goes_on && slot.gain == gain && slot.motion == Some(motion));
        if begins {
            let from = if slot.made[slot.buffer] {
                voices.levels(index, slot.buffer, left_of_frame)
            } else {
                Levels::SILENT
            };
            slot.buffer = 1 - slot.buffer;
            let frame = voices.frame(index, slot.buffer);
            if !slot.made[slot.buffer] {
                slot.made[slot.buffer] = true;
                *frame = None;
            }
            frame
                .get_or_insert_with(|| Frame::silent_at(&texture, scale))
                .update_scaled(&texture, motion, gain, from, samples);
            (slot.motion, slot.gain) = (Some(motion), gain);
        }
        let voice = VoiceStage {
            slot: index as u8,
            buffer: slot.buffer as u8,
            begins,
        };
        let planned = slot
            .surface
            .and_then(|surface| self.plan.surfaces.get(usize::from(surface)));
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

    fn direct_tap(
        &mut self,
        impact: Option<(Resonance, Strike)>,
        ringing: Ringing,
        block: &mut Block,
    ) {
        block.strike = impact.map(|(_, strike)| strike);
        match impact {
            Some((resonance, _)) => self.tap = Some(resonance),
            None if ringing.tap || self.struck => {}
            None => self.tap = None,
        }
        self.struck = impact.is_some();
        if let Some(resonance) = self.tap {
            push(block, Stage::Tap(resonance));
        }
    }

    fn direct_equaliser(&mut self, ringing: Ringing, block: &mut Block) {
        let feeds = !block.stages.is_empty();
        let sounds = feeds || self.fed || ringing.equaliser;
        if sounds && !self.plan.equaliser.is_empty() {
            push(block, Stage::Equaliser);
        }
        self.fed = feeds;
    }

    /// Fades tap and equaliser while a plan waits; the voices fade by their own levels.
    fn direct_fade(&mut self, moment: Moment, block: &mut Block) {
        let rings = |stage: &Stage| matches!(stage, Stage::Tap(_) | Stage::Equaliser);
        if self.next_plan.is_none() || !block.stages.iter().any(rings) {
            self.fading = None;
            return;
        }
        let from = self
            .fading
            .map_or(ONE as i32, |ramp| ramp.value(moment.left));
        let ramp = Ramp::between(from, 0, moment.samples);
        self.fading = Some(ramp);
        push(block, Stage::FadeOut(ramp));
    }
}

impl Slot<'_> {
    /// Returns whether the slot is audible at the end of the block that is played, of which `left` samples are left
    /// out.
    fn sounds(&self, left: u32) -> bool {
        self.played && (self.gain > 0 || self.left(left) > 0)
    }

    /// Number of samples of the frame's ramps that are left out with `left` of the block's.
    fn left(&self, left: u32) -> u32 {
        if self.played && self.began { left } else { 0 }
    }
}

/// The seed of a slot's own noise. The first slot has `seed` itself.
fn seed_of(seed: u64, slot: usize) -> u64 {
    /// 2⁶⁴ divided by the golden ratio: seeds of neighbouring numbers stay apart.
    const STEP: u64 = 0x9e37_79b9_7f4a_7c15;
    seed.wrapping_add(STEP.wrapping_mul(slot as u64))
}

/// Returns whether both are the same texture of the same library: the same bytes at the same address.
fn is_same(one: &Texture<'_>, other: &Texture<'_>) -> bool {
    core::ptr::eq(one.name(), other.name())
}

fn push(block: &mut Block, stage: Stage) {
    // There is room for one of each.
    let _ = block.stages.push(stage);
}
