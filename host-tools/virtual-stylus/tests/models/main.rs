//! Checks the board's models against the manual, as an image sees them.

mod bench;
mod flash;
mod motion;
mod pace;
mod registers;
mod usb;
