//! The lease of whoever plays: the link that asked for it, and that alone keeps it alive.

use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

/// A link of the device.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub enum LinkId {
    /// USB.
    Usb,
    /// The serial port.
    Serial,
}

impl core::fmt::Display for LinkId {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::Usb => "USB",
            Self::Serial => "the serial link",
        })
    }
}

/// State of the lease.
///
/// A play gives the lease to its link. Plays, motions and keep-alives of that link renew it for
/// [`super::LINK_LOST_AFTER_MS`]; nothing else does. While it lasts, the other link may stop what is played, and may
/// neither play nor move. Once it has lapsed the output is silent, and either link may play.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct LeaseStatus {
    /// The link that has played last, until it is stopped.
    pub holder: Option<LinkId>,
    /// True while that link keeps it alive.
    pub is_alive: bool,
    /// Plays and motions of another link that were refused.
    pub refused: u32,
}
