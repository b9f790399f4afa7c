//! Inputs of the tick: four channels of ADC1, started by TIM6, and the encoder's count by TIM3. `firmware/boards/` has
//! their pins.
//!
//! embassy-stm32 calibrates and enables the converter and configures the encoder's timer. It does not support an
//! injected sequence of this converter, so this module sets one up by RM0433 sections 25.4.19 to 25.4.22. A trigger
//! starts the sequence. Its four results stay in JDR1 to JDR4 until the next sequence overwrites them. The first
//! channel is sampled for longer than the others, so that the first result comes late. Therefore a tick that a critical
//! section delays still reads the results of the previous trigger.

use embassy_stm32::Peri;
use embassy_stm32::adc::{Adc, AdcChannel, AnyAdcChannel};
use embassy_stm32::gpio::Pull;
use embassy_stm32::pac::adc::vals::{Exten, Jqm, Pcsel, SampleTime};
use embassy_stm32::pac::timer::vals::FilterValue;
use embassy_stm32::pac::{ADC1, TIM3, TIM6};
use embassy_stm32::peripherals;
use embassy_stm32::timer::qei::{self, Qei};
use model_format::AdcCode;
use stylus_app::SAMPLE_RATE_HZ;
use stylus_board::pin;

use crate::boot::clock::{CONVERTER_BOOST, CONVERTER_HZ, TIMER_HZ};

/// A sampling time, and its length in half cycles of the converter (RM0433 section 25.4.13).
type Sampling = (SampleTime, u32);

/// Sampling time of each channel, in the order of the sequence: acceleration X, Y, Z, and force. The sampling time of
/// the first channel determines how late a tick may be.
const SAMPLING: [Sampling; 4] = {
    const LONG: Sampling = (SampleTime::CYCLES387_5, 775);
    const SHORT: Sampling = (SampleTime::CYCLES64_5, 129);
    [LONG, SHORT, SHORT, SHORT]
};

/// Half cycles of the converter from the end of the sampling time to the result: one, and one per bit of 16 (RM0433
/// section 25.4.17).
const CONVERSION: u32 = 17;

/// TIM6_TRGO as a trigger of injected sequences (RM0433 table 212, jadc_ext_trg14).
const TRIGGER_TIM6: u8 = 14;

/// Cycles of TIM6 per half cycle of the converter.
const TIMER_PER_HALF_CYCLE: u32 = TIMER_HZ / (2 * CONVERTER_HZ);

/// Time that reading the results of a sequence may take, cycles of TIM6: 2 µs.
const READING: u32 = TIMER_HZ / 500_000;

/// Latest time at which reading a sequence's results may end, cycles of TIM6 after the next trigger. It is the arrival
/// of that trigger's first result, 31.7 µs, less the time for reading.
const FIRST_RESULT: u32 = (SAMPLING[0].1 + CONVERSION) * TIMER_PER_HALF_CYCLE - READING;

/// Length of a sequence, cycles of TIM6: 49.2 µs.
const SEQUENCE: u32 = {
    let mut half_cycles = 0;
    let mut rank = 0;
    while rank < SAMPLING.len() {
        half_cycles += SAMPLING[rank].1 + CONVERSION;
        rank += 1;
    }
    half_cycles * TIMER_PER_HALF_CYCLE
};

const _: () = assert!(
    TIMER_HZ.is_multiple_of(2 * CONVERTER_HZ) && SEQUENCE < TIMER_HZ / SAMPLE_RATE_HZ / 2,
    "a sequence ends long before the next trigger"
);

/// Filter of the encoder's inputs: a level counts when 8 samples in a row, at the timer's clock / 32, show it (RM0433
/// chapter 39, TIMx_CCMR1, IC1F). This takes 1.28 µs at 200 MHz.
///
/// The fastest stroke of a hand is assumed to be 2 m/s, and the finest encoder to have 5 µm per count. Its counts then
/// come every 2.5 µs, and a level of one signal lasts two counts, 5 µs. So the filter leaves three quarters of a level
/// for the encoder's own errors of phase and duty cycle.
const ENCODER_FILTER: FilterValue = FilterValue::FDTS_DIV32_N8;

/// The pins and peripherals of all inputs.
pub struct Pins {
    /// The converter.
    pub adc: Peri<'static, peripherals::ADC1>,
    /// Acceleration along X.
    pub acceleration_x: Peri<'static, pin!(peripherals::acceleration_x)>,
    /// Acceleration along Y.
    pub acceleration_y: Peri<'static, pin!(peripherals::acceleration_y)>,
    /// Acceleration along Z.
    pub acceleration_z: Peri<'static, pin!(peripherals::acceleration_z)>,
    /// Normal force.
    pub force: Peri<'static, pin!(peripherals::force)>,
    /// The encoder's timer.
    pub timer: Peri<'static, peripherals::TIM3>,
    /// The encoder's first signal.
    pub encoder_a: Peri<'static, pin!(peripherals::encoder_a)>,
    /// The encoder's second signal.
    pub encoder_b: Peri<'static, pin!(peripherals::encoder_b)>,
}

/// Sets up all inputs and arms the sequence, which TIM6 starts at each trigger.
pub fn start(pins: Pins) {
    let Pins {
        adc,
        acceleration_x,
        acceleration_y,
        acceleration_z,
        force,
        timer,
        encoder_a,
        encoder_b,
    } = pins;
    // Each pin becomes analogue. embassy knows its channel.
    let channels: [AnyAdcChannel<'_, peripherals::ADC1>; SAMPLING.len()] = [
        acceleration_x.degrade_adc(),
        acceleration_y.degrade_adc(),
        acceleration_z.degrade_adc(),
        force.degrade_adc(),
    ];
    let _ = Adc::new(adc);
    arm_sequence(channels.map(|channel| channel.get_hw_channel()));
    // Pull-ups, because many encoders have open collectors.
    let config = qei::Config {
        ch1_pull: Pull::Up,
        ch2_pull: Pull::Up,
        ..Default::default()
    };
    // Forgotten, because dropping a `Qei` stops the timer.
    core::mem::forget(Qei::new(timer, encoder_a, encoder_b, config));
    // embassy leaves the filters off.
    TIM3.ccmr_input(0).modify(|w| {
        w.set_icf(0, ENCODER_FILTER);
        w.set_icf(1, ENCODER_FILTER);
    });
}

fn arm_sequence(channels: [u8; SAMPLING.len()]) {
    // embassy sets the boost for the clock before the silicon halves it.
    ADC1.cr().modify(|w| w.set_boost(CONVERTER_BOOST));
    ADC1.pcsel().modify(|w| {
        for channel in channels {
            w.set_pcsel(usize::from(channel), Pcsel::PRESELECTED);
        }
    });
    for (channel, (time, _)) in channels.map(usize::from).into_iter().zip(SAMPLING) {
        ADC1.smpr(channel / 10).modify(|w| w.set_smp(channel % 10, time));
    }
    ADC1.cfgr().modify(|w| {
        // The sequence never changes. Without the queue, JSQR keeps it (RM0433 section 25.4.21).
        w.set_jqdis(true);
        w.set_jqm(Jqm::MODE0);
    });
    ADC1.jsqr().write(|w| {
        w.set_jl(channels.len() as u8 - 1);
        w.set_jextsel(TRIGGER_TIM6);
        w.set_jexten(Exten::RISING_EDGE);
        for (rank, channel) in channels.into_iter().enumerate() {
            w.set_jsq(rank, channel);
        }
    });
    ADC1.cr().modify(|w| w.set_jadstart(true));
}

/// Signals on the pins after the previous trigger.
#[derive(Clone, Copy, Debug)]
pub struct Inputs {
    /// Acceleration along X, Y, Z.
    pub acceleration: [AdcCode; 3],
    /// Normal force.
    pub force: AdcCode,
    /// The encoder's count, which wraps.
    pub encoder: u16,
    /// True if all conversions belong to that trigger: they had ended, and no later conversion has overwritten a result
    /// yet.
    pub complete: bool,
    /// Time since the last trigger, cycles of TIM6.
    pub since_trigger: u32,
}

/// The encoder's count, which wraps.
#[inline(always)]
pub fn encoder_count() -> u16 {
    TIM3.cnt().read().cnt()
}

/// Time since the last trigger, cycles of TIM6.
#[inline(always)]
pub fn since_trigger() -> u32 {
    u32::from(TIM6.cnt().read().cnt())
}

/// Reads all inputs, within 29 µs of a trigger.
#[inline(always)]
pub fn read() -> Inputs {
    let encoder = encoder_count();
    let ended = ADC1.isr().read().jeos();
    let [x, y, z, force] = [0, 1, 2, 3].map(|rank| AdcCode(ADC1.jdr(rank).read().jdata() as u16));
    let elapsed = since_trigger();
    // Writing 1 clears a flag; writing 0 does nothing (RM0433 section 25.6.1).
    ADC1.isr().write(|w| {
        w.set_jeoc(true);
        w.set_jeos(true);
    });
    Inputs {
        acceleration: [x, y, z],
        force,
        encoder,
        complete: ended && elapsed < FIRST_RESULT,
        since_trigger: elapsed,
    }
}
