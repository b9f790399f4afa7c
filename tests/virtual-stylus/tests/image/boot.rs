//! The output is at rest from power-on until something is played.

use model_format::link::{InfoEndpoint, PROTOCOL_VERSION, ResetReason, SCHEMA_HASH};
use virtual_stylus::Options;

use crate::device::{Device, MID_SCALE, MS, product};

/// The memory of the library that is played (RM0433 section 2.4); none was played here.
const AXI_SRAM: std::ops::Range<u64> = 0x2400_0000..0x2408_0000;

#[test]
fn the_output_is_at_mid_scale_from_its_first_enable_until_play() {
    // RAM holds what power-on leaves in it.
    let options = Options {
        ram_noise: Some(1),
        ..Options::default()
    };
    let mut device = Device::new(&product(), options);
    device.run_for(300 * MS);
    device.wait_for_start();
    // A host that connects, asks and leaves does not move the output.
    let info = device.request::<InfoEndpoint>(&());
    assert_eq!(info.protocol_version, PROTOCOL_VERSION);
    assert_eq!(info.schema_hash, SCHEMA_HASH);
    let status = device.status();
    assert_eq!(
        (status.reset, status.resets, status.fault),
        (ResetReason::PowerOn, 0, None),
        "noise is not believed"
    );
    device.slots();
    device.run_for(200 * MS);
    let outputs = device.dac();
    let driven: Vec<u16> = outputs.iter().filter_map(|output| output.code).collect();
    assert!(driven.len() > 2_000, "{} outputs", driven.len());
    assert!(driven.iter().all(|&code| code == MID_SCALE));
    // Once the pin is driven, it stays driven.
    let first = outputs.iter().position(|output| output.code.is_some());
    assert!(
        outputs[first.expect("it was driven")..]
            .iter()
            .all(|output| output.code.is_some())
    );
    // The start has written all of the AXI SRAM, because a board's would fail to read what was never written.
    for address in AXI_SRAM.step_by(1024 - 4).chain([AXI_SRAM.end - 4]) {
        let word = device.stylus.read_word(address);
        assert_eq!(word, Some(0), "{address:#x}");
    }
    let report = device.stylus.report();
    assert!(report.unmapped.is_empty(), "{report:?}");
    // embassy selects a clock for the RTC, which nothing uses, and finds the selection made.
    let told: Vec<_> = (report.told.iter())
        .filter(|told| !is_rtc_selection(told))
        .collect();
    assert!(told.is_empty(), "{told:?}");
}

/// True for a second write of the RTC's clock, which the part ignores.
pub fn is_rtc_selection(told: &str) -> bool {
    told.starts_with("RCC.BDCR: ") && told.contains("RTCSEL can be written only one time")
}
