//! The output at the pin, read back by the converter on the same pin, and what takes an instrument.

use host_tools::link::self_test::{Line, Verdict, judge};
use model_format::link::{SelfTestRequest, SelfTestValues};

use crate::bench::Bench;
use crate::error::Result;

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
    let join = |part: fn(&Line) -> &String| {
        let parts: Vec<&str> = lines.iter().map(|line| part(line).as_str()).collect();
        parts.join(", ")
    };
    let holds = !lines.is_empty() && lines.iter().all(|line| line.verdict == Verdict::Pass);
    bench.judge(
        name,
        join(|line| &line.value),
        &join(|line| &line.limits),
        holds,
    );
    Ok(())
}

/// Has the device put out codes with the amplifier disabled, and judges what its converter reads at the pin.
///
/// # Errors
/// The link fails, or the device refuses to measure.
pub fn check(bench: &mut Bench) -> Result<()> {
    at_mid_scale(bench, "the pin is at mid-scale before it is moved")?;
    let core_hz = bench.status()?.tick_histogram.core_hz;
    let values = bench.device.self_test(SelfTestRequest::Output)?;
    let lines = match &values {
        SelfTestValues::Output(values) => judge::output(values, core_hz),
        _ => Vec::new(),
    };
    bench.judge(
        "the pin is read back",
        format!("{} values", lines.len()),
        "at least 1",
        !lines.is_empty(),
    );
    for line in lines {
        match line.verdict {
            Verdict::NotMeasured => bench.leave_out(&line.name, &line.value),
            verdict => {
                let holds = verdict == Verdict::Pass;
                bench.judge(&line.name, &line.value, &line.limits, holds);
            }
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
