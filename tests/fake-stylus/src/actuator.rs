//! A simulated actuator (plant) at the output's pin, and the device's own kernel, which drives it.

use std::io::Write;

use model_format::link::{Response, Selection};
use model_format::{AdcCode, DacCode, Library, OutputSample, PlayRate};
use stylus_app::control::plan_of;
use stylus_app::inputs::{Estimator, Follower, InputConfig, Timed};
use stylus_app::safety::OVERSAMPLING;
use stylus_kernel::UPDATE_INTERVAL_SAMPLES;
use stylus_kernel::scene::{Interaction, Plan, ScenePlayer};
use stylus_plant::{Parameters, Plant};

/// A plant at the pin.
pub struct Actuator {
    /// Parameters of the plant, as its owner knows them.
    pub parameters: Parameters,
    /// The plant.
    pub plant: Plant,
    log: Option<Box<dyn Write + Send>>,
    /// Codes of the last tick. The output changes to them 12.5 µs after the next tick; see `stylus_app::ring`.
    waiting: [DacCode; OVERSAMPLING],
}

impl Actuator {
    /// Creates a plant at rest. For each code, `log` receives two `f32` in little endian: the voltage at the pin, V
    /// from mid-scale, and the acceleration at the tip, m/s².
    pub fn new(parameters: Parameters, seed: u64, log: Option<Box<dyn Write + Send>>) -> Self {
        Self {
            plant: Plant::new(&parameters, seed),
            parameters,
            log,
            waiting: [DacCode::MID_SCALE; OVERSAMPLING],
        }
    }

    /// Returns the present codes of the accelerometer's axes.
    pub fn acceleration(&self) -> [AdcCode; 3] {
        self.plant.accelerometer_volts().map(|volts| {
            let code = 32_768.0 + volts / f64::from(AdcCode::STEP.0);
            AdcCode(code.round().clamp(0.0, 65_535.0) as u16)
        })
    }

    /// Puts out the codes of the previous tick, and keeps `codes` for the next one.
    /// Panics if the log cannot be written.
    pub fn put_out(&mut self, codes: [DacCode; OVERSAMPLING], enabled: bool) {
        for code in std::mem::replace(&mut self.waiting, codes) {
            let steps = f64::from(code.get()) - f64::from(DacCode::MID_SCALE.get());
            let volts = steps * f64::from(DacCode::STEP.0);
            self.plant.step(volts, enabled);
            if let Some(log) = &mut self.log {
                let tip = self.plant.tip_m_s2();
                for value in [volts, tip] {
                    let written = log.write_all(&(value as f32).to_le_bytes());
                    written.expect("the log can be written");
                }
            }
        }
    }
}

/// The kernel, run like the image's update and tick run it.
pub struct Performance {
    player: ScenePlayer<'static>,
    follower: Follower,
    /// The interaction that the last update decided, which the next block plays.
    decided: Interaction,
}

impl Performance {
    /// Plays a plan from silence, with noise from `seed`.
    pub fn new((plan, follower): (Plan<'static>, Follower), seed: u64) -> Self {
        Self {
            player: ScenePlayer::new(plan, seed),
            follower,
            decided: Interaction::NONE,
        }
    }

    /// Switches to another plan.
    pub fn switch(&mut self, (plan, follower): (Plan<'static>, Follower)) {
        self.player.switch(plan);
        self.follower = follower;
    }

    /// Begins the block that was decided during the last one, and decides the next one from the `chosen` motion.
    pub fn begin_block(&mut self, chosen: Timed, encoder: &Estimator, inputs: &InputConfig, now: u64, rate: PlayRate) {
        let samples = UPDATE_INTERVAL_SAMPLES * rate.samples_per_tick();
        self.player.at_tick(now);
        // One block late, as in the image, whose update decides a block while the one before it plays.
        self.player.follow(self.decided, samples);
        self.decided = self.follower.follow(chosen, encoder, inputs, now);
    }

    /// The next sample.
    pub fn next_sample(&mut self) -> OutputSample {
        self.player.next_sample()
    }
}

/// Returns the plan of `selection`, equalised with `response`, and a follower for it.
/// Panics if it cannot be played.
pub fn planned(library: &[u8], selection: &Selection, response: Option<&Response>) -> (Plan<'static>, Follower) {
    // Never freed: a plan borrows its library, and a test begins to play only a few times.
    let library: &'static [u8] = Box::leak(library.into());
    let library = Library::decode(library).expect("it was loaded");
    let plan = plan_of(selection, &library, u32::MAX, response);
    let (plan, _) = plan.expect("it was found playable");
    let follower = Follower::new(matches!(selection, Selection::Scene(_))).tracking(plan.has_lines());
    (plan, follower)
}
