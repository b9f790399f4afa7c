//! The stylus's image for the STM32H743 on a NUCLEO-H743ZI2.
//!
//! | room | content |
//! |---|---|
//! | [`boot`] | from reset to running: memory, clocks, interrupt priorities, cause of the reset |
//! | [`play`] | one block every 2 ms, handed to the tick |
//! | [`tick`] | one sample, 5000 times per second |
//! | [`fault`] | ends of the program, their reasons, and the guards: handlers, watchdog, stack |
//! | [`flash`] | library slots and settings in flash |
//! | [`device`] | the hardware as `stylus_app::control` sees it |
//! | [`link`] | requests, over two wires |
//! | `injection` | faults on request, in the tests' image alone |
//!
//! Rooms import in one direction: `link` imports `device` and `flash`; `device` imports `tick` and `play`; `flash`
//! imports `fault`; `fault` imports `tick`; `tick` imports `play`. All may import `boot`, which imports none. Only
//! `main` sees all.
//!
//! The pins stand at the head of [`tick::inputs`], [`tick::output`], [`link::serial`] and [`link::usb`]; LED LD1 on PB0
//! blinks while all is well, LD3 on PB14 lights after a fault.
#![no_std]
#![no_main]

mod boot;
mod device;
mod fault;
mod flash;
#[cfg(feature = "fault-injection")]
mod injection;
mod link;
mod play;
mod tick;

use defmt_rtt as _;
use panic_probe as _;

use embassy_executor::Spawner;
use embassy_stm32::gpio::{Level, Output, Speed};
use embassy_time::Timer;
use heapless::spsc::Queue;
use model_format::link::{Marks, Settings};
use static_cell::ConstStaticCell;
use stylus_app::inputs::InputConfig;
use stylus_app::recorder::{Recorder, SampleQueue, Tap};
use stylus_app::safety;

use crate::boot::reset::ResetFlags;
use crate::boot::{clock, critical, priority, protection, startup};
use crate::device::Hardware;
use crate::fault::{record, report, stack, watchdog};
use crate::flash::word;
use crate::link::wire::{self, Wire};
use crate::link::{counters, recording, requests, serial, storage, usb};
use crate::play::update;
use crate::tick::inputs;

#[embassy_executor::main]
async fn main(spawner: Spawner) {
    let Some(mut core) = cortex_m::Peripherals::take() else {
        defmt::unreachable!("the core peripherals are taken once");
    };
    protection::enable(&mut core.MPU);
    startup::prepare_memory(&mut core.SCB, &mut core.CPUID);
    startup::start_cycle_counter(&mut core.DCB, &mut core.DWT);
    word::enable_bus_fault(&mut core.SCB);
    let flags = ResetFlags::take();
    let before = record::take(flags == ResetFlags::PowerOn, flags == ResetFlags::Watchdog);
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
    // The defaults hold until the settings are read.
    let settings = Settings::default();
    update::start(InputConfig::new(&settings));
    tick::start(
        p.TIM6,
        Tap::new(producer),
        safety::Config::new(&settings, 1.0),
    );
    critical::begin_measuring();
    priority::enable();

    let hardware = Hardware::new(
        Recorder::new(consumer),
        report::reset_report(flags, before),
        counters::all,
        guard_marks,
    );
    let fault_led = if before.caught.is_some() {
        Level::High
    } else {
        Level::Low
    };
    core::mem::forget(Output::new(p.PB14, fault_led, Speed::Low));
    spawner.spawn(blink(Output::new(p.PB0, Level::Low, Speed::Low)).unwrap());
    storage::start(spawner, hardware).await;
    spawner.spawn(recording::stream().unwrap());
    if let Ok((sender, receiver)) = serial::open(p.USART3, p.PD8, p.PD9) {
        wire::SERIAL.open(sender).await;
        spawner.spawn(serve_serial(receiver).unwrap());
    } else {
        defmt::error!("serial link: the clock cannot give the baud rate; the link stays off");
    }
    if usb::answers().await {
        let (device, sender, receiver) = usb::open(p.USB_OTG_FS, p.PA12, p.PA11);
        wire::USB.open(sender).await;
        spawner.spawn(run_usb(device).unwrap());
        spawner.spawn(serve_usb(receiver).unwrap());
    } else {
        defmt::warn!("USB link: the peripheral does not answer; the link stays off");
    }
}

/// Marks of the guards in [`fault`]; the rest is left at zero.
fn guard_marks() -> Marks {
    Marks {
        stack_bytes: stack::bytes(),
        stack_used_bytes: stack::used_bytes(),
        longest_watchdog_gap_us: watchdog::longest_gap_us(),
        ..Marks::default()
    }
}

#[embassy_executor::task]
async fn serve_serial(receiver: serial::Receiver) -> ! {
    static BUFFER: ConstStaticCell<serial::Buffer> = ConstStaticCell::new(serial::EMPTY);
    requests::serve(Wire::Serial, receiver, BUFFER.take()).await
}

#[embassy_executor::task]
async fn run_usb(mut device: usb::Device) -> ! {
    device.run().await
}

#[embassy_executor::task]
async fn serve_usb(receiver: usb::Receiver) -> ! {
    static BUFFER: ConstStaticCell<usb::Buffer> =
        ConstStaticCell::new([0; size_of::<usb::Buffer>()]);
    requests::serve(Wire::Usb, receiver, BUFFER.take()).await
}

/// Blinks while the executor runs, and logs the use of the stack every ten seconds.
#[embassy_executor::task]
async fn blink(mut led: Output<'static>) -> ! {
    const BLINKS: u32 = 20;
    loop {
        for _ in 0..BLINKS {
            led.toggle();
            Timer::after_millis(500).await;
        }
        defmt::info!(
            "stack: {} of {} bytes used",
            stack::used_bytes(),
            stack::bytes()
        );
    }
}
