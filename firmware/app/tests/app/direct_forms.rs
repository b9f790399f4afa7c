//! Direct forms whose certificate has nothing behind it: the device proves them itself, or refuses them.

use embassy_futures::block_on;
use embedded_storage_async::nor_flash::{NorFlash, ReadNorFlash};
use model_format::limits::{MAX_LIBRARY_BYTES, SLOT_BYTES};
use model_format::link::{
    ActivateError, LIBRARY_CRC, LinkId, SlotFault, SlotId, SlotState, UploadAbortEndpoint,
    UploadChunk, UploadError, UploadState,
};
use model_format::{
    CodeSpec, Laws, NodeFlags, NodeSpec, PartsSpec, Provenance, SAMPLE_RATE_HZ, Structure,
    TextureSpec, encode,
};
use postcard_rpc::Endpoint;
use postcard_rpc::header::{VarHeader, VarKey, VarSeq};
use stylus_app::slots::SlotStore;
use stylus_app::upload::Uploader;

use fake_stylus::device::{SharedControl, SteppedStylus, Stores};
use fake_stylus::flash::{Memory, SimulatedFlash};
use fake_stylus::library::{announcement, library, upload};
use fake_stylus::requests::{Requests, frame};

/// A node of these predictor coefficients.
fn node(predictor: &[f64]) -> NodeSpec {
    /// Binary exponent: coefficients below 8.
    const EXPONENT: u8 = 3;
    let code = |h: &f64| (h * 2f64.powi(15 - i32::from(EXPONENT))).round() as i16;
    NodeSpec {
        output_power: 1.0,
        prediction_error_power: 0.01,
        flags: NodeFlags::NONE,
        codes: CodeSpec::Direct16 {
            exponent: EXPONENT,
            codes: predictor.iter().map(code).collect(),
        },
    }
}

/// A library of one texture with these nodes along the speed axis. Its certificate is well formed and claims `margin`
/// for each cell.
fn forged(predictors: &[&[f64]], margin: u8) -> Vec<u8> {
    let cells = (predictors.len() - 1).max(1);
    let spec = TextureSpec {
        name: "forged".to_owned(),
        sample_rate_hz: SAMPLE_RATE_HZ,
        structure: Structure::DirectForm16,
        provenance: Provenance::Simulated,
        laws: Laws::default(),
        parts: PartsSpec::default(),
        speed_axis_mm_s: (1..=predictors.len()).map(|speed| speed as f32).collect(),
        force_axis_n: vec![1.0],
        nodes: predictors.iter().map(|predictor| node(predictor)).collect(),
        cell_margins: vec![margin; cells],
    };
    encode(&[spec]).expect("the certificate is well formed")
}

/// The fate of an upload of `bytes`: the refusal, or none.
fn refusal(bytes: &[u8]) -> Option<String> {
    let mut flash = SimulatedFlash::two_slots();
    block_on(async {
        let mut store = SlotStore::open(&mut flash).await;
        let committed = upload(&mut Uploader::new(), &mut store, bytes, 512).await;
        let newest = store.newest();
        assert_eq!(committed.is_ok(), newest.is_some());
        committed.err().map(|error| error.to_string())
    })
}

/// Margin that claims next to nothing: 2^-63.
const LEAST: u8 = 252;

#[test]
fn an_unstable_direct_form_with_a_forged_certificate_is_refused() {
    for predictor in [&[1.5][..], &[2.5, -1.0], &[0.0, -1.001], &[1.0]] {
        let refusal = refusal(&forged(&[predictor], LEAST)).expect("it is unstable");
        assert!(refusal.contains("forged"), "{refusal}");
    }
}

/// The means of (1 - 0.9 z⁻¹)³ and (1 + 0.9 z⁻¹)³ have poles of radius up to 1.56.
const STABLE_ALONE: [&[f64]; 2] = [&[2.7, -2.43, 0.729], &[-2.7, -2.43, -0.729]];

#[test]
fn a_direct_form_that_is_stable_at_its_nodes_and_not_between_is_refused() {
    assert!(refusal(&forged(&STABLE_ALONE, LEAST)).is_some());
    for predictor in STABLE_ALONE {
        assert_eq!(refusal(&forged(&[predictor], LEAST)), None);
    }
}

#[test]
fn a_direct_form_with_a_claim_beyond_its_margin_is_refused() {
    // |1 - 0.9 e^(-jω)| is at least 0.1, which is 2^-3.32.
    let claimed = |margin: u8| refusal(&forged(&[&[0.9], &[0.9]], margin));
    assert_eq!(claimed(16), None);
    assert!(claimed(12).is_some());
}

/// A library of one direct form that is stable, and whose certificate claims no more than it has.
fn honest() -> Vec<u8> {
    forged(&[&[0.9], &[0.8, -0.1]], LEAST)
}

/// Offset in a slot of its header, and of the first mark.
const HEADER: usize = MAX_LIBRARY_BYTES;
const MARK: usize = HEADER + 32;

/// Flash as an image without the proof has left it: `bytes` in slot A, with a header and no mark.
fn filled_by_an_older_image(bytes: &[u8]) -> Memory {
    let mut flash = SimulatedFlash::two_slots();
    fill(&mut flash, SlotId::A, 1, bytes);
    flash.memory
}

/// Writes `bytes` and the header of upload number `sequence` into a blank slot.
fn fill(flash: &mut SimulatedFlash<'_>, slot: SlotId, sequence: u32, bytes: &[u8]) {
    let mut padded = bytes.to_vec();
    padded.resize(bytes.len().next_multiple_of(32), 0xff);
    let mut header = b"HTXS".to_vec();
    header.extend([1, 0, 0, 0]);
    for field in [sequence, bytes.len() as u32, LIBRARY_CRC.checksum(bytes)] {
        header.extend(field.to_le_bytes());
    }
    header.extend(LIBRARY_CRC.checksum(&header).to_le_bytes());
    header.resize(32, 0);
    let start = slot.index() * SLOT_BYTES;
    block_on(async {
        flash
            .write(start as u32, &padded)
            .await
            .expect("it is blank");
        let written = flash.write((start + HEADER) as u32, &header).await;
        written.expect("so is this");
    });
}

/// Flash with `bytes` in slot A, by an upload.
fn uploaded(bytes: &[u8]) -> Memory {
    let mut flash = SimulatedFlash::two_slots();
    block_on(async {
        let mut store = SlotStore::open(&mut flash).await;
        let committed = upload(&mut Uploader::new(), &mut store, bytes, 512).await;
        committed.expect("it is proved");
    });
    flash.memory
}

/// Boots on `memory`, and tells whether slot A's library is proved once more when it is activated after that.
fn is_proved_again(memory: Memory) -> bool {
    let mut stylus = SteppedStylus::boot_from(SimulatedFlash::new(memory));
    assert_eq!(stylus.storage.slots().active, Some(SlotId::A));
    activation(&mut stylus)
}

/// Activates slot A, and tells whether the status showed a proof meanwhile.
fn activation(stylus: &mut SteppedStylus) -> bool {
    let mut seen = false;
    let activated = stylus.request_meanwhile(
        async |storage, stage| storage.activate(stage, SlotId::A).await,
        |control| {
            seen |= matches!(control.borrow().status().upload, UploadState::Proving(_));
            control.millisecond();
        },
    );
    assert!(activated.is_ok());
    assert_eq!(stylus.control.borrow().status().upload, UploadState::Idle);
    seen
}

#[test]
fn a_proof_is_done_once_and_kept_over_a_restart() {
    assert!(!is_proved_again(uploaded(&honest())));
}

#[test]
fn a_slot_of_an_older_image_is_proved_before_it_is_active_and_then_kept() {
    // The boot has proved it, and has written the mark.
    assert!(!is_proved_again(filled_by_an_older_image(&honest())));
    // Without room for a mark it is proved at each activation.
    let mut memory = filled_by_an_older_image(&honest());
    for mark in (MARK..SLOT_BYTES).step_by(32) {
        memory.set_faulty(mark);
    }
    assert!(is_proved_again(memory));
}

#[test]
fn a_mark_that_cannot_be_read_is_none_and_the_next_word_takes_one() {
    let mut memory = uploaded(&honest());
    memory.set_faulty(MARK);
    assert!(!is_proved_again(memory.clone()));
    let mut memory = uploaded(&honest());
    memory.flip_bit(MARK + 4);
    assert!(!is_proved_again(memory));
}

#[test]
fn a_forged_library_of_an_older_image_is_never_active() {
    for forgery in [forged(&[&[1.5]], LEAST), forged(&STABLE_ALONE, LEAST)] {
        let memory = filled_by_an_older_image(&forgery);
        let mut stylus = SteppedStylus::boot_from(SimulatedFlash::new(memory));
        let slots = stylus.storage.slots();
        assert_eq!(slots.active, None);
        let SlotState::Faulty(fault @ SlotFault::Unproved { .. }) = &slots.slots[0] else {
            panic!("{:?}", slots.slots[0]);
        };
        let refused =
            stylus.request(async |storage, stage| storage.activate(stage, SlotId::A).await);
        let (slot, fault) = (SlotId::A, fault.clone());
        assert_eq!(refused, Err(ActivateError::Faulty { slot, fault }));
    }
}

#[test]
fn the_older_library_is_active_after_a_boot_where_the_newer_one_is_not_proved() {
    let mut flash = SimulatedFlash::new(filled_by_an_older_image(&forged(&[&[1.5]], LEAST)));
    fill(&mut flash, SlotId::B, 0, &honest());
    let stylus = SteppedStylus::boot_from(flash);
    assert_eq!(stylus.storage.slots().active, Some(SlotId::B));
}

#[test]
fn the_status_tells_the_progress_of_a_proof() {
    let bytes = honest();
    let mut stylus = SteppedStylus::boot();
    let mut shares = Vec::new();
    let committed = stylus.request_meanwhile(
        async |storage, stage| {
            let begun = storage.upload_begin(stage, announcement(&bytes)).await;
            assert!(begun.is_ok());
            for (index, data) in bytes.chunks(512).enumerate() {
                let offset = 512 * index as u32;
                let chunk = UploadChunk { offset, data };
                assert!(storage.upload_chunk(stage, chunk).await.is_ok());
            }
            storage.upload_commit(stage).await
        },
        |control| {
            if let UploadState::Proving(proving) = control.borrow().status().upload {
                shares.push(proving.permille);
            }
            control.millisecond();
        },
    );
    assert!(committed.is_ok());
    assert!(
        shares.is_sorted() && shares.iter().any(|&share| share > 0),
        "{shares:?}"
    );
    assert_eq!(stylus.control.borrow().status().upload, UploadState::Idle);
}

/// A library whose proof takes more steps than [`polls_after_an_abort`] goes on for.
fn long() -> Vec<u8> {
    let predictors: Vec<&[f64]> = [&[0.9][..], &[0.8, -0.1]].repeat(10);
    forged(&predictors, LEAST)
}

/// Requests an abort as soon as `work` shows a proof, and returns its result and the number of polls after that.
fn polls_after_an_abort<R>(
    stylus: &mut SteppedStylus,
    work: impl AsyncFnOnce(&mut Stores, &mut SharedControl) -> R,
) -> (R, u32) {
    let requests = Requests::new(stylus.control.clone());
    let mut polls = None;
    let result = stylus.request_meanwhile(work, |control| {
        let is_proving = matches!(control.borrow().status().upload, UploadState::Proving(_));
        match &mut polls {
            None if is_proving => {
                let header = VarHeader {
                    key: VarKey::Key8(UploadAbortEndpoint::REQ_KEY),
                    seq_no: VarSeq::Seq4(1),
                };
                let abort = frame(UploadAbortEndpoint::REQ_KEY, header, &());
                assert_eq!(requests.serve(LinkId::Usb, &abort, false), None);
                polls = Some(0);
            }
            None => {}
            Some(polls) => *polls += 1,
        }
        control.millisecond();
    });
    // The storage comes to the abort.
    assert!(stylus.control.borrow().is_abort_waiting());
    let aborted = stylus.request(async |storage, stage| storage.upload_abort(stage));
    assert_eq!(aborted, Ok(UploadState::Idle));
    assert!(!stylus.control.borrow().is_abort_waiting());
    (result, polls.expect("it was proved"))
}

/// Number of polls that end a proof in its next step.
const POLLS_PER_STEP: u32 = 2;

#[test]
fn an_abort_ends_the_proof_of_an_upload_at_its_next_step_and_the_library_before_stays() {
    let mut stylus = SteppedStylus::ready(&library(1, 4, 1));
    let before = stylus.storage.slots();
    let bytes = long();
    let committing = async |storage: &mut Stores, stage: &mut SharedControl| {
        let begun = storage.upload_begin(stage, announcement(&bytes)).await;
        assert!(begun.is_ok());
        for (index, data) in bytes.chunks(512).enumerate() {
            let offset = 512 * index as u32;
            let chunk = UploadChunk { offset, data };
            assert!(storage.upload_chunk(stage, chunk).await.is_ok());
        }
        storage.upload_commit(stage).await
    };
    let (committed, polls) = polls_after_an_abort(&mut stylus, committing);
    assert_eq!(committed, Err(UploadError::Aborted));
    assert!(polls <= POLLS_PER_STEP, "{polls}");
    let slots = stylus.storage.slots();
    assert_eq!(
        (slots.active, &slots.slots[0]),
        (before.active, &before.slots[0])
    );
    assert_eq!(slots.slots[1], SlotState::Faulty(SlotFault::Unfinished));
    assert_eq!(stylus.control.borrow().status().upload, UploadState::Idle);
    // Without an abort the same library is proved.
    assert!(stylus.request(committing).is_ok());
}

#[test]
fn an_abort_ends_the_proof_before_an_activation_and_the_slot_stays_valid() {
    let mut memory = filled_by_an_older_image(&long());
    // No mark can be kept, so that each activation proves it.
    for mark in (MARK..SLOT_BYTES).step_by(32) {
        memory.set_faulty(mark);
    }
    let mut stylus = SteppedStylus::boot_from(SimulatedFlash::new(memory));
    let before = stylus.storage.slots();
    assert_eq!(before.active, Some(SlotId::A));
    let activate = async |storage: &mut Stores, stage: &mut SharedControl| {
        storage.activate(stage, SlotId::A).await
    };
    let (activated, polls) = polls_after_an_abort(&mut stylus, activate);
    assert_eq!(activated, Err(ActivateError::Aborted { slot: SlotId::A }));
    assert!(polls <= POLLS_PER_STEP, "{polls}");
    assert_eq!(stylus.storage.slots(), before);
    assert!(activation(&mut stylus));
}

#[test]
fn a_library_of_lattices_has_no_mark_and_is_not_proved() {
    let memory = uploaded(&library(1, 4, 1));
    assert!(!is_proved_again(memory.clone()));
    let mut flash = SimulatedFlash::new(memory);
    let mut mark = [0; 32];
    block_on(flash.read(MARK as u32, &mut mark)).expect("it was erased");
    assert_eq!(mark, [0xff; 32]);
}
