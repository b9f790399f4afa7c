//! Probes and responses through the host's library, and what `stylus status` reports about them.

use std::cell::Cell;
use std::thread;
use std::time::Duration;

use crate::support::{connected, holds, started};
use fake_stylus::FakeStylus;
use fake_stylus::device::response_for;
use fake_stylus::library::texture;
use host_tools::dsp::response::PERIOD;
use host_tools::link::LinkError;
use host_tools::procedures::response::{DeviceBench, Failure, Probe, ProbedStylus};
use model_format::encode;
use model_format::link::{
    Activity, LINK_LOST_AFTER_MS, MAX_PROBE_SAMPLES, ProbeError, ProbeStart, ProbeThrough, ResponseChange,
    ResponseError,
};
use serde_json::Value;

#[test]
fn a_response_is_proved_by_a_probe_stored_shown_and_removed() {
    let (stylus, bench) = started();
    let device = connected(&stylus);
    let response = response_for(&device.settings().unwrap());
    let id = device.propose_response(&response).unwrap();
    let period: Vec<i16> = (0..MAX_PROBE_SAMPLES as i16).map(|n| n.wrapping_mul(7_919)).collect();
    let crc32 = device.load_probe(&period).unwrap();
    let start = ProbeStart {
        through: ProbeThrough::Proposed,
        ..ProbeStart::of(&period, 1, 5.0)
    };
    assert_eq!(start.crc32, crc32);
    let other = ProbeStart { crc32: !crc32, ..start };
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
        thread::sleep(Duration::from_millis(10));
    }
    assert!(probed);
    let unknown = device.set_response(ResponseChange::Store { id: !id });
    let refusal = ResponseError::NoSuchResponse { id: !id };
    assert!(matches!(unknown, Err(LinkError::Response(told)) if told == refusal));
    assert_eq!(device.response().unwrap().stored, None);
    device.set_response(ResponseChange::Store { id }).unwrap();
    drop(device);
    let line = format!("response {id:08x}, measured on 2023-11-14, flat within 1.5 dB (0.5 dB RMS)");
    holds(&bench.succeed("status"), &[&line]);
    // The upload has succeeded, whatever can be said of the headroom.
    bench.write("odd.lib", encode(&[texture("odd", 4, 1, 8_000)]).unwrap());
    holds(
        &bench.told("upload odd.lib"),
        &["the headroom is not known: no stylus plays 8000 Hz"],
    );
    bench.succeed("settings set output-gain 0.04");
    holds(&bench.succeed("status"), &["STALE: output-gain changed since"]);
    let device = connected(&stylus);
    device.set_response(ResponseChange::Clear { id }).unwrap();
    drop(device);
    assert_eq!(bench.json("status --json")["response"], Value::Null);
}

#[test]
fn a_probe_that_is_muted_because_the_host_was_late_is_played_again_and_never_taken_for_silence() {
    let stylus = FakeStylus::start();
    let device = connected(&stylus);
    let codes = [0, 8_000, 0, -8_000].repeat(PERIOD / 4);
    let probe = Probe {
        codes: &codes,
        peak_m_s2: 5.0,
        periods: 2,
        through: ProbeThrough::Nothing,
    };
    // Number of times that the host is still to be late by more than the lease, and number of arrivals so far.
    let (late, arrivals) = (Cell::new(0_u32), Cell::new(0_u32));
    let goes_on = || {
        arrivals.set(arrivals.get() + 1);
        if late.get() > 0 && arrivals.get().is_multiple_of(20) {
            late.set(late.get() - 1);
            stylus.pass(Duration::from_millis(4 * u64::from(LINK_LOST_AFTER_MS)));
        }
        true
    };
    let mut bench = DeviceBench::new(&device, &goes_on).unwrap();
    bench.play(&probe).unwrap();
    let undisturbed = bench.seconds();
    late.set(1);
    let played = bench.play(&probe).unwrap();
    assert_eq!(played.axes[0].len(), 2 * PERIOD);
    assert!(bench.seconds() >= 3.0 * undisturbed);
    late.set(u32::MAX);
    let told = bench.play(&probe);
    assert!(
        matches!(&told, Err(Failure::Link(LinkError::Lossy { what, .. })) if what.contains("late")),
        "{told:?}"
    );
}

#[test]
fn a_probe_whose_samples_are_torn_is_no_measurement() {
    let stylus = FakeStylus::start();
    let device = connected(&stylus);
    let mut bench = DeviceBench::new(&device, &|| true).unwrap();
    let probe = Probe {
        codes: &[0; PERIOD],
        peak_m_s2: 5.0,
        periods: 1,
        through: ProbeThrough::Nothing,
    };
    bench.play(&probe).unwrap();
    stylus.tear_samples(Duration::ZERO, u32::MAX);
    let told = bench.play(&probe);
    assert!(
        matches!(&told, Err(Failure::Link(LinkError::Lossy { what, .. })) if what.contains("torn")),
        "{told:?}"
    );
}
