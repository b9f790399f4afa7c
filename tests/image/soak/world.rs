//! The virtual stylus with its two hosts, what its flash must hold, and what must be true after every step.

use std::collections::BTreeMap;
use std::path::Path;

use model_format::Library;
use model_format::link::{
    Activity, MotionSource, MuteReason, PlayEndpoint, PlayError, PlayRequest, Selection, Settings, SlotState, Status,
    StopEndpoint,
};
use stylus_app::safety;
use virtual_stylus::Options;
use virtual_stylus::chance::Chance;
use virtual_stylus::model::flash::{Contents, Stalls};

use super::{Limits, Pin};
use crate::device::{Device, MS, product, with_faults};
use crate::requests::{announced, assert_on_time};
use crate::self_test::quiet;
use crate::ticks::check_bounds;
use crate::update::{EXCHANGE_NS, active as active_image, image};
use crate::{library, scenes};

/// Ticks per millisecond.
const TICKS_PER_MS: u64 = 5;

/// Name of the count of resets, all of which are expected.
pub const RESETS: &str = "resets, all expected";

/// Largest growth of the stack's mark in the last quarter, bytes: what a rare coincidence of interrupts uses.
const MOST_GROWTH_BYTES: u32 = 512;

/// A library, and everything that it can play.
pub struct Known {
    pub bytes: Vec<u8>,
    pub crc32: u32,
    pub selections: Vec<Selection>,
}

impl Known {
    fn new(bytes: Vec<u8>) -> Self {
        let library = Library::decode(&bytes).expect("a valid library");
        let textures = library
            .textures()
            .map(|texture| Selection::Texture(texture.name().try_into().expect("a texture's name fits")));
        let scenes = library.scenes().map(|scene| Selection::Scene(scene.name));
        Self {
            selections: textures.chain(scenes).collect(),
            crc32: announced(&bytes).crc32,
            bytes,
        }
    }
}

/// A run from one power-on to the next.
struct Run {
    has_faults: bool,
    /// Resets since power-on.
    resets: u32,
    /// Number of frames that each host has sent minus the number that the device has counted, modulo 2³². The serial
    /// port's is first.
    sent: [u32; 2],
    /// False once a host has sent something that is not a frame, or has lost a frame under way.
    is_exact: [bool; 2],
    /// True once the counts of ticks were set close to the overflow of their 32 bits.
    is_aged: bool,
    faults: u32,
    /// Accesses that waited for the flash while the bootloader exchanged images. The bootloader runs from the bank that
    /// it erases.
    stalls: Stalls,
    pin: Pin,
    last: Option<Status>,
}

/// Names of the figures that are kept per quarter of the run.
const FIGURES: [&str; 6] = [
    "stack, bytes",
    "tick's delay, cycles",
    "masked, cycles",
    "gap of feeds, us",
    "tick, cycles",
    "offset, steps",
];

/// The values named by [`FIGURES`].
type Figures = [u32; FIGURES.len()];

/// The stylus, its hosts, and what the hosts know.
pub struct World {
    pub device: Device,
    pub chance: Chance,
    pub libraries: Vec<Known>,
    /// The settings that flash must hold.
    pub settings: Settings,
    /// The host that keeps its play alive, if any: true for the host on USB, false for the one on the serial port.
    pub player: Option<bool>,
    /// The images: the product, and the image with fault injection.
    images: [Vec<u8>; 2],
    run: Run,
    /// Virtual time of the previous runs, ns.
    earlier_ns: u64,
    /// How often each operation was done.
    pub done: BTreeMap<&'static str, u64>,
    /// Largest figures of each quarter of the run.
    most: [Figures; 4],
    pub quarter: usize,
    /// Codes put out in the previous runs, and those of them that were not mid-scale.
    pub codes: [u64; 2],
    /// True after a step that was not possible.
    pub skipped: bool,
}

impl World {
    /// Switches the power on for the first time.
    pub fn new(seed: u64) -> Self {
        let libraries = [
            library::small(),
            library::middling(),
            library::other(),
            scenes::bytes(),
            scenes::fast(),
        ];
        let mut chance = Chance(seed);
        let flash = library::flash_with(&[&libraries[0]]);
        let has_faults = chance.below(2) == 0;
        let file = if has_faults { with_faults() } else { product() };
        let device = switched_on(&file, flash, false, &mut chance);
        let mut world = Self {
            device,
            chance,
            libraries: libraries.map(Known::new).into(),
            settings: Settings::default(),
            player: None,
            images: [product(), with_faults()].map(|path| image(&path)),
            run: Run::new(has_faults),
            earlier_ns: 0,
            done: BTreeMap::new(),
            most: [Figures::default(); 4],
            quarter: 0,
            codes: [0; 2],
            skipped: false,
        };
        world.come_back();
        world
    }

    /// Virtual time of all runs so far, ns.
    pub fn now_ns(&self) -> u64 {
        self.earlier_ns + self.device.stylus.now_ns()
    }

    /// A random number below `bound`.
    pub fn below(&mut self, bound: u64) -> u64 {
        self.chance.below(bound)
    }

    /// Returns true at random, with the probability 1/`of`.
    pub fn once_in(&mut self, of: u64) -> bool {
        self.below(of) == 0
    }

    pub fn count(&mut self, what: &'static str) {
        *self.done.entry(what).or_default() += 1;
    }

    /// Runs for a random time of at most `most_ms`.
    pub fn pass(&mut self, most_ms: u64) {
        let nanos = (1 + self.below(most_ms)) * MS;
        self.device.run_for(nanos);
    }

    /// Gives the turn to the host on USB if `usb` is true, otherwise to the one on the serial port.
    pub fn turn_to(&mut self, usb: bool) {
        if self.device.is_usb() != usb {
            self.device.turn();
        }
    }

    /// Returns true if the image with fault injection runs.
    pub fn takes_faults(&self) -> bool {
        self.run.has_faults
    }

    /// Returns true if another fault is possible without safe mode. Without fault injection only the external clock can
    /// fail, and only once.
    pub fn bears_fault(&self) -> bool {
        self.run.faults < if self.run.has_faults { 2 } else { 1 }
    }

    /// Notes that the step did nothing.
    pub fn skip(&mut self) {
        self.skipped = true;
    }

    /// Notes that the counts of ticks are close to the overflow of their 32 bits. Returns true if they were not before.
    pub fn age(&mut self) -> bool {
        !std::mem::replace(&mut self.run.is_aged, true)
    }

    /// Notes that the frames of the host with the turn can no longer be counted exactly.
    pub fn sends_noise(&mut self) {
        self.run.is_exact[usize::from(self.device.is_usb())] = false;
    }

    /// The image that does not run at present.
    pub fn other_image(&self) -> Vec<u8> {
        self.images[usize::from(!self.run.has_faults)].clone()
    }

    /// Waits until an image answers after an exchange, which a reset begins now or soon.
    pub fn wait_for_exchange(&mut self) {
        self.turn_to(false);
        self.device.run_for(300 * MS);
        assert!(self.device.answers_within(EXCHANGE_NS), "neither image");
        self.run.stalls = self.device.stylus.flash_stalls();
    }

    /// Handles an exchange, which a reset begins now or soon.
    pub fn is_exchanged(&mut self) {
        self.wait_for_exchange();
        self.run.has_faults ^= true;
        self.was_reset(false);
    }

    /// Handles a reset that the test has caused.
    pub fn was_reset(&mut self, is_fault: bool) {
        self.count(RESETS);
        self.run.resets += 1;
        self.run.faults += u32::from(is_fault);
        self.follow_pin();
        self.come_back();
    }

    /// Enumerates, and waits until the device answers both hosts.
    fn come_back(&mut self) {
        self.player = None;
        self.run.last = None;
        self.run.is_aged = false;
        for usb in [false, true] {
            self.turn_to(usb);
            self.device.keep_alive(false);
            self.device.forget_frames();
        }
        self.device.enumerate().expect("it enumerates");
        for usb in [false, true] {
            self.turn_to(usb);
            self.device.wait_for_start();
            // Requests sent before the start were lost, and their answers arrive late.
            self.device.run_for(20 * MS);
            self.device.forget_frames();
            self.run.is_exact[usize::from(usb)] = false;
        }
        assert_eq!(self.device.settings(), self.settings, "after a start");
        let status = self.device.status();
        assert_eq!(status.resets, self.run.resets, "since power-on");
        assert!(!status.start.safe_mode, "{status:?}");
        self.count_frames_from(&status);
    }

    /// Counts frames exactly from now on.
    fn count_frames_from(&mut self, status: &Status) {
        for (usb, counters) in [(false, status.serial), (true, status.usb)] {
            self.turn_to(usb);
            let counted = counters.frames + counters.malformed + counters.oversized;
            if !std::mem::replace(&mut self.run.is_exact[usize::from(usb)], true) {
                self.run.sent[usize::from(usb)] = self.device.sent().wrapping_sub(counted);
            }
        }
    }

    /// Cuts the power, and switches it on with `contents` in the flash. After that one of the libraries `allowed` must
    /// be active, and the library `was` must still be in a slot.
    pub fn cut_power(&mut self, contents: Contents, was: Option<u32>, allowed: &[u32], settings: [Settings; 2]) {
        self.follow_pin();
        let pin = &self.run.pin;
        self.codes = [self.codes[0] + pin.codes, self.codes[1] + pin.heard];
        assert_eq!(
            self.device.stylus.unwritten_ram(),
            [0; 0],
            "RAM that nobody had written was read"
        );
        self.earlier_ns += self.device.stylus.now_ns();
        // The image is that of the contents, whichever file is named.
        self.device = switched_on(&product(), contents, true, &mut self.chance);
        self.wait_for_exchange();
        let running = active_image(&self.device.stylus.flash().bytes);
        let found = self.images.iter().position(|image| *image == running);
        self.run = Run {
            stalls: self.run.stalls,
            ..Run::new(found.expect("one of the images, whole") == 1)
        };
        if self.device.is_on_trial() {
            self.device.confirm();
        }
        let found = self.device.settings();
        assert!(settings.contains(&found), "{found:?} is neither of {settings:?}");
        self.settings = found;
        let (active, valid) = self.slots();
        assert!(was.is_some_and(|was| valid.contains(&was)), "{was:x?} of {valid:x?}");
        assert!(
            active.is_some_and(|active| allowed.contains(&active)),
            "{active:x?} of {allowed:x?}"
        );
        self.come_back();
    }

    /// The checksum of the active library, and the checksums of all valid libraries.
    pub fn slots(&mut self) -> (Option<u32>, Vec<u32>) {
        let slots = self.device.slots();
        let crc32 = |state: &SlotState| match state {
            SlotState::Valid(info) => Some(info.crc32),
            _ => None,
        };
        let active = slots.active.and_then(|active| crc32(&slots.slots[active.index()]));
        (active, slots.slots.iter().filter_map(crc32).collect())
    }

    /// A random texture or scene of the active library.
    pub fn selection(&mut self) -> Selection {
        let (active, _) = self.slots();
        let active = active.expect("a library is active");
        let known = self.libraries.iter().find(|known| known.crc32 == active);
        let count = known.expect("it was uploaded").selections.len() as u64;
        let index = self.below(count) as usize;
        self.libraries
            .iter()
            .find(|known| known.crc32 == active)
            .expect("as above")
            .selections[index]
            .clone()
    }

    /// Makes the host with the turn play something. Returns false if it was refused, and checks that it had to be.
    pub fn play(&mut self, motion: MotionSource) -> bool {
        let request = PlayRequest {
            selection: self.selection(),
            gain: (self.below(9) as f32) / 4.0,
            motion,
            seed: self.chance.draw(),
        };
        let usb = self.device.is_usb();
        let held = self.player.filter(|player| *player != usb);
        match self.device.request::<PlayEndpoint>(&request) {
            Ok(_) => {
                assert_eq!(held, None, "the other host plays");
                self.player = Some(usb);
                self.device.keep_alive(true);
                true
            }
            Err(PlayError::Held { .. }) if held.is_some() => false,
            Err(PlayError::OverBudget { .. }) => false,
            Err(refused) => panic!("{request:?}: {refused}"),
        }
    }

    /// Notes that nothing is played any more because a library was activated.
    pub fn has_stopped(&mut self) {
        self.player = None;
        self.silence();
    }

    /// Makes the host with the turn stop the play, and waits until nothing plays.
    pub fn stop(&mut self) {
        self.silence();
        if self.player.take().is_some() {
            self.device.request::<StopEndpoint>(&()).expect("it plays");
        }
        for _ in 0..100 {
            if self.device.status().output.activity == Activity::Idle {
                return;
            }
            self.device.run_for(10 * MS);
        }
        panic!("it does not come to rest: {:?}", self.device.status());
    }

    /// Ends the keep-alives of both hosts, as after a fault.
    pub fn silence(&mut self) {
        for usb in [false, true] {
            self.turn_to(usb);
            self.device.keep_alive(false);
        }
    }

    /// Drops the previous status, because its counts do not continue.
    pub fn forget_last(&mut self) {
        self.run.last = None;
    }

    /// Prints the largest figures of each quarter of the run.
    pub fn tell_figures(&self) {
        let [codes, heard] = [self.codes[0] + self.run.pin.codes, self.codes[1] + self.run.pin.heard];
        println!("{codes:>11} codes, {heard} of them other than mid-scale");
        for (at, name) in FIGURES.into_iter().enumerate() {
            let most = self.most.map(|most| most[at]);
            println!("{name:>21}, largest of each quarter: {most:?}");
        }
    }

    /// Checks, if the run was `long`, that the stack's mark no longer grew in the last quarter.
    pub fn check_marks(&self, long: bool) {
        let stacks = self.most.map(|[stack, ..]| stack);
        let before = stacks[..3].iter().max().copied().unwrap_or_default();
        assert!(
            !long || stacks[3] <= before + MOST_GROWTH_BYTES,
            "the stack still grows: {stacks:?}"
        );
    }

    /// Checks everything that must be true after every step. `before` are the settings before the step.
    pub fn check(&mut self, before: Settings) {
        self.limits_and_pin(before);
        let status = self.device.status();
        assert_on_time(&status.tick);
        assert_eq!(
            self.device.stylus.resets().len(),
            self.run.resets as usize,
            "{status:?}"
        );
        assert_eq!(self.device.stylus.flash_stalls(), self.run.stalls);
        assert_eq!(self.device.broken, 0, "frames from the device");
        let faulted = status.output.mute_counts[MuteReason::Fault as usize];
        assert_eq!(faulted, 0, "mutes by faults");
        self.counters(&status);
        check_bounds(status.marks);
        let now: Figures = [
            status.marks.stack_used_bytes,
            status.marks.longest_tick_delay_cycles,
            status.marks.longest_critical_section_cycles,
            status.marks.longest_watchdog_gap_us,
            status.tick_histogram.longest,
            self.run.pin.largest.into(),
        ];
        for (most, now) in self.most[self.quarter].iter_mut().zip(now) {
            *most = now.max(*most);
        }
        self.run.last = Some(status);
    }

    fn limits_and_pin(&mut self, before: Settings) {
        let of = |settings: &Settings| {
            let config = safety::Config::new(settings, 1.0);
            [config.limit_steps() as u16, config.slew_steps() as u16]
        };
        let [one, other] = [of(&before), of(&self.settings)];
        // The step may have changed the settings, so each code must keep one or the other limit.
        let limits = Limits {
            offset: one[0].max(other[0]),
            slew: one[1].max(other[1]),
        };
        let outputs = self.device.stylus.take_dac_record();
        let amplifier = self.device.stylus.take_amplifier_record();
        self.run.pin.follow(&outputs, &amplifier, limits);
    }

    /// Lets up to `most_ms` pass. Returns true if the pin left mid-scale meanwhile.
    pub fn is_heard(&mut self, most_ms: u64) -> bool {
        self.follow_pin();
        let before = self.run.pin.heard;
        self.pass(most_ms);
        self.follow_pin();
        self.run.pin.heard > before
    }

    fn follow_pin(&mut self) {
        self.limits_and_pin(self.settings);
    }

    /// Checks that counters add up and only rise.
    fn counters(&mut self, status: &Status) {
        for (usb, counters) in [(false, status.serial), (true, status.usb)] {
            self.turn_to(usb);
            let counted = counters.frames + counters.malformed + counters.oversized;
            let sent = self.device.sent().wrapping_sub(self.run.sent[usize::from(usb)]);
            if self.run.is_exact[usize::from(usb)] {
                // A keep-alive may be under way, now or when the counting began.
                assert!(
                    counted.abs_diff(sent) <= 1,
                    "{counted} of {sent}: {counters:?}, USB: {usb}"
                );
            }
        }
        // A step that has sent something other than frames is over now.
        self.count_frames_from(status);
        let (ticks, uptime) = (status.tick.ticks, status.uptime_ms);
        // A tick may happen between the readings of the two counts.
        assert!((ticks / TICKS_PER_MS).abs_diff(uptime) <= 1, "{status:?}");
        if !self.run.is_aged {
            let binned: u64 = status.tick_histogram.bins.iter().map(|&bin| u64::from(bin)).sum();
            assert!(ticks.abs_diff(binned) <= 1, "{ticks} ticks, {binned} in the histogram");
        }
        let Some(last) = &self.run.last else { return };
        assert!(status.tick.ticks > last.tick.ticks);
        let counts = |status: &Status| {
            let output = &status.output;
            let mut counts = output.mute_counts.to_vec();
            counts.extend([output.saturations, output.hard_limited, output.slew_limited]);
            counts.extend([output.thermally_limited, status.lease.refused, status.resets]);
            counts.extend([status.usb, status.serial].map(|link| link.frames));
            counts
        };
        assert!(
            counts(last)
                .into_iter()
                .zip(counts(status))
                .into_iter()
                .all(|(before, now)| before <= now),
            "{last:?}, then {status:?}"
        );
    }
}

impl Run {
    fn new(has_faults: bool) -> Self {
        Self {
            has_faults,
            resets: 0,
            sent: [0; 2],
            is_exact: [false; 2],
            is_aged: false,
            faults: 0,
            stalls: Stalls::default(),
            pin: Pin::default(),
            last: None,
        }
    }
}

/// Switches on a stylus with two hosts. Its flash has `contents`, and the image in the file at `image` unless `keep` is
/// true, which keeps the image of the contents.
fn switched_on(image: &Path, contents: Contents, keep: bool, chance: &mut Chance) -> Device {
    let options = Options {
        ram_noise: Some(chance.draw()),
        keep_flash: keep,
        ..library::after(contents)
    };
    let mut device = Device::new(image, options);
    device.set_pins(quiet);
    device.move_at(120.0);
    device.add_usb();
    device.run_for(300 * MS);
    device
}
