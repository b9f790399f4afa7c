//! `stylus calibrate`

mod scales;

use std::io::BufRead;
use std::ops::Range;

use model_format::link::{Setting, SettingChange, SettingSet, Settings};
use scales::{Scales, ScalesReport};
use serde::Serialize;
use stylus_link::link::Device;
use stylus_link::procedures::calibrate::{AtRest, Coil, acceleration_zeros, verify};
use stylus_support::{Error, Result};

use super::Link;
use super::response::{Answer, ResponseArguments, ResponseReport};
use crate::cli::input::positive;
use crate::cli::interrupt::Interrupt;
use crate::cli::output::{print, print_json, tell};

#[derive(clap::Args)]
#[expect(clippy::struct_excessive_bools, reason = "each is an option of its own")]
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
    #[command(flatten)]
    scales: Scales,
    /// Duration of each measurement, in seconds
    #[arg(long, value_name = "S", value_parser = positive, default_value_t = 1.0)]
    seconds: f64,
    /// Ask nothing: the coil's values are on the command line, and the stylus is still, in the air
    #[arg(long)]
    yes: bool,
    /// Print the report as JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    response: ResponseArguments,
    #[command(flatten)]
    link: Link,
}

impl Arguments {
    /// True if any value of the coil is given.
    fn has_coil(&self) -> bool {
        [self.resistance, self.amplifier_gain, self.power_limit, self.hard_limit]
            .iter()
            .any(Option::is_some)
    }

    /// True if something besides a response is to be measured or set.
    fn sets_more_than_a_response(&self) -> bool {
        self.has_coil() || self.accelerometer || self.scales.are_wanted()
    }
}

#[derive(Serialize)]
struct CalibrationReport {
    coil: Coil,
    peak_volts: f64,
    peak_amperes: f64,
    peak_watts: f64,
    /// The sensors at rest, measured again after the force's zero was set; `None` if it was kept.
    at_rest: Option<AtRest>,
    /// The scales of force and path, if they were measured.
    scales: ScalesReport,
    /// Every setting that was changed, read back from the device.
    set: Vec<Set>,
}

/// The results for the coil and for the response, each if it was requested.
#[derive(Serialize)]
struct Report {
    #[serde(flatten)]
    calibration: Option<CalibrationReport>,
    #[serde(skip_serializing_if = "Option::is_none")]
    response: Option<ResponseReport>,
}

#[derive(Serialize)]
struct Set {
    name: &'static str,
    value: f32,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    arguments.response.check_output()?;
    let device = arguments.link.connect()?;
    let interrupt = Interrupt::listen()?;
    let mut report = Report {
        calibration: None,
        response: None,
    };
    // With --response alone, everything else stays as it is set.
    if !arguments.response.response || arguments.sets_more_than_a_response() {
        report.calibration = Some(calibrate(arguments, &device, interrupt)?);
    }
    let mut outcome = Ok(());
    if arguments.response.response {
        let asked: Option<Answer<'_>> = (!arguments.yes).then_some(&answer);
        // The coil's settings are stored by now, whatever comes of the response.
        let failed = |failure| match &report.calibration {
            Some(calibration) => after_storing(&calibration.set, "the response failed", &failure),
            None => failure,
        };
        let measured = arguments.response.run(&device, interrupt, asked);
        let (response, passed) = measured.map_err(failed)?;
        outcome = passed.map_err(failed);
        report.response = Some(response);
    }
    if arguments.json {
        print_json(&report)?;
        return outcome;
    }
    outcome?;
    if let Some(calibration) = &report.calibration {
        let noise = calibration.at_rest.map_or_else(String::new, |at_rest| {
            let zero = device
                .settings()
                .map_or(f64::NAN, |settings| settings.force_zero().0.into());
            format!(
                "; measured again, the force is {:.1} codes from its zero, with a noise of {:.1}",
                at_rest.mean[3] - zero,
                at_rest.deviation[3]
            )
        });
        print(&format!(
            "{} settings stored and read back{noise}",
            calibration.set.len()
        ))?;
    }
    match report.response {
        Some(_) => print("the response and its output-gain are stored and read back"),
        None => Ok(()),
    }
}

/// Sets the coil's values, the sensors' zeros, and the scales that were requested.
fn calibrate(arguments: &Arguments, device: &Device, interrupt: Interrupt) -> Result<CalibrationReport> {
    let settings = device.settings()?;
    let bench = CalibrationRun {
        arguments,
        device,
        interrupt,
    };
    let (coil, mut changes) = bench.coil(&settings)?;
    // The coil's values are refused before anybody holds the stylus for the measurements.
    check(&changes)?;
    let (zeros, scales) = bench.sensors(&settings)?;
    changes.extend(zeros);
    changes.extend(scales.changes());
    check(&changes)?;
    for line in coil.summary() {
        tell(&line);
    }
    for SettingChange { setting, value } in &changes {
        tell(&format!("  {setting} {value} {}", setting.spec().unit));
    }
    if !arguments.yes && answer("store these? [y/N]")?.trim() != "y" {
        return Err(Error::Request("nothing was stored".to_owned()));
    }
    // In one change, so that a failure stores none of them.
    let stored = device.set_all(&changes)?;
    let set: Vec<Set> = changes
        .iter()
        .map(|change| Set {
            name: change.setting.spec().name,
            value: stored.get(change.setting),
        })
        .collect();
    // An error from here on must say that the settings are stored.
    let verified = bench.verify(&scales, &stored);
    let at_rest = verified.map_err(|failure| after_storing(&set, "not verified", &failure))?;
    Ok(CalibrationReport {
        coil,
        peak_volts: coil.peak_volts(),
        peak_amperes: coil.peak_amperes(),
        peak_watts: coil.peak_watts(),
        at_rest,
        scales,
        set,
    })
}

/// Returns an error for settings that were stored although `what` came after them.
fn after_storing(set: &[Set], what: &str, failure: &Error) -> Error {
    let stored: Vec<String> = set
        .iter()
        .map(|Set { name, value }| format!("{name} {value}"))
        .collect();
    Error::Request(format!(
        "stored and read back: {}; {what}: {failure}",
        stored.join(", ")
    ))
}

/// Message for an answer that is missing.
const UNANSWERED: &str = "nobody answered: give --resistance, --amplifier-gain, --power-limit and --yes";

/// Checks the ranges of `changes` before they are stored.
fn check(changes: &[SettingChange]) -> Result<()> {
    for change in changes {
        change
            .setting
            .check(change.value)
            .map_err(|error| Error::Request(format!("nothing was stored: {error}")))?;
    }
    Ok(())
}

/// The stylus to calibrate, with the command's arguments.
struct CalibrationRun<'a> {
    arguments: &'a Arguments,
    device: &'a Device,
    interrupt: Interrupt,
}

impl CalibrationRun<'_> {
    /// Returns the coil, from the command line and the operator's answers, and the changes of its settings. If scales
    /// or a response are requested and no value of the coil, a coil that was set before is kept.
    fn coil(&self, settings: &Settings) -> Result<(Coil, Vec<SettingChange>)> {
        let arguments = self.arguments;
        let mut coil = Coil {
            resistance: settings.get(Setting::CoilResistance),
            amplifier_gain: settings.get(Setting::AmplifierGain),
            power_limit: settings.get(Setting::PowerLimit),
            hard_limit: settings.get(Setting::HardLimit),
        };
        let may_keep = arguments.scales.are_wanted() || arguments.response.response;
        if may_keep && !arguments.has_coil() {
            // Settings that were never set have placeholders, which are no coil.
            let set = self.device.status()?.settings.set;
            if SettingSet::REQUIRED.without(set) == SettingSet::NONE {
                return Ok((coil, Vec::new()));
            }
        }
        let value = |given: Option<f64>, question: &str| match given {
            Some(value) => Ok(value as f32),
            None if arguments.yes => Err(Error::Request(UNANSWERED.to_owned())),
            None => number(question),
        };
        coil.resistance = value(
            arguments.resistance,
            "resistance of the coil in ohms, measured with a multimeter at the unplugged coil:",
        )?;
        coil.amplifier_gain = value(
            arguments.amplifier_gain,
            "volts at the coil per volt at the amplifier's input:",
        )?;
        coil.power_limit = value(
            arguments.power_limit,
            "power that the coil bears continuously, in watts:",
        )?;
        if let Some(volts) = arguments.hard_limit {
            coil.hard_limit = volts as f32;
        }
        Ok((coil, coil.changes().to_vec()))
    }

    /// Measures a stylus that is held still in this `pose`. Only faults of `sensors` count.
    fn measure(&self, pose: &str, sensors: &Range<usize>) -> Result<AtRest> {
        if !self.arguments.yes {
            answer(&format!("hold the stylus still, {pose}, then press Enter"))?;
        }
        let goes_on = || !self.interrupt.is_raised();
        let measured = AtRest::measure(self.device, self.arguments.seconds, goes_on)?;
        let at_rest = measured.ok_or_else(|| Error::Request("interrupted; nothing was stored".to_owned()))?;
        let faults = at_rest.faults(sensors);
        if faults.is_empty() {
            return Ok(at_rest);
        }
        Err(Error::Request(format!("nothing was stored: {}", faults.join("; "))))
    }

    /// Measures the zeros of the sensors, and the scales that were requested.
    fn sensors(&self, settings: &Settings) -> Result<(Vec<SettingChange>, ScalesReport)> {
        let mut changes = Vec::new();
        if self.arguments.accelerometer {
            let pose = self.measure("in the air, tip down", &AtRest::ACCELERATION)?;
            let opposite = self.measure("in the air, tip up", &AtRest::ACCELERATION)?;
            let zeros = acceleration_zeros(&pose, &opposite, settings)
                .map_err(|words| Error::Request(format!("nothing was stored: {words}")))?;
            changes.extend(zeros);
        }
        let scales = self.scales()?;
        if !self.arguments.keep_force {
            // The zero includes the tip's weight, in the pose in which the stylus is used.
            let at_rest = self.measure("in the air, tip down", &AtRest::FORCE)?;
            changes.push(at_rest.force_zero());
        }
        Ok((changes, scales))
    }

    /// Measures again the force's zero and the scales that were set. Returns the sensors at rest if the force's zero
    /// was set.
    fn verify(&self, scales: &ScalesReport, stored: &Settings) -> Result<Option<AtRest>> {
        let at_rest = if self.arguments.keep_force {
            None
        } else {
            Some(verify(self.device, self.arguments.seconds)?)
        };
        self.verify_scales(scales, stored)?;
        Ok(at_rest)
    }
}

/// Asks `question` and returns the operator's answer.
fn answer(question: &str) -> Result<String> {
    tell(question);
    let mut line = String::new();
    let read = std::io::stdin().lock().read_line(&mut line);
    match read {
        Ok(bytes) if bytes > 0 => Ok(line),
        _ => Err(Error::Request(UNANSWERED.to_owned())),
    }
}

fn number(question: &str) -> Result<f32> {
    let line = answer(question)?;
    line.trim()
        .parse()
        .map_err(|_| Error::Request(format!("'{}' is not a number", line.trim())))
}
