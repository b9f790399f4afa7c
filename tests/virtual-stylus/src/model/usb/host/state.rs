//! State of the host between two calls.

use std::collections::{BTreeMap, VecDeque};

use super::chance::Chance;
use super::pending::{Packets, Pending, Pipe};
use super::transfer::{Completion, TransferId};
use crate::model::usb::packets::{InAnswer, Pid};

/// Counts of the bus's traffic.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Traffic {
    /// Transactions that were carried out.
    pub transactions: u64,
    /// Transactions that the device refused for now.
    pub naks: u64,
    /// Transactions that were broken or not answered.
    pub broken: u64,
    /// Packets that came twice and were dropped by the host.
    pub repeated: u64,
}

/// A mishap, which may happen at any transaction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mishap {
    /// The cable is pulled.
    Unplug,
    /// The host resets the bus for 10 ms.
    Reset,
}

/// A reset of the bus by a root port (section 7.1.7.5).
pub const RESET_NS: u64 = 10_000_000;

/// State of the bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Bus {
    /// The cable is out.
    Unplugged,
    /// The cable is in, and nothing is sent.
    Silent,
    /// A reset, until an instant.
    Reset { until_ns: u64, begun: bool },
    /// A resume, until an instant.
    Resume { until_ns: u64 },
    /// Frames.
    Running,
}

/// A transaction under way.
#[derive(Clone, Debug)]
pub(super) struct Transaction {
    pub(super) pipe: Pipe,
    pub(super) id: TransferId,
    pub(super) packets: Packets,
    pub(super) pid: Pid,
    pub(super) ends_ns: u64,
    pub(super) sent: Sent,
}

/// Fate of a transaction's packets on the wire.
#[derive(Clone, Debug)]
pub(super) enum Sent {
    /// The device receives nothing, or nothing whole.
    Unheard,
    /// The device receives all; its handshake arrives if `is_answered`.
    Heard { is_answered: bool },
    /// The device's answer to an IN token, which arrives if `arrives`; the host's handshake arrives if
    /// `is_acknowledged`.
    Answered {
        answer: InAnswer,
        arrives: bool,
        is_acknowledged: bool,
    },
}

/// The host.
#[derive(Debug)]
#[expect(
    clippy::struct_excessive_bools,
    reason = "each is a fact of its own, and any may come together"
)]
pub struct Host {
    pub(super) bus: Bus,
    /// Beginning of the silence on the bus; `quiet_told` is set once the silence has suspended the device.
    pub(super) quiet_from_ns: u64,
    pub(super) quiet_told: bool,
    pub(super) is_pulled_up: bool,
    pub(super) sees_device: bool,
    pub(super) frames_from_ns: u64,
    pub(super) free_from_ns: u64,
    pub(super) address: u8,
    pub(super) queue: BTreeMap<Pipe, VecDeque<Pending>>,
    pub(super) turn: Option<Pipe>,
    pub(super) toggles: BTreeMap<Pipe, Pid>,
    pub(super) under_way: Option<Transaction>,
    /// The core's number of changes when it refused everything that was due.
    pub(super) refused_at: Option<u64>,
    pub(super) chance: Chance,
    pub(super) mishap: Option<(u64, Mishap)>,
    pub(super) next_id: u64,
    pub(super) completions: Vec<Completion>,
    pub(super) traffic: Traffic,
    /// The device's clock is off by more than a host puts up with.
    pub(super) clock_is_off: bool,
}

impl Default for Host {
    fn default() -> Self {
        Self {
            bus: Bus::Unplugged,
            quiet_from_ns: 0,
            quiet_told: false,
            is_pulled_up: false,
            sees_device: false,
            frames_from_ns: 0,
            free_from_ns: 0,
            address: 0,
            queue: BTreeMap::new(),
            turn: None,
            toggles: BTreeMap::new(),
            under_way: None,
            refused_at: None,
            chance: Chance {
                state: 0,
                per_million: 0,
            },
            mishap: None,
            next_id: 0,
            completions: Vec::new(),
            traffic: Traffic::default(),
            clock_is_off: true,
        }
    }
}
