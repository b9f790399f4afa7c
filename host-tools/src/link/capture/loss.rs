//! Count of the blocks that a recording lost.

/// Losses of a recording, in blocks of [`BLOCK_SAMPLES`](model_format::link::BLOCK_SAMPLES) samples.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Loss {
    /// Blocks that arrived.
    pub received: u32,
    /// Blocks that the device dropped because its buffer was full.
    pub in_device: u32,
    /// Blocks that the device sent and that did not arrive.
    pub on_link: u32,
    /// Frames that arrived and could not be decoded.
    pub broken_frames: u64,
    /// Samples that arrived with conversions of more than one tick, because the device read them late.
    pub torn_samples: u32,
}

impl Loss {
    /// Returns true if nothing was lost or torn.
    pub fn is_none(&self) -> bool {
        (self.in_device, self.on_link, self.broken_frames) == (0, 0, 0) && self.torn_samples == 0
    }
}

impl std::fmt::Display for Loss {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if self.is_none() {
            return f.write_str("nothing lost");
        }
        write!(
            f,
            "{} blocks arrived, {} lost in the device, {} on the link",
            self.received, self.in_device, self.on_link
        )?;
        if self.torn_samples > 0 {
            write!(f, "; {} torn samples are no data", self.torn_samples)?;
        }
        Ok(())
    }
}
