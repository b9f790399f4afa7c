//! Every line of the self test can fail. For each line, one change to the values of a healthy device makes it fail, and
//! the line says what to do. No line that `stylus selftest` prints is left out.

use std::collections::BTreeSet;
use std::f64::consts::TAU;
use std::time::Duration;

use crate::support::connected;
use fake_stylus::library::library;
use fake_stylus::{Board, FakeStylus, Hand};
use host_tools::link::capture::{Calibration, Capture, Loss};
use host_tools::link::upload::upload;
use host_tools::procedures::self_test::judge::Traffic;
use host_tools::procedures::self_test::{self, Line, Options, Verdict, judge};
use model_format::AdcCode;
use model_format::link::{
    ChipValues, ClockCount, ClockSource, ClockValues, DeviceInfo, ErrorCorrectionValues, Fault, FaultKind, FlashValues,
    OptionByteValues, OutputValues, RecordSample, RestValues, STEP_CODES, SlotId, Status,
};

const RATE_HZ: u32 = 5_000;
const CORE_HZ: u32 = 400_000_000;

/// Everything that a self test measures.
#[derive(Clone)]
struct SelfTestAnswers {
    info: DeviceInfo,
    chip: ChipValues,
    option_bytes: OptionByteValues,
    clocks: ClockValues,
    memory: ErrorCorrectionValues,
    rest: RestValues,
    output: OutputValues,
    flash: FlashValues,
    at_rest: Capture,
    moved: Capture,
    /// For each line of the encoder, whether its low and its high level were seen.
    seen: [[bool; 2]; 2],
    traffic: Traffic,
    status: Status,
}

/// A recording of one second, with `sample` at each tick.
fn recorded(sample: impl FnMut(u32) -> RecordSample) -> Capture {
    Capture {
        samples: (0..RATE_HZ).map(sample).collect(),
        rate_hz: RATE_HZ,
        first_tick: 0,
        loss: Loss::default(),
        holes: 0,
        interpolated: 0,
    }
}

/// The code of a converter at rest, with the converter's noise.
fn quiet(n: u32) -> u16 {
    32_760 + (n * n % 16) as u16
}

fn lying(n: u32) -> RecordSample {
    RecordSample {
        acceleration: [0, 1, 2].map(|axis| AdcCode(quiet(n + axis))),
        force: AdcCode(quiet(n + 3)),
        encoder_delta: 0,
    }
}

impl SelfTestAnswers {
    /// The measurements of a healthy device.
    fn healthy() -> Self {
        let stylus = FakeStylus::start();
        let device = connected(&stylus);
        let (info, status) = (device.info().clone(), device.status().expect("it answers"));
        let board = Board::default();
        let mut after = status.clone();
        after.tick.ticks += 64 * 32;
        Self {
            info,
            chip: board.chip,
            option_bytes: board.option_bytes,
            clocks: board.clocks,
            memory: board.error_correction,
            rest: board.rest.expect("it is healthy"),
            output: board.output.expect("it is healthy"),
            flash: FlashValues {
                slot: SlotId::A,
                erase_us: 1_000_000,
                not_erased: 0,
                words: 128,
                write_us: 128 * 200,
                longest_write_us: 300,
                wrong: 0,
            },
            at_rest: recorded(lying),
            moved: recorded(|n| RecordSample {
                encoder_delta: 1,
                ..lying(n)
            }),
            seen: [[true; 2]; 2],
            traffic: Traffic {
                before: status.clone(),
                after,
                loss: Loss {
                    received: 60,
                    ..Loss::default()
                },
                round_trips: vec![Duration::from_millis(3); 5],
            },
            status,
        }
    }

    fn lines(&self) -> Vec<Line> {
        let settings = model_format::link::Settings::default();
        [
            judge::chip(&self.chip, &self.info),
            judge::option_bytes(&self.option_bytes),
            judge::clocks(&self.clocks),
            judge::memory(&self.memory),
            judge::rest(&self.rest),
            judge::output(&self.output, CORE_HZ),
            judge::flash(&self.flash),
            judge::at_rest(&self.at_rest, &Calibration::new(&settings, None)),
            judge::moved(&self.moved, self.seen),
            judge::traffic("link", &self.traffic),
            judge::state(&self.status),
        ]
        .concat()
    }

    /// Changes the codes of `sensor` at rest: 0 to 2 are the axes, 3 is the force.
    fn change(&mut self, sensor: usize, code: impl Fn(u32, u16) -> u16) {
        for (n, sample) in (0..).zip(&mut self.at_rest.samples) {
            let changed = match sensor {
                3 => &mut sample.force,
                axis => &mut sample.acceleration[axis],
            };
            changed.0 = code(n, changed.0);
        }
    }

    fn hum(&mut self, sensor: usize, hz: f64) {
        self.change(sensor, |n, code| {
            let phase = TAU * hz * f64::from(n) / f64::from(RATE_HZ);
            (f64::from(code) + 4_000.0 * phase.sin()) as u16
        });
    }

    fn output(&mut self, pin: impl Fn(f64) -> f64) {
        self.output = Board::output(pin);
    }
}

/// A line's name, and a change to a healthy device that makes the line fail.
type Row = (&'static str, fn(&mut SelfTestAnswers));

/// The part of a line's name after the sensor's name, and a change to that sensor.
type SensorRow = (&'static str, fn(&mut SelfTestAnswers, usize));

/// A change to a healthy device.
type Change = Box<dyn Fn(&mut SelfTestAnswers)>;

/// Lines about the board, the flash, the encoder, the link and the state.
const LINES: &[Row] = &[
    ("chip", |m| m.chip.device = 0x483),
    ("silicon revision", |m| m.chip.revision = 0x1003),
    ("unique id", |m| m.chip.unique_id[0] ^= 1),
    ("flash size", |m| m.chip.flash_kb = 1024),
    ("read protection", |m| m.option_bytes.status ^= 0xFF00),
    ("brown-out level", |m| m.option_bytes.status &= !0b1100),
    ("watchdog by", |m| m.option_bytes.status &= !(1 << 4)),
    ("banks swapped", |m| m.option_bytes.banks_swapped = true),
    ("writable sectors", |m| {
        m.option_bytes.writable_sectors[1] = 0x7F;
    }),
    ("protected areas", |m| {
        m.option_bytes.secure[1] = 0x0010_0000;
    }),
    ("boot address", |m| m.option_bytes.boot = 0x1FF0_2000),
    ("pins for low voltage", |m| m.option_bytes.status |= 1 << 29),
    ("LSI", |m| {
        m.clocks.low_speed = Some(ClockCount {
            periods: 8_000,
            cycles: u64::from(m.clocks.timer_hz) * 8_000 / 36_000,
        });
    }),
    ("core against USB", |m| {
        let frames = m.clocks.usb_frames.as_mut().expect("it is connected");
        frames.cycles += frames.cycles / 500;
    }),
    ("ticks against core", |m| m.clocks.ticks.cycles += 40_000),
    ("RAM errors corrected", |m| m.memory.ram[0] = 0b001),
    ("RAM errors not corrected", |m| m.memory.ram[0] = 0b010),
    ("flash bank 1 errors corrected", |m| {
        m.memory.flash_corrected[0] = 1;
    }),
    ("flash bank 1 errors not corrected", |m| {
        m.memory.flash_failed[0] = 1;
    }),
    ("flash bank 2 errors corrected", |m| {
        m.memory.flash_corrected[1] = 1;
    }),
    ("flash bank 2 errors not corrected", |m| {
        m.memory.flash_failed[1] = 1;
    }),
    ("output at rest", |m| m.rest = Board::rest(2_100.0)),
    ("output still at rest", |m| m.rest.range[1] += 1_000),
    ("output at PA4", |m| m.output(|_| 1_300.0)),
    ("output gain", |m| {
        m.output(|code| 2_048.0 + 0.95 * (code - 2_048.0));
    }),
    ("output offset", |m| m.output(|code| code + 40.0)),
    ("output bend", |m| {
        m.output(|code| code + 30.0 * ((code - 2_048.0) / 2_048.0).powi(2));
    }),
    // Bit 6 of the code is stuck at zero.
    ("output smallest step", |m| {
        m.output(|code| f64::from(code as u16 & !(1 << 6)));
    }),
    ("output largest step", |m| {
        m.output(|code| f64::from(code as u16 & !(1 << 6)));
    }),
    ("output noise", |m| m.output.noise = 100.0),
    ("output delay", |m| {
        m.output.step_words[..6].fill(STEP_CODES[0] * 16);
    }),
    ("output settled", |m| {
        m.output.step_words[1..12].fill((STEP_CODES[1] - 100) * 16);
    }),
    ("slot A sector erase", |m| m.flash.erase_us = 5_000_000),
    ("slot A bytes not erased", |m| m.flash.not_erased = 1),
    ("slot A word write, mean", |m| {
        m.flash.write_us = 128 * 3_000;
    }),
    ("slot A bytes wrong", |m| m.flash.wrong = 1),
    ("encoder counts at rest", |m| {
        for one in &mut m.at_rest.samples[..5] {
            one.encoder_delta = 1;
        }
    }),
    ("encoder counts moved", |m| m.moved.samples.truncate(99)),
    ("encoder direction", |m| {
        for one in m.moved.samples.iter_mut().step_by(2) {
            one.encoder_delta = -1;
        }
    }),
    ("encoder line A", |m| m.seen[0] = [true, false]),
    ("encoder line B", |m| m.seen[1] = [false, true]),
    ("link: blocks received", |m| m.traffic.loss.received = 1),
    ("link: blocks lost in the device", |m| {
        m.traffic.loss.in_device = 1;
    }),
    ("link: blocks lost on the link", |m| {
        m.traffic.loss.on_link = 1;
    }),
    ("link: frames broken", |m| m.traffic.loss.broken_frames = 1),
    ("link: faults of the link", |m| {
        m.traffic.after.usb.malformed += 1;
    }),
    ("link: round trip, longest", |m| {
        m.traffic.round_trips[2] = Duration::from_millis(600);
    }),
    ("link: round trip, median", |m| {
        m.traffic.round_trips.fill(Duration::from_millis(150));
    }),
    ("link: ticks missed", |m| m.traffic.after.tick.missed += 1),
    ("link: frames late", |m| {
        m.traffic.after.tick.late_frames += 1;
    }),
    ("link: conversions late", |m| {
        m.traffic.after.tick.late_conversions += 1;
    }),
    ("link: outputs late", |m| {
        m.traffic.after.tick.late_outputs += 1;
    }),
    ("clock", |m| m.status.start.clock = ClockSource::Internal),
    ("safe mode", |m| m.status.start.safe_mode = true),
    ("supply", |m| m.status.start.supply_low = true),
    ("stack used", |m| {
        m.status.marks.stack_used_bytes = m.status.marks.stack_bytes;
    }),
    ("trigger to tick", |m| {
        m.status.marks.longest_tick_delay_cycles = CORE_HZ / 20_000;
    }),
    ("masked interrupts", |m| {
        m.status.marks.longest_critical_section_cycles = CORE_HZ / 20_000;
    }),
    ("watchdog gap", |m| {
        m.status.marks.longest_watchdog_gap_us = 200_000;
    }),
    ("fault since power-on", |m| {
        m.status.fault = Some(Fault {
            kind: FaultKind::Panic,
            program_counter: 0x0800_1234,
            detail: 0,
            address: None,
            text: "src/main.rs:1".try_into().expect("it is short"),
        });
    }),
    ("ticks missed since the start", |m| m.status.tick.missed = 1),
    ("frames late since the start", |m| {
        m.status.tick.late_frames = 1;
    }),
    ("conversions late since the start", |m| {
        m.status.tick.late_conversions = 1;
    }),
    ("outputs late since the start", |m| {
        m.status.tick.late_outputs = 1;
    }),
    ("longest tick", |m| {
        m.status.tick_histogram.longest = CORE_HZ / 5_000;
    }),
];

/// Names of the sensors, with which the lines of each axis and of the force begin.
const SENSORS: [&str; 4] = ["acceleration X", "acceleration Y", "acceleration Z", "force"];
const OF_SENSOR: [SensorRow; 5] = [
    ("from the rails", |m, sensor| {
        m.change(sensor, |_, code| code - 32_700);
    }),
    ("converts", |m, sensor| m.change(sensor, |_, _| 32_760)),
    ("noise", |m, sensor| {
        m.change(sensor, |n, code| code + (n.wrapping_mul(0x9E37_79B9) >> 18) as u16);
    }),
    ("hum of 50 Hz", |m, sensor| m.hum(sensor, 50.0)),
    ("hum of 60 Hz", |m, sensor| m.hum(sensor, 60.0)),
];

/// The name of every line, with its change.
fn rows() -> Vec<(String, Change)> {
    let mut rows: Vec<(String, Change)> = Vec::new();
    for &(name, change) in LINES {
        rows.push((name.to_owned(), Box::new(change)));
    }
    for (sensor, name) in SENSORS.into_iter().enumerate() {
        for (line, change) in OF_SENSOR {
            let change = move |measured: &mut SelfTestAnswers| change(measured, sensor);
            rows.push((format!("{name} {line}"), Box::new(change)));
        }
    }
    rows
}

#[test]
fn each_line_fails_when_what_it_measures_is_wrong_and_says_what_to_do() {
    let healthy = SelfTestAnswers::healthy();
    for (name, change) in rows() {
        let mut measured = healthy.clone();
        change(&mut measured);
        let lines = measured.lines();
        let line = lines.iter().find(|line| line.name == name);
        let line = line.unwrap_or_else(|| panic!("there is no line {name}"));
        assert_eq!(line.verdict, Verdict::Fail, "{line:?}");
        assert!(line.remedy.len() > 20, "{line:?}");
    }
}

#[test]
fn no_line_that_is_printed_is_without_a_change_that_makes_it_fail() {
    let known: BTreeSet<String> = rows().into_iter().map(|(name, _)| name).collect();
    let judged = SelfTestAnswers::healthy().lines();
    for line in &judged {
        assert_eq!(line.verdict, Verdict::Pass, "{line:?}");
    }
    let judged: BTreeSet<String> = judged.into_iter().map(|line| line.name).collect();
    assert_eq!(judged, known);
    // A self test has no other lines, except the load's, which has no limit.
    let stylus = FakeStylus::start();
    stylus.set_hand(Hand::moving(30.7, 2.0));
    let link = stylus.link();
    let mut device = connected(&stylus);
    let uploaded = upload(&mut device, &library(1, 20, 1), |_| ()).expect("there is room");
    device.activate(uploaded.slot).expect("it is there");
    let options = Options {
        traffic_s: 0.3,
        rest_s: 0.3,
        move_s: 0.3,
        moves: true,
        ..Options::default()
    };
    let lines = self_test::run(&device, &options, |_| ()).expect("it answers");
    let printed: BTreeSet<String> = (lines.iter())
        .map(|line| line.name.replace(&link, "link").replace("slot B", "slot A"))
        .filter(|name| name != "link: kernel loaded")
        .collect();
    assert_eq!(printed, known);
}
