//! State of the host between two calls, and the calls that the host's software makes.

use std::collections::{BTreeMap, VecDeque};

use super::transfer::{Completion, Packets, Pending, Pipe, Stage, Transfer, TransferError, TransferId};
use crate::chance::Chance;
use crate::model::usb::{InAnswer, Pid};

/// Counts of the bus's traffic.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Traffic {
    /// Number of transactions that were carried out.
    pub transactions: u64,
    /// Number of transactions that the device refused for the time being.
    pub naks: u64,
    /// Number of transactions that were broken or not answered.
    pub broken: u64,
    /// Number of packets that arrived twice and that the host dropped.
    pub repeated: u64,
}

/// A mishap, which may happen at the end of any transaction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mishap {
    /// The cable is pulled.
    Unplug,
    /// The host resets the bus for 10 ms.
    Reset,
}

/// Duration of a bus reset by a root port, ns (section 7.1.7.5).
pub const RESET_NS: u64 = 10_000_000;

/// State of the bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Bus {
    /// The cable is out.
    Unplugged,
    /// The cable is in, and nothing is sent.
    Silent,
    /// The host drives a reset until an instant.
    Reset { until_ns: u64, begun: bool },
    /// The host drives a resume until an instant.
    Resume { until_ns: u64 },
    /// The host sends frames.
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
    /// The device receives nothing, or only broken packets.
    Unheard,
    /// The device receives all packets. The device's handshake reaches the host if `is_answered` is true.
    Heard { is_answered: bool },
    /// The device answers an IN token. The answer reaches the host if `arrives` is true, and the host's handshake
    /// reaches the device if `is_acknowledged` is true.
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
    /// Start of the silence on the bus. `quiet_told` is set once the silence has suspended the device.
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
    /// The core's number of changes at the time when it refused everything that was due.
    pub(super) refused_at: Option<u64>,
    chance: Chance,
    broken_per_million: u64,
    pub(super) mishap: Option<(u64, Mishap)>,
    pub(super) next_id: u64,
    pub(super) completions: Vec<Completion>,
    pub(super) traffic: Traffic,
    /// True if the device's clock deviates by more than a host tolerates.
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
            chance: Chance::default(),
            broken_per_million: 0,
            mishap: None,
            next_id: 0,
            completions: Vec::new(),
            traffic: Traffic::default(),
            // At power-on USB has no clock yet.
            clock_is_off: true,
        }
    }
}

impl Host {
    /// Puts the cable in.
    pub fn plug(&mut self, now_ns: u64) {
        if self.bus == Bus::Unplugged {
            self.go_quiet(Bus::Silent, now_ns);
        }
    }

    /// Pulls the cable: the device receives nothing, and the host sees no device.
    pub fn unplug(&mut self, now_ns: u64) {
        if self.bus != Bus::Unplugged {
            self.go_quiet(Bus::Unplugged, now_ns);
            self.fail_all(now_ns, TransferError::Gone);
            self.sees_device = false;
        }
    }

    /// Returns true while the host sees a device's pull-up.
    pub fn sees_device(&self) -> bool {
        self.sees_device
    }

    /// Returns true while the host sends frames.
    pub fn is_running(&self) -> bool {
        self.bus == Bus::Running
    }

    /// Drives a reset for `nanos`, if the host sees a device. All transfers that wait are cancelled. Afterwards the
    /// host sends frames, to address 0, and its data toggles start again at DATA0.
    pub fn reset_bus(&mut self, now_ns: u64, nanos: u64) {
        if self.sees_device {
            self.bus = Bus::Reset {
                until_ns: now_ns + nanos,
                begun: false,
            };
            self.fail_all(now_ns, TransferError::Cancelled);
            self.toggles.clear();
            self.address = 0;
        }
    }

    /// Sends nothing from now on, so that the device is suspended 3 ms later. Transfers that wait continue after a
    /// resume.
    pub fn suspend(&mut self, now_ns: u64) {
        if self.bus == Bus::Running {
            self.go_quiet(Bus::Silent, now_ns);
        }
    }

    /// Drives a resume for `nanos`, and sends frames afterwards.
    pub fn resume(&mut self, now_ns: u64, nanos: u64) {
        if self.bus == Bus::Silent {
            self.bus = Bus::Resume {
                until_ns: now_ns + nanos,
            };
        }
    }

    /// Sets the address that all later tokens carry.
    pub fn set_address(&mut self, address: u8) {
        self.address = address;
    }

    /// Breaks each later packet with a probability of `per_million` in a million.
    pub fn break_packets(&mut self, per_million: u64, seed: u64) {
        (self.chance, self.broken_per_million) = (Chance(seed), per_million);
    }

    /// Draws at random whether the next packet breaks.
    pub(super) fn breaks(&mut self) -> bool {
        self.broken_per_million != 0 && self.chance.below(1_000_000) < self.broken_per_million
    }

    /// Schedules `mishap` for the end of a transaction: the one that follows once `transactions` more transactions have
    /// been counted. That transaction is lost if [`Traffic::transactions`] is even by then. If it is odd, it is carried
    /// out before the mishap.
    pub fn have(&mut self, mishap: Mishap, transactions: u64) {
        self.mishap = Some((self.traffic.transactions + transactions, mishap));
    }

    /// Returns true if no mishap is scheduled, so once the last one has happened.
    pub fn has_happened(&self) -> bool {
        self.mishap.is_none()
    }

    /// Appends `transfer` to the transfers that wait for the same pipe.
    pub fn submit(&mut self, transfer: Transfer) -> TransferId {
        let id = TransferId(self.next_id);
        self.next_id += 1;
        let pipe = match &transfer {
            Transfer::Control { .. } => Pipe::Control,
            Transfer::Out { endpoint, .. } => Pipe::Out(*endpoint),
            Transfer::In { endpoint, .. } => Pipe::In(*endpoint),
        };
        self.queue.entry(pipe).or_default().push_back(Pending {
            id,
            transfer,
            stage: Stage::Setup,
            sent: 0,
            received: Vec::new(),
            failures: 0,
        });
        // The core may accept the new transfer although it refuses all others.
        self.refused_at = None;
        id
    }

    /// Cancels a transfer. A transaction under way still ends on the wire, but is not reported.
    pub fn cancel(&mut self, id: TransferId, now_ns: u64) {
        for waiting in self.queue.values_mut() {
            if let Some(position) = waiting.iter().position(|pending| pending.id == id) {
                waiting.remove(position);
                self.completions.push(Completion {
                    id,
                    at_ns: now_ns,
                    result: Err(TransferError::Cancelled),
                });
                return;
            }
        }
    }

    /// Resets the data toggle of a bulk endpoint in one direction, as at the end of the endpoint's halt.
    pub fn reset_toggle(&mut self, address: u8) {
        let number = address & 0x0F;
        let pipe = if address & 0x80 == 0 {
            Pipe::Out(number)
        } else {
            Pipe::In(number)
        };
        self.toggles.remove(&pipe);
    }

    /// Returns the completions of transfers since the last call, in the order in which the transfers ended.
    pub fn take_completions(&mut self) -> Vec<Completion> {
        std::mem::take(&mut self.completions)
    }

    /// Counts of the bus's traffic since power-on.
    pub fn traffic(&self) -> Traffic {
        self.traffic
    }

    pub(super) fn go_quiet(&mut self, bus: Bus, now_ns: u64) {
        self.bus = bus;
        self.quiet_from_ns = now_ns;
        self.quiet_told = false;
    }

    pub(super) fn fail_all(&mut self, now_ns: u64, error: TransferError) {
        self.under_way = None;
        self.refused_at = None;
        for pending in std::mem::take(&mut self.queue).into_values().flatten() {
            self.completions.push(Completion {
                id: pending.id,
                at_ns: now_ns,
                result: Err(error),
            });
        }
    }
}
