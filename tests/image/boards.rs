//! What a board's file says, on every board: clock, pins, LEDs and USB.

use model_format::link::ClockSource;
use stylus_board::{ALL, Board};
use virtual_stylus::Options;

use crate::bootloader::{LOW_SUPPLY, committed_on};
use crate::device::{Device, MS, SECOND, product_of};
use crate::library;
use crate::self_test::{MEASUREMENTS, failing, lines, quiet};
use crate::update::image;

/// Options on `board` with a library.
fn on(board: &'static Board) -> Options {
    Options {
        flash: library::options().flash,
        ..Options::on(board)
    }
}

#[test]
fn each_board_runs_by_its_own_clock_and_passes_its_self_test_over_usb() {
    for board in ALL {
        let mut device = Device::on_usb(on(board));
        let start = device.status().start;
        assert_eq!((start.board.as_str(), start.clock), (board.name, ClockSource::External));
        device.set_pins(quiet);
        for request in MEASUREMENTS {
            let found = lines(&mut device, request);
            assert_eq!(failing(&found), [""; 0], "{}", board.name);
        }
        // USB 2.0, table 9-10: bit 6 says that the board is powered otherwise; the current is in steps of 2 mA.
        let configuration = device.enumerate().expect("it enumerates again").configuration;
        let powered = 0x80 | if board.usb_ma == 0 { 0x40 } else { 0 };
        assert_eq!(configuration[7..9], [powered, (board.usb_ma / 2) as u8]);
        device.assert_models_sufficed();
    }
}

#[test]
fn leds_and_button_of_each_board_are_at_its_pins() {
    for board in ALL {
        let mut device = Device::new(&product_of(board), on(board));
        device.stylus.press_button(true);
        device.wait_for_start();
        assert!(device.update_state().takes_unsigned, "{}", board.name);
        let mut lit = [0; 2];
        for _ in 0..20 {
            device.run_for(100 * MS);
            for (count, &led) in lit.iter_mut().zip(board.leds) {
                *count += u32::from(device.is_lit(led));
            }
        }
        // The first blinks each second, and nothing lights the second.
        assert!((8..=12).contains(&lit[0]) && lit[1] == 0, "{}: {lit:?}", board.name);
        // The bootloader waits while it cannot write.
        let waiting = Options {
            flash: committed_on(board, &image(&product_of(board))),
            keep_flash: true,
            ..Options::on(board)
        };
        let mut device = Device::new(&product_of(board), waiting);
        device.stylus.set_supply(LOW_SUPPLY);
        device.run_for(SECOND);
        let shown = (device.flash_operations(), device.is_lit(board.fault_led()));
        assert_eq!(shown, (0, true), "{}", board.name);
    }
}

#[test]
fn the_image_of_a_board_with_another_kind_of_clock_runs_on_the_internal_one() {
    for (board, other) in [(&ALL[0], &ALL[1]), (&ALL[1], &ALL[0])] {
        let mut device = Device::new(&product_of(other), on(board));
        device.wait_for_start();
        let start = device.status().start;
        assert_eq!((start.board.as_str(), start.clock), (other.name, ClockSource::Internal));
    }
}
