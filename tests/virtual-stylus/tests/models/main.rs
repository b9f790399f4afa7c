//! The board's models against the manual, as an image sees them.

mod bench;
mod codes;
mod converters;
mod digest;
mod flash;
mod motion;
mod probe;
mod registers;
mod resets;
mod ticks;
mod usb;
