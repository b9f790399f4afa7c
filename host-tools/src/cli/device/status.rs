//! `stylus status`

use host_tools::support::error::Result;
use model_format::link::{
    Activity, ClockSource, DeviceInfo, FLASH_SUPPLY_MV, LinkCounters, MotionSource, MuteReason,
    OutputStatus, StartReport, Status, UploadState,
};
use serde::Serialize;

use super::connection::Link;
use super::histogram;
use crate::cli::output::{print, print_json};

#[derive(clap::Args)]
pub struct Arguments {
    /// Print all figures as JSON
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    link: Link,
}

#[derive(Serialize)]
struct StatusReport<'a> {
    link: String,
    device: &'a DeviceInfo,
    /// Reasons for muting, in words.
    muted: Vec<String>,
    status: &'a Status,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let device = arguments.link.connect()?;
    let status = device.status()?;
    if arguments.json {
        return print_json(&StatusReport {
            link: device.address().to_string(),
            device: device.info(),
            muted: status.output.mute.iter().map(|r| r.to_string()).collect(),
            status: &status,
        });
    }
    print(&text(device.info(), &status))
}

/// The status with one line per subject.
fn text(info: &DeviceInfo, status: &Status) -> String {
    let mut lines = vec![
        format!(
            "{} {}: firmware {} ({}), protocol {}, libraries of format {}",
            info.product,
            info.serial,
            info.firmware_version,
            info.build,
            info.protocol_version,
            info.library_format_version
        ),
        format!("up       {}", uptime(status)),
    ];
    if let Some(fault) = &status.fault {
        lines.push(format!(
            "FAULT    {:?} at {:#010x}, detail {:#x} {}",
            fault.kind, fault.program_counter, fault.detail, fault.text
        ));
    }
    if status.settings_faulty {
        lines.push(
            "SETTINGS could not be read, so the defaults are in use; set them again".to_owned(),
        );
    }
    lines.extend(start(status.start));
    let library = match status.active {
        Some(slot) => format!("slot {slot}, checksum {:08x}", status.library_crc32),
        None => "none active".to_owned(),
    };
    lines.push(format!("library  {library}{}", upload(&status.upload)));
    lines.push(format!("output   {}", output(&status.output)));
    lines.push(format!("muted    {}", mutes(&status.output)));
    lines.push(format!(
        "limits   saturated {}, hard limit {}, slew {}, thermal {} samples; coil at {:.1} % of its limit, gain {:.1} %",
        status.output.saturations,
        status.output.hard_limited,
        status.output.slew_limited,
        status.output.thermally_limited,
        f64::from(status.output.thermal_load_permille) / 10.0,
        f64::from(status.output.thermal_gain_permille) / 10.0
    ));
    lines.push(format!(
        "recorder {}, {} blocks, {} lost",
        if status.record.recording {
            "recording"
        } else {
            "idle"
        },
        status.record.blocks,
        status.record.lost_blocks
    ));
    lines.push(format!("USB      {}", link(&status.usb)));
    lines.push(format!("serial   {}", link(&status.serial)));
    lines.push(format!(
        "tick     {} ticks, {} missed, {} late frames, {} late conversions",
        status.tick.ticks,
        status.tick.missed,
        status.tick.late_frames,
        status.tick.late_conversions
    ));
    let histogram = histogram::draw(&status.tick_histogram);
    lines.push(format!(
        "tick time {}",
        histogram.replace('\n', "\n         ")
    ));
    lines.join("\n")
}

/// The start: clock, silicon and supply, and a line for each thing to see to.
fn start(start: StartReport) -> Vec<String> {
    let mut lines = vec![format!(
        "start    {} clock, silicon revision {}, brown-out level {}, {} quick faults",
        start.clock, start.revision, start.brown_out_level, start.quick_faults
    )];
    if start.safe_mode {
        lines.push(
            "SAFE     the device plays nothing; switch the power off and on, or press the reset button, to leave"
                .to_owned(),
        );
    }
    match start.clock {
        ClockSource::External => {}
        ClockSource::Internal => lines.push(
            "CLOCK    the external clock is missing or failed: pitch and times are within 1 %"
                .to_owned(),
        ),
        ClockSource::InternalUnmultiplied => lines
            .push("CLOCK    no clock could be multiplied: nothing is sampled or played".to_owned()),
    }
    if let Some(stage) = start.hung_stage {
        lines.push(format!(
            "HUNG     a start did not get past the stage: {stage}"
        ));
    }
    if start.supply_low {
        lines.push(format!(
            "SUPPLY   below {FLASH_SUPPLY_MV} mV: no upload and no change of settings until it rises"
        ));
    }
    if start.brown_out_level == 0 {
        lines.push(
            "BROWNOUT the brown-out reset is off in the option bytes: set BOR_LEV to 3 with the probe".to_owned(),
        );
    }
    lines
}

fn uptime(status: &Status) -> String {
    let seconds = status.uptime_ms as f64 / 1000.0;
    format!(
        "{seconds:.1} s; last reset by {}, {} resets since power came",
        status.reset, status.resets
    )
}

fn upload(state: &UploadState) -> String {
    match state {
        UploadState::Idle => String::new(),
        UploadState::Receiving(progress) => format!(
            "; receiving into slot {}: {} of {} bytes",
            progress.slot, progress.next_offset, progress.upload.length
        ),
    }
}

/// State of the player in a few words.
pub fn output(output: &OutputStatus) -> String {
    let what = match &output.activity {
        Activity::Idle => "idle".to_owned(),
        Activity::Playing { selection, motion } => {
            let motion = match motion {
                MotionSource::Sensors => "the sensors",
                MotionSource::Host => "the host",
            };
            format!("playing {selection} along the motion of {motion}")
        }
        Activity::FadingOut => "fading out".to_owned(),
        Activity::Activating => "taking over another library".to_owned(),
    };
    if output.mute.is_empty() {
        what
    } else {
        format!("{what}; muted: {}", output.mute)
    }
}

fn mutes(output: &OutputStatus) -> String {
    let counts = MuteReason::ALL.iter().zip(output.mute_counts);
    let words: Vec<String> = counts
        .map(|(reason, count)| format!("{reason} {count} x"))
        .collect();
    words.join(", ")
}

fn link(counters: &LinkCounters) -> String {
    format!(
        "{} frames, {} malformed, {} oversized, {} line errors, {} unsent",
        counters.frames,
        counters.malformed,
        counters.oversized,
        counters.line_errors,
        counters.unsent
    )
}
