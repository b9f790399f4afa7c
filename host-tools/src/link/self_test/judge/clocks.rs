//! Clocks against each other.

use model_format::SAMPLE_RATE_HZ;
use model_format::link::{ClockCount, ClockValues};

use crate::link::self_test::line::Line;

/// Rate of LSI over the whole range of temperature and supply, Hz (DS12110 table 136).
const LOW_SPEED_HZ: (f64, f64) = (29_400.0, 33_600.0);

/// Deviation of the core's clock from the host's frames, ppm: 500 for the host (USB 2.0, section 7.1.12), 50 for the
/// board's crystal, and 200 for the reading.
const USB_PPM: f64 = 750.0;

/// Deviation of a tick from its period, ppm: both come from the same clock, so this is the reading alone.
const TICK_PPM: f64 = 50.0;

/// Frequency of `count`, whose cycles are those of a clock of `hz`.
fn hertz(count: ClockCount, hz: u32) -> f64 {
    f64::from(count.periods) * f64::from(hz) / count.cycles as f64
}

/// Deviation of `value` from `expected`, ppm.
fn ppm(value: f64, expected: f64) -> f64 {
    (value / expected - 1.0) * 1e6
}

/// Judges the clocks.
pub fn clocks(values: &ClockValues) -> Vec<Line> {
    let low_speed = match values.low_speed {
        Some(count) => Line::number(
            "LSI",
            hertz(count, values.timer_hz),
            LOW_SPEED_HZ,
            ("Hz", 0),
            "LSI or the core's clock is not what it should be: see the line of USB; if that passes, the chip is \
             damaged",
        ),
        None => Line::exact(
            "LSI",
            "no edge",
            format!("{} to {} Hz", LOW_SPEED_HZ.0, LOW_SPEED_HZ.1),
            false,
            "LSI does not run, so neither does the watchdog: restart the device; if it stays, the chip is damaged",
        ),
    };
    let usb = match values.usb_frames {
        Some(count) => Line::number(
            "core against USB",
            // A core that is too fast counts fewer frames per cycle.
            -ppm(hertz(count, values.core_hz), 1_000.0),
            (-USB_PPM, USB_PPM),
            ("ppm", 0),
            "the core does not run from the probe's 8 MHz: power the board through the probe's USB (CN1), and see the \
             clock in `status`",
        ),
        None => Line::not_measured(
            "core against USB",
            "connect the stylus's own USB (CN13) to measure it",
        ),
    };
    let tick = ppm(
        hertz(values.ticks, values.core_hz),
        f64::from(SAMPLE_RATE_HZ),
    );
    vec![
        low_speed,
        usb,
        Line::number(
            "ticks against core",
            tick,
            (-TICK_PPM, TICK_PPM),
            ("ppm", 0),
            "the timer and the core have other clocks than the image assumes: flash the image again",
        ),
    ]
}
