//! embassy's driver of the USB core, protected from what makes it fail (embassy-usb-synopsys-otg 0.3.3, embassy-usb
//! 0.6.0).
//!
//! Invariant: no host, whatever it sends or leaves out, makes the device panic, wait forever, or lose a frame
//! unnoticed.
//!
//! What a host may do, and how it is handled here:
//! - **A request to an endpoint that does not exist** makes embassy panic. Here the request is stalled ([`control`]).
//! - **A control transfer that begins before the last one ended, or a reset of the bus meanwhile,** makes embassy wait
//!   forever for the end of the last transfer. Here the last transfer is abandoned ([`control`]).
//! - **A cleared halt, or a choice of setting or configuration,** leaves embassy's data toggles as they were, so a
//!   packet is lost (USB 2.0, sections 9.1.1.5 and 9.4.5). Here the toggles are reset.
//! - **A choice of configuration while a packet waits to be fetched** makes embassy flush its FIFO while the endpoint
//!   stays enabled, after which nothing is ever sent. Here the endpoint is disabled first.
//! - **A reset of the bus, or a pulled cable, in the middle of a frame** makes embassy join the sent part to the next
//!   frame. Here a new session begins, and both parts of the frame are dropped.
//! - **A suspend followed by a reset while the tasks are busy** makes embassy serve the suspend after the reset, so the
//!   device sleeps through its enumeration. Here the reset clears the suspend.
//! - **A packet right after a reset, while the tasks are busy,** finds the device silent at its old address. Here the
//!   interrupt's handler resets the address.
//!
//! embassy has since fixed the toggles and the late suspend, but has not yet released these fixes.

pub mod control;
pub mod driver;
