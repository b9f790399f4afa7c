//! How programs and a virtual stylus on the same computer find each other and communicate.
//!
//! | module | subject |
//! |---|---|
//! | [`announcement`] | announcements of virtual styluses, in the user's folder for them |
//! | [`usb_messages`] | messages between a program and the USB host of a virtual stylus |
//!
//! This is a package of its own, because the virtual stylus is built without the host's tools.

pub mod announcement;
pub mod usb_messages;
