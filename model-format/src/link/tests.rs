//! The protocol's promises, over every message in its largest and smallest forms.

extern crate std;

use core::fmt::{Debug, Display};
use std::string::{String, ToString};
use std::vec::Vec;

use postcard_rpc::Key;
use proptest::prelude::*;
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::*;
use crate::{AdcCode, MillimetresPerSecond, Newton, Provenance, SAMPLE_RATE_HZ};

/// postcard-rpc's header with the longest key and sequence number: one byte, eight and four.
const HEADER_BYTES: usize = 13;

/// Checks that `value` comes back, in a frame of `limit` bytes, and returns its length.
fn check<T: Serialize + DeserializeOwned + PartialEq + Debug>(value: &T, limit: usize) -> usize {
    let mut bytes = [0; 4096];
    let used = postcard::to_slice(value, &mut bytes).expect("no message is so long");
    assert!(
        used.len() + HEADER_BYTES <= limit,
        "{} bytes: {value:?}",
        used.len()
    );
    assert_eq!(postcard::from_bytes::<T>(used).as_ref(), Ok(value));
    // Without its last byte the message is incomplete.
    if let Some(cut) = used.len().checked_sub(1) {
        assert!(
            postcard::from_bytes::<T>(&used[..cut]).is_err(),
            "{value:?}"
        );
    }
    used.len()
}

fn to_host<T: Serialize + DeserializeOwned + PartialEq + Debug>(
    values: impl IntoIterator<Item = T>,
) {
    for value in values {
        check(&value, MAX_DEVICE_FRAME_BYTES);
    }
}

fn to_device<T: Serialize + DeserializeOwned + PartialEq + Debug>(
    values: impl IntoIterator<Item = T>,
) {
    for value in values {
        check(&value, MAX_HOST_FRAME_BYTES);
    }
}

fn text<const N: usize>() -> heapless::String<N> {
    core::iter::repeat_n('x', N).collect()
}

fn slot_info() -> SlotInfo {
    SlotInfo {
        sequence: u32::MAX,
        length: u32::MAX,
        crc32: u32::MAX,
        textures: u16::MAX,
        scenes: u8::MAX,
    }
}

fn slot_faults() -> Vec<SlotFault> {
    std::vec![
        SlotFault::Unreadable { offset: u32::MAX },
        SlotFault::Unfinished,
        SlotFault::HeaderVersion { found: u16::MAX },
        SlotFault::Length { length: u32::MAX },
        SlotFault::Checksum {
            expected: u32::MAX,
            found: u32::MAX
        },
        SlotFault::Invalid { reason: text() },
    ]
}

fn upload_progress() -> UploadProgress {
    UploadProgress {
        upload: UploadBegin {
            length: u32::MAX,
            crc32: u32::MAX,
            replaces_last: true,
        },
        slot: SlotId::B,
        next_offset: u32::MAX,
    }
}

fn upload_errors() -> Vec<UploadError> {
    let (slot, offset) = (SlotId::B, u32::MAX);
    let mut errors = std::vec![
        UploadError::Length { length: u32::MAX },
        UploadError::NotBegun,
        UploadError::Offset {
            expected: u32::MAX,
            found: u32::MAX
        },
        UploadError::ChunkLength { length: u32::MAX },
        UploadError::PastEnd {
            end: u32::MAX,
            length: u32::MAX
        },
        UploadError::Incomplete {
            next_offset: u32::MAX,
            length: u32::MAX
        },
        UploadError::Checksum {
            expected: u32::MAX,
            found: u32::MAX
        },
        UploadError::Invalid { reason: text() },
        UploadError::ReadBack { slot, offset },
        UploadError::LastLibrary { slot },
        UploadError::Busy,
        UploadError::SupplyLow,
    ];
    for operation in [
        FlashOperation::Read,
        FlashOperation::Erase,
        FlashOperation::Write,
    ] {
        errors.push(UploadError::Flash {
            slot,
            operation,
            offset,
        });
    }
    errors
}

fn activate_errors() -> Vec<ActivateError> {
    let slot = SlotId::B;
    let mut errors = std::vec![
        ActivateError::NoLibrary { slot },
        ActivateError::NotCopied { slot },
        ActivateError::Busy,
        ActivateError::NotAtRest,
    ];
    errors.extend(
        slot_faults()
            .into_iter()
            .map(|fault| ActivateError::Faulty { slot, fault }),
    );
    errors
}

fn list_errors() -> Vec<ListError> {
    let slot = SlotId::B;
    let mut errors = std::vec![
        ListError::NoLibrary { slot },
        ListError::Index {
            slot,
            index: u8::MAX,
            textures: u16::MAX
        },
        ListError::SceneIndex {
            slot,
            index: u8::MAX,
            scenes: u8::MAX
        },
    ];
    errors.extend(
        slot_faults()
            .into_iter()
            .map(|fault| ListError::Faulty { slot, fault }),
    );
    errors
}

fn play_errors() -> Vec<PlayError> {
    std::vec![
        PlayError::NoLibrary,
        PlayError::NoSuchTexture { name: text() },
        PlayError::NoSuchScene { name: text() },
        PlayError::InvalidScene { reason: text() },
        PlayError::OverBudget {
            instructions: u32::MAX,
            budget: u32::MAX,
            arithmetic: text()
        },
        PlayError::SampleRate {
            texture_hz: u32::MAX
        },
        PlayError::Gain {
            gain: f32::INFINITY
        },
        PlayError::Busy,
        PlayError::Held { by: LinkId::Serial },
        PlayError::Fault,
        PlayError::SettingsNotSet {
            missing: SettingSet::ALL
        },
        PlayError::SettingsLost {
            lost: SettingSet::ALL
        },
        PlayError::SafeMode {
            quick_faults: u8::MAX
        },
    ]
}

fn self_test_values() -> Vec<SelfTestValues> {
    let count = ClockCount {
        periods: u32::MAX,
        cycles: u64::MAX,
    };
    std::vec![
        SelfTestValues::Chip(ChipValues {
            device: u16::MAX,
            revision: u16::MAX,
            unique_id: [u32::MAX; 3],
            flash_kb: u16::MAX,
            package: u8::MAX,
        }),
        SelfTestValues::OptionBytes(OptionByteValues {
            status: u32::MAX,
            banks_swapped: true,
            writable_sectors: [u8::MAX; 2],
            read_protected: [u32::MAX; 2],
            secure: [u32::MAX; 2],
            boot: u32::MAX,
        }),
        SelfTestValues::Clocks(ClockValues {
            core_hz: u32::MAX,
            timer_hz: u32::MAX,
            low_speed: Some(count),
            usb_frames: Some(count),
            ticks: count,
        }),
        SelfTestValues::ErrorCorrection(ErrorCorrectionValues {
            ram: [u8::MAX; RAM_MONITORS],
            flash_corrected: [u32::MAX; 2],
            flash_failed: [u32::MAX; 2],
        }),
        SelfTestValues::Output(OutputValues {
            sums: [u32::MAX; OUTPUT_CODES],
            noise: f32::MAX,
            step_words: [u16::MAX; STEP_INSTANTS],
            sample_cycles: u32::MAX,
        }),
        SelfTestValues::Rest(RestValues {
            sum: u32::MAX,
            range: [u16::MAX; 2],
        }),
        SelfTestValues::Encoder(EncoderValues {
            count: u16::MAX,
            levels: [true; 2],
        }),
        SelfTestValues::Flash(FlashValues {
            slot: SlotId::B,
            erase_us: u32::MAX,
            not_erased: u32::MAX,
            words: u32::MAX,
            write_us: u32::MAX,
            longest_write_us: u32::MAX,
            wrong: u32::MAX,
        }),
    ]
}

fn self_test_errors() -> Vec<SelfTestError> {
    std::vec![
        SelfTestError::Playing,
        SelfTestError::Uploading,
        SelfTestError::ActiveSlot { slot: SlotId::B },
        SelfTestError::NotEmpty { slot: SlotId::B },
        SelfTestError::LastLibrary { slot: SlotId::B },
        SelfTestError::Hardware { what: text() },
    ]
}

fn settings_errors() -> Vec<SettingsError> {
    let setting = Setting::HardLimit;
    let from = LinkId::Serial;
    let mut errors = std::vec![
        SettingsError::Playing,
        SettingsError::SupplyLow,
        SettingsError::Repeated { setting },
        SettingsError::Nothing,
        SettingsError::NoProposal,
        SettingsError::OtherLink { from },
    ];
    for setting in Setting::ALL {
        errors.extend(setting.check(f32::INFINITY).err());
    }
    for operation in [
        FlashOperation::Read,
        FlashOperation::Erase,
        FlashOperation::Write,
    ] {
        errors.push(SettingsError::Flash { operation });
    }
    errors
}

fn play_request() -> PlayRequest {
    PlayRequest {
        selection: Selection::Scene(text()),
        gain: 1.5,
        motion: MotionSource::Host,
        seed: u64::MAX,
    }
}

fn all_mute_reasons() -> MuteReasons {
    MuteReasons::from_bits(u8::MAX)
}

fn outputs() -> Vec<OutputStatus> {
    let playing = |motion| Activity::Playing {
        selection: Selection::Scene(text()),
        motion,
    };
    let activities = [
        Activity::Idle,
        playing(MotionSource::Sensors),
        playing(MotionSource::Host),
        Activity::FadingOut,
        Activity::Activating,
    ];
    let output = |activity| OutputStatus {
        activity,
        at_rest: true,
        mute: all_mute_reasons(),
        mute_counts: [u32::MAX; MUTE_REASON_COUNT],
        saturations: u32::MAX,
        hard_limited: u32::MAX,
        slew_limited: u32::MAX,
        thermally_limited: u32::MAX,
        thermal_load_permille: u16::MAX,
        thermal_gain_permille: u16::MAX,
        amplifier: true,
    };
    activities.map(output).into()
}

/// The longest proposal.
fn proposal() -> SettingsProposal {
    let values = Setting::ALL.map(|setting| SettingChange {
        setting,
        value: f32::MAX,
    });
    SettingsProposal {
        token: ProposalToken(u32::MAX),
        change: SettingsChange::of(&values).expect("one each"),
        loosens: SettingSet::ALL,
        from: LinkId::Serial,
        remaining_ms: u32::MAX,
    }
}

#[expect(clippy::too_many_lines, reason = "one value per field of the status")]
fn statuses() -> Vec<Status> {
    let link = LinkCounters {
        frames: u32::MAX,
        malformed: u32::MAX,
        oversized: u32::MAX,
        line_errors: u32::MAX,
        unsent: u32::MAX,
    };
    let fault = |kind| Fault {
        kind,
        program_counter: u32::MAX,
        detail: u32::MAX,
        address: Some(u32::MAX),
        text: text(),
    };
    let status = |output, reset, fault, upload| Status {
        uptime_ms: u64::MAX,
        output,
        tick: TickCounters {
            ticks: u64::MAX,
            missed: u32::MAX,
            late_frames: u32::MAX,
            late_conversions: u32::MAX,
            late_outputs: u32::MAX,
        },
        tick_histogram: TickHistogram {
            core_hz: u32::MAX,
            shortest: u32::MAX,
            longest: u32::MAX,
            bins: [u32::MAX; TICK_BIN_COUNT],
        },
        marks: Marks {
            stack_bytes: u32::MAX,
            stack_used_bytes: u32::MAX,
            longest_tick_delay_cycles: u32::MAX,
            longest_critical_section_cycles: u32::MAX,
            longest_watchdog_gap_us: u32::MAX,
        },
        levels: Levels {
            samples: u32::MAX,
            vibration_decibel: f32::MIN,
            force_newton: f32::MAX,
            force_noise_decibel: f32::MIN,
        },
        record: RecordCounters {
            recording: true,
            blocks: u32::MAX,
            lost_blocks: u32::MAX,
        },
        usb: link,
        serial: link,
        active: Some(SlotId::B),
        library_crc32: u32::MAX,
        upload,
        reset,
        resets: u32::MAX,
        fault,
        settings: SettingsState {
            set: SettingSet::ALL,
            lost: SettingSet::ALL,
            differing: SettingSet::ALL,
            mended: true,
            unwritable: true,
        },
        start: StartReport {
            clock: ClockSource::InternalUnmultiplied,
            revision: SiliconRevision(u16::MAX),
            brown_out_level: u8::MAX,
            supply_low: true,
            quick_faults: u8::MAX,
            safe_mode: true,
            hung_stage: Some(StartStage::Links),
        },
        lease: LeaseStatus {
            holder: Some(LinkId::Serial),
            is_alive: true,
            refused: u32::MAX,
        },
        proposal: Some(proposal()),
        limits: OutputLimits {
            peak_volt: f32::MAX,
            mean_square: f32::MAX,
            coil_watt: f32::MAX,
            is_capped: true,
        },
    };
    let resets = [
        ResetReason::PowerOn,
        ResetReason::Brownout,
        ResetReason::Pin,
        ResetReason::Software,
        ResetReason::Watchdog,
        ResetReason::Fault,
        ResetReason::Unknown,
    ];
    let kinds = [
        FaultKind::HardFault,
        FaultKind::Nmi,
        FaultKind::Panic,
        FaultKind::UnexpectedInterrupt,
        FaultKind::TickStopped,
        FaultKind::ExecutorStopped,
        FaultKind::ClockFailed,
        FaultKind::StartHung,
        FaultKind::StackOverflow,
        FaultKind::MemoryProtection,
        FaultKind::BusFault,
    ];
    let busy = UploadState::Receiving(upload_progress());
    let mut statuses = std::vec![status(
        outputs().remove(0),
        resets[0],
        None,
        UploadState::Idle
    )];
    for output in outputs() {
        for reset in resets {
            statuses.push(status(output.clone(), reset, Some(fault(kinds[0])), busy));
        }
    }
    for kind in kinds {
        statuses.push(status(
            outputs().remove(1),
            resets[0],
            Some(fault(kind)),
            busy,
        ));
    }
    statuses
}

fn texture_infos() -> Vec<TextureInfo> {
    let info = |provenance| TextureInfo {
        name: text(),
        provenance,
        sample_rate_hz: u32::MAX,
        max_order: u16::MAX,
        speeds: u8::MAX,
        forces: u8::MAX,
        speed_range: [MillimetresPerSecond(0.0), MillimetresPerSecond(f32::MAX)],
        force_range: [Newton(0.0), Newton(f32::MAX)],
        silent_nodes: u16::MAX,
        filled_nodes: u16::MAX,
        doubtful_nodes: u16::MAX,
    };
    [Provenance::Recorded, Provenance::Simulated]
        .map(info)
        .into()
}

/// The response type of an endpoint. It is found by the endpoint's name, so that a change of the tables shows here.
type Response<E> = <E as postcard_rpc::Endpoint>::Response;

fn upload_committed() -> UploadCommitted {
    UploadCommitted {
        slot: SlotId::B,
        sequence: u32::MAX,
        textures: u16::MAX,
        times: UploadTimes {
            erase_us: u32::MAX,
            program_us: u32::MAX,
            check_us: u32::MAX,
            wait_us: u32::MAX,
            sectors: u16::MAX,
            words: u32::MAX,
        },
    }
}

#[test]
fn every_answer_comes_back_and_fits_a_frame() {
    to_host::<Response<InfoEndpoint>>([DeviceInfo {
        product: text(),
        serial: text(),
        firmware_version: text(),
        build: text(),
        protocol_version: u16::MAX,
        library_format_version: u16::MAX,
        schema_hash: u64::MAX,
    }]);
    to_host::<Response<StatusEndpoint>>(statuses());
    to_host::<Response<UploadBeginEndpoint>>(upload_errors().into_iter().map(Err));
    to_host::<Response<UploadChunkEndpoint<'_>>>([Ok(upload_progress())]);
    to_host::<Response<UploadCommitEndpoint>>([Ok(upload_committed())]);
    to_host::<Response<UploadAbortEndpoint>>([Ok(UploadState::Idle)]);
    to_host::<Response<UploadProgressEndpoint>>([
        UploadState::Idle,
        UploadState::Receiving(upload_progress()),
    ]);
    let mut states = std::vec![
        SlotState::Empty,
        SlotState::Receiving,
        SlotState::Valid(slot_info())
    ];
    states.extend(slot_faults().into_iter().map(SlotState::Faulty));
    for state in states {
        let slots = [state.clone(), state];
        to_host::<Response<SlotsEndpoint>>([
            Slots {
                slots: slots.clone(),
                active: None,
            },
            Slots {
                slots,
                active: Some(SlotId::A),
            },
        ]);
    }
    to_host::<Response<ListEndpoint>>(texture_infos().into_iter().map(Ok));
    to_host::<Response<ListEndpoint>>(list_errors().into_iter().map(Err));
    to_host::<Response<ListSceneEndpoint>>([Ok(SceneInfo {
        name: text(),
        surfaces: u8::MAX,
        regions: u8::MAX,
        taps: u8::MAX,
        stick_slips: u8::MAX,
        sections: u8::MAX,
        constant_motion: true,
    })]);
    to_host::<Response<ListSceneEndpoint>>(list_errors().into_iter().map(Err));
    to_host::<Response<ActivateEndpoint>>([Ok(Activated {
        slot: SlotId::B,
        library: slot_info(),
    })]);
    to_host::<Response<ActivateEndpoint>>(activate_errors().into_iter().map(Err));
    to_host::<Response<PlayEndpoint>>([Ok(Playing {
        request: play_request(),
        mute: all_mute_reasons(),
    })]);
    to_host::<Response<PlayEndpoint>>(play_errors().into_iter().map(Err));
    let range = CycleRange {
        runs: u32::MAX,
        shortest: u32::MAX,
        longest: u32::MAX,
    };
    to_host::<Response<CyclesEndpoint>>([CycleReport {
        core_hz: u32::MAX,
        tick: range,
        update: range,
    }]);
    to_host::<Response<StopEndpoint>>(outputs().into_iter().map(Ok));
    to_host::<Response<StopEndpoint>>([Err(StopError::NotPlaying)]);
    to_host::<Response<MotionEndpoint>>([
        Ok(MotionSource::Sensors),
        Ok(MotionSource::Host),
        Err(MotionRefused::Speed),
        Err(MotionRefused::Force),
        Err(MotionRefused::Position),
        Err(MotionRefused::Held { by: LinkId::Usb }),
    ]);
    let started = RecordStarted {
        sample_rate_hz: u32::MAX,
        block_samples: u32::MAX,
    };
    to_host::<Response<RecordStartEndpoint>>([Ok(started), Err(RecordError::Recording)]);
    let stopped = RecordStopped {
        blocks: u32::MAX,
        lost_blocks: u32::MAX,
    };
    to_host::<Response<RecordStopEndpoint>>([Ok(stopped), Err(RecordError::NotRecording)]);
    to_host::<Response<SettingsGetEndpoint>>([Ok(Settings::default())]);
    to_host::<Response<SettingsProposeEndpoint>>(settings_errors().into_iter().map(Err));
    to_host::<Response<SettingsProposeEndpoint>>([Ok(proposal())]);
    to_host::<Response<SettingsApplyEndpoint>>([Ok(Settings::default())]);
}

#[test]
fn every_request_comes_back_and_fits_a_frame() {
    to_device([
        UploadBegin {
            length: 0,
            crc32: 0,
            replaces_last: false,
        },
        upload_progress().upload,
    ]);
    to_device([
        ListRequest {
            slot: SlotId::A,
            index: 0,
        },
        ListRequest {
            slot: SlotId::B,
            index: u8::MAX,
        },
    ]);
    to_device(SlotId::ALL);
    to_device([play_request()]);
    to_device([
        MotionSample {
            speed: MillimetresPerSecond(f32::MAX),
            force: Newton(f32::MIN),
            position_mm: Some(f32::MAX),
            contact: Some(true),
        },
        MotionSample {
            speed: MillimetresPerSecond(0.0),
            force: Newton(0.0),
            position_mm: None,
            contact: None,
        },
    ]);
    to_device([proposal().change, SettingsChange::Reset]);
    to_device([proposal().token]);

    let data = [0xa5; MAX_CHUNK_BYTES];
    let chunk = UploadChunk {
        offset: u32::MAX,
        data: &data,
    };
    let mut bytes = [0; MAX_HOST_FRAME_BYTES];
    let used = postcard::to_slice(&chunk, &mut bytes).expect("a chunk fits a frame");
    assert!(used.len() + HEADER_BYTES <= MAX_HOST_FRAME_BYTES);
    assert_eq!(postcard::from_bytes(used), Ok(chunk));
}

#[test]
fn a_record_block_takes_less_than_400_bytes_whatever_is_in_it() {
    let block = |code: u16, sequence| RecordBlock {
        sequence,
        first_tick: u64::from(sequence) << 32,
        lost_blocks: sequence,
        torn: sequence,
        samples: [RecordSample {
            acceleration: [AdcCode(code); 3],
            force: AdcCode(code),
            encoder_delta: code as i16,
        }
        .into(); BLOCK_SAMPLES],
    };
    assert!(check(&block(u16::MAX, u32::MAX), 400) > check(&block(0, 0), 400));
    // At the serial rate, 10 bits per byte, blocks take less than three quarters of the line.
    let bytes_per_second = SAMPLE_RATE_HZ / BLOCK_SAMPLES as u32
        * (check(&block(u16::MAX, u32::MAX), 400) as u32 + 20);
    assert!(bytes_per_second * 10 < SERIAL_BAUD / 4 * 3);
    // Twice as many would not fit, so recordings stay at this rate.
    assert!(2 * bytes_per_second * 10 > SERIAL_BAUD);
}

proptest! {
    #[test]
    fn a_packed_sample_is_the_sample(x: u16, y: u16, z: u16, force: u16, encoder_delta: i16) {
        let sample = RecordSample {
            acceleration: [x, y, z].map(AdcCode),
            force: AdcCode(force),
            encoder_delta,
        };
        prop_assert_eq!(RecordSample::from(PackedSample::from(sample)), sample);
    }

    #[test]
    fn random_bytes_are_a_request_or_an_error(bytes in prop::collection::vec(any::<u8>(), 0..64)) {
        fn decode<'a, T: Deserialize<'a>>(bytes: &'a [u8]) -> bool {
            postcard::from_bytes::<T>(bytes).is_ok()
        }
        let (begin, chunk) = (decode::<UploadBegin>(&bytes), decode::<UploadChunk<'_>>(&bytes));
        let (list, slot) = (decode::<ListRequest>(&bytes), decode::<SlotId>(&bytes));
        let (play, motion) = (decode::<PlayRequest>(&bytes), decode::<MotionSample>(&bytes));
        let change = decode::<SettingChange>(&bytes);
        if bytes.is_empty() {
            prop_assert!(!(begin || chunk || list || slot || play || motion || change));
        }
        prop_assert_eq!(slot, bytes.first().is_some_and(|&byte| byte < 2));
        // Two numbers, then a position and a contact, or none.
        prop_assert!(!motion || bytes.len() >= 10);
    }

    #[test]
    fn settings_off_the_wire_are_in_range_or_refused(index in 0..SETTING_COUNT, value: f32) {
        let mut values = Setting::ALL.map(|setting| setting.spec().default);
        values[index] = value;
        let mut bytes = [0; 4 * SETTING_COUNT];
        let used = postcard::to_slice(&values, &mut bytes).expect("four bytes each");
        let decoded = postcard::from_bytes::<Settings>(used);
        let setting = Setting::ALL[index];
        prop_assert_eq!(decoded.is_ok(), setting.check(value).is_ok());
        if let Ok(settings) = decoded {
            prop_assert_eq!(settings.get(setting), value);
        }
    }
}

#[test]
fn every_measurement_fits_its_frame() {
    to_host::<Response<SelfTestEndpoint>>(self_test_values().into_iter().map(Ok));
    to_host::<Response<SelfTestEndpoint>>(self_test_errors().into_iter().map(Err));
    let flash = SelfTestRequest::Flash {
        slot: SlotId::B,
        erases_library: true,
    };
    to_device([SelfTestRequest::Chip, SelfTestRequest::Output, flash]);
}

#[test]
fn settings_stand_at_their_numbers_with_defaults_in_range() {
    for (index, setting) in Setting::ALL.into_iter().enumerate() {
        let spec = setting.spec();
        assert_eq!(setting as usize, index);
        assert_eq!(setting.check(spec.default), Ok(spec.default));
        assert_eq!(Setting::named(spec.name), Some(setting));
        for outside in [
            spec.lowest - 1.0,
            spec.highest + 1.0,
            f32::NAN,
            f32::INFINITY,
        ] {
            assert!(setting.check(outside).is_err(), "{setting} {outside}");
        }
        assert_eq!(
            setting.check(0.5).is_ok(),
            !spec.whole && (spec.lowest..=spec.highest).contains(&0.5)
        );
    }
    assert_eq!(Setting::named("no such setting"), None);
}

#[test]
fn mute_reasons_are_kept_apart() {
    for (index, reason) in MuteReason::ALL.into_iter().enumerate() {
        assert_eq!(reason as usize, index);
        let one = MuteReasons::NONE.set(reason, true);
        assert_eq!(one.iter().collect::<Vec<_>>(), [reason]);
        assert_eq!(one.to_string(), reason.to_string());
        assert!(one.set(reason, false).is_empty());
    }
    assert_eq!(all_mute_reasons().iter().count(), MUTE_REASON_COUNT);
}

/// The text of every error of the protocol.
fn errors_in_words() -> Vec<String> {
    fn words<E: Display>(errors: impl IntoIterator<Item = E>) -> impl Iterator<Item = String> {
        errors
            .into_iter()
            .map(|error| error.to_string())
            .collect::<Vec<_>>()
            .into_iter()
    }
    words(upload_errors())
        .chain(words(slot_faults()))
        .chain(words(list_errors()))
        .chain(words(activate_errors()))
        .chain(words(play_errors()))
        .chain(words(settings_errors()))
        .chain(words(self_test_errors()))
        .chain(words([StopError::NotPlaying]))
        .chain(words([RecordError::Recording, RecordError::NotRecording]))
        .chain(words([MotionRefused::Speed, MotionRefused::Force]))
        .collect()
}

#[test]
fn every_error_says_what_is_wrong_and_what_to_do() {
    for words in errors_in_words() {
        let parts = words.split_once(": ").or_else(|| words.split_once("; "));
        assert!(
            parts.is_some_and(|(what, remedy)| what.len() > 3 && remedy.len() > 3),
            "{words}"
        );
    }
}

/// Path and key of each of this protocol's own entries.
fn keys() -> Vec<(String, Key)> {
    let own = |path: &str| path.starts_with("stylus/");
    let mut keys = Vec::new();
    for (path, request, response) in ENDPOINTS.endpoints {
        if own(path) {
            keys.push((std::format!("request  {path}"), *request));
            keys.push((std::format!("response {path}"), *response));
        }
    }
    for (direction, topics) in [
        ("to device", TOPICS_IN.topics),
        ("to host", TOPICS_OUT.topics),
    ] {
        for (path, key) in topics {
            if own(path) {
                keys.push((std::format!("{direction}  {path}"), *key));
            }
        }
    }
    keys
}

#[test]
fn no_two_messages_of_one_direction_share_a_key() {
    for directions in [["request", "to device"], ["response", "to host"]] {
        let mut seen = std::collections::BTreeMap::new();
        for (name, key) in keys() {
            // A topic and an endpoint of one path and type would have the same key.
            if directions
                .iter()
                .any(|direction| name.starts_with(direction))
            {
                let before = seen.insert(key.to_bytes(), name.clone());
                assert_eq!(before, None, "{name}");
            }
        }
    }
}

/// postcard-rpc's dispatcher computes this when it is compiled; a collision is a panic there.
#[test]
fn a_dispatcher_can_tell_all_messages_apart() {
    use postcard_rpc::server::min_key_needed;
    let requests: Vec<Key> = ENDPOINTS.endpoints.iter().map(|entry| entry.1).collect();
    let responses: Vec<Key> = ENDPOINTS.endpoints.iter().map(|entry| entry.2).collect();
    let of = |topics: &[(&str, Key)]| -> Vec<Key> { topics.iter().map(|entry| entry.1).collect() };
    assert!(min_key_needed(&[&requests, &of(TOPICS_IN.topics)]) <= 8);
    assert!(min_key_needed(&[&responses, &of(TOPICS_OUT.topics)]) <= 8);
}

#[test]
fn keys_and_versions_are_those_that_are_written_down() {
    let mut lines = String::new();
    for (name, key) in keys() {
        let key = u64::from_be_bytes(key.to_bytes());
        lines += &std::format!("{key:016x}  {name}\n");
    }
    lines +=
        &std::format!("{SCHEMA_HASH:016x}  all of them, protocol version {PROTOCOL_VERSION}\n");
    assert_eq!(
        lines,
        include_str!("keys.txt"),
        "the protocol has changed: if this was meant, copy the new lines to keys.txt, and raise PROTOCOL_VERSION if an \
         older program could misunderstand a message whose key is the same"
    );
}
