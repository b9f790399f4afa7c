//! The bus in time: resets, silence, frames, and the transactions of each frame.

use super::pending::{Packets, Pending, Pipe};
use super::state::{Bus, Host, Mishap, RESET_NS};
use super::timing::{FRAME_NS, GUARD_NS, TOKEN_BITS, longest_nanos, nanos, refusal_nanos};
use super::transfer::TransferError;
use crate::model::usb::core::Core;
use crate::model::usb::packets::{Handshake, InAnswer};

/// Silence after which a device is suspended (section 7.1.7.6).
const SUSPEND_NS: u64 = 3_000_000;

impl Host {
    /// Does what is due at `now_ns`, after any change of the core since the last call; returns the latest instant of
    /// the next call.
    pub fn advance(&mut self, now_ns: u64, core: &mut Core) -> Option<u64> {
        let is_pulled_up = core.is_connected();
        if is_pulled_up && !self.is_pulled_up {
            self.quiet_from_ns = now_ns;
            self.quiet_told = false;
        }
        self.is_pulled_up = is_pulled_up;
        let sees_device = self.bus != Bus::Unplugged && is_pulled_up;
        if self.sees_device && !sees_device {
            self.go_quiet(Bus::Silent, now_ns);
            self.fail_all(now_ns, TransferError::Gone);
        }
        self.sees_device = sees_device;
        match self.bus {
            Bus::Unplugged | Bus::Silent => self.quiet(now_ns, core),
            Bus::Reset { until_ns, begun } => {
                if !begun {
                    core.bus_reset_begins();
                    self.bus = Bus::Reset {
                        until_ns,
                        begun: true,
                    };
                }
                if now_ns < until_ns {
                    return Some(until_ns);
                }
                core.bus_reset_ends();
                self.run(now_ns, core)
            }
            Bus::Resume { until_ns } => {
                core.resume();
                if now_ns < until_ns {
                    return Some(until_ns);
                }
                self.run(now_ns, core)
            }
            Bus::Running => self.frame(now_ns, core),
        }
    }

    /// Suspends the core after the silence. The core notices it while its pull-up is on, even without a cable.
    fn quiet(&mut self, now_ns: u64, core: &mut Core) -> Option<u64> {
        let due_ns = self.quiet_from_ns + SUSPEND_NS;
        if !self.is_pulled_up || self.quiet_told {
            None
        } else if now_ns < due_ns {
            Some(due_ns)
        } else {
            self.quiet_told = true;
            core.suspend();
            None
        }
    }

    fn run(&mut self, now_ns: u64, core: &mut Core) -> Option<u64> {
        self.bus = Bus::Running;
        self.frames_from_ns = now_ns;
        self.free_from_ns = now_ns;
        self.refused_at = None;
        self.frame(now_ns, core)
    }

    fn frame(&mut self, now_ns: u64, core: &mut Core) -> Option<u64> {
        core.start_of_frame(((now_ns - self.frames_from_ns) / FRAME_NS) as u32);
        if let Some(transaction) = self.under_way.take() {
            if now_ns < transaction.ends_ns {
                let ends_ns = transaction.ends_ns;
                self.under_way = Some(transaction);
                return Some(ends_ns);
            }
            if let Some((number, mishap)) = self.mishap
                && self.traffic.transactions >= number
            {
                self.mishap = None;
                if number % 2 == 1 {
                    self.end(transaction, core);
                }
                match mishap {
                    Mishap::Unplug => self.unplug(now_ns),
                    Mishap::Reset => self.reset_bus(now_ns, RESET_NS),
                }
                return Some(now_ns);
            }
            self.end(transaction, core);
        }
        if now_ns < self.free_from_ns {
            return Some(self.free_from_ns);
        }
        self.queue.retain(|_, waiting| !waiting.is_empty());
        if self.queue.is_empty() || self.refused_at == Some(core.changes()) {
            return None;
        }
        if self
            .queue
            .values()
            .all(|waiting| refused(&waiting[0], core))
        {
            self.refused_at = Some(core.changes());
            return None;
        }
        if self.refused_at.take().is_some() {
            // Until now the device was asked again and again.
            let round: u64 = (self.queue.values())
                .map(|waiting| refusal_nanos(&waiting[0].packets()))
                .sum();
            let rounds = (now_ns - self.free_from_ns).div_ceil(round);
            self.free_from_ns += rounds * round;
            if now_ns < self.free_from_ns {
                return Some(self.free_from_ns);
            }
        }
        let pipe = self.next_pipe()?;
        let packets = self.queue[&pipe][0].packets();
        let frame_ns = (now_ns - self.frames_from_ns) % FRAME_NS;
        let sof_ns = nanos(TOKEN_BITS);
        if frame_ns < sof_ns {
            self.free_from_ns = now_ns - frame_ns + sof_ns;
            return Some(self.free_from_ns);
        }
        if frame_ns + longest_nanos(&packets) + GUARD_NS > FRAME_NS {
            self.free_from_ns = now_ns - frame_ns + FRAME_NS + sof_ns;
            return Some(self.free_from_ns);
        }
        self.turn = Some(pipe);
        let transaction = self.begin(now_ns, pipe, packets, core);
        self.free_from_ns = transaction.ends_ns;
        self.under_way = Some(transaction);
        Some(self.free_from_ns)
    }

    /// The pipe after the one that had its turn.
    fn next_pipe(&self) -> Option<Pipe> {
        let after = self.queue.keys().find(|pipe| Some(**pipe) > self.turn);
        after.or_else(|| self.queue.keys().next()).copied()
    }
}

/// True if the core would refuse the transfer's next transaction without any other effect.
fn refused(pending: &Pending, core: &Core) -> bool {
    match pending.packets() {
        Packets::Setup(_) => false,
        Packets::Out { endpoint: 0, .. } | Packets::In { endpoint: 0 } if core.in_setup_stage() => {
            false
        }
        Packets::Out { endpoint, data } => {
            core.answer_out(endpoint, data.len()) == Some(Handshake::Nak)
        }
        Packets::In { endpoint } => core.answer_in(endpoint) == Some(InAnswer::Nak),
    }
}
