//! The command that runs as a broker, and the program that starts it.

use std::ffi::OsString;
use std::path::PathBuf;

use crate::link::LinkAddress;

/// Line that a broker prints once clients may come.
pub const BROKER_READY: &str = "ready";

/// Line that a broker prints if another program has the device.
pub const BROKER_TAKEN: &str = "taken";

/// Name of the command that runs as a broker.
pub const BROKER_COMMAND: &str = "share-link";

/// A program that shares the links that it opens.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Sharing {
    /// The `stylus` program, which is started as a broker if none is running.
    pub program: PathBuf,
    /// The command that opens the link. Other programs name it in their messages.
    pub command: String,
}

impl Sharing {
    /// Returns the arguments that make the program a broker of `address`.
    pub fn arguments(&self, address: &LinkAddress) -> [OsString; 3] {
        [
            BROKER_COMMAND.into(),
            "--link".into(),
            address.to_string().into(),
        ]
    }
}
