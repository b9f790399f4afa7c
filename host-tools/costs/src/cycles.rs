//! The schema of `firmware/cycles.json`: cycles of tick and update, as a device's own cycle counter measured them.
//!
//! `cargo tasks hil --cycles FILE` writes such a file. The pages show a file of a board alone: figures of an emulated
//! processor follow from the emulator's constant rate of instructions, and say nothing of a board.

use serde::{Deserialize, Serialize};

/// Cycles of one device.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct MeasuredCycles {
    /// The device.
    pub device: MeasuredDevice,
    /// A row for each texture or scene, the idle device first.
    pub rows: Vec<CycleRow>,
}

/// The device that was measured.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct MeasuredDevice {
    /// Serial number of the board.
    pub serial: String,
    /// True if the processor was emulated, and the figures are none of a board.
    pub emulated: bool,
    /// Revision of the silicon, as the device states it.
    pub revision: String,
    /// Clock of the processor, Hz.
    pub core_hz: u32,
    /// Version of the firmware.
    pub firmware_version: String,
    /// Profile and compiler of the firmware.
    pub build: String,
    /// Day of the measurement, as year, month and day.
    pub date: String,
}

/// Cycles of tick and update while one texture or scene was played.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct CycleRow {
    /// The texture or scene.
    pub what: String,
    /// Number of ticks.
    pub ticks: u32,
    /// Shortest tick, cycles.
    pub tick_shortest: u32,
    /// Longest tick, cycles: one that begins a block.
    pub tick_longest: u32,
    /// Number of updates.
    pub updates: u32,
    /// Shortest update, cycles, with the ticks that interrupted it.
    pub update_shortest: u32,
    /// Longest update, cycles, with the ticks that interrupted it.
    pub update_longest: u32,
}
