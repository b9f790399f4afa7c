//! Direct forms in a slot without a mark of their proof, as an image with another version of the proof leaves it.

use host_tools::texture::certificate::certified;
use model_format::link::UploadState;
use model_format::{
    CodeSpec, Laws, NodeFlags, NodeSpec, PartsSpec, Provenance, SAMPLE_RATE_HZ, Structure,
    TextureSpec, encode,
};
use virtual_stylus::Options;
use virtual_stylus::model::flash::Contents;

use crate::device::{Device, MS};
use crate::library;

/// Longest time from power-on to an answer.
const ANSWERS_WITHIN_NS: u64 = 1_000 * MS;

/// A library of one direct form of order 300 with two cells, which take more than half a second to prove.
fn direct() -> Vec<u8> {
    let node = |number: i16| NodeSpec {
        output_power: 1.0,
        prediction_error_power: 0.9,
        flags: NodeFlags::NONE,
        codes: CodeSpec::Direct16 {
            exponent: 0,
            codes: (0..300).map(|tap| (tap * 7 + number) % 40).collect(),
        },
    };
    let spec = TextureSpec {
        name: "direct".to_owned(),
        sample_rate_hz: SAMPLE_RATE_HZ,
        structure: Structure::DirectForm16,
        provenance: Provenance::Simulated,
        laws: Laws::default(),
        parts: PartsSpec::default(),
        speed_axis_mm_s: vec![50.0, 100.0, 200.0],
        force_axis_n: vec![1.0],
        nodes: (0..3).map(node).collect(),
        cell_margins: Vec::new(),
    };
    encode(&[certified(spec).expect("it is stable")]).expect("within the limits")
}

/// Flash with `library` in a slot, without its mark.
fn without_mark(library: &[u8]) -> Contents {
    let mut contents = library::flash_with(library);
    let marks = contents.bytes.windows(4).enumerate();
    let marks = marks.filter(|(_, bytes)| *bytes == b"HTXP");
    let [at] = marks.map(|(at, _)| at).collect::<Vec<_>>()[..] else {
        panic!("one mark is expected");
    };
    contents.bytes[at..at + 32].fill(0xff);
    contents
}

#[test]
fn a_proof_at_the_start_does_not_keep_the_links_waiting_and_is_done_once() {
    let with = |flash| Options {
        flash,
        ..Options::default()
    };
    let mut device = Device::started(with(without_mark(&direct())));
    let answered_ns = device.stylus.now_ns();
    assert!(answered_ns < ANSWERS_WITHIN_NS, "{answered_ns}");
    let status = device.status();
    assert!(
        matches!(status.upload, UploadState::Proving(_)) && status.active.is_none(),
        "{status:?}"
    );
    while device.status().active.is_none() {
        assert!(device.stylus.now_ns() < 20_000 * MS, "it is never active");
        device.run_for(100 * MS);
    }
    assert_eq!(device.status().upload, UploadState::Idle);
    let flash = device.stylus.flash().expect("the run goes on");
    let mut device = Device::started(with(flash));
    assert!(device.status().active.is_some(), "it has its mark");
}
