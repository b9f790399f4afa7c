//! What the image must put out, from the product's own kernel and safety stages on this computer.

use model_format::Texture;
use model_format::link::{MotionSource, RecordSample, Settings};
use stylus_app::inputs::{self, InputConfig, Sensors, Timed};
use stylus_app::safety;
use stylus_kernel::{Motion, Synthesis, UPDATE_INTERVAL_SAMPLES};

/// What the sensors gave at successive ticks.
pub struct Recorded {
    /// The first one's number, counted from 1 at the start of the timer.
    pub first_tick: u64,
    pub samples: Vec<RecordSample>,
}

impl Recorded {
    /// The motion that is noted at the first tick of each block, with that tick.
    ///
    /// Right for blocks that begin a window of the speed's or more after the first tick.
    fn motions(&self) -> Vec<(u64, Motion)> {
        let config = InputConfig::new(&Settings::default());
        let mut sensors = Sensors::new();
        let mut motions = Vec::new();
        for (tick, sample) in (self.first_tick..).zip(&self.samples) {
            sensors.read(tick, sample.encoder_delta, sample.force, true);
            if begins_block(tick) {
                sensors.end_block();
                let timed = sensors.motion(&config);
                let (motion, _) = inputs::choose(MotionSource::Sensors, timed, Timed::NEVER, tick);
                motions.push((tick, motion));
            }
        }
        motions
    }
}

/// Blocks begin at the first tick and every so many after it.
fn begins_block(tick: u64) -> bool {
    tick % u64::from(UPDATE_INTERVAL_SAMPLES) == 1
}

/// When a texture was taken up, and when the mute ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Began {
    /// First tick of the block in which the texture is played, silent yet.
    pub play: u64,
    /// First tick that is not muted.
    pub unmuted: u64,
}

/// Samples of `texture` from tick `play` on: a silent block, then each block by the motion that was noted one block before.
fn samples(
    texture: Texture<'_>,
    seed: u64,
    recorded: &Recorded,
    play: u64,
) -> Vec<model_format::OutputSample> {
    let mut synthesis: Synthesis<'_> = Synthesis::new(texture, seed);
    let block = |synthesis: &mut Synthesis<'_>| -> Vec<_> {
        (0..UPDATE_INTERVAL_SAMPLES)
            .map(|_| synthesis.next_sample())
            .collect()
    };
    let mut samples = block(&mut synthesis);
    for (_, motion) in recorded
        .motions()
        .into_iter()
        .filter(|&(tick, _)| tick >= play)
    {
        synthesis.follow(motion, UPDATE_INTERVAL_SAMPLES);
        samples.extend(block(&mut synthesis));
    }
    samples
}

/// Finds when the output `codes` (of tick 1 on) began to be that of `texture`, and how many ticks it stays so: all that were
/// recorded if the image does what it must. Of several beginnings the one that explains most.
pub fn explain(
    texture: Texture<'_>,
    seed: u64,
    recorded: &Recorded,
    codes: &[u16],
    from: u64,
) -> (Began, u64) {
    let first_heard = (1u64..)
        .zip(codes)
        .find(|&(tick, &code)| tick >= from && code != 2048);
    let (first_heard, _) = first_heard.expect("something is heard");
    let config = safety::Config::new(&Settings::default(), 1.0);
    // How the stages stand after all the silence before.
    let mut rested = safety::State::new();
    for _ in 1..from {
        rested.process(&config, model_format::OutputSample::SILENCE, true);
    }
    let end = recorded.first_tick + recorded.samples.len() as u64;
    let mut best = (
        Began {
            play: 0,
            unmuted: 0,
        },
        0,
    );
    for play in (from..=first_heard).filter(|&tick| begins_block(tick)) {
        let played = samples(texture, seed, recorded, play);
        for unmuted in from..=first_heard {
            let mut state = rested;
            let mut tick = from;
            while tick < end {
                let sample = tick.checked_sub(play).and_then(|n| played.get(n as usize));
                let sample = sample.copied().unwrap_or_default();
                let code = state.process(&config, sample, tick < unmuted);
                if codes.get(tick as usize - 1) != Some(&code.get()) {
                    break;
                }
                tick += 1;
            }
            if tick > best.1 {
                best = (Began { play, unmuted }, tick);
            }
        }
    }
    best
}
