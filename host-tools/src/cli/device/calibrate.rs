//! `stylus calibrate`

use std::io::BufRead;

use host_tools::link::calibrate::{AtRest, Coil, acceleration_zeros, verify};
use host_tools::link::{Device, LinkError};
use host_tools::support::error::{Error, Result};
use model_format::link::{Setting, SettingChange, Settings};
use serde::Serialize;

use super::connection::Link;
use crate::cli::input::positive;
use crate::cli::interrupt::Interrupt;
use crate::cli::output::{print, print_json, tell};

#[derive(clap::Args)]
#[expect(
    clippy::struct_excessive_bools,
    reason = "each is an option of its own"
)]
pub struct Arguments {
    /// Resistance of the coil in ohms, measured with a multimeter at the unplugged coil [asked for if not given]
    #[arg(long, value_name = "OHM", value_parser = positive)]
    resistance: Option<f64>,
    /// Volts at the coil per volt at the amplifier's input, from its data sheet or measured [asked for if not given]
    #[arg(long, value_name = "V/V", value_parser = positive)]
    amplifier_gain: Option<f64>,
    /// Power that the coil bears continuously, in watts [asked for if not given]
    #[arg(long, value_name = "W", value_parser = positive)]
    power_limit: Option<f64>,
    /// Largest voltage at the DAC to either side of mid-scale [default: as it is set]
    #[arg(long, value_name = "V", value_parser = positive)]
    hard_limit: Option<f64>,
    /// Leave the force sensor as it is set
    #[arg(long)]
    keep_force: bool,
    /// Measure the accelerometer's zeros too, in two opposite poses
    #[arg(long, conflicts_with = "yes")]
    accelerometer: bool,
    /// Duration of each measurement, in seconds
    #[arg(long, value_name = "S", value_parser = positive, default_value_t = 1.0)]
    seconds: f64,
    /// Ask nothing: the coil's values are on the command line, and the stylus is still, in the air
    #[arg(long, requires_all = ["resistance", "amplifier_gain", "power_limit"])]
    yes: bool,
    /// Print the report as JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    link: Link,
}

#[derive(Serialize)]
struct CalibrationReport {
    coil: Coil,
    peak_volts: f64,
    peak_amperes: f64,
    peak_watts: f64,
    /// The sensors at rest, measured again after their zeros were set.
    at_rest: Option<AtRest>,
    /// Every setting that was set, read back.
    set: Vec<Set>,
}

#[derive(Serialize)]
struct Set {
    name: &'static str,
    value: f32,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let device = arguments.link.connect()?;
    let interrupt = Interrupt::listen()?;
    let settings = device.settings()?;
    let coil = coil(arguments, &settings)?;
    let mut changes = coil.changes().to_vec();
    for change in &changes {
        change
            .setting
            .check(change.value)
            .map_err(|error| Error::Request(error.to_string()))?;
    }
    changes.extend(sensors(arguments, &device, interrupt, &settings)?);
    for line in coil.summary() {
        say(&line);
    }
    for SettingChange { setting, value } in &changes {
        say(&format!("  {setting} {value} {}", setting.spec().unit));
    }
    if !arguments.yes && answer("store these? [y/N]")?.trim() != "y" {
        return Err(Error::Request("nothing was stored".to_owned()));
    }
    let stored = device.set_all(&changes)?;
    let at_rest = if arguments.keep_force {
        None
    } else {
        Some(verify(&device, arguments.seconds).map_err(|failure| unverified(&changes, &failure))?)
    };
    let report = CalibrationReport {
        coil,
        peak_volts: coil.peak_volts(),
        peak_amperes: coil.peak_amperes(),
        peak_watts: coil.peak_watts(),
        at_rest,
        set: changes
            .iter()
            .map(|change| Set {
                name: change.setting.spec().name,
                value: stored.get(change.setting),
            })
            .collect(),
    };
    if arguments.json {
        return print_json(&report);
    }
    let noise = report.at_rest.map_or_else(String::new, |at_rest| {
        format!(
            "; measured again, the force is {:.1} codes from its zero, with a noise of {:.1}",
            at_rest.mean[3] - f64::from(stored.force_zero().0),
            at_rest.deviation[3]
        )
    });
    print(&format!(
        "{} settings stored and read back{noise}",
        report.set.len()
    ))
}

/// An error for settings that are stored although the measurement after them failed.
fn unverified(changes: &[SettingChange], failure: &LinkError) -> Error {
    let stored: Vec<String> = changes
        .iter()
        .map(|SettingChange { setting, value }| format!("{setting} {value}"))
        .collect();
    Error::Request(format!(
        "stored and read back: {}; not verified: {failure}",
        stored.join(", ")
    ))
}

/// The coil by the command line, and by what the operator answers.
fn coil(arguments: &Arguments, settings: &Settings) -> Result<Coil> {
    let value = |given: Option<f64>, question: &str| match given {
        Some(value) => Ok(value as f32),
        None => number(question),
    };
    let resistance = value(
        arguments.resistance,
        "resistance of the coil in ohms, measured with a multimeter at the unplugged coil:",
    )?;
    let amplifier_gain = value(
        arguments.amplifier_gain,
        "volts at the coil per volt at the amplifier's input:",
    )?;
    let power_limit = value(
        arguments.power_limit,
        "power that the coil bears continuously, in watts:",
    )?;
    let as_it_is = settings.get(Setting::HardLimit);
    Ok(Coil {
        resistance,
        amplifier_gain,
        power_limit,
        hard_limit: arguments.hard_limit.map_or(as_it_is, |volts| volts as f32),
    })
}

/// The zeros of the sensors, measured.
fn sensors(
    arguments: &Arguments,
    device: &Device,
    interrupt: Interrupt,
    settings: &Settings,
) -> Result<Vec<SettingChange>> {
    let measure = |pose: &str, is_force_alone: bool| -> Result<AtRest> {
        if !arguments.yes {
            answer(&format!("hold the stylus still, {pose}, then press Enter"))?;
        }
        let measured = AtRest::measure(device, arguments.seconds, || !interrupt.is_raised())?;
        let at_rest =
            measured.ok_or_else(|| Error::Request("interrupted; nothing was stored".to_owned()))?;
        let faults = at_rest.faults(is_force_alone);
        if faults.is_empty() {
            return Ok(at_rest);
        }
        Err(Error::Request(format!(
            "nothing was stored: {}",
            faults.join("; ")
        )))
    };
    let mut changes = Vec::new();
    if arguments.accelerometer {
        let pose = measure("in the air, tip down", arguments.keep_force)?;
        let opposite = measure("in the air, tip up", arguments.keep_force)?;
        let zeros = acceleration_zeros(&pose, &opposite, settings);
        changes
            .extend(zeros.map_err(|words| Error::Request(format!("nothing was stored: {words}")))?);
        // The tip's weight is part of the force in the pose in which the stylus is used.
        say("next is the force: turn the tip down again");
    }
    if !arguments.keep_force {
        changes.push(measure("in the air, tip down", true)?.force_zero());
    }
    Ok(changes)
}

/// Prints to standard error, so that standard output holds the report alone.
fn say(text: &str) {
    tell(text);
}

/// The operator's answer to `question`.
fn answer(question: &str) -> Result<String> {
    say(question);
    let mut line = String::new();
    let read = std::io::stdin().lock().read_line(&mut line);
    match read {
        Ok(bytes) if bytes > 0 => Ok(line),
        _ => Err(Error::Request(
            "nobody answered: give --resistance, --amplifier-gain, --power-limit and --yes"
                .to_owned(),
        )),
    }
}

fn number(question: &str) -> Result<f32> {
    let line = answer(question)?;
    line.trim()
        .parse()
        .map_err(|_| Error::Request(format!("'{}' is not a number", line.trim())))
}
