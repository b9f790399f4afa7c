//! The stylus's image for the STM32H743 on a board of `firmware/boards/`.
//!
//! The time-critical modules `boot`, `play` and `tick` are in the package `stylus-realtime`, which all modules may
//! import. Modules import in one direction: `link` imports `device`, `fault`, `flash` and `self_test`; `self_test`
//! imports `flash`; `flash` imports `fault`. Only this file imports all.
//!
//! The first LED blinks while all is well, a second one lights after a fault, and in safe mode they blink in turn.
#![no_std]
#![cfg(all(target_arch = "arm", feature = "image"))]

mod device;

/// How the program ends: fault handlers, the watchdog and the guard of the stack, and the records of the reasons.
///
/// Invariant: the first act of every handler is to put the output to mid-scale, which works whatever state the program
/// is in.
mod fault {
    pub mod handlers;
    pub mod heat;
    pub mod record;
    pub mod report;
    pub mod stack;
    pub mod watchdog;
}

/// The two flash banks behind the NorFlash traits: bank 2 holds the library slots, bank 1 the settings and the record
/// of updates.
///
/// Invariant: a word that cannot be read is an error and never a bus fault, every wait is bounded, and nothing outside
/// the slots, the settings and the record of updates is erased or written.
mod flash {
    pub mod banks;
    pub mod errors;
}

/// The two wires to the host, and the requests that come over them.
///
/// Invariants:
/// - Requests run in tasks. Interrupt handlers move bytes and count faults of the line.
/// - A frame that cannot be sent or decoded is counted. A transfer cut off by the end of a USB session is not.
/// - No host stops the tick. No host stops the other link, except by what writes bank 1 of the flash, which masks the
///   tasks' interrupts meanwhile: a change of settings or response, and a step of an update, which are refused while
///   something is played; and the first upload after a start, which renews the record of updates.
mod link {
    pub mod otg;
    pub mod outlet;
    pub mod requests;
    pub mod serial;
    pub mod storage;
    pub mod usb;
    pub mod wire;
}

mod self_test;

use defmt_rtt as _;
use panic_probe as _;

use embassy_executor::Spawner;
use embassy_stm32::gpio::{AnyPin, Input, Level, Output, Pull, Speed};
use embassy_stm32::{Peri, Peripherals, peripherals};
use embassy_time::{Instant, Timer};
use heapless::spsc::Queue;
use model_format::link::{Marks, QUICK_FAULT_MS, ResetReason, Settings, StartReport, StartStage};
use static_cell::ConstStaticCell;
use stylus_app::inputs::InputConfig;
use stylus_app::recorder::{Recorder, SampleQueue, Tap};
use stylus_app::requests::Frame;
use stylus_app::safety;
use stylus_board::{BOARD, pin};
use stylus_boot::supply;
use stylus_realtime::{boot, play, tick};

use crate::boot::{clock, critical, priority, protection, silicon, startup};
use crate::device::Hardware;
use crate::fault::record::{self, Before};
use crate::fault::{heat, report, stack, watchdog};
use crate::link::wire::{self, Wire};
use crate::link::{outlet, requests, serial, storage, usb};
use crate::play::update;
use crate::tick::{inputs, output, raising};

#[embassy_executor::main]
async fn main(spawner: Spawner) {
    let (peripherals, cause, before, start) = begin();
    defmt::info!(
        "start {} after {}: {}",
        before.resets,
        defmt::Debug2Format(&cause),
        before.caught
    );
    static SAMPLES: ConstStaticCell<SampleQueue> = ConstStaticCell::new(Queue::new());
    let (producer, consumer) = SAMPLES.take().split();
    let hardware = Hardware::new(
        Recorder::new(consumer),
        report::reset_report(cause, before),
        start,
        heat::take(cause),
        outlet::all_counters,
        guard_marks,
    );
    let board = Board::new(peripherals, &before, &start);
    let takes_unsigned = cause == ResetReason::PowerOn && board.button.is_high();
    if start.safe_mode {
        // Neither converter nor tick nor amplifier is started: the output stays at mid-scale, where `boot` put it.
        defmt::warn!("safe mode after {} quick faults", start.quick_faults);
        watchdog::expect_no_tick();
        spawner.spawn(watchdog::feed().unwrap());
        serve(spawner, hardware, board.links, board.leds, takes_unsigned).await;
        return;
    }
    record::enter(Some(StartStage::Inputs));
    spawner.spawn(watchdog::feed().unwrap());
    inputs::start(board.inputs);
    // The defaults apply until the settings are read.
    let settings = Settings::default();
    update::start(InputConfig::new(&settings));
    tick::start(
        board.tick_timer,
        board.output,
        Tap::new(producer),
        safety::Config::new(&settings, 1.0),
    );
    critical::begin_measuring();
    priority::enable();
    serve(spawner, hardware, board.links, board.leds, takes_unsigned).await;
    tick::supply::guard();
    // This comes last, when everything that ends the program at mid-scale is in place.
    spawner.spawn(raising::raise_amplifier().unwrap());
}

/// Prepares what every later step needs: memory, watchdog, clocks, time and priorities. Returns the peripherals, and
/// what is known about the last run and about this start.
fn begin() -> (Peripherals, ResetReason, Before, StartReport) {
    let Some(mut core) = cortex_m::Peripherals::take() else {
        defmt::unreachable!("the core peripherals are taken once");
    };
    protection::enable(&mut core.MPU);
    startup::prepare_memory(&mut core.SCB, &mut core.CPUID);
    play::voice::begin();
    startup::start_cycle_counter(&mut core.DCB, &mut core.DWT);
    stylus_boot::word::enable_bus_fault(&mut core.SCB);
    watchdog::start();
    let revision = silicon::revision();
    silicon::remedy(revision);
    self_test::chip::watch_memories();
    let cause = silicon::take_reset_cause();
    let before = record::take(cause);
    let clock = clock::select(before.starts.clock);
    record::enter(Some(clock::stage(clock)));
    watchdog::reload();
    let peripherals = clock::begin_time(|| embassy_stm32::init(clock::config(clock, revision)));
    clock::guard(clock);
    supply::watch();
    watchdog::reload();
    priority::assign();
    let start = StartReport {
        board: device::NAME,
        clock,
        revision,
        brown_out_level: silicon::brown_out_level(),
        supply_low: supply::is_low(),
        quick_faults: before.starts.quick_faults,
        safe_mode: before.starts.safe_mode,
        hung_stage: before.starts.hung_stage,
    };
    (peripherals, cause, before, start)
}

/// The board's peripherals, by their use.
struct Board {
    /// Its pin is high while the button is pressed.
    button: Input<'static>,
    leds: Leds,
    links: Links,
    inputs: inputs::Pins,
    tick_timer: Peri<'static, peripherals::TIM6>,
    output: output::Hardware,
}

impl Board {
    /// Hands out the peripherals. Pins of button and LEDs are set up; all others are left as they are.
    fn new(p: Peripherals, before: &Before, start: &StartReport) -> Self {
        let leds = pin!(p.leds).map(|pin: Peri<'static, AnyPin>| Output::new(pin, Level::Low, Speed::Low));
        let [life, mut fault @ ..] = leds;
        for led in &mut fault {
            led.set_level(before.caught.is_some().into());
        }
        Self {
            button: Input::new(pin!(p.button), Pull::Down),
            leds: Leds {
                life,
                fault,
                safe_mode: start.safe_mode,
            },
            links: Links {
                usart: p.USART3,
                tx: pin!(p.serial_tx),
                rx: pin!(p.serial_rx),
                // In safe mode USB stays off if the start hung at the links, because USB can hang in more places than
                // the serial port.
                usb: (!start.safe_mode || start.hung_stage != Some(StartStage::Links)).then_some((
                    p.USB_OTG_FS,
                    p.PA12,
                    p.PA11,
                )),
            },
            inputs: inputs::Pins {
                adc: p.ADC1,
                acceleration_x: pin!(p.acceleration_x),
                acceleration_y: pin!(p.acceleration_y),
                acceleration_z: pin!(p.acceleration_z),
                force: pin!(p.force),
                timer: p.TIM3,
                encoder_a: pin!(p.encoder_a),
                encoder_b: pin!(p.encoder_b),
            },
            tick_timer: p.TIM6,
            output: output::Hardware {
                timer: p.TIM7,
                to_converter: p.DMA1_CH0,
                eraser: p.DMA1_CH1,
                amplifier: pin!(p.amplifier),
            },
        }
    }
}

/// Peripherals of the links.
struct Links {
    usart: Peri<'static, peripherals::USART3>,
    tx: Peri<'static, pin!(peripherals::serial_tx)>,
    rx: Peri<'static, pin!(peripherals::serial_rx)>,
    /// The core, D+ and D-; none where USB is left off.
    usb: Option<(
        Peri<'static, peripherals::USB_OTG_FS>,
        Peri<'static, peripherals::PA12>,
        Peri<'static, peripherals::PA11>,
    )>,
}

/// Opens the stores and the links, which ends the start.
async fn serve(spawner: Spawner, hardware: Hardware, links: Links, leds: Leds, takes_unsigned: bool) {
    spawner.spawn(blink(leds).unwrap());
    record::enter(Some(StartStage::Storage));
    storage::start(spawner, hardware, takes_unsigned).await;
    record::enter(Some(StartStage::Links));
    spawner.spawn(requests::stream_recording().unwrap());
    if let Ok((sender, receiver)) = serial::open(links.usart, links.tx, links.rx) {
        wire::SERIAL.open(sender).await;
        spawner.spawn(serve_serial(receiver).unwrap());
    } else {
        defmt::error!("serial link: the clock cannot give the baud rate; the link stays off");
    }
    match links.usb {
        Some((core, dp, dm)) if usb::answers().await => {
            let (device, sender, receiver) = usb::open(core, dp, dm);
            wire::USB.open(sender).await;
            spawner.spawn(run_usb(device).unwrap());
            spawner.spawn(serve_usb(receiver).unwrap());
        }
        Some(_) => {
            defmt::warn!("USB link: the peripheral does not answer; the link stays off");
        }
        None => defmt::warn!("USB link: a start hung there; the link stays off"),
    }
    record::enter(None);
    spawner.spawn(note_healthy().unwrap());
}

/// Notes a healthy run once it has lasted long enough.
#[embassy_executor::task]
async fn note_healthy() {
    Timer::at(Instant::from_millis(QUICK_FAULT_MS.into())).await;
    record::note_healthy();
}

/// Marks of the guards in [`fault`]; the other marks stay zero.
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
    static ANSWER: ConstStaticCell<Frame> = ConstStaticCell::new([0; _]);
    requests::serve(Wire::Serial, receiver, BUFFER.take(), ANSWER.take()).await
}

#[embassy_executor::task]
async fn run_usb(mut device: usb::Device) -> ! {
    device.run().await
}

#[embassy_executor::task]
async fn serve_usb(receiver: usb::Receiver) -> ! {
    static BUFFER: ConstStaticCell<usb::Buffer> = ConstStaticCell::new([0; size_of::<usb::Buffer>()]);
    static ANSWER: ConstStaticCell<Frame> = ConstStaticCell::new([0; _]);
    requests::serve(Wire::Usb, receiver, BUFFER.take(), ANSWER.take()).await
}

/// The board's LEDs.
struct Leds {
    life: Output<'static>,
    /// None on a board with one LED.
    fault: [Output<'static>; BOARD.leds.len() - 1],
    safe_mode: bool,
}

/// Blinks the first LED while the executor runs, and logs the use of the stack every ten seconds. In safe mode the LEDs
/// blink in turn, four times as fast.
#[embassy_executor::task]
async fn blink(mut leds: Leds) -> ! {
    const BLINKS: u32 = 20;
    const IN_SAFE_MODE: u32 = 4;
    loop {
        for _ in 0..BLINKS {
            leds.life.toggle();
            if !leds.safe_mode {
                Timer::after_millis(500).await;
                continue;
            }
            for _ in 0..IN_SAFE_MODE {
                for fault in &mut leds.fault {
                    fault.set_level(leds.life.get_output_level());
                }
                leds.life.toggle();
                Timer::after_millis(125).await;
            }
        }
        defmt::info!("stack: {} of {} bytes used", stack::used_bytes(), stack::bytes());
    }
}
