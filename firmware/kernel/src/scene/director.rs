//! The half of a scene that decides, once per block, at a lower priority than the tick.

use super::interaction::Interaction;
use super::path::Located;
use super::plan::Plan;
use super::playback::{Block, Ringing, SLOTS, Stage};
use super::slots::{Moment, Slots, Voices, Wanted};
use super::tap::{Resonance, Strike};
use crate::grid::{Motion, ONE};
use crate::level::Ramp;
use crate::position::{Passage, Track};
use crate::synthesis::UPDATE_INTERVAL_SAMPLES;

/// Decides the stages of each block.
#[derive(Clone, Debug)]
pub struct Director<'a> {
    plan: Plan<'a>,
    next_plan: Option<Plan<'a>>,
    /// Number of plans played, including this one.
    plans: u32,
    slots: Slots<'a>,
    tap: Option<Resonance>,
    /// The contact that began with the block that is played, and whose tap is yet to be struck.
    touched: Option<Touch>,
    /// True if the block that is played begins with a strike, which `ringing` may not show yet.
    struck: bool,
    /// True if the block that is played feeds the equaliser.
    fed: bool,
    /// The fade of the block that is played.
    fading: Option<Ramp>,
    /// Movement of the tool, for lines that are tied to position.
    track: Track,
    before: Option<Before>,
    /// Tick at which the next block begins.
    tick: u64,
}

/// The interaction in the previous block.
#[derive(Clone, Copy, Debug)]
struct Before {
    interaction: Interaction,
    samples: u32,
}

/// A contact whose tap is yet to be struck.
#[derive(Clone, Copy, Debug)]
struct Touch {
    /// Index of the surface.
    surface: usize,
    /// Rate of force in the block in which the contact began, N/s.
    rate_n_s: f32,
}

impl<'a> Director<'a> {
    /// Creates a director of `plan`. The same `seed` gives the same samples on every machine.
    pub fn new(plan: Plan<'a>, seed: u64) -> Self {
        Self {
            plan,
            next_plan: None,
            plans: 1,
            slots: Slots::new(seed),
            tap: None,
            touched: None,
            struck: false,
            fed: false,
            fading: None,
            track: Track::new(),
            before: None,
            tick: 0,
        }
    }

    /// Changes to `plan` at the first block boundary after everything audible has faded. The fade takes one block, or
    /// two if a voice of the new plan needs a slot that is still played.
    pub fn switch(&mut self, plan: Plan<'a>) {
        self.next_plan = Some(plan);
    }

    /// Sets the tick at which the next block begins, to which a probe's waveform is tied.
    pub fn at_tick(&mut self, tick: u64) {
        self.tick = tick;
    }

    /// Returns whether a plan waits for the present one to fade.
    pub fn is_switching(&self) -> bool {
        self.next_plan.is_some()
    }

    /// The plan that is played.
    pub fn plan(&self) -> &Plan<'a> {
        &self.plan
    }

    /// Decides the stages of the next block, of `samples` samples, writes them to `block`, and computes its frames.
    ///
    /// `ringing` is the value of [`super::ScenePlayback::ringing`] after the block that is played had begun. `left` is
    /// the number of samples of that block's ramps that will not be played: 0 if blocks are played to their end.
    ///
    /// The work is bounded. Per slot it is at most one [`crate::Frame::update`], one [`crate::Frame::feed`], one start
    /// of a playback, and some thousand instructions.
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
        // What rang before is reset before the first sample of this block.
        let ringing = if resets { Ringing::default() } else { ringing };
        block.stages.clear();
        (block.samples, block.resets) = (samples, resets);
        // The caller reuses its blocks. A cascade of up to 14 sections is copied once per plan and not in every block.
        if block.equaliser_of != self.plans {
            block.equaliser.clone_from(&self.plan.equaliser);
            block.equaliser_of = self.plans;
        }
        let located = self.locate(&interaction);
        let moment = self.moment(&interaction, samples, left);
        let wanted = self.wanted(&located);
        self.slots.direct(&self.plan, &wanted, moment, voices, block);
        let impact = self.impact(&interaction, &located);
        self.direct_wave(block);
        self.direct_tap(impact, ringing, block);
        self.direct_equaliser(ringing, block);
        self.direct_fade(moment, block);
        self.before = Some(Before { interaction, samples });
    }

    /// Changes to the waiting plan, once nothing is audible. Returns true if it changed, in which case tap and
    /// equaliser must be reset.
    fn take_up_next_plan(&mut self, left: u32, ringing: Ringing) -> bool {
        let faded = self.fading.is_some_and(|ramp| ramp.value(left) == 0);
        let feeds = self.fed && !self.plan.equaliser.is_empty();
        let rings = self.tap.is_some() || ringing.equaliser || feeds;
        // A tap or equaliser may ring for seconds. Once its fade has ended the change does not wait for its silence.
        if (self.slots.sound(left) || rings) && !faded {
            return false;
        }
        let Some(next) = &mut self.next_plan else {
            return false;
        };
        // In place, because a plan takes kilobytes, and the update uses the stack of whatever it interrupts.
        core::mem::swap(&mut self.plan, next);
        self.next_plan = None;
        self.plans = self.plans.wrapping_add(1);
        self.slots.release();
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

    fn moment(&mut self, interaction: &Interaction, samples: u32, left: u32) -> Moment {
        let rate = self.plan.sample_rate_hz as f32;
        let distance_mm = match (self.plan.constant_motion, &self.before) {
            (Some(motion), _) => motion.speed_mm_s() * samples as f32 / rate,
            (None, Some(before)) => {
                let gone = interaction.position_mm() - before.interaction.position_mm();
                // The path of the next block may not be known: the tool is assumed to go on as in the block before.
                gone.abs() * samples as f32 / before.samples.max(1) as f32
            }
            (None, None) => 0.0,
        };
        let motion = self.plan.constant_motion.unwrap_or(interaction.motion);
        Moment {
            motion,
            passage: self.passage(interaction, motion, samples, left),
            distance_mm,
            samples,
            left,
        }
    }

    /// Returns the movement of the tool in the block, if anything depends on it.
    fn passage(&mut self, interaction: &Interaction, motion: Motion, samples: u32, left: u32) -> Passage {
        if !self.plan.has_lines {
            return Passage::default();
        }
        // If the motion does not follow the hand, the position does not follow it either.
        let follows = self.plan.constant_motion.is_none();
        let told = interaction.position().filter(|_| follows);
        let (speed, rate) = (motion.speed_mm_s(), self.plan.sample_rate_hz);
        self.track.advance(told, speed, samples, left, rate)
    }

    /// Returns the tap of an impact: a contact that did not exist in the previous block, on the surface of greater
    /// weight. Contact from the beginning is no impact.
    ///
    /// The tap is struck one block after contact, at the larger rate of force of the two blocks, because contact can
    /// begin anywhere in a block: a force that rises only at the block's end shows little of its rate in it.
    fn impact(&mut self, interaction: &Interaction, located: &[Located]) -> Option<(Resonance, Strike)> {
        let before = self.before?;
        let seconds = before.samples.max(1) as f32 / self.plan.sample_rate_hz as f32;
        let rise = interaction.motion.force_n() - before.interaction.motion.force_n();
        let rate_n_s = rise / seconds;
        let touched = self.touched.take();
        if interaction.contact && !before.interaction.contact {
            // The surface at the position itself comes first; its weight is never the smaller one.
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

    fn direct_tap(&mut self, impact: Option<(Resonance, Strike)>, ringing: Ringing, block: &mut Block) {
        block.strike = impact.map(|(_, strike)| strike);
        match impact {
            Some((resonance, _)) => self.tap = Some(resonance),
            None if ringing.tap || self.struck => {}
            None => self.tap = None,
        }
        self.struck = impact.is_some();
        if let Some(resonance) = self.tap {
            block.push(Stage::Tap(resonance));
        }
    }

    fn direct_wave(&mut self, block: &mut Block) {
        let Some(wave) = &self.plan.wave else {
            return;
        };
        // Ten ticks are a block at either rate, as many as a block at 5 kHz has samples.
        let per_tick = self.plan.block_samples() / UPDATE_INTERVAL_SAMPLES;
        let from = self.tick.wrapping_sub(wave.first_tick) as i64 * i64::from(per_tick);
        let count = block.wave.len().min(block.samples as usize);
        if wave.fill(from, &mut block.wave[..count]) {
            block.push(Stage::Wave);
        }
    }

    fn direct_equaliser(&mut self, ringing: Ringing, block: &mut Block) {
        let feeds = !block.stages.is_empty();
        // `ringing` was taken when the block that is played began, so that it may not show what that block feeds.
        let sounds = feeds || self.fed || ringing.equaliser;
        if sounds && !self.plan.equaliser.is_empty() {
            block.push(Stage::Equaliser);
        }
        self.fed = feeds;
    }

    /// Fades tap and equaliser while a plan waits. The voices fade by their own levels.
    fn direct_fade(&mut self, moment: Moment, block: &mut Block) {
        let rings = |stage: &Stage| matches!(stage, Stage::Tap(_) | Stage::Equaliser);
        if self.next_plan.is_none() || !block.stages.iter().any(rings) {
            self.fading = None;
            return;
        }
        let from = self.fading.map_or(ONE as i32, |ramp| ramp.value(moment.left));
        let ramp = Ramp::between(from, 0, moment.samples);
        self.fading = Some(ramp);
        block.push(Stage::FadeOut(ramp));
    }
}
