//! Texts that messages carry, each of a bounded length.

use heapless::String;

use crate::limits::MAX_NAME_BYTES;

/// Name of a texture.
pub type TextureName = String<MAX_NAME_BYTES>;

/// Reason of a fault, as text for a person.
pub type Reason = String<160>;
