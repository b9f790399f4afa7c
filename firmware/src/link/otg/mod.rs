//! embassy's driver of the USB core, kept from what it does not survive (embassy-usb-synopsys-otg 0.3.3, embassy-usb
//! 0.6.0).
//!
//! Invariant: no host, whatever it sends or leaves out, makes the device panic, wait forever, or lose a frame unnoticed.
//!
//! | a host may | embassy's reaction | here |
//! |---|---|---|
//! | ask for an endpoint that does not exist | a panic | the request is stalled ([`control`]) |
//! | begin a control transfer before the last one ended, or reset the bus meanwhile | an endless wait for the last one | the last one is given up ([`control`]) |
//! | clear a halt, or choose a setting or configuration | toggles stay as they were, so a packet is lost (USB 2.0, sections 9.1.1.5 and 9.4.5) | toggles begin anew |
//! | choose a configuration while a packet waits to be fetched | its FIFO is flushed and the endpoint stays enabled: nothing is ever sent again | the endpoint is disabled first |
//! | reset the bus, or pull the cable, in the middle of a frame | the part that went is joined to the next frame | a new session: both parts of the frame are dropped |
//! | suspend the bus and reset it while the tasks are busy | the suspend is believed, and the device sleeps through its enumeration | the suspend is forgotten with the reset |
//! | speak to the device right after a reset, while the tasks are busy | it still has its old address and is silent | the interrupt's handler takes the address back |
//!
//! embassy has mended the toggles and the late suspend since, in no release yet.

pub mod control;
pub mod core;
pub mod driver;
