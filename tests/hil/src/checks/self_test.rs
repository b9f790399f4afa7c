//! The product's own self test, and a list of the tests that need an instrument.

use model_format::link::{SelfTestRequest, SelfTestValues};
use stylus_link::procedures::self_test::{self, Line, Options, judge};

use crate::bench::DeviceUnderTest;
use crate::error::Result;

/// Runs the tests of `stylus selftest --bare`, with traffic of the bench's length, and adds their lines. Those of the
/// output are left out if an amplifier whose enable is not wired may be connected.
pub fn check(bench: &mut DeviceUnderTest) -> Result<()> {
    let options = Options {
        traffic_s: bench.lengths.record_ms as f64 / 1e3,
        sensors: false,
        no_amplifier: bench.no_amplifier,
        ..Options::default()
    };
    let lines = self_test::run(&bench.device, &options, |_| ())?;
    bench.add_all(lines);
    let reason = "a status comes only after the restart: put an oscilloscope on PA4, triggered by NRST";
    bench.leave_out("mid-scale between a fault and the reset", reason);
    let reason = "the status shows what the image drives: put an oscilloscope on PE9, triggered by NRST";
    bench.leave_out("the amplifier's enable is low through a reset", reason);
    Ok(())
}

/// Reads the pin back and adds lines of `name`. The converter, and not the image's own state, must show that the pin is
/// at rest.
pub fn at_mid_scale(bench: &mut DeviceUnderTest, name: &str) -> Result<()> {
    let SelfTestValues::Rest(values) = bench.device.self_test(SelfTestRequest::Rest)? else {
        bench.judge(name, "another measurement", "that of the pin at rest", false);
        return Ok(());
    };
    for line in judge::rest(&values) {
        let name = format!("{name}: {}", line.name);
        bench.add(Line { name, ..line });
    }
    Ok(())
}
