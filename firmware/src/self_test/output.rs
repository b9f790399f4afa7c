//! Sets the output's pin by hand and reads it back.

use cortex_m::peripheral::DWT;
use embassy_futures::yield_now;
use embassy_stm32::pac::adc::vals::SampleTime;
use embassy_time::{Duration, Instant, Timer};
use micromath::F32Ext;
use model_format::DacCode;
use model_format::link::{
    CONVERSIONS_PER_CODE, OUTPUT_CODES, OutputValues, REST_CONVERSIONS, RestValues, STEP_CODES, STEP_INSTANT_CYCLES,
    STEP_INSTANTS, SelfTestError, output_code,
};

use crate::boot::clock::{CONVERTER_HZ, CORE_HZ};
use crate::self_test::clocks::since;
use crate::self_test::read_back::{ReadBack, fault};
use crate::tick::output::by_hand::ByHand;

/// Time after which an amplifier is off once its enable has dropped: amplifiers mute or fade for tens of milliseconds
/// (TDF8544: 50 ms).
const AMPLIFIER_OFF: Duration = Duration::from_millis(100);

/// Largest step from one code to the next, except the step that is measured: 0.1 V.
const RAMP: i32 = 128;

/// Time in which a new code settles, cycles: 20 µs, many times what the output's buffer needs.
const SETTLE_CYCLES: u32 = CORE_HZ / 50_000;

/// Time within which a new code is on the pin, many times the three ticks that this takes.
const LIMIT: Duration = Duration::from_millis(20);

/// Longest busy wait until a new code is on the pin, cycles: 1 ms.
const LIMIT_CYCLES: u32 = CORE_HZ / 1_000;

/// Cycles of the core per cycle of the converter.
const CONVERTER_CYCLES: u32 = CORE_HZ / CONVERTER_HZ;

/// Cycles of the core from the order of a conversion to its sample with the shortest sampling time: 1.5 cycles of the
/// converter, and up to three from the order to the start (RM0433 section 25.4.14).
const SAMPLE_CYCLES: u32 = CONVERTER_CYCLES * 9 / 2;

/// Conversions between two yields: 50 µs.
const CONVERSIONS_PER_TURN: u32 = 8;

/// Longest time between two looks at the step, and largest delay of the order of a conversion, cycles. If either is
/// longer, an interrupt came in between.
const LATE_CYCLES: u32 = STEP_INSTANT_CYCLES / 4;

/// Attempts per instant of the step.
const ATTEMPTS: usize = 16;

/// Conversions for the noise.
const NOISE_CONVERSIONS: u32 = 256;

fn settle() {
    let begin = DWT::cycle_count();
    while DWT::cycle_count().wrapping_sub(begin) < SETTLE_CYCLES {}
}

fn dac_code(code: u16) -> DacCode {
    DacCode::from_mid_scale(i32::from(code) - i32::from(DacCode::MID_SCALE.get()))
}

/// Moves the output to `code`, by steps of at most [`RAMP`], and waits until it has settled on the pin.
async fn set(by_hand: &ByHand, code: DacCode) -> Result<(), SelfTestError> {
    let offset = |code: DacCode| i32::from(code.get()) - i32::from(DacCode::MID_SCALE.get());
    loop {
        let left = offset(code) - offset(by_hand.code());
        let next = DacCode::from_mid_scale(offset(by_hand.code()) + left.clamp(-RAMP, RAMP));
        by_hand.set(next);
        let begin = Instant::now();
        while !by_hand.is_out(next) {
            if since(begin) > LIMIT {
                return Err(fault("the output does not take a code"));
            }
            yield_now().await;
        }
        if next == code {
            settle();
            return Ok(());
        }
    }
}

/// Measures everything. Afterwards, even after a failure, the output belongs to the tick again and the amplifier is as
/// before.
pub async fn measure() -> Result<OutputValues, SelfTestError> {
    let read_back = ReadBack::start().await?;
    let by_hand = ByHand::take();
    Timer::after(AMPLIFIER_OFF).await;
    let mut sums = [0; OUTPUT_CODES];
    for (index, sum) in sums.iter_mut().enumerate() {
        set(&by_hand, dac_code(output_code(index))).await?;
        *sum = add(&read_back, CONVERSIONS_PER_CODE).await?.0;
    }
    set(&by_hand, DacCode::MID_SCALE).await?;
    let noise = noise(add(&read_back, NOISE_CONVERSIONS).await?);
    read_back.sample_for(SampleTime::CYCLES1_5);
    let mut step_words = [0; STEP_INSTANTS];
    for (index, word) in step_words.iter_mut().enumerate() {
        *word = step(&by_hand, &read_back, index as u32 * STEP_INSTANT_CYCLES).await?;
    }
    set(&by_hand, DacCode::MID_SCALE).await?;
    Ok(OutputValues {
        sums,
        noise,
        step_words,
        sample_cycles: SAMPLE_CYCLES,
    })
}

/// Reads the pin as the tick drives it. Changes neither the output nor the amplifier.
pub async fn rest() -> Result<RestValues, SelfTestError> {
    let read_back = ReadBack::start().await?;
    let mut sum = 0;
    let mut range = [u16::MAX, 0];
    for n in 1..=REST_CONVERSIONS {
        read_back.order();
        let word = read_back.word()?;
        sum += u32::from(word);
        range = [range[0].min(word), range[1].max(word)];
        if n.is_multiple_of(CONVERSIONS_PER_TURN) {
            yield_now().await;
        }
    }
    Ok(RestValues { sum, range })
}

/// Returns the sum of `count` words, and the sum of their squares.
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
    // Computed in integers, because the difference is small compared with both terms.
    let spread = (count * squares).saturating_sub(u64::from(sum) * u64::from(sum));
    F32Ext::sqrt(spread as f32) / NOISE_CONVERSIONS as f32
}

/// Returns the core's cycle at which `to` appears on the pin; none if an interrupt hid that instant, or if `to` does
/// not appear.
fn edge(by_hand: &ByHand, to: DacCode) -> Option<u32> {
    by_hand.set(to);
    let begin = DWT::cycle_count();
    let mut before = begin;
    loop {
        let is_out = by_hand.is_out(to);
        let now = DWT::cycle_count();
        if is_out {
            return (now.wrapping_sub(before) <= LATE_CYCLES).then_some(now);
        }
        if now.wrapping_sub(begin) > LIMIT_CYCLES {
            return None;
        }
        before = now;
    }
}

/// Returns the word of the pin `after` cycles from the step.
async fn step(by_hand: &ByHand, read_back: &ReadBack, after: u32) -> Result<u16, SelfTestError> {
    let [from, to] = STEP_CODES.map(dac_code);
    for _ in 0..ATTEMPTS {
        set(by_hand, from).await?;
        if let Some(edge) = edge(by_hand, to) {
            while DWT::cycle_count().wrapping_sub(edge) < after {}
            read_back.order();
            let late = DWT::cycle_count().wrapping_sub(edge) > after + LATE_CYCLES;
            let word = read_back.word()?;
            if !late {
                return Ok(word);
            }
        }
        yield_now().await;
    }
    Err(fault("the output's step was disturbed every time"))
}
