//! The part of the self test's measurements that needs no registers.
//!
//! A measurement begins only while nothing is played, and prevents playing until it ends. It needs nothing from the
//! host after its request. If the link is lost meanwhile, the measurement still ends, and everything is as before. The
//! host holds the limits and judges the values.

use embedded_storage_async::nor_flash::NorFlash;
use model_format::link::{
    ChipValues, ClockValues, EncoderValues, ErrorCorrectionValues, FLASH_TEST_BYTES, FlashValues, OptionByteValues,
    OutputValues, RestValues, SelfTestError, SelfTestRequest, SelfTestValues, Setting, SlotId, SlotState, UploadState,
};

use crate::control::Control;
use crate::flash::WORD_BYTES;
use crate::slots::{Claim, LastLibrary, MappedFlash, SlotStore};
use crate::storage::{Stage, Storage};

/// The hardware that is measured.
pub trait SelfTestHardware {
    /// Identity of the silicon.
    fn chip(&self) -> ChipValues;

    /// The option bytes in use.
    fn option_bytes(&self) -> OptionByteValues;

    /// Errors that the error-correcting codes of RAM and flash have found since the start.
    fn error_correction(&self) -> ErrorCorrectionValues;

    /// Levels of the encoder's lines.
    fn encoder(&self) -> EncoderValues;

    /// Counts clocks against each other, within two seconds, or within four in safe mode, in which no tick comes.
    fn clocks(&mut self) -> impl Future<Output = ClockValues>;

    /// Disables the amplifier, moves the output and reads its pin, and leaves everything as it was, within two seconds.
    ///
    /// # Errors
    /// The converter does not answer. Everything is left as it was then, too.
    fn output(&mut self) -> impl Future<Output = Result<OutputValues, SelfTestError>>;

    /// Reads the output's pin and moves nothing.
    fn rest(&mut self) -> impl Future<Output = Result<RestValues, SelfTestError>>;

    /// Time since the start, µs, which wraps after 71 minutes.
    fn now_us(&self) -> u32;
}

/// Byte of the test's pattern at `offset`: no byte and no word is all ones, and neighbours differ.
fn pattern(offset: u32) -> u8 {
    (offset.wrapping_mul(0x9E37_79B9) >> 25) as u8
}

impl<F: MappedFlash, S: NorFlash> Storage<F, S> {
    /// Serves `SelfTestEndpoint`.
    ///
    /// # Errors
    /// Something is played, activated, stored or received; an update needs the slots; the slot is active, is not empty
    /// and may not be erased, or holds the last library; the hardware does not answer; the amplifier may be on.
    pub async fn self_test(
        &mut self,
        stage: &mut impl Stage,
        bench: &mut impl SelfTestHardware,
        request: SelfTestRequest,
    ) -> Result<SelfTestValues, SelfTestError> {
        stage
            .with_control(Control::begin_self_test)
            .map_err(|_| SelfTestError::Playing)?;
        let values = match request {
            SelfTestRequest::Chip => Ok(SelfTestValues::Chip(bench.chip())),
            SelfTestRequest::OptionBytes => Ok(SelfTestValues::OptionBytes(bench.option_bytes())),
            SelfTestRequest::Clocks => Ok(SelfTestValues::Clocks(bench.clocks().await)),
            SelfTestRequest::ErrorCorrection => Ok(SelfTestValues::ErrorCorrection(bench.error_correction())),
            SelfTestRequest::Output { disconnected } => {
                let enable = |control: &mut Control<_>| control.settings().get(Setting::EnableWired);
                if disconnected || stage.with_control(enable) == 1.0 {
                    bench.output().await.map(SelfTestValues::Output)
                } else {
                    Err(SelfTestError::AmplifierMayBeOn)
                }
            }
            SelfTestRequest::Rest => bench.rest().await.map(SelfTestValues::Rest),
            SelfTestRequest::Encoder => Ok(SelfTestValues::Encoder(bench.encoder())),
            SelfTestRequest::Flash { slot, erases_library } => self
                .flash_values(bench, slot, erases_library)
                .await
                .map(SelfTestValues::Flash),
        };
        stage.with_control(Control::end_self_test);
        values
    }

    async fn flash_values(
        &mut self,
        bench: &impl SelfTestHardware,
        slot: SlotId,
        erases_library: bool,
    ) -> Result<FlashValues, SelfTestError> {
        if self.upload() != UploadState::Idle || self.keeps_image().await {
            return Err(SelfTestError::Uploading);
        }
        let slots = self.slot_store();
        slots.scan_once().await;
        if slots.active() == Some(slot) {
            return Err(SelfTestError::ActiveSlot { slot });
        }
        if !erases_library && *slots.state(slot) != SlotState::Empty {
            return Err(SelfTestError::NotEmpty { slot });
        }
        let claim = slots.claim(slot, false).await;
        let claim = claim.map_err(|LastLibrary { slot }| SelfTestError::LastLibrary { slot })?;
        let values = measure(slots, bench, claim).await;
        // The claim made the slot unfinished; now it is empty, or as faulty as the flash is.
        slots.scan(slot).await;
        Ok(values)
    }
}

/// Erases the last sector of the claimed slot, which holds its header, writes and reads the pattern, and erases it
/// again.
///
/// The word of the header is never written, so that a power loss at any time leaves a slot without a library.
async fn measure<F: MappedFlash>(slots: &mut SlotStore<F>, bench: &impl SelfTestHardware, claim: Claim) -> FlashValues {
    let slot = claim.slot();
    let sector = SlotStore::<F>::header_sector();
    let begin = bench.now_us();
    let mut failed = slots.erase_sector(&claim, sector).await.is_err();
    let mut values = FlashValues {
        slot,
        erase_us: bench.now_us().wrapping_sub(begin),
        not_erased: 0,
        words: 0,
        write_us: 0,
        longest_write_us: 0,
        wrong: 0,
    };
    let words = (0..FLASH_TEST_BYTES).step_by(WORD_BYTES);
    for offset in words.clone() {
        let read = slots.word(slot, sector + offset).await;
        values.not_erased += differing(read, |_| 0xff);
    }
    for offset in words.clone() {
        let word: [u8; WORD_BYTES] = core::array::from_fn(|byte| pattern(offset + byte as u32));
        let begin = bench.now_us();
        failed |= slots.program(&claim, sector + offset, &word).await.is_err();
        let took = bench.now_us().wrapping_sub(begin);
        values.words += 1;
        values.write_us = values.write_us.saturating_add(took);
        values.longest_write_us = values.longest_write_us.max(took);
    }
    for offset in words {
        let read = slots.word(slot, sector + offset).await;
        values.wrong += differing(read, |byte| pattern(offset + byte));
    }
    failed |= slots.erase_sector(&claim, sector).await.is_err();
    if failed {
        // An operation that the flash refused left at least one byte that was not tested.
        values.wrong = values.wrong.max(1);
    }
    values
}

/// Number of bytes of a word that differ from `expected`; all of them if the word cannot be read.
fn differing(read: Option<[u8; WORD_BYTES]>, expected: impl Fn(u32) -> u8) -> u32 {
    read.map_or(WORD_BYTES as u32, |word| {
        let wrong = |&(at, byte): &(usize, &u8)| *byte != expected(at as u32);
        word.iter().enumerate().filter(wrong).count() as u32
    })
}
