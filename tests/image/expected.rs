//! The output that the image must produce, computed by the product's own kernel and safety stages on this computer, and
//! plays that are compared with it.

use model_format::link::{RecordSample, Settings};
use model_format::{DacCode, PlayRate, Texture};
use stylus_app::inputs::{Estimator, Follower, InputConfig, Sensors};
use stylus_app::{UPDATE_LEAD_TICKS, safety};
use stylus_kernel::UPDATE_INTERVAL_SAMPLES;
use stylus_kernel::scene::{Plan, ScenePlayer};
use virtual_stylus::model::dac::Cause;

use crate::device::{CODES, Device, MID_SCALE, MS};
use crate::requests::assert_even;

/// Codes of the sensors at successive ticks.
pub struct Recorded {
    /// Number of the first tick, counted from 1 at the start of the timer.
    pub first_tick: u64,
    pub samples: Vec<RecordSample>,
}

impl Recorded {
    /// The samples that `device` has recorded.
    pub fn of(device: &Device) -> Self {
        Self {
            first_tick: device.blocks[0].first_tick,
            samples: device.samples(),
        }
    }

    /// Returns each tick that requests an update, with the sensors at that tick. The tool is at rest when the recording
    /// begins.
    fn noted(&self) -> Vec<(u64, Sensors)> {
        let mut sensors = Sensors::new();
        let mut noted = Vec::new();
        for (tick, sample) in (self.first_tick..).zip(&self.samples) {
            sensors.read(tick, sample.encoder_delta, sample.force, true);
            if begins_block(tick + u64::from(UPDATE_LEAD_TICKS)) {
                sensors.end_block();
                noted.push((tick, sensors));
            }
        }
        noted
    }
}

/// The texture or scene that is played.
pub struct ExpectedPlay<'a> {
    pub plan: Plan<'a>,
    pub follower: Follower,
    pub seed: u64,
    /// The plan that replaces `plan`, its follower, and the first tick whose update knows of the change.
    pub switch: Option<(u64, Plan<'a>, Follower)>,
}

impl<'a> ExpectedPlay<'a> {
    pub fn of_texture(texture: Texture<'a>, seed: u64) -> Self {
        let plan = Plan::of_texture(texture);
        Self {
            follower: Follower::new(false).tracking(plan.has_lines()),
            plan,
            seed,
            switch: None,
        }
    }

    pub fn of_scene(plan: Plan<'a>, seed: u64) -> Self {
        Self {
            follower: Follower::new(true).tracking(plan.has_lines()),
            plan,
            seed,
            switch: None,
        }
    }
}

/// Returns true if a block begins at `tick`. Blocks begin at the first tick and at constant intervals after it.
fn begins_block(tick: u64) -> bool {
    tick % u64::from(UPDATE_INTERVAL_SAMPLES) == 1
}

/// The ticks at which playing began and at which the mute ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Began {
    /// First tick of the play's first block, which is still silent.
    pub play: u64,
    /// First tick that is not muted.
    pub unmuted: u64,
}

/// Samples of `heard` from tick `play` on: first a silent block, then blocks that each follow the sensors at the
/// previous block. Each tick has one sample at 5 kHz, and two at 10 kHz.
fn samples(heard: &ExpectedPlay<'_>, recorded: &Recorded, play: u64) -> Vec<model_format::OutputSample> {
    let config = InputConfig::new(&Settings::default());
    let mut player: ScenePlayer<'_> = ScenePlayer::new(heard.plan.clone(), heard.seed);
    let mut follower = heard.follower;
    let mut switch = heard.switch.clone();
    let block = heard.plan.block_samples();
    let mut samples = vec![model_format::OutputSample::SILENCE; block as usize];
    let mut estimator = Estimator::new();
    for (tick, sensors) in recorded.noted() {
        let motion = estimator.motion(&sensors, &config);
        if tick < play {
            continue;
        }
        if let Some((_, plan, next)) = switch.take_if(|(known, ..)| tick >= *known) {
            player.switch(plan);
            follower = next;
        }
        let interaction = follower.follow(motion, &estimator, &config, tick);
        player.at_tick(tick + u64::from(UPDATE_LEAD_TICKS));
        player.follow(interaction, block);
        samples.extend((0..block).map(|_| player.next_sample()));
    }
    samples
}

/// What an output is compared with: the safety stages after the silence before the request, and the codes of all ticks.
struct Output<'a> {
    rate: PlayRate,
    config: safety::Config,
    rested: safety::State,
    codes: &'a [[u16; CODES]],
    ticks: std::ops::Range<u64>,
}

impl<'a> Output<'a> {
    fn of(heard: &ExpectedPlay<'_>, compared: &'a Compared) -> Self {
        let rate = PlayRate::of(heard.plan.sample_rate_hz()).expect("a stylus plays it");
        let config = safety::Config::at_rate(&Settings::default(), 1.0, rate);
        // The image's stages have run at each tick since the start, so their state must be the same.
        let mut rested = safety::State::new(&config);
        for _ in 1..compared.asked {
            rested.process(&config, model_format::OutputSample::SILENCE, true);
        }
        Self {
            rate,
            config,
            rested,
            codes: &compared.codes,
            ticks: compared.asked..compared.end(),
        }
    }

    /// Returns the first tick whose codes differ from the codes of the `played` samples, or the end of the recording.
    fn equal_until(&self, played: &[model_format::OutputSample], began: Began) -> u64 {
        let mut state = self.rested;
        let sample = |tick: u64, of_tick: u64| {
            let per_tick = u64::from(self.rate.samples_per_tick());
            let number = tick.checked_sub(began.play)? * per_tick + of_tick;
            played.get(number as usize).copied()
        };
        let is_equal = |tick: u64| {
            let [first, second] = [0, 1].map(|of_tick| sample(tick, of_tick).unwrap_or_default());
            let muted = tick < began.unmuted;
            let processed = match self.rate {
                PlayRate::Hz5000 => state.process(&self.config, first, muted),
                PlayRate::Hz10000 => state.process_pair(&self.config, [first, second], muted),
            };
            self.codes.get(tick as usize - 1) == Some(&processed.map(DacCode::get))
        };
        let mut ticks = self.ticks.clone().map(is_equal).zip(self.ticks.clone());
        ticks
            .find(|(is_equal, _)| !is_equal)
            .map_or(self.ticks.end, |(_, tick)| tick)
    }
}

/// Number of codes at the output before the codes of the first tick. The timer of the codes starts 17 codes before the
/// first code of the first tick is due, and the tick's own timer starts later.
pub const BEFORE_FIRST_TICK: usize = 17;

/// Checks the instants of the codes at the output, and returns the codes of each tick, from the first tick on.
fn latched(device: &mut Device) -> Vec<[u16; CODES]> {
    let outputs = device.triggered();
    assert_even(&outputs);
    let codes: Vec<u16> = (outputs[BEFORE_FIRST_TICK..].iter())
        .map(|output| output.code.expect("driven"))
        .collect();
    codes.as_chunks().0.to_vec()
}

/// A play with its recorded inputs and its codes.
pub struct Compared {
    /// The inputs.
    pub recorded: Recorded,
    /// The codes at the output, per tick.
    pub codes: Vec<[u16; CODES]>,
    /// The tick at which the play was requested.
    pub asked: u64,
    /// Number of ticks that were audited, none of which touched flash.
    pub audits: usize,
}

impl Compared {
    /// The number of the first tick after the recording.
    pub fn end(&self) -> u64 {
        self.recorded.first_tick + self.recorded.samples.len() as u64
    }

    /// Returns the first tick whose codes differ from the output of `heard` with the beginning `began`. If the image is
    /// right, that is the end of the recording. Ticks before the request are not compared.
    pub fn explained_from(&self, heard: &ExpectedPlay<'_>, began: Began) -> u64 {
        let played = samples(heard, &self.recorded, began.play);
        Output::of(heard, self).equal_until(&played, began)
    }

    /// Returns the beginning for which [`Compared::explained_from`] is latest, and the tick that it returns.
    pub fn explained(&self, heard: &ExpectedPlay<'_>) -> (Began, u64) {
        let mut codes = (1u64..).zip(&self.codes);
        let first_heard = codes.find(|&(tick, codes)| tick >= self.asked && *codes != [MID_SCALE; CODES]);
        let (first_heard, _) = first_heard.expect("something is heard");
        // A host does not learn the ticks at which the play began and the mute ended, so all of them are tried.
        let output = Output::of(heard, self);
        let mut best = None;
        for play in (self.asked..=first_heard).filter(|&tick| begins_block(tick)) {
            let played = samples(heard, &self.recorded, play);
            for unmuted in self.asked..=first_heard {
                let began = Began { play, unmuted };
                let until = output.equal_until(&played, began);
                if best.is_none_or(|(_, most)| until > most) {
                    best = Some((began, until));
                }
            }
        }
        best.expect("a beginning")
    }

    /// Checks that more than a quarter of the codes since `began` are not mid-scale.
    pub fn assert_heard(&self, began: Began) {
        let played = &self.codes[began.unmuted as usize..self.end() as usize];
        let codes = played.as_flattened();
        let sounding = codes.iter().filter(|&&code| code != MID_SCALE).count();
        assert!(sounding > codes.len() / 4, "{sounding} of {}", codes.len());
    }
}

/// Records, first with the tool at rest and then while `play` runs. Checks that no tick is late, saturated or touches
/// flash.
pub fn recorded(device: &mut Device, play: impl FnOnce(&mut Device)) -> Compared {
    device.record();
    // After this time the estimate of the speed is exactly at rest.
    device.run_for(60 * MS);
    let asked = device.status().tick.ticks;
    // A prime, so that the audits fall on every place in a block of ten ticks.
    device.stylus.audit_ticks(997);
    play(device);
    let stopped = device.stop_recording();
    assert_eq!(stopped.lost_blocks, 0);
    device.assert_undisturbed();
    assert_eq!(device.status().output.saturations, 0);
    let audits = device.stylus.take_audits();
    for audit in &audits {
        let from_flash = (audit.flash_fetches, audit.flash_reads);
        assert_eq!(from_flash, (0, 0), "{audit:x?}");
    }
    let late = device
        .dac()
        .iter()
        .find(|output| output.cause != Cause::Trigger && output.code.is_some_and(|code| code != MID_SCALE));
    assert_eq!(late, None, "a code that no trigger has put out");
    Compared {
        recorded: Recorded::of(device),
        codes: latched(device),
        asked,
        audits: audits.len(),
    }
}

/// Starts playing with `play`, plays for `millis`, and compares all codes with those that the host computes for
/// `heard`.
pub fn plays_as_the_host_does(
    device: &mut Device,
    heard: &ExpectedPlay<'_>,
    millis: u64,
    play: impl FnOnce(&mut Device),
) -> Compared {
    let compared = recorded(device, |device| {
        play(device);
        device.run_for(millis * MS);
    });
    let (began, same_until) = compared.explained(heard);
    let end = compared.end();
    assert_eq!(same_until, end, "codes differ from there on, with {began:?}");
    compared.assert_heard(began);
    compared
}
