//! Identity, versions, clock, and the state before anything was asked for.

use model_format::FORMAT_VERSION;
use model_format::link::{
    ClockSource, LEAST_BROWN_OUT_LEVEL, MuteReason, PROTOCOL_VERSION, SCHEMA_HASH, SiliconRevision,
    Status,
};

use crate::bench::Bench;
use crate::error::Result;

/// Length of a serial number, hexadecimal digits.
const SERIAL_DIGITS: usize = 24;

/// Clock of the processor, Hz.
const CORE_HZ: u32 = 400_000_000;

/// Checks the identity.
///
/// # Errors
/// The link fails.
pub fn check(bench: &mut Bench) -> Result<()> {
    let info = bench.device.info().clone();
    let status = bench.status()?;
    bench.judge("product", &info.product, "stylus", info.product == "stylus");
    let digits = info.serial.chars().filter(char::is_ascii_hexdigit).count();
    bench.judge(
        "serial number",
        &info.serial,
        "24 hexadecimal digits, not all alike",
        digits == SERIAL_DIGITS
            && info.serial.len() == digits
            && info
                .serial
                .bytes()
                .any(|digit| Some(&digit) != info.serial.as_bytes().first()),
    );
    let version = env!("CARGO_PKG_VERSION");
    bench.judge(
        "firmware version",
        format!("{} ({})", info.firmware_version, info.build),
        &format!("{version}, as this suite's"),
        info.firmware_version == version,
    );
    bench.judge(
        "protocol",
        format!("{} {:016x}", info.protocol_version, info.schema_hash),
        &format!("{PROTOCOL_VERSION} {SCHEMA_HASH:016x}"),
        (info.protocol_version, info.schema_hash) == (PROTOCOL_VERSION, SCHEMA_HASH),
    );
    bench.judge(
        "format of libraries",
        info.library_format_version,
        &FORMAT_VERSION.to_string(),
        info.library_format_version == FORMAT_VERSION,
    );
    start(bench, &status);
    at_rest(bench, &status);
    let later = bench.wait(bench.lengths.play_ms)?;
    let ticks = later.tick.ticks - status.tick.ticks;
    let missed = later.tick.missed - status.tick.missed;
    bench.judge(
        "ticks go on",
        format!("{ticks}, {missed} missed"),
        "some, 0 missed",
        ticks > 0 && missed == 0,
    );
    Ok(())
}

/// Checks clocks, silicon and supply.
fn start(bench: &mut Bench, status: &Status) {
    let core_hz = status.tick_histogram.core_hz;
    bench.judge(
        "processor's clock",
        format!("{core_hz} Hz"),
        "400 MHz",
        core_hz == CORE_HZ,
    );
    let start = status.start;
    bench.judge(
        "source of the clock",
        start.clock,
        "external",
        start.clock == ClockSource::External,
    );
    bench.judge(
        "silicon revision",
        start.revision,
        SiliconRevision::SUPPORTED,
        start.revision.is_supported(),
    );
    bench.judge(
        "brown-out level",
        start.brown_out_level,
        &format!("{LEAST_BROWN_OUT_LEVEL} to 3; 0 is off: set the option bytes"),
        (LEAST_BROWN_OUT_LEVEL..=3).contains(&start.brown_out_level),
    );
    bench.judge(
        "supply",
        if start.supply_low {
            "low"
        } else {
            "enough to write flash"
        },
        "enough to write flash",
        !start.supply_low,
    );
    bench.judge("safe mode", start.safe_mode, "false", !start.safe_mode);
}

/// Checks the output before anything is played.
fn at_rest(bench: &mut Bench, status: &Status) {
    let fault = status.output.mute.contains(MuteReason::Fault);
    bench.judge(
        "no fault mutes the output",
        status.output.mute,
        "no fault",
        !fault,
    );
    bench.judge(
        "output before playing",
        if status.output.at_rest {
            "at mid-scale"
        } else {
            "not at rest"
        },
        "at mid-scale",
        status.output.at_rest,
    );
}
