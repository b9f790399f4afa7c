//! The part of `stylus calibrate` on the response, `stylus check`, and the stored response in `stylus status`.

use std::path::PathBuf;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use model_format::link::{ResponseChange, ResponseState, StoredResponse};
use serde::Serialize;
use stylus_dsp::equaliser::CALIBRATION_GAIN_DB;
use stylus_dsp::response::Bandwidths;
use stylus_link::link::Device;
use stylus_link::procedures::response::{
    Calibrated, DeviceBench, Failure, Fault, Flatness, Options, Verdict, calibrate, check,
};
use stylus_report::plot::{Caption, Curve, responses};
use stylus_support::date::utc;
use stylus_support::{Error, Result};

use super::Link;
use crate::cli::files::Overwrite;
use crate::cli::input::{of_axes, positive};
use crate::cli::interrupt::Interrupt;
use crate::cli::output::{note, print, print_json, tell};

/// A function that asks the operator a question and returns the answer.
pub type Answer<'a> = &'a dyn Fn(&str) -> Result<String>;

#[derive(clap::Args)]
pub struct ResponseArguments {
    /// Measure what the tip does for a voltage, and equalise it; without the coil's values, those that are set stay
    #[arg(long)]
    pub response: bool,
    /// Bandwidth of the accelerometer in hertz: one for all axes, or X,Y,Z; its roll-off is then made up for
    #[arg(long, value_name = "HZ", value_delimiter = ',', value_parser = positive, requires = "response")]
    accelerometer_bandwidth: Vec<f64>,
    /// Sine that coil and limits bear at every frequency that is corrected, in m/s² RMS
    #[arg(long, value_name = "M_S2", value_parser = positive, default_value_t = 1.0)]
    level: f64,
    /// Largest gain of the equaliser over the mean of the response, in decibels
    #[arg(long, value_name = "DB", value_parser = positive, default_value_t = CALIBRATION_GAIN_DB)]
    max_gain: f64,
    /// Invert the output if a positive voltage moves the tip against the accelerometer's positive axis
    #[arg(long, requires = "response")]
    invert: bool,
    /// Write the response before and after as a picture
    #[arg(long, value_name = "SVG", requires = "response")]
    svg: Option<PathBuf>,
    #[command(flatten)]
    overwrite: Overwrite,
}

/// The result of a calibration as JSON.
#[derive(Serialize)]
pub struct ResponseReport {
    verdict: String,
    /// Fault that was found; `None` if there is none.
    #[serde(skip_serializing_if = "Option::is_none")]
    fault: Option<Fault>,
    found: Option<Calibrated>,
}

impl ResponseArguments {
    /// Checks the file of the picture that will be written.
    pub fn check_output(&self) -> Result<()> {
        let svg = self.svg.as_ref();
        svg.map_or(Ok(()), |svg| self.overwrite.file(svg))
    }

    /// Asks the operator to hold the stylus, and notes what is unknown about the accelerometer.
    fn prepare(&self, answer: Option<Answer<'_>>) -> Result<()> {
        if let Some(answer) = answer {
            answer(
                "hold the stylus as in use, with the tip in the air, and stay so for half a minute; then press Enter",
            )?;
        }
        if self.accelerometer_bandwidth.is_empty() {
            note(
                "the accelerometer's own roll-off is not known and counts as the actuator's: see \
                 --accelerometer-bandwidth",
            );
        }
        Ok(())
    }

    /// Measures, verifies and stores the response. `answer` asks the operator; `None` if nobody is asked. If the
    /// actuator has a fault, nothing is stored, and the error stands beside the report.
    ///
    /// # Errors
    /// The link is lost, Ctrl-C was pressed, the operator does not answer or declines, the picture cannot be written,
    /// or the number of bandwidths is neither one nor three.
    pub fn run(
        &self,
        device: &Device,
        interrupt: Interrupt,
        answer: Option<Answer<'_>>,
    ) -> Result<(ResponseReport, Result<()>)> {
        self.prepare(answer)?;
        let options = Options {
            bandwidths: bandwidths(&self.accelerometer_bandwidth)?,
            max_gain_db: self.max_gain,
            level_m_s2: self.level,
            invert: self.invert,
        };
        let goes_on = || !interrupt.is_raised();
        let now = SystemTime::now()
            .duration_since(SystemTime::UNIX_EPOCH)
            .map_or(0, |since| since.as_secs());
        let mut heard = |step: &str| note(&format!("  {step}"));
        let outcome =
            DeviceBench::new(device, &goes_on).and_then(|mut bench| calibrate(&mut bench, &options, now, &mut heard));
        let done = match outcome {
            Ok(done) => done,
            Err(Failure::Fault(fault)) => {
                let fault = with_resistance(fault, answer)?;
                let report = ResponseReport {
                    verdict: fault.verdict.name(),
                    fault: Some(fault.clone()),
                    found: None,
                };
                let failure = Failure::Fault(fault);
                return Ok((report, Err(Error::Request(format!("nothing was stored: {failure}")))));
            }
            Err(Failure::Link(failure)) => return Err(failure.into()),
            Err(Failure::Interrupted) => {
                return Err(Error::Request("interrupted; nothing was stored".to_owned()));
            }
        };
        // Before the question, because the picture helps to answer it.
        if let Some(path) = &self.svg {
            picture(&done, device.address().is_of_an_emulator())?.write(path)?;
        }
        tell(&summary(&done));
        if let Some(answer) = answer
            && answer("store this? [y/N]")?.trim() != "y"
        {
            return Err(Error::Request("nothing was stored".to_owned()));
        }
        // The device stores only the response that was proposed and proved, which the hash names.
        let id = done.response.id();
        device.set_response(ResponseChange::Store { id })?;
        let report = ResponseReport {
            verdict: "pass".to_owned(),
            fault: None,
            found: Some(done),
        };
        Ok((report, Ok(())))
    }
}

/// Returns the fault. If nothing moves, it is completed with a resistance that the operator measures.
fn with_resistance(fault: Fault, answer: Option<Answer<'_>>) -> Result<Fault> {
    let (Verdict::NothingMoves, Some(answer)) = (fault.verdict, answer) else {
        return Ok(fault);
    };
    let line =
        answer("nothing moves: resistance at the amplifier's output with the coil plugged in, in ohms, or 'open':")?;
    Ok(match line.trim().parse::<f64>() {
        _ if line.trim() == "open" => Verdict::OpenWire.seen("nothing moves, and no current flows"),
        Ok(ohm) => Verdict::DeadCoil.seen(format!("nothing moves, and the coil has {ohm} Ω")),
        Err(_) => fault,
    })
}

fn bandwidths(given: &[f64]) -> Result<Bandwidths> {
    let given = of_axes("--accelerometer-bandwidth", given)?;
    Ok(Bandwidths(given.map_or([None; 3], |given| given.map(Some))))
}

fn summary(done: &Calibrated) -> String {
    let (response, [low, high]) = (&done.response, done.design.band_hz);
    let flat = |flat: &Flatness| {
        format!(
            "{:+.1} dB, {:.2} dB RMS and {:.2} dB at worst from flat",
            flat.level_db, flat.rms_db, flat.worst_db
        )
    };
    format!(
        "resonance {:.1} Hz with a damping ratio of {:.2}, delay {:.0} µs\n{low:.0} to {high:.0} Hz before: {}\n\
         through the equaliser ({} sections, gain up to {:.1} dB): {}\noutput-gain {:.5} V/(m/s²); passed in {:.0} s",
        response.resonance_hz,
        response.damping_ratio,
        response.delay_us,
        flat(&done.before.1),
        done.design.sections[0].len(),
        done.design.max_gain_db,
        flat(&done.after.1),
        done.design.output_gain,
        done.seconds
    )
}

fn picture(done: &Calibrated, simulated: bool) -> Result<stylus_report::plot::Svg> {
    let caption = Caption {
        title: "acceleration of the tip over what is asked for",
        simulated,
    };
    let curves = [
        Curve {
            name: "before",
            points: &done.before.0,
        },
        Curve {
            name: "through the equaliser",
            points: &done.after.0,
        },
    ];
    responses(&caption, &curves, done.design.band_hz, 2.0)
}

#[derive(clap::Args)]
pub struct CheckArguments {
    /// Bandwidth of the accelerometer in hertz, as it was given to `calibrate`
    #[arg(long, value_name = "HZ", value_delimiter = ',', value_parser = positive)]
    accelerometer_bandwidth: Vec<f64>,
    /// Print the result as JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    link: Link,
}

pub fn run_check(arguments: &CheckArguments) -> Result<()> {
    let device = arguments.link.connect()?;
    let interrupt = Interrupt::listen()?;
    let stored = device
        .response()?
        .stored
        .ok_or_else(|| Error::Request("no response is stored: run `stylus calibrate --response` first".to_owned()))?;
    let goes_on = || !interrupt.is_raised();
    let bandwidths = bandwidths(&arguments.accelerometer_bandwidth)?;
    let checked = DeviceBench::new(&device, &goes_on)
        .and_then(|mut bench| check(&mut bench, &stored.response, &bandwidths))
        .map_err(|failure| Error::Request(failure.to_string()))?;
    if arguments.json {
        print_json(&checked)?;
    }
    // After the JSON, because a script wants the figures of a check that fails, too.
    if !checked.ok {
        let moved = checked.moved.join("; ");
        return Err(Error::Request(format!(
            "{moved}: find out why, or run `stylus calibrate --response`"
        )));
    }
    if arguments.json {
        return Ok(());
    }
    print(&format!(
        "as calibrated: gain {:+.1} dB, resonance {:.1} Hz, direction within {:.0} degrees",
        checked.gain_db,
        checked.resonance_hz.unwrap_or(f64::NAN),
        checked.axis_deg
    ))
}

/// A summary of the stored response.
#[derive(Serialize)]
pub struct Summary {
    /// Hash of the whole response.
    id: String,
    /// Day of the measurement, UTC.
    measured_on: String,
    /// Largest deviation from a flat response in the verification, dB.
    worst_db: f32,
    /// RMS of that deviation, dB.
    rms_db: f32,
    /// Settings that have changed since the measurement, in words; empty if none has.
    changed_since: String,
}

impl Summary {
    pub fn of(state: &ResponseState) -> Option<Self> {
        let StoredResponse { response, id, stale } = state.stored.as_ref()?;
        Some(Self {
            id: format!("{id:08x}"),
            measured_on: utc(UNIX_EPOCH + Duration::from_secs(response.measured_at))[..10].to_owned(),
            worst_db: response.worst_db,
            rms_db: response.rms_db,
            changed_since: stale.to_string(),
        })
    }

    pub fn line(&self) -> String {
        let Self {
            id,
            measured_on,
            worst_db,
            rms_db,
            changed_since,
        } = self;
        let stale = if changed_since.is_empty() {
            String::new()
        } else {
            format!("; STALE: {changed_since} changed since, calibrate again")
        };
        format!("{id}, measured on {measured_on}, flat within {worst_db:.1} dB ({rms_db:.1} dB RMS){stale}")
    }
}
