//! Probes and responses by the host's library, and what `stylus status` says of them.

use std::thread;

use crate::support::{attached, holds, json};
use fake_stylus::FakeStylus;
use fake_stylus::device::response_for;
use host_tools::link::{Device, LinkError, Timeouts};
use model_format::link::{
    Activity, MAX_PROBE_SAMPLES, ProbeError, ProbeStart, ProbeThrough, ResponseChange,
    ResponseError,
};
use serde_json::Value;

#[test]
fn a_response_is_proved_by_a_probe_stored_shown_and_removed() {
    let (stylus, bench) = attached(FakeStylus::start());
    let device = Device::connect(&stylus.link().parse().unwrap(), Timeouts::default()).unwrap();
    let response = response_for(&device.settings().unwrap());
    let id = device.propose_response(&response).unwrap();
    let period: Vec<i16> = (0..MAX_PROBE_SAMPLES as i16)
        .map(|n| n.wrapping_mul(7_919))
        .collect();
    let crc32 = device.load_probe(&period).unwrap();
    let start = ProbeStart {
        through: ProbeThrough::Proposed,
        ..ProbeStart::of(&period, 1, 5.0)
    };
    assert_eq!(start.crc32, crc32);
    let other = ProbeStart {
        crc32: !crc32,
        ..start
    };
    match device.start_probe(&other) {
        Err(LinkError::Probe(refused)) => {
            assert_eq!(*refused, ProbeError::Waveform { loaded: crc32 });
        }
        other => panic!("{other:?}"),
    }
    let started = device.start_probe(&start).unwrap();
    let mut probed = false;
    loop {
        device.keep_alive().unwrap();
        let status = device.status().unwrap();
        probed |= status.output.activity == Activity::Probing;
        if status.output.activity == Activity::Idle {
            assert!(status.tick.ticks >= started.end_tick);
            break;
        }
        thread::sleep(std::time::Duration::from_millis(10));
    }
    assert!(probed);
    let unknown = device.set_response(ResponseChange::Store { id: !id });
    let refusal = ResponseError::NoSuchResponse { id: !id };
    assert!(matches!(unknown, Err(LinkError::Response(told)) if told == refusal));
    assert_eq!(device.response().unwrap().stored, None);
    device.set_response(ResponseChange::Store { id }).unwrap();
    drop(device);
    let line =
        format!("response {id:08x}, measured on 2023-11-14, flat within 1.5 dB (0.5 dB RMS)");
    holds(&bench.succeed("status"), &[&line]);
    bench.succeed("settings set output-gain 0.04");
    holds(
        &bench.succeed("status"),
        &["STALE: output-gain changed since"],
    );
    let device = Device::connect(&stylus.link().parse().unwrap(), Timeouts::default()).unwrap();
    device.set_response(ResponseChange::Clear { id }).unwrap();
    drop(device);
    assert_eq!(
        json(&bench.succeed("status --json"))["response"],
        Value::Null
    );
}
