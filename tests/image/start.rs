//! Starts with clocks that do not start, do not lock or fail, on old silicon, with a low supply, and after faults in
//! quick succession.

use fake_stylus::device::change;
use hil::checks::faults::Injected;
use model_format::link::{
    BoardName, ClockSource, FaultKind, InfoEndpoint, MuteReason, PROTOCOL_VERSION, PlayEndpoint, PlayError,
    QUICK_FAULTS, ResetReason, SCHEMA_HASH, Setting, SettingsError, SiliconRevision, StartReport, StartStage,
    UploadBeginEndpoint, UploadError,
};
use stylus_board::ALL;
use virtual_stylus::{Electrical, Options, ResetCause};

use crate::device::{Device, MS, inject, long, product};
use crate::library;
use crate::requests::{announced, play_request};

const REVISION_Y: u16 = 0x1003;
/// RCC_CR, and its bits HSEON and HSECSSON (section 8.7.2).
const RCC_CR: u64 = 0;
const HSEON: u32 = 1 << 16;
const HSECSSON: u32 = 1 << 19;
/// DBGMCU_CR, and its bits DBGSLEEP_D1 and D1DBGCKEN (section 60.5.8).
const DBGMCU_CR: u64 = 4;
const DBGSLEEP_D1: u32 = 1;
const D1DBGCKEN: u32 = 1 << 21;
/// ODR of a port, and the pins of LD1 and LD3 on port B.
const ODR: u64 = 0x14;
const LD1: u32 = 1;
const LD3: u32 = 1 << 14;

/// Options with a library, and with changed silicon, clocks or supply.
fn with(change: impl FnOnce(&mut Electrical)) -> Options {
    let mut options = library::options();
    change(&mut options.electrical);
    options
}

fn start(device: &mut Device) -> StartReport {
    device.status().start
}

fn register(device: &mut Device, instance: &'static str, offset: u64) -> u32 {
    device.stylus.read_register(instance, offset).expect("it exists")
}

/// Plays until the output is heard, and a little longer.
fn plays(device: &mut Device) {
    device.move_at(120.0);
    device.play_until_heard("lattice");
    device.run_for(50 * MS);
    device.keep_alive(false);
}

#[test]
fn the_watchdog_counts_before_a_clock_is_touched() {
    let mut device = Device::new(&product(), Options::default());
    device.stylus.run_until(20_000);
    assert!(device.stylus.board(|board| board.part.watchdog.started()));
    assert_eq!(register(&mut device, "RCC", RCC_CR) & HSEON, 0);
    device.wait_for_start();
    let timeout = (device.stylus).board(|board| board.part.watchdog.timeout_ns());
    assert_eq!(timeout, Some(100 * MS), "of the running device");
}

#[test]
fn a_healthy_start_reports_itself_and_never_comes_near_the_watchdogs_end() {
    // With the largest libraries in both slots, the scan takes longest.
    let large = library::large();
    let flash = library::flash_with(&[&large, &large]);
    let mut device = Device::started(library::of(flash));
    assert_eq!(device.resets(), []);
    let healthy = StartReport {
        board: BoardName::new(ALL[0].name),
        revision: SiliconRevision(0x2003),
        brown_out_level: 3,
        ..StartReport::default()
    };
    assert_eq!(start(&mut device), healthy);
    assert_ne!(register(&mut device, "RCC", RCC_CR) & HSECSSON, 0);
    assert_ne!(register(&mut device, "DBGMCU", DBGMCU_CR) & DBGSLEEP_D1, 0);
}

#[test]
fn without_an_external_clock_the_device_plays_on_the_internal_one() {
    let mut device = Device::started(with(|electrical| electrical.clocks.external_hz = None));
    assert_eq!(device.resets(), []);
    let report = start(&mut device);
    assert_eq!((report.clock, report.quick_faults), (ClockSource::Internal, 0));
    assert_eq!(register(&mut device, "RCC", RCC_CR) & HSEON, 0);
    plays(&mut device);
    let status = device.status();
    assert_eq!((status.tick.missed, status.tick.late_conversions), (0, 0));
    device.assert_models_sufficed();
}

#[test]
fn usb_works_on_the_internal_clock_because_the_hosts_frames_trim_it() {
    let mut device = Device::on_usb(with(|electrical| electrical.clocks.external_hz = None));
    assert_eq!(start(&mut device).clock, ClockSource::Internal);
}

#[test]
fn a_pll_that_does_not_lock_on_the_external_clock_costs_one_start() {
    for pll in (0..3).filter(|&pll| long() || pll == 1) {
        let mut device = Device::started(with(|electrical| {
            electrical.clocks.unlocked_external[pll] = true;
        }));
        assert_eq!(device.resets(), [ResetCause::Watchdog], "PLL{}", pll + 1);
        let status = device.status();
        assert_eq!(status.reset, ResetReason::Watchdog);
        let kind = status.fault.map(|fault| fault.kind);
        assert_eq!(kind, Some(FaultKind::StartHung));
        assert_eq!(status.start.hung_stage, Some(StartStage::ExternalClock));
        assert_eq!(status.start.clock, ClockSource::Internal);
        assert_eq!(status.start.quick_faults, 1);
        plays(&mut device);
    }
}

#[test]
fn when_no_pll_locks_at_all_the_device_speaks_and_does_not_play() {
    let mut device = Device::started(with(|electrical| {
        electrical.clocks.unlocked_external = [true; 3];
        electrical.clocks.unlocked_internal = [true; 3];
    }));
    assert_eq!(device.resets(), [ResetCause::Watchdog; 2]);
    let report = start(&mut device);
    assert_eq!(report.clock, ClockSource::InternalUnmultiplied);
    assert_eq!(report.hung_stage, Some(StartStage::InternalClock));
    assert!(report.safe_mode);
    // The device stays up, and no reset follows.
    device.run_for(1_000 * MS);
    assert_eq!(device.resets().len(), 2);
    assert_eq!(device.sounds_in(..), 0);
}

#[test]
fn an_external_clock_that_fails_in_mid_play_ends_at_mid_scale_and_is_not_used_again() {
    let mut device = Device::with_library();
    plays(&mut device);
    device.play_until_heard("lattice");
    let failed_ns = device.stylus.now_ns();
    device.keep_alive(false);
    device.stylus.fail_external_clock();
    device.run_for(400 * MS);
    assert_eq!(device.sounds_in(failed_ns + MS..), 0);
    assert!(device.sounds_in(..) > 100, "it was heard before");
    assert_eq!(device.resets(), [ResetCause::Software]);
    device.wait_for_start();
    let status = device.status();
    let kind = status.fault.map(|fault| fault.kind);
    assert_eq!(kind, Some(FaultKind::ClockFailed));
    assert_eq!(status.start.clock, ClockSource::Internal);
    plays(&mut device);
    // A manual reset tries the external clock again for a bounded time, but the clock is still missing.
    device.stylus.reset_by_pin();
    device.wait_for_start();
    assert_eq!(start(&mut device).clock, ClockSource::Internal);
}

/// Injects a panic, and waits until the device has started again.
fn panics(device: &mut Device) {
    let before = device.resets().len();
    inject(device, Injected::Panic);
    device.run_for(50 * MS);
    assert_eq!(device.resets().len(), before + 1);
    device.forget_frames();
    device.wait_for_start();
}

#[test]
fn after_three_quick_faults_the_device_speaks_and_does_not_play_until_a_person_resets_it() {
    let mut device = Device::with_faults(library::options());
    for count in 1..=QUICK_FAULTS {
        assert!(!start(&mut device).safe_mode, "after {} faults", count - 1);
        panics(&mut device);
        assert_eq!(start(&mut device).quick_faults, count);
    }
    let safe_ns = device.stylus.now_ns();
    let status = device.status();
    assert!(status.start.safe_mode && status.output.mute.contains(MuteReason::SafeMode));
    device.upload(&library::small());
    let refused = device.request::<PlayEndpoint>(&play_request("lattice", 1));
    let quick_faults = QUICK_FAULTS;
    assert_eq!(refused, Err(PlayError::SafeMode { quick_faults }));
    // Both LEDs blink in turn.
    let mut seen = [0; 2];
    for _ in 0..20 {
        device.run_for(63 * MS);
        let lit = register(&mut device, "GPIOB", ODR) & (LD1 | LD3);
        seen[0] += u32::from(lit == LD1);
        seen[1] += u32::from(lit == LD3);
    }
    assert!(seen[0] >= 5 && seen[1] >= 5, "{seen:?}");
    assert!(device.status().uptime_ms > 1_000);
    assert_eq!(device.sounds_in(safe_ns..), 0);
    // One more fault changes nothing. Only a person's reset does.
    let faulted_ns = device.stylus.now_ns();
    panics(&mut device);
    assert!(start(&mut device).safe_mode);
    // In safe mode the uptime is embassy's clock, which must not be ahead of the time since the start.
    let uptime_ms = device.status().uptime_ms;
    let elapsed_ms = (device.stylus.now_ns() - faulted_ns) / MS;
    assert!(uptime_ms <= elapsed_ms, "{uptime_ms} of {elapsed_ms} ms");
    device.stylus.reset_by_pin();
    device.forget_frames();
    device.wait_for_start();
    let report = start(&mut device);
    assert_eq!((report.safe_mode, report.quick_faults), (false, 0));
    plays(&mut device);
}

#[test]
fn silicon_of_revision_y_reads_its_library_whole() {
    let mut device = Device::started(with(|electrical| electrical.revision = REVISION_Y));
    assert_eq!(start(&mut device).revision, SiliconRevision(REVISION_Y));
    let status = device.status();
    assert_eq!(status.library_crc32, announced(&library::small()).crc32);
    plays(&mut device);
    assert!(device.sounds_in(..) > 100);
}

#[test]
fn while_the_supply_is_low_no_flash_is_written() {
    let mut device = Device::started(with(|electrical| electrical.brown_out_level = 2));
    assert_eq!(start(&mut device).brown_out_level, 2);
    let before = device.stylus.flash_operations().len();
    let change = change(Setting::HardLimit, 0.25);
    device.stylus.set_supply(2_700);
    assert!(start(&mut device).supply_low);
    let begun = device.request::<UploadBeginEndpoint>(&announced(&library::other()));
    assert_eq!(begun, Err(UploadError::SupplyLow));
    let set = device.change_settings(&[change]);
    assert_eq!(set, Err(SettingsError::SupplyLow));
    let after = device.stylus.flash_operations().len();
    assert_eq!(before, after);
    device.stylus.set_supply(3_300);
    assert!(!start(&mut device).supply_low);
    assert!(device.change_settings(&[change]).is_ok());
    device.upload(&library::other());
}

#[test]
fn a_start_with_a_low_supply_writes_no_flash_either() {
    // Without settings in flash, a start would erase sectors for them.
    let mut options = Options::default();
    options.electrical.supply_millivolts = 2_700;
    let mut device = Device::started(options);
    assert!(start(&mut device).supply_low);
    assert_eq!(device.stylus.flash_operations(), []);
}

#[test]
fn what_a_debugger_makes_wait_while_the_core_is_halted_goes_on_again() {
    let mut device = Device::started(Options::default());
    device.stylus.board(|board| board.part.freeze_in_halt());
    assert!(device.stylus.board(|board| board.part.is_frozen_in_halt()));
    device.run_for(50 * MS);
    assert!(!device.stylus.board(|board| board.part.is_frozen_in_halt()));
}

#[test]
fn the_cycle_counter_goes_on_in_sleep_after_a_debugger_has_detached() {
    let mut device = Device::started(Options::default());
    let before = register(&mut device, "DBGMCU", DBGMCU_CR) & (DBGSLEEP_D1 | D1DBGCKEN);
    device.stylus.board(|board| board.part.detach_debugger());
    device.run_for(50 * MS);
    let after = register(&mut device, "DBGMCU", DBGMCU_CR);
    assert_eq!((before, after), (DBGSLEEP_D1 | D1DBGCKEN, before));
}

/// The memory of the library that is played (RM0433 section 2.4). Nothing was played here.
const AXI_SRAM: std::ops::Range<u64> = 0x2400_0000..0x2408_0000;

#[test]
fn the_output_is_at_mid_scale_from_its_first_enable_until_play() {
    // RAM holds noise, as after power-on.
    let options = Options {
        ram_noise: Some(1),
        ..Options::default()
    };
    let mut device = Device::new(&product(), options);
    device.run_for(300 * MS);
    device.wait_for_start();
    // A host that connects, requests information and leaves does not move the output.
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
    device.assert_held_since_reset();
    // The start has written all of the AXI SRAM, because on a board a read of memory that was never written would fail.
    for address in AXI_SRAM.step_by(1024 - 4).chain([AXI_SRAM.end - 4]) {
        let word = device.stylus.read_word(address);
        assert_eq!(word, Some(0), "{address:#x}");
    }
    // All other RAM was written before it was read or partly written.
    let read: Vec<String> = (device.stylus.unwritten_ram().iter())
        .map(|address| format!("{address:#x}"))
        .collect();
    assert!(read.is_empty(), "{read:?}");
    let report = device.stylus.report();
    assert!(report.unmapped.is_empty(), "{report:?}");
    device.assert_models_sufficed();
}
