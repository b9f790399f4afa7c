//! The command that is a broker, and a program that starts it.

use std::ffi::OsString;
use std::path::PathBuf;

use crate::link::LinkAddress;

/// Line that a broker prints once clients may come.
pub const BROKER_READY: &str = "ready";

/// Line that a broker prints if another program has the device.
pub const BROKER_TAKEN: &str = "taken";

/// Name of the command that is a broker.
pub const BROKER_COMMAND: &str = "share-link";

/// A program that shares the links that it opens.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Sharing {
    /// The `stylus` program, which is started as a broker where there is none.
    pub program: PathBuf,
    /// The command that opens the link, for others that want to know who does.
    pub command: String,
}

impl Sharing {
    /// The arguments with which the program is a broker of `address`.
    pub fn arguments(&self, address: &LinkAddress) -> [OsString; 3] {
        [
            BROKER_COMMAND.into(),
            "--link".into(),
            address.to_string().into(),
        ]
    }
}
