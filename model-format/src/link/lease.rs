//! The lease to play. The link that asked to play holds it, and only that link can renew it.

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
/// A play request gives the lease to its link. Plays, motions and keep-alives of that link renew the lease for
/// [`super::LINK_LOST_AFTER_MS`]; nothing else renews it. While the lease lasts, the other link may stop the output,
/// but may neither play nor send motions. Once the lease has lapsed, the output is silent and either link may play.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct LeaseStatus {
    /// The link that has played last; none after a stop.
    pub holder: Option<LinkId>,
    /// True while that link keeps the lease alive.
    pub is_alive: bool,
    /// Plays, probes and motions of another link that were refused.
    pub refused: u32,
}
