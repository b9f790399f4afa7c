//! Subjects that play nothing: the product's own self test, with a list of the tests that need an instrument; and an
//! upload, after which the library is listed and can be activated.

use model_format::link::{LIBRARY_CRC, SelfTestRequest, SelfTestValues};
use stylus_link::link::upload::upload;
use stylus_link::procedures::self_test::{self, Line, Options, judge};

use crate::bench::DeviceUnderTest;
use crate::report::Result;

/// Runs the tests of `stylus selftest --bare`, with traffic of the bench's length, and adds their lines. Those of the
/// output are left out if an amplifier whose enable is not wired may be connected.
pub fn check_self_test(bench: &mut DeviceUnderTest) -> Result<()> {
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

/// Uploads `library` and activates it.
pub fn check_upload(bench: &mut DeviceUnderTest, library: &[u8]) -> Result<()> {
    let active = bench.status()?.library_crc32;
    let crc32 = LIBRARY_CRC.checksum(library);
    let begin = bench.status()?;
    let uploaded = upload(&mut bench.device, library, |_| ())?;
    let end = bench.status()?;
    bench.judge(
        "a library is uploaded and read back",
        format!(
            "{} bytes and {} textures in slot {}, {} ms",
            uploaded.library.length,
            uploaded.textures.len(),
            uploaded.slot,
            end.uptime_ms.saturating_sub(begin.uptime_ms)
        ),
        "same length and checksum, every texture listed",
        (uploaded.library.length as usize, uploaded.library.crc32) == (library.len(), crc32),
    );
    bench.judge(
        "an upload leaves the active library alone",
        format!("{:08x}", end.library_crc32),
        format!("{active:08x}"),
        end.library_crc32 == active,
    );
    let scenes = bench.device.scenes(uploaded.slot)?.len();
    bench.judge(
        "every scene is listed",
        scenes.to_string(),
        uploaded.library.scenes.to_string(),
        scenes == usize::from(uploaded.library.scenes),
    );
    let activated = bench.device.activate(uploaded.slot)?;
    let status = bench.status()?;
    bench.judge(
        "the library is activated",
        format!("slot {}, {:08x}", activated.slot, status.library_crc32),
        format!("slot {}, {crc32:08x}", uploaded.slot),
        activated.slot == uploaded.slot && status.library_crc32 == crc32,
    );
    Ok(())
}
