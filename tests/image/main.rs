//! Tests of the image as it is flashed, on the virtual stylus.
//!
//! `STYLUS_IMAGE` and `STYLUS_FAULT_IMAGE` name the files that `cargo firmware` and `cargo firmware --fault-injection`
//! build for the first board, and `STYLUS_IMAGE_NAME` the product's image for each further one. `cargo tasks
//! test-virtual-stylus` builds all and sets the variables.

mod boards;
mod bootloader;
mod cost;
mod device;
mod expected;
mod flash;
mod inputs;
mod latency;
mod library;
mod link;
mod output;
/// Access to the generated blocks of a page; the source file belongs to the tasks.
#[path = "../../host-tools/tasks/src/tables/page.rs"]
mod page;
mod play;
mod registers;
mod requests;
mod reset;
mod scenes;
mod self_test;
mod soak;
mod start;
mod ticks;
mod update;
mod usb;
mod usb_client;
mod usb_link;
mod usb_mishaps;
