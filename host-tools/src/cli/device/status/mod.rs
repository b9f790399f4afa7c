//! `stylus status`

mod watch;

use model_format::link::{
    Activity, ClockSource, DeviceInfo, FLASH_SUPPLY_MV, Fault, LEAST_BROWN_OUT_LEVEL, LeaseStatus, Levels,
    LinkCounters, Marks, MotionSource, MuteReason, OutputLimits, OutputStatus, SettingChange, SettingsChange,
    SettingsState, StartReport, Status, UpdatePhase, UpdateReport, UploadState,
};
use serde::Serialize;
use stylus_link::link::settings::cap;
use stylus_support::Result;

use super::Link;
use super::response::Summary;
use crate::cli::input::positive;
use crate::cli::output::{print, print_json};

#[derive(clap::Args)]
pub struct Arguments {
    /// Show the state and the sensors continuously, a line at a time, until Ctrl-C
    #[arg(long)]
    watch: bool,
    /// With --watch: interval between lines, in seconds
    #[arg(long, value_name = "S", value_parser = positive, requires = "watch", default_value_t = 0.2)]
    interval: f64,
    /// With --watch: duration, in seconds [default: until Ctrl-C]
    #[arg(long, value_name = "S", value_parser = positive, requires = "watch")]
    seconds: Option<f64>,
    /// Print all figures as JSON; with --watch each line
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
    /// The stored response, if any.
    response: Option<Summary>,
    /// Images and state of the update; `None` without a bootloader.
    update: Option<UpdateReport>,
}

pub fn run(arguments: &Arguments) -> Result<()> {
    let device = arguments.link.connect()?;
    if arguments.watch {
        return watch::run(&device, arguments);
    }
    let status = device.status()?;
    let response = Summary::of(&device.response()?);
    let update = device.update_state()?;
    if arguments.json {
        return print_json(&StatusReport {
            link: device.address().to_string(),
            device: device.info(),
            muted: status.output.mute.iter().map(|r| r.to_string()).collect(),
            status: &status,
            response,
            update,
        });
    }
    let mut text = text(device.info(), &status, update);
    if let Some(response) = response {
        text += &format!("\nresponse {}", response.line());
    }
    print(&text)
}

/// Returns the status with one line per subject.
fn text(info: &DeviceInfo, status: &Status, update: Option<UpdateReport>) -> String {
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
    let update = update.map_or("no bootloader".to_owned(), self::update);
    lines.push(format!("update   {update}"));
    if let Some(fault) = &status.fault {
        // Labels in capitals are of what needs attention.
        lines.push(self::fault(fault));
    }
    lines.extend(settings(&status.settings).map(|line| format!("SETTINGS {line}")));
    lines.extend(start(status.start));
    lines.extend(output_lines(status));
    lines.extend(counter_lines(status));
    lines.join("\n")
}

/// Returns the lines on library, output, limits and lease.
fn output_lines(status: &Status) -> Vec<String> {
    let library = match status.active {
        Some(slot) => format!("slot {slot}, checksum {:08x}", status.library_crc32),
        None => "none active".to_owned(),
    };
    let mut lines = vec![format!("library  {library}{}", upload(&status.upload))];
    let amplifier = if status.output.amplifier { "on" } else { "off" };
    lines.push(format!("output   {}; amplifier {amplifier}", output(&status.output)));
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
    lines.push(format!("in force {}", limits(&status.limits)));
    lines.push(format!("lease    {}", lease(status.lease)));
    if let Some(proposal) = &status.proposal {
        lines.push(format!(
            "PROPOSED a change of settings on {} by token {}, for {} s more: {}",
            proposal.from,
            proposal.token,
            proposal.remaining_ms / 1_000,
            change(&proposal.change)
        ));
    }
    lines
}

/// Returns the lines on counts, worst cases and levels.
fn counter_lines(status: &Status) -> [String; 7] {
    let times = &status.tick_histogram;
    let micros = |cycles: u32| f64::from(cycles) * 1e6 / f64::from(times.core_hz.max(1));
    [
        format!(
            "recorder {}, {} blocks, {} lost",
            if status.record.recording { "recording" } else { "idle" },
            status.record.blocks,
            status.record.lost_blocks
        ),
        format!("USB      {}", link(&status.usb)),
        format!("serial   {}", link(&status.serial)),
        format!(
            "tick     {} ticks, {} missed, {} late frames, {} late conversions, {} late outputs",
            status.tick.ticks,
            status.tick.missed,
            status.tick.late_frames,
            status.tick.late_conversions,
            status.tick.late_outputs
        ),
        format!("marks    {}", marks(&status.marks, status.tick_histogram.core_hz)),
        format!("sensors  {}", levels(&status.levels)),
        format!(
            "tick time {:.1} to {:.1} µs",
            micros(times.shortest),
            micros(times.longest)
        ),
    ]
}

/// Returns the lines on the start: clock, silicon and supply, and one for each item that needs attention.
fn start(start: StartReport) -> Vec<String> {
    let mut lines = vec![format!(
        "start    {}, {} clock, silicon revision {}, brown-out level {}, {} quick faults",
        start.board, start.clock, start.revision, start.brown_out_level, start.quick_faults
    )];
    if start.safe_mode {
        lines.push(
            "SAFE     nothing plays in safe mode: to end it, switch the power off and on, or press the reset button"
                .to_owned(),
        );
    }
    match start.clock {
        ClockSource::External => {}
        ClockSource::Internal => {
            let usb = if start.revision.lacks_trimming() {
                "; by reports this silicon does not trim USB's clock: use serial"
            } else {
                ""
            };
            lines.push(format!(
                "CLOCK    the external clock is missing or failed: pitch and times are off by up to 1 %{usb}"
            ));
        }
        ClockSource::InternalUnmultiplied => {
            lines.push("CLOCK    no clock could be multiplied: nothing is sampled or played".to_owned());
        }
    }
    if let Some(stage) = start.hung_stage {
        lines.push(format!("HUNG     an earlier start hung at the stage: {stage}"));
    }
    if start.supply_low {
        lines.push(format!(
            "SUPPLY   below {FLASH_SUPPLY_MV} mV: amplifier off, no upload and no change of settings until it rises"
        ));
    }
    if start.brown_out_level < LEAST_BROWN_OUT_LEVEL {
        lines.push(
            "BROWNOUT the brown-out reset is off in the option bytes: set BOR_LEV to 3 with the probe".to_owned(),
        );
    }
    lines
}

fn fault(fault: &Fault) -> String {
    let address = fault
        .address
        .map_or(String::new(), |address| format!(", access to {address:#010x}"));
    format!(
        "FAULT    {:?} at {:#010x}{address}, detail {:#x} {}",
        fault.kind, fault.program_counter, fault.detail, fault.text
    )
}

/// Returns the worst cases since the start, for a processor with a clock of `core_hz`.
fn marks(marks: &Marks, core_hz: u32) -> String {
    let micros = |cycles: u32| f64::from(cycles) * 1e6 / f64::from(core_hz.max(1));
    format!(
        "stack {} of {} bytes; at most {:.2} µs from trigger to tick, {:.2} µs of masked interrupts, {:.1} ms between \
         feeds of the watchdog",
        marks.stack_used_bytes,
        marks.stack_bytes,
        micros(marks.longest_tick_delay_cycles),
        micros(marks.longest_critical_section_cycles),
        f64::from(marks.longest_watchdog_gap_us) / 1e3
    )
}

/// Returns the limits of the output, in words.
fn limits(limits: &OutputLimits) -> String {
    format!(
        "{:.3} V peak and {:.3} V RMS at the pin, {:.3} W held in the coil: {}",
        limits.peak_volt,
        limits.mean_square.sqrt(),
        limits.coil_watt,
        if limits.is_capped {
            cap()
        } else {
            "by the settings".to_owned()
        }
    )
}

/// Returns, in words, which link has the lease.
fn lease(lease: LeaseStatus) -> String {
    let holder = match lease.holder {
        None => "nobody plays".to_owned(),
        Some(link) if lease.is_alive => format!("{link} plays"),
        Some(link) => format!("{link} was playing and fell silent"),
    };
    format!("{holder}; {} refused", lease.refused)
}

/// Returns a change of settings in one line.
fn change(change: &SettingsChange) -> String {
    match change {
        SettingsChange::Reset => "reset".to_owned(),
        SettingsChange::Set(values) => {
            let value = |value: &SettingChange| format!("{} {}", value.setting, value.value);
            let words: Vec<String> = values.iter().map(value).collect();
            words.join(", ")
        }
    }
}

fn levels(levels: &Levels) -> String {
    if levels.samples == 0 {
        return "no levels yet".to_owned();
    }
    // Levels are in dB re one millionth of the unit.
    let unit = |decibel: f32| 10f64.powf(f64::from(decibel) / 20.0 - 6.0);
    format!(
        "vibration {:.1} dB re 1 µm/s² ({:.3} m/s² RMS); force {:.3} N, noise {:.1} dB re 1 µN \
         ({:.4} N RMS)",
        levels.vibration_decibel,
        unit(levels.vibration_decibel),
        levels.force_newton,
        levels.force_noise_decibel,
        unit(levels.force_noise_decibel)
    )
}

/// Returns everything about the settings that a user should know, one line each.
pub fn settings(state: &SettingsState) -> impl Iterator<Item = String> + use<> {
    let refusal = state.check_playable().err();
    let differing = (!state.differing.is_empty()).then(|| {
        format!(
            "{}: the copies in flash differed, so the tighter value holds; check it, then set it again",
            state.differing
        )
    });
    // Lost settings are told by the refusal to play, which says more.
    let mended = (state.mended && state.lost.is_empty()).then(|| {
        "one of the two copies in flash was damaged, or its writing was interrupted; it was rewritten".to_owned()
    });
    let unwritable = state.unwritable.then(|| {
        "the last change could not be written to flash: try again; if that fails, `stylus settings reset`".to_owned()
    });
    let refusal = refusal.map(|refusal| format!("nothing plays: {refusal}"));
    [refusal, differing, mended, unwritable].into_iter().flatten()
}

/// Returns both images' versions and the state of the update, in words.
fn update(report: UpdateReport) -> String {
    let phase = match report.phase {
        UpdatePhase::Confirmed => "confirmed".to_owned(),
        UpdatePhase::Committed { version } => format!("{version} follows at the restart"),
        UpdatePhase::Trial { left_ms, .. } => {
            format!(
                "ON TRIAL for {} s more: a reset puts the one before back",
                left_ms / 1000
            )
        }
        UpdatePhase::RolledBack { version, cause } => {
            format!("put back, because {version} was reset on its trial, by: {cause}")
        }
        UpdatePhase::GivenUp { version } => {
            format!("kept, because a sector of flash could not be written for {version}: update again")
        }
    };
    let bootloader = report
        .bootloader
        .map_or("none".to_owned(), |version| version.to_string());
    let key = if report.trusts_development_key {
        "; trusts the DEVELOPMENT KEY, so everybody's images"
    } else {
        ""
    };
    let unsigned = if report.takes_unsigned {
        "; takes an unsigned image until the next reset"
    } else {
        ""
    };
    format!(
        "image {}, bootloader {bootloader}, {phase}{key}{unsigned}",
        report.image
    )
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

/// Returns the state of the player in a few words.
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
        Activity::Probing => "probing".to_owned(),
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
    let words: Vec<String> = MuteReason::ALL
        .iter()
        .zip(output.mute_counts)
        .map(|(reason, count)| format!("{reason} {count} x"))
        .collect();
    words.join(", ")
}

fn link(counters: &LinkCounters) -> String {
    format!(
        "{} frames, {} malformed, {} oversized, {} line errors, {} unsent",
        counters.frames, counters.malformed, counters.oversized, counters.line_errors, counters.unsent
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_limits_in_force_are_told_in_volts_and_watts_and_by_whom() {
        let by_settings = OutputLimits {
            peak_volt: 0.5,
            mean_square: 0.04,
            coil_watt: 0.25,
            is_capped: false,
        };
        let told = "0.500 V peak and 0.200 V RMS at the pin, 0.250 W held in the coil: ";
        assert_eq!(limits(&by_settings), format!("{told}by the settings"));
        let capped = OutputLimits {
            is_capped: true,
            ..by_settings
        };
        assert_eq!(limits(&capped), format!("{told}{}", cap()));
    }
}
