//! The board's models against the manual, as an image sees them.

mod codes;
mod converters;
mod digest;
mod flash;
mod motion;
mod no_memory;
mod probe;
mod registers;
mod resets;
mod ticks;
mod usb;
