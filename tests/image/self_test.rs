//! The self test: a healthy board passes, each fault fails the line that names it, and no state is left changed.

use model_format::link::{
    InfoEndpoint, SelfTestEndpoint, SelfTestError, SelfTestRequest, SelfTestValues, Setting, SlotId,
};
use stylus_link::procedures::self_test::{Line, Verdict, judge};
use virtual_stylus::Options;
use virtual_stylus::board::StylusBoard;
use virtual_stylus::model::pins::{Drive, OutputPin};

use crate::device::{Device, MID_SCALE, MS, SECOND, product};
use crate::requests::assert_even;

/// The request to test the output, where the user confirms that no amplifier is connected.
const OUTPUT: SelfTestRequest = SelfTestRequest::Output { disconnected: true };

/// All measurements, with what they need to be allowed.
pub const MEASUREMENTS: [SelfTestRequest; 8] = [
    SelfTestRequest::Chip,
    SelfTestRequest::OptionBytes,
    SelfTestRequest::Clocks,
    SelfTestRequest::ErrorCorrection,
    SelfTestRequest::Rest,
    SelfTestRequest::Encoder,
    SelfTestRequest::Flash {
        slot: SlotId::B,
        erases_library: true,
    },
    OUTPUT,
];

/// A device on a board to which `change` was applied before the power came on.
fn on_board(change: impl FnOnce(&mut StylusBoard) + Send + 'static) -> Device {
    let mut device = Device::new(&product(), Options::default());
    device.stylus.board(change);
    device.wait_for_start();
    device
}

#[expect(clippy::result_large_err, reason = "the error is as large as its longest text")]
fn ask(device: &mut Device, request: SelfTestRequest) -> Result<SelfTestValues, SelfTestError> {
    device.request::<SelfTestEndpoint>(&request)
}

/// Makes one measurement, and returns its lines.
pub fn lines(device: &mut Device, request: SelfTestRequest) -> Vec<Line> {
    match ask(device, request).expect("nothing is played") {
        SelfTestValues::Chip(values) => judge::chip(&values, &device.request::<InfoEndpoint>(&())),
        SelfTestValues::OptionBytes(values) => judge::option_bytes(&values),
        SelfTestValues::Clocks(values) => judge::clocks(&values, device.status().start.board),
        SelfTestValues::ErrorCorrection(values) => judge::memory(&values),
        SelfTestValues::Output(values) => judge::output(&values, device.status().tick_histogram.core_hz),
        SelfTestValues::Rest(values) => judge::rest(&values),
        SelfTestValues::Encoder(_) => Vec::new(),
        SelfTestValues::Flash(values) => judge::flash(&values),
    }
}

/// Names of the lines that fail.
pub fn failing(lines: &[Line]) -> Vec<&str> {
    show(lines);
    (lines.iter())
        .filter(|line| line.verdict == Verdict::Fail)
        .map(|line| line.name.as_str())
        .collect()
}

/// Prints the lines, which `--nocapture` shows.
fn show(lines: &[Line]) {
    for line in lines {
        println!(
            "{:36} {:24} {:28} {:12} {}",
            line.name, line.value, line.limits, line.verdict, line.remedy
        );
    }
}

/// A healthy pin: mid-scale with a converter's noise, and a force within its range.
pub fn quiet(channel: u8, at_ns: u64) -> u16 {
    let mixed = (at_ns / 1_000)
        .wrapping_mul(0x9E37_79B9_7F4A_7C15)
        .wrapping_add(u64::from(channel) << 7);
    0x8000 + (mixed >> 60) as u16
}

#[test]
fn silicon_and_option_bytes_that_are_wrong_are_named() {
    let mut device = on_board(|board| board.part.set_revision(0x1003));
    let found = lines(&mut device, SelfTestRequest::Chip);
    assert_eq!(failing(&found), ["silicon revision"]);
    for request in [SelfTestRequest::Rest, OUTPUT] {
        let found = lines(&mut device, request);
        assert_eq!(failing(&found), [""; 0], "with the clock that it shares");
    }
    let mut device = on_board(|board| {
        board.part.set_option_bytes(|options| {
            // Protection level 1, and sector 6 of bank 1 write-protected.
            options.optsr = options.optsr & !0xFF00 | 0x5500;
            options.wpsn[0] = 0xBF;
            // The option that configures the pins for low voltage.
            options.optsr |= 1 << 29;
        });
    });
    let found = lines(&mut device, SelfTestRequest::OptionBytes);
    assert_eq!(
        failing(&found),
        ["read protection", "writable sectors", "pins for low voltage"]
    );
    // New parts have this level.
    let mut options = Options::default();
    options.electrical.brown_out_level = 0;
    let mut device = Device::started(options);
    let found = lines(&mut device, SelfTestRequest::OptionBytes);
    assert_eq!(failing(&found), ["brown-out level"]);
}

#[test]
fn a_crystal_that_is_off_and_a_low_speed_oscillator_that_is_off_are_found() {
    let mut device = Device::new(&product(), Options::default());
    device
        .stylus
        .board(|board| board.part.low_speed.around.set_hz(Some(36_000)));
    device.wait_for_start();
    let found = lines(&mut device, SelfTestRequest::Clocks);
    assert_eq!(failing(&found), ["LSI"]);
    device.stylus.board(|board| board.part.low_speed.around.set_hz(None));
    let found = lines(&mut device, SelfTestRequest::Clocks);
    assert_eq!(failing(&found), ["LSI"]);
}

#[test]
fn a_core_that_runs_too_fast_is_found_by_the_frames_of_usb() {
    let mut options = Options::default();
    options.electrical.clocks.external_hz = Some(8_010_000);
    let mut device = Device::on_usb(options);
    let found = lines(&mut device, SelfTestRequest::Clocks);
    assert_eq!(failing(&found), ["core against USB"]);
}

#[test]
fn errors_of_memories_are_counted_until_the_next_start() {
    let mut device = Device::started(Options::default());
    device.stylus.board(|board| {
        board.part.find_ram_error(0b11).expect("the part has it");
        board.part.correct_flash_error();
    });
    for _ in 0..2 {
        let found = lines(&mut device, SelfTestRequest::ErrorCorrection);
        let named = [
            "RAM errors corrected",
            "RAM errors not corrected",
            "flash bank 1 errors corrected",
        ];
        assert_eq!(failing(&found), named);
    }
}

#[test]
fn faults_of_the_output_are_named() {
    use SelfTestRequest::Rest;
    let mut device = Device::started(Options::default());
    let mut fails = |request, change: fn(&mut OutputPin), named: &[&str]| {
        let mut pin = OutputPin::default();
        change(&mut pin);
        device.stylus.board(move |board| board.part.read_back.around.pin = pin);
        let found = lines(&mut device, request);
        let found = failing(&found);
        let is_named = named.iter().all(|name| found.contains(name));
        assert!(is_named && found.len() < 6, "{pin:?}: {found:?} for {named:?}");
    };
    fails(OUTPUT, |pin| pin.gain = 0.95, &["output gain", "output offset"]);
    fails(OUTPUT, |pin| pin.settling_ns = 6_000.0, &["output delay"]);
    fails(OUTPUT, |pin| pin.stuck_low = 1 << 6, &["output smallest step"]);
    fails(OUTPUT, |pin| pin.disconnected = true, &["output at PA4"]);
    fails(Rest, |pin| pin.disconnected = true, &["output at rest"]);
    fails(Rest, |pin| pin.noise = 120.0, &["output still at rest"]);
}

#[test]
fn no_code_but_mid_scale_is_put_out_with_an_amplifier_that_may_be_on() {
    let mut device = Device::started(Options::default());
    for wired in [false, true] {
        device.set(Setting::EnableWired, f32::from(u8::from(wired)));
        let unsaid = SelfTestRequest::Output { disconnected: false };
        for request in MEASUREMENTS.into_iter().chain([unsaid]) {
            let before = device.dac().len();
            let answer = ask(&mut device, request);
            device.run_for(MS);
            let codes = &device.dac()[before..];
            let away = codes.iter().filter(|output| output.code != Some(MID_SCALE)).count();
            let is_said = request == OUTPUT;
            let is_output = matches!(request, SelfTestRequest::Output { .. });
            let may_move = is_said || is_output && wired;
            assert_eq!(away > 1_000, may_move, "{away} codes: {request:?}, {wired}");
            assert!(may_move || away == 0, "{away} codes: {request:?}, {wired}");
            let is_refused = answer == Err(SelfTestError::AmplifierMayBeOn);
            assert_eq!(is_refused, is_output && !may_move, "{request:?}");
        }
    }
}

#[test]
fn the_output_is_at_rest_and_follows_the_tick_again_even_if_the_host_is_gone() {
    let mut device = Device::with_library();
    // The host sends the request, but does not receive the answer.
    let asked_ns = device.stylus.now_ns();
    device.send_frame(<SelfTestEndpoint as postcard_rpc::Endpoint>::REQ_KEY, &OUTPUT);
    device.run_for(2 * SECOND);
    let (now, outputs) = (device.stylus.now_ns(), device.dac().to_vec());
    let away: Vec<u64> = outputs
        .iter()
        .filter(|output| output.code != Some(MID_SCALE))
        .map(|output| output.at_ns)
        .collect();
    assert!(away.len() > 1_000, "the output was moved");
    // After the start the amplifier is on. It must be on before and after the test, and off in between.
    let amplifier = device.stylus.take_amplifier_record();
    let on_at = |at_ns: u64| {
        amplifier
            .iter()
            .rev()
            .find(|driven| driven.at_ns <= at_ns)
            .is_some_and(|driven| driven.drive == Drive::High)
    };
    assert!(on_at(asked_ns) && on_at(now));
    assert!(!away.iter().any(|&at_ns| on_at(at_ns)));
    // An amplifier takes some time to switch off. A coil connected to it must receive no jump except the one that is
    // measured.
    let dropped = amplifier
        .iter()
        .rfind(|driven| driven.drive == Drive::Low)
        .expect("it was on")
        .at_ns;
    assert!(away[0] - dropped >= 100 * MS, "{} ns", away[0] - dropped);
    let codes: Vec<u16> = outputs.iter().filter_map(|output| output.code).collect();
    let jumps: Vec<u16> = codes
        .windows(2)
        .map(|pair| pair[0].abs_diff(pair[1]))
        .filter(|&jump| jump > 128)
        .collect();
    assert!(jumps.iter().all(|&jump| jump == 2048), "{jumps:?}");
    let last: Vec<_> = (outputs.iter())
        .filter(|output| output.at_ns > now - 500 * MS)
        .collect();
    assert!(last.len() > 19_000, "codes go on");
    let at_rest = last.iter().all(|output| output.code == Some(MID_SCALE));
    assert!(at_rest, "it is at rest");
    let asked = outputs.partition_point(|output| output.at_ns <= asked_ns);
    assert_even(&outputs[asked..]);
    let status = device.status();
    assert_eq!((status.tick.missed, status.tick.late_conversions), (0, 0));
    device.play_until_heard("lattice");
}
