//! The product's own self test, and what takes an instrument.

use host_tools::procedures::self_test::{self, Options, Verdict, judge};
use model_format::link::{SelfTestRequest, SelfTestValues};

use crate::bench::Bench;
use crate::error::Result;

/// Runs what `stylus selftest --bare` runs, with the bench's length of traffic, and adds its lines. The output's are
/// left out with an amplifier whose enable is not wired.
///
/// # Errors
/// The link fails, or the device refuses to measure.
pub fn check(bench: &mut Bench) -> Result<()> {
    let options = Options {
        traffic_s: bench.lengths.record_ms as f64 / 1e3,
        sensors: false,
        no_amplifier: bench.no_amplifier,
        ..Options::default()
    };
    for line in self_test::run(&bench.device, &options, |_| ())? {
        if line.verdict == Verdict::NotMeasured {
            bench.leave_out(&line.name, &line.remedy);
        } else if bench.is_emulated() && line.name.contains("round trip") {
            bench.leave_out(&line.name, "it is a matter of the computer that emulates");
        } else {
            let holds = line.verdict == Verdict::Pass;
            bench.judge(&line.name, &line.value, &line.limits, holds);
        }
    }
    let reason =
        "a status comes only after the restart: put an oscilloscope on PA4, triggered by NRST";
    bench.leave_out("mid-scale between a fault and the reset", reason);
    let reason =
        "the status shows what the image drives: put an oscilloscope on PE9, triggered by NRST";
    bench.leave_out("the amplifier's enable is low through a reset", reason);
    Ok(())
}

/// Reads the pin back, which the converter and not the image's own state must show at rest, and adds a line `name`.
///
/// # Errors
/// The link fails, or the device refuses to measure.
pub fn at_mid_scale(bench: &mut Bench, name: &str) -> Result<()> {
    let values = bench.device.self_test(SelfTestRequest::Rest)?;
    let lines = match &values {
        SelfTestValues::Rest(values) => judge::rest(values),
        _ => Vec::new(),
    };
    let value: Vec<&str> = lines.iter().map(|line| line.value.as_str()).collect();
    let limits: Vec<&str> = lines.iter().map(|line| line.limits.as_str()).collect();
    let holds = !lines.is_empty() && lines.iter().all(|line| line.verdict == Verdict::Pass);
    bench.judge(name, value.join(", "), &limits.join(", "), holds);
    Ok(())
}
