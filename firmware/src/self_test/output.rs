//! The output's pin, set by hand and read back by ADC2: PA4 is DAC1_OUT1 and INP18 of both ADC1 and ADC2 (DS12110, pin
//! definitions).
//!
//! ADC1 converts for the tick, so it is not touched. ADC2 shares the clock of ADC1, which is on, and the reset, which
//! is therefore not used. ADC2 is in deep power-down before and after.
//!
//! [`measure`] sets codes by hand, with the amplifier off. [`rest`] only reads the pin while the tick drives it, and
//! changes neither the output nor the amplifier.

use cortex_m::asm;
use cortex_m::peripheral::DWT;
use embassy_futures::yield_now;
use embassy_stm32::pac::ADC2;
use embassy_stm32::pac::adc::vals::{Adcaldif, Difsel, Exten, Ovrmod, Pcsel, SampleTime};
use embassy_time::{Duration, Instant, Timer};
use micromath::F32Ext;
use model_format::DacCode;
use model_format::link::{
    CONVERSIONS_PER_CODE, OUTPUT_CODES, OutputValues, REST_CONVERSIONS, RestValues, STEP_CODES, STEP_INSTANT_CYCLES,
    STEP_INSTANTS, SelfTestError, output_code,
};

use crate::boot::clock::{CONVERTER_BOOST, CONVERTER_HZ, CORE_HZ};
use crate::self_test::clocks::since;
use crate::tick::output::by_hand::ByHand;

/// Time after which an amplifier is off once its enable has dropped: amplifiers mute or fade for tens of milliseconds
/// (TDF8544: 50 ms).
const AMPLIFIER_OFF: Duration = Duration::from_millis(100);

/// Largest step from one code to the next, except the step that is measured: 0.1 V.
const RAMP: i32 = 128;

/// Time in which a new code settles, cycles: 20 µs, many times what the output's buffer needs.
const SETTLE_CYCLES: u32 = CORE_HZ / 50_000;

/// Time within which a new code is on the pin, many times the three ticks that this takes.
const EDGE_LIMIT: Duration = Duration::from_millis(20);

/// Longest busy wait until a new code is on the pin, cycles: 1 ms.
const EDGE_CYCLES: u32 = CORE_HZ / 1_000;

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
            if since(begin) > EDGE_LIMIT {
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
        if now.wrapping_sub(begin) > EDGE_CYCLES {
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

/// Channel of PA4.
const CHANNEL: usize = 18;

/// Limit of the waits for the converter. The longest wait, for a calibration, takes 165 010 of the converter's cycles,
/// 13 ms.
const CONVERTER_LIMIT: Duration = Duration::from_millis(100);

/// Wait for the regulator, many times its start-up time of 10 µs (DS12110, ADC characteristics, t_ADCVREG_STUP).
const REGULATOR: Duration = Duration::from_millis(1);

/// Limit of a conversion, cycles of the core: many times the 73 cycles of the converter.
const CONVERSION_CYCLES: u32 = CORE_HZ / 10_000;

/// The converter, calibrated and enabled. When this is dropped, the converter returns to deep power-down.
pub struct ReadBack(());

/// A failure of the hardware.
pub fn fault(what: &'static str) -> SelfTestError {
    SelfTestError::Hardware {
        // Fits.
        what: what.try_into().unwrap_or_default(),
    }
}

async fn becomes(is_there: impl Fn() -> bool, what: &'static str) -> Result<(), SelfTestError> {
    let begin = Instant::now();
    while !is_there() {
        if since(begin) > CONVERTER_LIMIT {
            return Err(fault(what));
        }
        yield_now().await;
    }
    Ok(())
}

impl ReadBack {
    /// Wakes, calibrates and enables the converter (RM0433 sections 25.4.6 to 25.4.9).
    pub async fn start() -> Result<Self, SelfTestError> {
        // From here on a failure drops this value, which puts the converter to sleep.
        let read_back = Self(());
        ADC2.cr().modify(|w| {
            w.set_deeppwd(false);
            w.set_boost(CONVERTER_BOOST);
        });
        ADC2.cr().modify(|w| w.set_advregen(true));
        // Waits for a fixed time, because revisions Z and Y have no flag that shows when the regulator is ready.
        Timer::after(REGULATOR).await;
        ADC2.difsel().modify(|w| w.set_difsel(CHANNEL, Difsel::SINGLE_ENDED));
        ADC2.cr().modify(|w| {
            w.set_adcaldif(Adcaldif::SINGLE_ENDED);
            w.set_adcallin(true);
        });
        ADC2.cr().modify(|w| w.set_adcal(true));
        becomes(|| !ADC2.cr().read().adcal(), "ADC2's calibration does not end").await?;
        ADC2.isr().write(|w| w.set_adrdy(true));
        ADC2.cr().modify(|w| w.set_aden(true));
        becomes(|| ADC2.isr().read().adrdy(), "ADC2 does not become ready").await?;
        ADC2.cfgr().modify(|w| {
            w.set_cont(false);
            w.set_exten(Exten::DISABLED);
            w.set_ovrmod(Ovrmod::OVERWRITE);
        });
        ADC2.pcsel().write(|w| w.set_pcsel(CHANNEL, Pcsel::PRESELECTED));
        ADC2.sqr1().write(|w| w.set_sq(0, CHANNEL as u8));
        read_back.sample_for(SampleTime::CYCLES64_5);
        Ok(read_back)
    }

    /// Sets the sampling time.
    #[expect(clippy::unused_self, reason = "the value is the right to do it")]
    pub fn sample_for(&self, time: SampleTime) {
        ADC2.smpr(1).modify(|w| w.set_smp(CHANNEL - 10, time));
    }

    /// Orders a conversion.
    #[expect(clippy::unused_self, reason = "the value is the right to do it")]
    #[inline(always)]
    pub fn order(&self) {
        ADC2.cr().modify(|w| w.set_adstart(true));
    }

    /// Waits for the end of the conversion that was ordered, and returns its code.
    #[expect(clippy::unused_self, reason = "the value is the right to do it")]
    #[expect(
        clippy::result_large_err,
        reason = "without allocation the error is as large as its longest text"
    )]
    pub fn word(&self) -> Result<u16, SelfTestError> {
        let begin = DWT::cycle_count();
        while !ADC2.isr().read().eoc() {
            if DWT::cycle_count().wrapping_sub(begin) > CONVERSION_CYCLES {
                return Err(fault("ADC2 does not convert"));
            }
        }
        // Reading clears the flag (RM0433 section 25.6.1).
        Ok(ADC2.dr().read().rdata())
    }
}

impl Drop for ReadBack {
    /// Disables the converter, which is idle within the time of a conversion, and puts it to sleep.
    fn drop(&mut self) {
        let begin = DWT::cycle_count();
        let waited = || DWT::cycle_count().wrapping_sub(begin) > CONVERSION_CYCLES;
        while ADC2.cr().read().adstart() && !waited() {
            asm::nop();
        }
        if ADC2.cr().read().aden() {
            ADC2.cr().modify(|w| w.set_addis(true));
            while ADC2.cr().read().aden() && !waited() {
                asm::nop();
            }
        }
        ADC2.cr().modify(|w| w.set_advregen(false));
        ADC2.cr().modify(|w| w.set_deeppwd(true));
    }
}
