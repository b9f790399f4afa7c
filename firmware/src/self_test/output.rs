//! The output's pin, moved by hand and read back.

use cortex_m::peripheral::DWT;
use embassy_futures::yield_now;
use embassy_stm32::pac::adc::vals::SampleTime;
use micromath::F32Ext;
use model_format::DacCode;
use model_format::link::{
    CONVERSIONS_PER_CODE, OUTPUT_CODES, OutputValues, STEP_CODES, STEP_INSTANT_CYCLES,
    STEP_INSTANTS, SelfTestError, output_code,
};

use crate::boot::clock::CORE_HZ;
use crate::self_test::read_back::ReadBack;
use crate::tick::output::ByHand;

/// Time in which a new code settles, cycles: 20 µs, many times what the output's buffer takes.
const SETTLE_CYCLES: u32 = CORE_HZ / 50_000;

/// Cycles of the core per cycle of the converter, of 12.5 MHz.
const CONVERTER_CYCLES: u32 = CORE_HZ / 12_500_000;

/// From the order of a conversion to its sample with the shortest sampling time: 1.5 cycles of the converter, and up to
/// three from the order to the start (RM0433 section 25.4.14).
const SAMPLE_CYCLES: u32 = CONVERTER_CYCLES * 9 / 2;

/// Conversions between two yields: 50 µs.
const CONVERSIONS_PER_TURN: u32 = 8;

/// Most cycles by which a conversion of the step may be ordered late; later, an interrupt was in between.
const LATE_CYCLES: u32 = STEP_INSTANT_CYCLES / 4;

/// Attempts per instant of the step.
const ATTEMPTS: usize = 16;

/// Conversions for the noise.
const NOISE_CONVERSIONS: u32 = 256;

fn settle() {
    let begin = DWT::cycle_count();
    while DWT::cycle_count().wrapping_sub(begin) < SETTLE_CYCLES {}
}

fn unmoved() -> SelfTestError {
    SelfTestError::Hardware {
        // Fits.
        what: "the output does not take a code"
            .try_into()
            .unwrap_or_default(),
    }
}

fn dac_code(code: u16) -> DacCode {
    DacCode::from_mid_scale(i32::from(code) - i32::from(DacCode::MID_SCALE.get()))
}

fn set(by_hand: &ByHand, code: u16) -> Result<(), SelfTestError> {
    if !by_hand.set(dac_code(code)) {
        return Err(unmoved());
    }
    settle();
    Ok(())
}

/// Measures everything. However it ends, the output is at mid-scale and follows the tick, as before.
///
/// # Errors
/// The converter does not answer, or the output takes no code.
pub async fn measure() -> Result<OutputValues, SelfTestError> {
    let read_back = ReadBack::start().await?;
    let by_hand = ByHand::take();
    let mut sums = [0; OUTPUT_CODES];
    for (index, sum) in sums.iter_mut().enumerate() {
        set(&by_hand, output_code(index))?;
        *sum = add(&read_back, CONVERSIONS_PER_CODE).await?.0;
    }
    set(&by_hand, DacCode::MID_SCALE.get())?;
    let noise = noise(add(&read_back, NOISE_CONVERSIONS).await?);
    read_back.sample_for(SampleTime::CYCLES1_5);
    let mut step_words = [0; STEP_INSTANTS];
    for (index, word) in step_words.iter_mut().enumerate() {
        *word = step(&by_hand, &read_back, index as u32 * STEP_INSTANT_CYCLES).await?;
    }
    Ok(OutputValues {
        sums,
        noise,
        step_words,
        sample_cycles: SAMPLE_CYCLES,
    })
}

/// Sum of `count` words, and sum of their squares.
async fn add(read_back: &ReadBack, count: u32) -> Result<(u32, u64), SelfTestError> {
    let (mut sum, mut squares) = (0u32, 0u64);
    for n in 1..=count {
        read_back.order();
        let word = read_back.word()?;
        sum += u32::from(word);
        squares += u64::from(word) * u64::from(word);
        if n.is_multiple_of(CONVERSIONS_PER_TURN) {
            yield_now().await;
        }
    }
    Ok((sum, squares))
}

/// RMS about the mean of [`NOISE_CONVERSIONS`] words.
fn noise((sum, squares): (u32, u64)) -> f32 {
    let count = u64::from(NOISE_CONVERSIONS);
    // In whole numbers, because the difference is small against both.
    let spread = (count * squares).saturating_sub(u64::from(sum) * u64::from(sum));
    F32Ext::sqrt(spread as f32) / NOISE_CONVERSIONS as f32
}

/// Word of the pin `after` cycles from the step.
async fn step(by_hand: &ByHand, read_back: &ReadBack, after: u32) -> Result<u16, SelfTestError> {
    let [from, to] = STEP_CODES.map(dac_code);
    for _ in 0..ATTEMPTS {
        if !by_hand.set(from) {
            return Err(unmoved());
        }
        settle();
        by_hand.load(to);
        let begin = DWT::cycle_count();
        by_hand.trigger();
        while DWT::cycle_count().wrapping_sub(begin) < after {}
        read_back.order();
        let late = DWT::cycle_count().wrapping_sub(begin) > after + LATE_CYCLES;
        let word = read_back.word()?;
        if !late && by_hand.is_out(to) {
            return Ok(word);
        }
        yield_now().await;
    }
    Err(SelfTestError::Hardware {
        what: "the output's step was disturbed every time"
            .try_into()
            .unwrap_or_default(),
    })
}
