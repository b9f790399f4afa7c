//! `stylus play`

use std::path::PathBuf;
use std::time::Duration;

use clap::builder::RangedU64ValueParser;
use host_tools::link::Device;
use host_tools::link::play::{Drive, Driven, MAX_MOTION_RATE_HZ, MIN_MOTION_RATE_HZ, drive};
use host_tools::playing::motion::MotionPath;
use host_tools::support::error::{Error, Result};
use model_format::link::{Activity, MotionSource, PlayRequest, Selection, Status, TextureName};
use model_format::scene::SceneName;
use model_format::{MillimetresPerSecond, Newton};
use serde::Serialize;

use super::connection::Link;
use super::interrupt::Interrupt;
use super::live_line::live_line;
use super::status::output;
use crate::cli::input::{not_negative, positive};
use crate::cli::output::{print, print_json, warn};

/// Value of `--motion` for the stylus's own sensors.
const SENSORS: &str = "sensors";

#[derive(clap::Args)]
pub struct Arguments {
    /// Name of a texture in the active library
    #[arg(
        long,
        value_name = "NAME",
        required_unless_present = "scene",
        conflicts_with = "scene"
    )]
    texture: Option<String>,
    /// Name of a scene in the active library
    #[arg(long, value_name = "NAME")]
    scene: Option<String>,
    /// Factor on the amplitude; 1 is as recorded
    #[arg(long, default_value_t = 1.0, allow_negative_numbers = true)]
    gain: f32,
    /// Motion: 'sensors', or a CSV with time_s, speed_mm_s, force_n, and position_mm and contact if a scene needs them,
    /// played once [default: sensors]
    #[arg(long, value_name = "sensors|CSV", conflicts_with_all = ["speed", "force"])]
    motion: Option<String>,
    /// Constant tangential speed instead, in mm/s
    #[arg(long, value_name = "MM_S", value_parser = not_negative, requires = "force")]
    speed: Option<f64>,
    /// Constant normal force instead, in newtons
    #[arg(long, value_name = "N", value_parser = not_negative, requires = "speed")]
    force: Option<f64>,
    /// Duration, in seconds [default: until the motion's end, or Ctrl-C]
    #[arg(long, value_name = "S", value_parser = positive)]
    seconds: Option<f64>,
    /// Rate at which motions are sent, in hertz
    #[arg(
        long,
        value_name = "HZ",
        default_value_t = MAX_MOTION_RATE_HZ,
        value_parser = RangedU64ValueParser::<u32>::new()
            .range(u64::from(MIN_MOTION_RATE_HZ)..=u64::from(MAX_MOTION_RATE_HZ))
    )]
    rate: u32,
    /// Seed of the noise: the same seed gives the same samples
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Print the result as JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    link: Link,
}

#[derive(Serialize)]
struct PlayReport<'a> {
    #[serde(skip_serializing_if = "Option::is_none")]
    texture: Option<&'a str>,
    #[serde(skip_serializing_if = "Option::is_none")]
    scene: Option<&'a str>,
    #[serde(flatten)]
    driven: Driven,
    saturations: u32,
    hard_limited: u32,
    slew_limited: u32,
    thermally_limited: u32,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let plan = plan(arguments)?;
    let request = request(arguments, &plan)?;
    let device = arguments.link.connect()?;
    let interrupt = Interrupt::listen()?;
    device.play(&request)?;
    let played = keep_playing(&device, &plan, &interrupt);
    // The output is switched off after a failure, too; the first failure is the one that is reported.
    let stopped = device.stop();
    let driven = played?;
    let (was_playing, status) = stopped?;
    if !was_playing {
        let problem = "the device had stopped by itself; read its status";
        return Err(Error::Request(format!("{}: {problem}", device.address())));
    }
    if arguments.json {
        return print_json(&PlayReport {
            texture: arguments.texture.as_deref(),
            scene: arguments.scene.as_deref(),
            driven,
            saturations: status.saturations,
            hard_limited: status.hard_limited,
            slew_limited: status.slew_limited,
            thermally_limited: status.thermally_limited,
        });
    }
    if driven.skipped > 0 {
        warn(&format!(
            "{} motions were left out, because the link or this computer is too slow for {} Hz",
            driven.skipped, plan.rate_hz
        ));
    }
    print(&format!(
        "played {} for {:.1} s ({} motions, {} keep-alives); stopped, the output is at rest",
        request.selection, driven.seconds, driven.motions, driven.keep_alives
    ))
}

fn plan(arguments: &Arguments) -> Result<Drive> {
    let motion = match (&arguments.motion, arguments.speed, arguments.force) {
        (None, Some(speed), Some(force)) => Some(MotionPath::constant(
            MillimetresPerSecond(speed as f32),
            Newton(force as f32),
        )?),
        (Some(file), ..) if file != SENSORS => Some(MotionPath::from_csv(&PathBuf::from(file))?),
        _ => None,
    };
    let end = motion.as_ref().map(MotionPath::duration_s);
    let seconds = arguments.seconds.or(end.filter(|&seconds| seconds > 0.0));
    Ok(Drive {
        motion,
        rate_hz: arguments.rate,
        // More than a day is as good as until Ctrl-C.
        duration: seconds
            .filter(|&seconds| seconds < 86_400.0)
            .map(Duration::from_secs_f64),
    })
}

fn request(arguments: &Arguments, plan: &Drive) -> Result<PlayRequest> {
    Ok(PlayRequest {
        selection: selection(arguments)?,
        gain: arguments.gain,
        motion: match plan.motion {
            Some(_) => MotionSource::Host,
            None => MotionSource::Sensors,
        },
        seed: arguments.seed,
    })
}

/// The texture or scene to play; the command line has exactly one of them.
fn selection(arguments: &Arguments) -> Result<Selection> {
    let too_long = |what: &str, name: &str| {
        Error::Request(format!(
            "no {what} has a name as long as '{name}'; see `stylus list`"
        ))
    };
    if let Some(name) = &arguments.scene {
        let scene = SceneName::try_from(name.as_str()).map_err(|_| too_long("scene", name))?;
        return Ok(Selection::Scene(scene));
    }
    let name = arguments.texture.as_deref().unwrap_or_default();
    let texture = TextureName::try_from(name).map_err(|_| too_long("texture", name))?;
    Ok(Selection::Texture(texture))
}

fn keep_playing(device: &Device, plan: &Drive, interrupt: &Interrupt) -> Result<Driven> {
    let line = live_line("playing; Ctrl-C stops");
    let mut ended = false;
    let goes_on = std::cell::Cell::new(true);
    let heard = |driven: &Driven, status: &Status| {
        line.set_message(format!(
            "{:.1} s, {}",
            driven.seconds,
            output(&status.output)
        ));
        // Only idle means stopped, because the output may still fade out of the previous play.
        if status.output.activity == Activity::Idle {
            ended = true;
            goes_on.set(false);
        }
    };
    let driven = drive(
        device,
        plan,
        || goes_on.get() && !interrupt.is_raised(),
        heard,
    )?;
    line.finish_and_clear();
    if ended {
        let problem = "the device has stopped by itself; read its status";
        return Err(Error::Request(format!("{}: {problem}", device.address())));
    }
    Ok(driven)
}
