//! The boards that the image is built for, as host, image and virtual stylus know them.
//!
//! Each file `NAME.board` of this package describes one: [`Board`] says what it holds. [`ALL`] has all of them, and
//! [`BOARD`] is the one that `STYLUS_BOARD` named in the build. [`pin`] gives the image the types of that board's pins,
//! so that a pin that its function or package does not have ends the build.
#![no_std]

use core::fmt;

#[cfg(all(target_arch = "arm", feature = "hardware"))]
use stm32_metapac::{GPIOA, GPIOB, GPIOC, GPIOD, GPIOE, RCC, gpio::Gpio};

/// A pin of the part.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pin {
    /// Port, from 0 for A.
    pub port: usize,
    /// Number in its port.
    pub number: usize,
    /// Where it is on the board.
    pub place: &'static str,
}

impl Pin {
    /// The pin of a name such as `PC13`.
    const fn new(name: &str, place: &'static str) -> Self {
        let (port, number) = match *name.as_bytes() {
            [b'P', port, ones] => (port, ones - b'0'),
            [b'P', port, tens, ones] => (port, (tens - b'0') * 10 + ones - b'0'),
            _ => panic!("a pin has a port and a number"),
        };
        Self {
            port: (port - b'A') as usize,
            number: number as usize,
            place,
        }
    }

    /// Registers of its port. A pin whose port is beyond E ends the build.
    #[cfg(all(target_arch = "arm", feature = "hardware"))]
    pub const fn registers(self) -> Gpio {
        [GPIOA, GPIOB, GPIOC, GPIOD, GPIOE][self.port]
    }

    /// Turns the clock of its port on.
    #[cfg(all(target_arch = "arm", feature = "hardware"))]
    #[inline(always)]
    pub fn start_clock(self) {
        RCC.ahb4enr().modify(|w| w.0 |= 1 << self.port);
        // The read waits until the write has arrived.
        let _ = RCC.ahb4enr().read();
    }
}

impl fmt::Display for Pin {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "P{}{}", (b'A' + self.port as u8) as char, self.number)
    }
}

/// Pins by their function. USB has PA11 and PA12 on every board.
#[derive(Clone, Copy, Debug)]
#[expect(missing_docs, reason = "the names say it")]
pub struct Pins {
    /// Channel 1 of DAC1: PA4 on every board.
    pub output: Pin,
    pub acceleration_x: Pin,
    pub acceleration_y: Pin,
    pub acceleration_z: Pin,
    pub force: Pin,
    /// Signals of the encoder: channels 1 and 2 of TIM3.
    pub encoder_a: Pin,
    pub encoder_b: Pin,
    /// Enable of the amplifier, active high.
    pub amplifier: Pin,
    /// USART3.
    pub serial_tx: Pin,
    pub serial_rx: Pin,
    /// Button, which connects its pin to the supply.
    pub button: Pin,
}

/// The clock at HSE.
#[derive(Clone, Copy, Debug)]
pub struct Clock {
    /// Frequency, Hz.
    pub hz: u32,
    /// True for a crystal, false for a clock that drives OSC_IN.
    pub is_crystal: bool,
    /// What to do if it does not come.
    pub remedy: &'static str,
}

/// A board.
#[derive(Clone, Copy, Debug)]
pub struct Board {
    /// Its name, at most 16 bytes. In small letters it is the name of its file.
    pub name: &'static str,
    /// The part, as embassy-stm32 and stm32-metapac call it.
    pub part: &'static str,
    /// The part, as probe-rs calls it.
    pub probe: &'static str,
    /// The clock at HSE.
    pub clock: Clock,
    /// The socket of the stylus's own USB.
    pub usb: &'static str,
    /// Most current from that socket, mA; 0 if it does not power the board.
    pub usb_ma: u16,
    /// The far end of the serial link.
    pub serial: &'static str,
    /// Inputs of ADC1 at the pins of acceleration X, Y, Z and force. The image takes them from embassy-stm32.
    pub inputs: [u8; 4],
    /// Inputs of ADC1 at pins that something on the board drives.
    pub driven: &'static [u8],
    /// What it lacks, or what must be left open.
    pub lacks: &'static str,
    /// LEDs, lit by a high level: the first blinks while all is well, and a second one lights after a fault.
    pub leds: &'static [Pin],
    /// The pins.
    pub pins: Pins,
}

impl Board {
    /// The LED by which the bootloader says that it waits: the last one.
    pub const fn fault_led(&self) -> Pin {
        self.leds[self.leds.len() - 1]
    }
}

/// A name that no board has.
#[derive(Clone, Copy, Debug)]
pub struct NoBoard;

impl fmt::Display for NoBoard {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("no board of firmware/boards; there are")?;
        ALL.iter().try_for_each(|board| write!(f, " {}", board.name))
    }
}

impl core::error::Error for NoBoard {}

/// Returns the board called `name`, in small or large letters.
///
/// # Errors
/// There is none.
pub fn named(name: &str) -> Result<&'static Board, NoBoard> {
    ALL.iter()
        .find(|board| board.name.eq_ignore_ascii_case(name))
        .ok_or(NoBoard)
}

/// Data of a board's file.
macro_rules! board {
    (
        { $($fields:tt)* }
        leds { $($led:ident $lit:literal,)* }
        pins { $($function:ident: $pin:ident $place:literal,)* }
    ) => {
        Board {
            $($fields)*
            leds: &[$(Pin::new(stringify!($led), $lit)),*],
            pins: Pins { $($function: Pin::new(stringify!($pin), $place)),* },
        }
    };
}

/// Makes [`pin`] of a board's file.
macro_rules! pins {
    (
        $d:tt
        { $($fields:tt)* }
        leds { $($led:ident $lit:literal,)* }
        pins { $($function:ident: $pin:ident $place:literal,)* }
    ) => {
        /// The board's pin of a function: its value by `pin!(peripherals.function)`, its type by
        /// `pin!(peripherals::function)`, and all LEDs by `pin!(peripherals.leds)`.
        #[macro_export]
        macro_rules! pin {
            ($d of:ident.leds) => { [$($d of.$led.into()),*] };
            $(
                ($d of:ident.$function) => { $d of.$pin };
                ($d of:ident::$function) => { $d of::$pin };
            )*
        }
    };
}

include!(concat!(env!("OUT_DIR"), "/boards.rs"));

const _: () = {
    let mut index = 0;
    while index < ALL.len() {
        let board = &ALL[index];
        assert!(board.name.len() <= 16 && !board.leds.is_empty());
        assert!(board.pins.output.port == 0 && board.pins.output.number == 4);
        index += 1;
    }
};

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_pin_of_a_board_has_two_functions_and_no_sensor_is_at_an_input_that_the_board_drives() {
        for board in ALL {
            let pins = board.pins;
            let analogue = [
                pins.acceleration_x,
                pins.acceleration_y,
                pins.acceleration_z,
                pins.force,
            ];
            let encoder = [pins.encoder_a, pins.encoder_b];
            let others = [pins.output, pins.amplifier, pins.serial_tx, pins.serial_rx, pins.button];
            let all = [&analogue[..], &encoder, &others, board.leds];
            let all = || all.iter().copied().flatten().map(|pin| (pin.port, pin.number));
            for pin in all() {
                assert_eq!(
                    all().filter(|&other| other == pin).count(),
                    1,
                    "{}: {pin:?}",
                    board.name
                );
            }
            let driven = board.inputs.iter().find(|input| board.driven.contains(input));
            assert_eq!(driven, None, "{}", board.name);
        }
    }
}
