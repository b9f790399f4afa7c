//! The self test: measurements of the device, compared with limits.
//!
//! The device measures without knowing any limit, and [`judge`] compares without a device. [`run`] does both in turn.
//! The output is moved only if the device knows that the amplifier is off, or a person says that none is connected. A
//! library is erased only on request.

/// Limits of the self test. Each function compares the values of one measurement with their limits, and names the
/// remedies.
///
/// A limit's source is given with the limit. DS12110 is the part's datasheet, RM0433 its manual, ES0392 its errata. A
/// limit without a source is a choice, wide enough for a good device and narrow enough for the fault that the limit
/// detects.
pub mod judge {
    mod board;
    mod output;
    mod run;
    mod sensors;

    pub use board::{chip, clocks, flash, memory, option_bytes};
    pub use output::{output, rest};
    pub use run::{Traffic, state, traffic};
    pub use sensors::{at_rest, moved};
}

mod line;

use std::thread;
use std::time::{Duration, Instant};

use model_format::link::{
    EncoderValues, MotionSource, PlayRequest, Selection, SelfTestError, SelfTestRequest, SelfTestValues, SlotId,
    SlotState, Status,
};

use self::judge::Traffic;
use crate::link::Device;
use crate::link::capture::{Calibration, Capture, Stream, capture};
use crate::link::{LinkError, Result};

pub use self::line::{Line, Record, Verdict};

/// Least number of blocks, of 6.4 ms each, between two readings of the encoder's lines.
const LOOK_BLOCKS: u32 = 8;

/// Waits before successive readings of the lines, ms, in turn. Without them a steady motion might bring a line to the
/// same level at the end of each block, and a line that works would seem stuck.
const LOOK_WAITS_MS: [u64; 7] = [0, 3, 1, 5, 2, 6, 4];

/// Interval between two requests while a recording streams.
const PING_INTERVAL: Duration = Duration::from_millis(100);

/// Parts of the self test that the user chooses.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Duration of the traffic, s.
    pub traffic_s: f64,
    /// Duration of the recording at rest, s.
    pub rest_s: f64,
    /// Duration of the recording of a movement, s.
    pub move_s: f64,
    /// True if sensors are connected.
    pub sensors: bool,
    /// True if a person says, for this run only, that no amplifier is connected. Otherwise the device moves its output
    /// only if an enable is wired.
    pub no_amplifier: bool,
    /// True if the user moves the tool when asked.
    pub moves: bool,
    /// A slot whose library may be erased for the test of the flash.
    pub erasable: Option<SlotId>,
}

impl Default for Options {
    /// The self test of a board with its sensors, which are not moved.
    fn default() -> Self {
        Self {
            traffic_s: 30.0,
            rest_s: 4.0,
            move_s: 5.0,
            sensors: true,
            no_amplifier: false,
            moves: false,
            erasable: None,
        }
    }
}

/// A step of the self test, for the person who waits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Step {
    /// A measurement of the device.
    Measuring(&'static str),
    /// The tool must be left alone.
    Rest,
    /// The tool must be moved in one direction.
    Move,
    /// Traffic on the link.
    Traffic,
}

/// Runs the whole self test. Calls `told` with each step before it begins.
pub fn run(device: &Device, options: &Options, mut told: impl FnMut(Step)) -> Result<Vec<Line>> {
    let mut lines = Vec::new();
    for (name, request) in [
        ("chip", SelfTestRequest::Chip),
        ("option bytes", SelfTestRequest::OptionBytes),
        ("clocks", SelfTestRequest::Clocks),
        ("memories", SelfTestRequest::ErrorCorrection),
        ("output at rest", SelfTestRequest::Rest),
        (
            "output",
            SelfTestRequest::Output {
                disconnected: options.no_amplifier,
            },
        ),
    ] {
        told(Step::Measuring(name));
        lines.extend(measured(device, name, request)?);
    }
    told(Step::Measuring("flash"));
    lines.extend(flash(device, options.erasable)?);
    if options.sensors {
        let calibration = Calibration::new(&device.settings()?, None);
        told(Step::Rest);
        if let Some(rest) = capture(device, options.rest_s, 0.0, || true, |_, _, _| ())? {
            lines.extend(judge::at_rest(&rest, &calibration));
        }
    } else {
        lines.push(Line::not_measured(
            "sensors",
            "to measure them, connect them and omit --bare",
        ));
    }
    if options.sensors && options.moves {
        told(Step::Move);
        let (moved, seen) = movement(device, options.move_s)?;
        lines.extend(judge::moved(&moved, seen));
    } else {
        lines.push(Line::not_measured(
            "encoder moved",
            "to measure it, give --move, and move the tool when asked",
        ));
    }
    told(Step::Traffic);
    lines.extend(traffic(device, options.traffic_s)?);
    lines.extend(judge::state(&device.status()?));
    Ok(lines)
}

/// Traffic on another link to the same device, for the lines of [`run`].
pub fn other_link(device: &Device, seconds: f64) -> Result<Vec<Line>> {
    traffic(device, seconds)
}

/// Returns the lines of one measurement. A part of the hardware that does not answer gives a failed line instead of an
/// error, because the rest can still be measured.
fn measured(device: &Device, name: &str, request: SelfTestRequest) -> Result<Vec<Line>> {
    Ok(match device.self_test(request) {
        Ok(SelfTestValues::Chip(values)) => judge::chip(&values, device.info()),
        Ok(SelfTestValues::OptionBytes(values)) => judge::option_bytes(&values),
        Ok(SelfTestValues::Clocks(values)) => judge::clocks(&values, device.status()?.start.board),
        Ok(SelfTestValues::ErrorCorrection(values)) => judge::memory(&values),
        Ok(SelfTestValues::Output(values)) => judge::output(&values, device.status()?.tick_histogram.core_hz),
        Ok(SelfTestValues::Rest(values)) => judge::rest(&values),
        // The encoder is judged by what `movement` has seen.
        Ok(SelfTestValues::Encoder(_)) => Vec::new(),
        Ok(SelfTestValues::Flash(values)) => judge::flash(&values),
        Err(LinkError::SelfTest(refusal)) => match *refusal {
            SelfTestError::Hardware { what } => vec![Line::judged(
                name,
                what.as_str(),
                "an answer",
                false,
                "restart the device and test again; if it stays, the chip is damaged",
            )],
            refusal @ SelfTestError::AmplifierMayBeOn => {
                vec![Line::not_measured(name, &refusal.to_string())]
            }
            refusal => return Err(refusal.into()),
        },
        Err(failure) => return Err(failure),
    })
}

/// Lines of the flash, measured in a slot that is empty or that the user has named.
fn flash(device: &Device, erasable: Option<SlotId>) -> Result<Vec<Line>> {
    let slots = device.slots()?;
    // An empty slot has no library to lose. The slot that is played is never erased.
    let empty = (SlotId::ALL.into_iter())
        .find(|slot| slots.slots[slot.index()] == SlotState::Empty && slots.active != Some(*slot));
    let Some(slot) = erasable.or(empty) else {
        return Ok(vec![Line::not_measured(
            "flash",
            "no slot is empty: pass --use-slot with a slot whose library may be erased",
        )]);
    };
    let request = SelfTestRequest::Flash {
        slot,
        erases_library: erasable == Some(slot),
    };
    measured(device, "flash", request)
}

/// Records while the user moves the tool. Also returns for each line of the encoder whether it was seen low and whether
/// it was seen high.
fn movement(device: &Device, seconds: f64) -> Result<(Capture, [[bool; 2]; 2])> {
    let mut seen = [[false; 2]; 2];
    let mut failure = None;
    let mut blocks = 0u32;
    let mut next_look = LOOK_BLOCKS;
    let mut waits_ms = LOOK_WAITS_MS.into_iter().cycle();
    let moved = capture(
        device,
        seconds,
        0.0,
        || true,
        |_, _, _| {
            blocks += 1;
            if blocks >= next_look && failure.is_none() {
                next_look = blocks + LOOK_BLOCKS;
                thread::sleep(Duration::from_millis(waits_ms.next().unwrap_or_default()));
                match device.self_test(SelfTestRequest::Encoder) {
                    Ok(SelfTestValues::Encoder(EncoderValues { levels, .. })) => {
                        for (line, level) in seen.iter_mut().zip(levels) {
                            line[usize::from(level)] = true;
                        }
                    }
                    Ok(_) => {}
                    Err(found) => failure = Some(found),
                }
            }
        },
    )?;
    match (failure, moved) {
        (Some(failure), _) => Err(failure),
        (None, Some(moved)) => Ok((moved, seen)),
        (None, None) => unreachable!("it goes on to its end"),
    }
}

/// Lines of the traffic on a device's link, while a texture is played silently if there is one.
fn traffic(device: &Device, seconds: f64) -> Result<Vec<Line>> {
    let link = device.address().to_string();
    let name = format!("{link}: kernel loaded");
    let (is_loaded, line) = match load(device)? {
        Ok(texture) => (true, Line::judged(name, format!("by {texture}"), "a texture", true, "")),
        Err(why) => (false, Line::not_measured(name, &why)),
    };
    let measured = stream(device, seconds);
    // The texture is stopped also after a failure, so that the device is as before.
    if is_loaded {
        device.stop()?;
    }
    let mut lines = vec![line];
    lines.extend(judge::traffic(&link, &measured?));
    if device.address().is_of_an_emulator() {
        for line in lines.iter_mut().filter(|line| line.name.contains("round trip")) {
            let why = "it is a matter of the computer that emulates";
            *line = Line::not_measured(&line.name, why);
        }
    }
    Ok(lines)
}

/// Plays the first texture of the active library with a gain of zero, so that the kernel works while the output stays
/// at mid-scale. Returns the texture's name, or why none is played.
fn load(device: &Device) -> Result<std::result::Result<String, String>> {
    let Some(slot) = device.slots()?.active else {
        let why = "to load the kernel, upload and activate a library";
        return Ok(Err(why.to_owned()));
    };
    let Some(texture) = device.textures(slot)?.into_iter().next() else {
        return Ok(Err("the active library has no texture".to_owned()));
    };
    let request = PlayRequest {
        selection: Selection::Texture(texture.name.clone()),
        gain: 0.0,
        motion: MotionSource::Host,
        seed: 1,
    };
    match device.play(&request) {
        Ok(_) => Ok(Ok(texture.name.as_str().to_owned())),
        Err(LinkError::Play(refusal)) => Ok(Err(refusal.to_string())),
        Err(failure) => Err(failure),
    }
}

/// Records for `seconds` of the device's clock, and sends requests and keep-alives meanwhile. Ends earlier if no block
/// arrives within the timeout of an answer.
fn stream(device: &Device, seconds: f64) -> Result<Traffic> {
    let before: Status = device.status()?;
    let mut stream = Stream::start(device)?;
    let ticks = (seconds * f64::from(stream.rate_hz())) as u64;
    let mut first_tick = None;
    let mut heard_at = Instant::now();
    let mut next_ping = heard_at;
    let mut round_trips = Vec::new();
    while heard_at.elapsed() < device.timeouts().answer {
        let now = Instant::now();
        if now >= next_ping {
            round_trips.push(device.round_trip()?);
            next_ping = now + PING_INTERVAL;
        }
        device.keep_alive()?;
        let Some(arrival) = stream.next(Duration::from_millis(5))? else {
            continue;
        };
        heard_at = Instant::now();
        let first_tick = *first_tick.get_or_insert(arrival.first_tick);
        let next_tick = arrival.first_tick + arrival.samples.len() as u64;
        if next_tick.saturating_sub(first_tick) >= ticks {
            break;
        }
    }
    let loss = stream.stop()?;
    // By the time the status is read, the ticks of the last block are over.
    thread::sleep(Duration::from_millis(10));
    Ok(Traffic {
        before,
        after: device.status()?,
        loss,
        round_trips,
    })
}
