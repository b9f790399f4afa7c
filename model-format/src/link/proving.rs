//! Progress of the device's own proof of direct forms.

use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

use super::SlotId;

/// A library whose direct forms the device proves stable, before it may be played.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Schema)]
pub struct Proving {
    /// Its slot.
    pub slot: SlotId,
    /// Share that is proved, ‰.
    pub permille: u16,
}
