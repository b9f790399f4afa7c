//! A slot on the command line.

use model_format::link::SlotId;

/// A slot on the command line.
#[derive(Clone, Copy, clap::ValueEnum)]
#[value(rename_all = "UPPER")]
pub enum Slot {
    A,
    B,
}

impl From<Slot> for SlotId {
    fn from(slot: Slot) -> Self {
        match slot {
            Slot::A => Self::A,
            Slot::B => Self::B,
        }
    }
}
