//! The output that the image must give, from the product's own kernel and safety stages on this computer.

use model_format::link::{RecordSample, Settings};
use model_format::{DacCode, PlayRate, Texture};
use stylus_app::inputs::{Follower, InputConfig, Sensors};
use stylus_app::safety;
use stylus_kernel::UPDATE_INTERVAL_SAMPLES;
use stylus_kernel::scene::{Plan, ScenePlayer};

use crate::device::{CODES, Device, MID_SCALE};

/// Codes of the sensors at successive ticks.
pub struct Recorded {
    /// Number of the first tick, counted from 1 at the start of the timer.
    pub first_tick: u64,
    pub samples: Vec<RecordSample>,
}

impl Recorded {
    /// The samples that `device` has recorded, of which nothing may be lost.
    pub fn of(device: &Device) -> Self {
        Self {
            first_tick: device.blocks[0].first_tick,
            samples: device.samples(),
        }
    }

    /// The sensors at the first tick of each block, with that tick.
    ///
    /// They are right for blocks that begin at least a window of the speed after the first tick.
    fn noted(&self) -> Vec<(u64, Sensors)> {
        let mut sensors = Sensors::new();
        let mut noted = Vec::new();
        for (tick, sample) in (self.first_tick..).zip(&self.samples) {
            sensors.read(tick, sample.encoder_delta, sample.force, true);
            if begins_block(tick) {
                sensors.end_block();
                noted.push((tick, sensors));
            }
        }
        noted
    }
}

/// The texture or scene that is played.
pub struct Heard<'a> {
    pub plan: Plan<'a>,
    pub follower: Follower,
    pub seed: u64,
    /// The one that takes over, and the first tick at whose block's beginning it is known.
    pub switch: Option<(u64, Plan<'a>, Follower)>,
}

impl<'a> Heard<'a> {
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

/// True if a block begins at `tick`, as at the first tick and at constant intervals after it.
fn begins_block(tick: u64) -> bool {
    tick % u64::from(UPDATE_INTERVAL_SAMPLES) == 1
}

/// The ticks at which playing and the end of the mute began.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Began {
    /// First tick of the first block that is played, which is still silent.
    pub play: u64,
    /// First tick that is not muted.
    pub unmuted: u64,
}

/// Samples of `heard` from tick `play` on: a silent block, then blocks that follow the sensors at the block before.
/// Each tick has one at 5 kHz, and two at 10 kHz.
fn samples(heard: &Heard<'_>, recorded: &Recorded, play: u64) -> Vec<model_format::OutputSample> {
    let config = InputConfig::new(&Settings::default());
    let mut player: ScenePlayer<'_> = ScenePlayer::new(heard.plan.clone(), heard.seed);
    let mut follower = heard.follower;
    let mut switch = heard.switch.clone();
    let block = heard.plan.block_samples();
    let mut samples = vec![model_format::OutputSample::SILENCE; block as usize];
    let noted = recorded.noted().into_iter();
    for (tick, sensors) in noted.filter(|&(tick, _)| tick >= play) {
        if let Some((_, plan, next)) = switch.take_if(|(known, ..)| tick >= *known) {
            player.switch(plan);
            follower = next;
        }
        let interaction = follower.follow(sensors.motion(&config), &sensors, &config, tick);
        player.follow(interaction, block);
        samples.extend((0..block).map(|_| player.next_sample()));
    }
    samples
}

/// The reference of an output: the stages after the silence before tick `from`, and the codes of all ticks.
struct Output<'a> {
    rate: PlayRate,
    config: safety::Config,
    rested: safety::State,
    codes: &'a [[u16; CODES]],
    ticks: std::ops::Range<u64>,
}

impl<'a> Output<'a> {
    fn of(heard: &Heard<'_>, recorded: &Recorded, codes: &'a [[u16; CODES]], from: u64) -> Self {
        let rate = PlayRate::of(heard.plan.sample_rate_hz()).expect("a stylus plays it");
        let config = safety::Config::at_rate(&Settings::default(), 1.0, rate);
        let mut rested = safety::State::new(&config);
        for _ in 1..from {
            rested.process(&config, model_format::OutputSample::SILENCE, true);
        }
        Self {
            rate,
            config,
            rested,
            codes,
            ticks: from..recorded.first_tick + recorded.samples.len() as u64,
        }
    }

    /// The first tick whose codes are not those of the `played` samples, or the end of the recording.
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
        let different = ticks.find(|(is_equal, _)| !is_equal);
        different.map_or(self.ticks.end, |(_, tick)| tick)
    }
}

/// The first tick from which the output of `heard`, which began so, does not equal `codes` (of the ticks from tick 1
/// on): the end of the recording if the image is right. Before tick `from` nothing was played.
pub fn explained(
    heard: &Heard<'_>,
    recorded: &Recorded,
    codes: &[[u16; CODES]],
    from: u64,
    began: Began,
) -> u64 {
    let played = samples(heard, recorded, began.play);
    Output::of(heard, recorded, codes, from).equal_until(&played, began)
}

/// Finds the beginning with which [`explained`] is latest, and that tick.
pub fn explain(
    heard: &Heard<'_>,
    recorded: &Recorded,
    codes: &[[u16; CODES]],
    from: u64,
) -> (Began, u64) {
    let first_heard = (1u64..)
        .zip(codes)
        .find(|&(tick, codes)| tick >= from && *codes != [MID_SCALE; CODES]);
    let (first_heard, _) = first_heard.expect("something is heard");
    let output = Output::of(heard, recorded, codes, from);
    let mut best = None;
    for play in (from..=first_heard).filter(|&tick| begins_block(tick)) {
        let played = samples(heard, recorded, play);
        for unmuted in from..=first_heard {
            let began = Began { play, unmuted };
            let until = output.equal_until(&played, began);
            if best.is_none_or(|(_, most)| until > most) {
                best = Some((began, until));
            }
        }
    }
    best.expect("a beginning")
}
