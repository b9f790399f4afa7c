//! The stylus's image for the STM32H743 on a NUCLEO-H743ZI2.
//!
//! | module | what |
//! |---|---|
//! | [`startup`], [`clock`], [`priority`] | from reset to running |
//! | [`tick`], [`inputs`], [`output`] | one sample, 5000 times a second |
//! | [`update`], [`direction`], [`voice`], [`shared`] | one block every 2 ms, handed to the tick |
//! | [`device`], [`library_ram`], [`storage`], [`flash`], [`flash_word`] | what `stylus_app` needs of the hardware |
//! | [`link`], [`serial`], [`usb`] | requests, over two wires |
//! | [`otg`], [`otg_control`] | what embassy's driver of the USB core does not survive by itself |
//! | [`fault`], [`watchdog`], [`stack`] | the end, and why; what keeps from it |
//! | `injection` | faults on request, in the tests' image alone |
//!
//! The pins stand at the head of [`inputs`], [`output`], [`serial`] and [`usb`]; LED LD1 on PB0 blinks while all is well, LD3
//! on PB14 lights after a fault.
#![no_std]
#![no_main]

mod clock;
mod device;
mod direction;
mod fault;
mod flash;
mod flash_word;
#[cfg(feature = "fault-injection")]
mod injection;
mod inputs;
mod library_ram;
mod link;
mod link_counters;
mod otg;
mod otg_control;
mod output;
mod priority;
mod serial;
mod shared;
mod stack;
mod startup;
mod storage;
mod tick;
mod update;
mod usb;
mod voice;
mod watchdog;
mod wire;

use defmt_rtt as _;
use panic_probe as _;

use embassy_executor::Spawner;
use embassy_stm32::gpio::{Level, Output, Speed};
use embassy_time::Timer;
use heapless::spsc::Queue;
use micromath::F32Ext;
use model_format::link::Settings;
use static_cell::ConstStaticCell;
use stylus_app::inputs::InputConfig;
use stylus_app::recorder::{Recorder, SampleQueue, Tap};
use stylus_app::safety;

use crate::device::{Hardware, ResetFlags, reset_report};
use crate::wire::Wire;

#[embassy_executor::main]
async fn main(spawner: Spawner) {
    let Some(mut core) = cortex_m::Peripherals::take() else {
        defmt::unreachable!("nobody took them before");
    };
    startup::prepare_memory(&mut core.SCB, &mut core.CPUID);
    startup::start_cycle_counter(&mut core.DCB, &mut core.DWT);
    flash_word::enable_bus_fault(&mut core.SCB);
    let flags = ResetFlags::take();
    let before = fault::take(flags == ResetFlags::PowerOn, flags == ResetFlags::Watchdog);
    let p = embassy_stm32::init(clock::config());
    priority::assign();
    watchdog::start(p.IWDG1);
    spawner.spawn(watchdog::feed().unwrap());
    defmt::info!("start {} after {}: {}", before.resets, flags, before.caught);

    inputs::start(inputs::Pins {
        adc: p.ADC1,
        acceleration_x: p.PA3,
        acceleration_y: p.PC0,
        acceleration_z: p.PC1,
        force: p.PB1,
        timer: p.TIM3,
        encoder_a: p.PA6,
        encoder_b: p.PC7,
    });
    static SAMPLES: ConstStaticCell<SampleQueue> = ConstStaticCell::new(Queue::new());
    let (producer, consumer) = SAMPLES.take().split();
    // What the tick starts with, until the settings are read.
    let settings = Settings::default();
    update::start(InputConfig::new(&settings));
    tick::start(
        p.TIM6,
        Tap::new(producer),
        safety::Config::new(&settings, 1.0),
    );
    priority::enable();

    let hardware = Hardware::new(Recorder::new(consumer), reset_report(flags, before));
    let fault_led = if before.caught.is_some() {
        Level::High
    } else {
        Level::Low
    };
    core::mem::forget(Output::new(p.PB14, fault_led, Speed::Low));
    spawner.spawn(blink(Output::new(p.PB0, Level::Low, Speed::Low)).unwrap());
    storage::start(spawner, hardware).await;
    spawner.spawn(link::record::stream().unwrap());
    if let Ok((half, inlet)) = serial::open(p.USART3, p.PD8, p.PD9) {
        wire::SERIAL.open(half).await;
        spawner.spawn(serve_serial(inlet).unwrap());
    } else {
        defmt::error!("the clock does not give the serial port's rate");
    }
    usb::start(spawner, p.USB_OTG_FS, p.PA12, p.PA11).await;
}

#[embassy_executor::task]
async fn serve_serial(inlet: serial::Inlet) -> ! {
    static BUFFER: ConstStaticCell<serial::Buffer> = ConstStaticCell::new(serial::EMPTY);
    link::serve(Wire::Serial, inlet, BUFFER.take()).await
}

/// Shows that the executor lives, and now and then how much stack was needed and how warm the coil is.
#[embassy_executor::task]
async fn blink(mut led: Output<'static>) -> ! {
    const BLINKS: u32 = 20;
    loop {
        for _ in 0..BLINKS {
            led.toggle();
            Timer::after_millis(500).await;
        }
        let (used, bytes) = stack::used();
        defmt::info!("stack: {} of {} bytes were used", used, bytes);
        if let Some(report) = tick::report() {
            let load = f32::from(report.safety.thermal_load_permille().max(1)) / 1000.0;
            // For people: a logarithm to a tenth is enough.
            let decibel = 10.0 * load.log10();
            defmt::info!("the coil is {} dB above its power limit", decibel);
        }
    }
}
