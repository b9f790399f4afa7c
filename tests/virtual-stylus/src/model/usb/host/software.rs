//! Calls of the host's software.

use super::chance::Chance;
use super::pending::{Pending, Pipe, Stage};
use super::state::{Bus, Host, Mishap, Traffic};
use super::transfer::{Completion, Transfer, TransferError, TransferId};

impl Host {
    /// Puts the cable in.
    pub fn plug(&mut self, now_ns: u64) {
        if self.bus == Bus::Unplugged {
            self.go_quiet(Bus::Silent, now_ns);
        }
    }

    /// Pulls the cable: the device sees silence, the host no device.
    pub fn unplug(&mut self, now_ns: u64) {
        if self.bus != Bus::Unplugged {
            self.go_quiet(Bus::Unplugged, now_ns);
            self.fail_all(now_ns, TransferError::Gone);
            self.sees_device = false;
        }
    }

    /// True while the host sees a device's pull-up.
    pub fn sees_device(&self) -> bool {
        self.sees_device
    }

    /// True while frames are sent.
    pub fn is_running(&self) -> bool {
        self.bus == Bus::Running
    }

    /// Drives a reset for `nanos`; frames are sent afterwards, to address 0, and data toggles begin anew.
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

    /// Sends nothing more, so that the device is suspended 3 ms later. Transfers that wait go on after a resume.
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

    /// Sets the address of the tokens from now on.
    pub fn set_address(&mut self, address: u8) {
        self.address = address;
    }

    /// Breaks each packet from now on with a probability of `per_million` in a million.
    pub fn break_packets(&mut self, per_million: u64, seed: u64) {
        self.chance = Chance {
            state: seed,
            per_million,
        };
    }

    /// Schedules `mishap` for the time when `transactions` more transactions have begun. With an even number the last
    /// one is lost, with an odd one it is carried out.
    pub fn have(&mut self, mishap: Mishap, transactions: u64) {
        self.mishap = Some((self.traffic.transactions + transactions, mishap));
    }

    /// True once the mishap has happened.
    pub fn has_happened(&self) -> bool {
        self.mishap.is_none()
    }

    /// Puts `transfer` behind those that wait for the same pipe.
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
        self.refused_at = None;
        id
    }

    /// Cancels a transfer; a transaction under way still ends on the wire, without a report.
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

    /// Resets the toggle of a bulk endpoint in one direction, as after the end of its halt.
    pub fn reset_toggle(&mut self, address: u8) {
        let number = address & 0x0F;
        let pipe = if address & 0x80 == 0 {
            Pipe::Out(number)
        } else {
            Pipe::In(number)
        };
        self.toggles.remove(&pipe);
    }

    /// Takes the transfers that have ended since the last call, in the order of their ends.
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
