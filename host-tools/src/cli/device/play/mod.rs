//! `stylus play`

mod expected;
mod live;

use std::cell::{Cell, RefCell};
use std::path::{Path, PathBuf};
use std::time::Duration;

use clap::ArgGroup;
use clap::builder::RangedU64ValueParser;
use model_format::link::{
    Activity, MAX_PLAY_GAIN, MotionRefused, MotionSource, OutputStatus, PlayRequest, Selection, TextureName,
};
use model_format::scene::SceneName;
use serde::Serialize;
use stylus_link::link::play::{Drive, Driven, MAX_MOTION_RATE_HZ, MIN_MOTION_RATE_HZ, PlayCounts, Vibration, drive};
use stylus_link::link::{Device, LinkError};
use stylus_support::number::counted;
use stylus_support::{Error, Result};

use super::Link;
use crate::cli::input::{ConstantMotion, positive, warn_of_motion};
use crate::cli::interrupt::Interrupt;
use crate::cli::output::{print, print_json, warn};
use expected::{Level, LibraryFile};
use live::Live;

/// Parses a gain, the factor on the amplitude.
fn gain(text: &str) -> std::result::Result<f32, String> {
    match text.parse() {
        Ok(gain) if (0.0..=MAX_PLAY_GAIN).contains(&gain) => Ok(gain),
        _ => Err(format!("must be 0 to {MAX_PLAY_GAIN}")),
    }
}

/// Value of `--motion` for the stylus's own sensors.
const SENSORS: &str = "sensors";

#[derive(clap::Args)]
#[command(group = ArgGroup::new("selection").required(true).args(["texture", "scene"]))]
#[command(group = ArgGroup::new("given motion").args(["motion", "speed"]))]
pub struct Arguments {
    /// Name of a texture in the active library
    #[arg(long, value_name = "NAME")]
    texture: Option<String>,
    /// Name of a scene in the active library
    #[arg(long, value_name = "NAME")]
    scene: Option<String>,
    /// Factor on the amplitude, 0 to 4; 1 is as recorded
    #[arg(long, default_value_t = 1.0, allow_negative_numbers = true, value_parser = gain)]
    gain: f32,
    /// Motion: 'sensors', or a CSV with time_s, speed_mm_s, force_n, and position_mm and contact if a scene needs them,
    /// played once [default: sensors]
    #[arg(long, value_name = "sensors|CSV", conflicts_with_all = ["speed", "force"])]
    motion: Option<String>,
    #[command(flatten)]
    constant: ConstantMotion,
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
    /// File of the active library, to print the level that is expected along the given motion
    #[arg(long, value_name = "LIB", requires = "texture", requires = "given motion")]
    library: Option<PathBuf>,
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
    /// Largest speed that the sensors measured, mm/s; `None` with another motion, or if the sensors could not be read.
    fastest_mm_s: Option<f64>,
    saturations: u32,
    /// Numbers of samples at each limit.
    hard_limited: u32,
    slew_limited: u32,
    thermally_limited: u32,
    /// Number of mutes, without those of the begin and the end.
    mutes: u32,
    /// Fraction of the time in which the output was muted, according to the readings of the status.
    muted_share: Option<f64>,
    missed_ticks: u32,
    /// Level at the accelerometer before and during the playback; `None` if the device does not report it.
    #[serde(skip_serializing_if = "Option::is_none")]
    accelerometer: Option<Vibration>,
    /// Expected level, if `--library` is given.
    #[serde(skip_serializing_if = "Option::is_none")]
    expected: Option<Level>,
    /// The reason why the playback counts as failed.
    #[serde(skip_serializing_if = "Option::is_none")]
    failure: Option<String>,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    // Files and names are read before the device is asked, so that a slip needs no device to be told.
    let plan = plan(arguments)?;
    let request = request(arguments, &plan)?;
    let device = arguments.link.connect()?;
    let interrupt = Interrupt::listen()?;
    let before = device.status()?;
    let library = arguments
        .library
        .as_deref()
        .map(|path| LibraryFile::read(path, &before))
        .transpose()?;
    let mut heard = PlayCounts::since(&before);
    device.play(&request)?;
    let (played, fastest_mm_s) = keep_playing(&device, &plan, interrupt, &mut heard);
    let (driven, status) = stop(&device, played)?;
    let known = library.as_ref().zip(plan.motion.as_ref());
    // Only now it is known for how long the play lasted.
    let expected = known
        .map(|(library, motion)| library.level(&request, motion, driven.seconds))
        .transpose()?
        .flatten();
    let failure = heard.failure(&driven);
    let limited = limited(&before.output, &status);
    warn_of_limits(limited);
    let has_moved = fastest_mm_s.is_none_or(|speed| speed > 0.0);
    // A scene may have a constant motion of its own, which no sensor shows.
    if !has_moved && arguments.texture.is_some() {
        warn_of_stillness(&device);
    }
    if arguments.json {
        print_json(&PlayReport {
            texture: arguments.texture.as_deref(),
            scene: arguments.scene.as_deref(),
            driven,
            fastest_mm_s,
            saturations: status.saturations,
            hard_limited: limited[0],
            slew_limited: limited[1],
            thermally_limited: limited[2],
            mutes: heard.mutes,
            muted_share: heard.muted_share(),
            missed_ticks: heard.missed_ticks,
            accelerometer: heard.vibration(),
            expected,
            failure: failure.clone(),
        })?;
    } else {
        if failure.is_none() {
            warn_of_skipped(&driven, plan.rate_hz);
        }
        print(&summary(&request, &driven, &heard, expected))?;
    }
    match failure {
        None => Ok(()),
        Some(failure) => Err(Error::Request(format!("{}: {failure}", device.address()))),
    }
}

/// Outcome of a playback: what was sent; none if the output was stopped meanwhile.
type Played = std::result::Result<Option<Driven>, LinkError>;

/// Stops the output after a playback with the outcome `played`, and returns the status. The output is stopped after a
/// failure too, and the first failure is reported.
fn stop(device: &Device, played: Played) -> Result<(Driven, OutputStatus)> {
    // A stop now could end what another program plays over the other link since.
    let is_over = matches!(played, Ok(None) | Err(LinkError::Motion(MotionRefused::Held { .. })));
    if !is_over {
        let stopped = device.stop();
        let driven = played?;
        let (was_playing, status) = stopped?;
        if let (Some(driven), true) = (driven, was_playing) {
            return Ok((driven, status));
        }
    }
    let problem = "stopped over the stylus's other link, or by the device: `stylus status` says why";
    Err(Error::Request(format!("{}: {problem}", device.address())))
}

/// Warns of motions that could not be sent at `rate_hz`.
fn warn_of_skipped(driven: &Driven, rate_hz: u32) {
    if driven.skipped > 0 {
        warn(&format!(
            "{} of {} motions were left out, because the link or this computer is too slow for {rate_hz} Hz",
            driven.skipped,
            driven.motions + driven.skipped
        ));
    }
}

/// Returns the numbers of samples at the hard, the slew and the thermal limit between two states.
fn limited(before: &OutputStatus, after: &OutputStatus) -> [u32; 3] {
    // The device counts from its start.
    [
        after.hard_limited.saturating_sub(before.hard_limited),
        after.slew_limited.saturating_sub(before.slew_limited),
        (after.thermally_limited).saturating_sub(before.thermally_limited),
    ]
}

/// Warns if limits of the output acted.
fn warn_of_limits(limited: [u32; 3]) {
    let [hard, slew, thermal] = limited;
    if limited != [0; 3] {
        warn(&format!(
            "limits of the output acted on samples ({hard} hard, {slew} slew, {thermal} thermal): `stylus headroom \
             LIB` says in which bands, and at which gain the library fits"
        ));
    }
}

/// Warns that nothing moved.
fn warn_of_stillness(device: &Device) {
    warn(if device.address().is_of_an_emulator() {
        "nothing moved, so that nothing was heard: the virtual stylus needs --speed and --force, or --motion"
    } else {
        "nothing moved, so that nothing was heard: the sensors say 0 mm/s; move the tool, or give --speed and \
         --force; `stylus selftest --move` tests the sensors"
    });
}

fn summary(request: &PlayRequest, driven: &Driven, heard: &PlayCounts, expected: Option<Level>) -> String {
    let muted = match heard.muted_share() {
        Some(share) if share > 0.0 => format!(", muted {:.0} % of the time", share * 100.0),
        _ => String::new(),
    };
    format!(
        "played {} for {:.1} s ({}, {}): {}{muted}, {}{}; stopped, the output is at rest",
        request.selection,
        driven.seconds,
        counted(driven.motions, "motion"),
        counted(driven.keep_alives, "keep-alive"),
        mutes(heard),
        counted(heard.missed_ticks, "missed tick"),
        levels(heard.vibration(), expected)
    )
}

/// Returns the levels that are known, expected and measured, in words.
fn levels(vibration: Option<Vibration>, expected: Option<Level>) -> String {
    let mut text = String::new();
    if let Some(level) = expected {
        text = format!(
            "; expected {:.3} m/s² RMS, peak {:.3} m/s²",
            level.rms_m_s2, level.peak_m_s2
        );
    }
    if let Some(level) = vibration {
        text += &format!(
            "; at the accelerometer up to {:.3} m/s² RMS, {:.3} before",
            level.greatest_m_s2, level.before_m_s2
        );
    }
    text
}

/// Returns the number of mutes, with their reasons as far as they were observed.
fn mutes(heard: &PlayCounts) -> String {
    let count = counted(heard.mutes, "mute");
    match heard.reasons() {
        Some(reasons) if heard.mutes > 0 => format!("{count} ({reasons})"),
        _ => count,
    }
}

fn plan(arguments: &Arguments) -> Result<Drive> {
    let file = arguments.motion.as_deref();
    let file = file.filter(|file| *file != SENSORS).map(Path::new);
    let motion = arguments.constant.or_in(file, None)?;
    if let (Some(motion), Some(_)) = (&motion, &arguments.texture) {
        warn_of_motion(motion);
    }
    let seconds = match (arguments.seconds, &motion, file) {
        (None, Some(motion), Some(file)) => Some(motion.end_s(file)?),
        (seconds, ..) => seconds,
    };
    Ok(Drive {
        motion,
        rate_hz: arguments.rate,
        // A day or more counts as unlimited.
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

/// Returns the texture or scene to play. The command line names exactly one.
fn selection(arguments: &Arguments) -> Result<Selection> {
    let too_long = |what: &str, name: &str| {
        Error::Request(format!(
            "'{name}' is longer than the name of any {what}: `stylus slots` lists the names"
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

/// Plays until the end. Returns what was sent, and the largest speed that the sensors measured, mm/s.
fn keep_playing(device: &Device, plan: &Drive, interrupt: Interrupt, heard: &mut PlayCounts) -> (Played, Option<f64>) {
    // Both functions that `drive` calls use the display, one after the other.
    let live = RefCell::new(Live::begin(device, plan.motion.as_ref()));
    let is_over = Cell::new(false);
    let driven = drive(
        device,
        plan,
        || {
            live.borrow_mut().listen();
            !is_over.get() && !interrupt.is_raised()
        },
        |driven, status| {
            heard.hear(driven, status);
            live.borrow_mut().show(driven, status, heard);
            // Only an idle output has stopped, because otherwise it may still be fading out from the previous playback.
            is_over.set(status.output.activity == Activity::Idle);
        },
    );
    let fastest_mm_s = live.into_inner().end();
    let played = driven.map(|driven| (!is_over.get()).then_some(driven));
    (played, fastest_mm_s)
}
