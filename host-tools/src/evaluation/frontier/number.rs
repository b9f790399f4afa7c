//! Numbers of a file that may have no value.

use serde::{Deserialize, Deserializer};

/// Reads a number. What was not a number, or infinite, has no value in the file, and is not a number again.
pub fn number<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
    Ok(Option::deserialize(deserializer)?.unwrap_or(f64::NAN))
}
