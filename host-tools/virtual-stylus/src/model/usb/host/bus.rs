//! The bus in time: resets, silence, frames, and the packets and the outcome of each transaction.

use std::collections::VecDeque;

use super::state::{Bus, Host, Mishap, RESET_NS, Sent, Transaction};
use super::transfer::{Completion, PACKET_BYTES, Packets, Pending, Pipe, Stage, TransferError};
use crate::model::usb::core::Core;
use crate::model::usb::{Handshake, InAnswer, Pid};

/// A bit's time in thousandths of a nanosecond.
const PICOS_PER_BIT: u64 = 83_333;
const FRAME_NS: u64 = 1_000_000;
/// Bits of a token, of a handshake, and of a data packet without its data: sync, identifiers, CRC and end of packet.
const TOKEN_BITS: u64 = 35;
const HANDSHAKE_BITS: u64 = 19;
const DATA_BITS: u64 = 35;
/// Longest time until an answer begins, and time after which an answer counts as missing, bits (sections 7.1.18 and
/// 7.1.19).
const TURNAROUND_BITS: u64 = 8;
const TIMEOUT_BITS: u64 = 18;
/// Time that no transaction uses at the end of a frame.
const GUARD_NS: u64 = 3_500;

fn nanos(bits: u64) -> u64 {
    bits * PICOS_PER_BIT / 1000
}

fn data_nanos(bytes: usize) -> u64 {
    // A zero is stuffed after six ones (section 7.1.9), so at worst data take 7/6 of their bits.
    nanos(DATA_BITS + (bytes as u64 * 8 * 7).div_ceil(6))
}

/// Duration of a transaction that the device refuses.
fn refusal_nanos(packets: &Packets) -> u64 {
    let data_ns = match packets {
        Packets::Setup(_) => data_nanos(8),
        Packets::Out { data, .. } => data_nanos(data.len()),
        Packets::In { .. } => 0,
    };
    data_ns + nanos(TOKEN_BITS + 2 * TURNAROUND_BITS + HANDSHAKE_BITS)
}

/// Longest duration of a transaction.
fn longest_nanos(packets: &Packets) -> u64 {
    refusal_nanos(packets)
        + match packets {
            Packets::In { .. } => data_nanos(PACKET_BYTES) + nanos(TURNAROUND_BITS),
            _ => 0,
        }
}

/// Silence after which a device is suspended (section 7.1.7.6).
const SUSPEND_NS: u64 = 3_000_000;

impl Host {
    /// Does what is due at `now_ns`, after any change of the core since the last call. Returns the instant by which the
    /// next call must come; `None` if nothing is due until the core or the software does something.
    pub fn advance(&mut self, now_ns: u64, core: &mut Core) -> Option<u64> {
        let is_pulled_up = core.is_connected();
        // The device counts silence from its own pull-up on, with or without a cable.
        if is_pulled_up && !self.is_pulled_up {
            self.quiet_from_ns = now_ns;
            self.quiet_told = false;
        }
        self.is_pulled_up = is_pulled_up;
        let sees_device = self.bus != Bus::Unplugged && is_pulled_up;
        // To the host, a pull-up that ends is a device that is gone.
        if self.sees_device && !sees_device {
            self.go_quiet(Bus::Silent, now_ns);
            self.fail_all(now_ns, TransferError::Gone);
        }
        self.sees_device = sees_device;
        match self.bus {
            Bus::Unplugged | Bus::Silent => self.quiet(now_ns, core),
            Bus::Reset { until_ns, begun } => {
                // The software's call has no access to the core, so the core learns of the reset here.
                if !begun {
                    core.bus_reset_begins();
                    self.bus = Bus::Reset { until_ns, begun: true };
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

    /// Suspends the core after 3 ms of silence. The core notices the silence while its pull-up is on, even without a
    /// cable.
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
        if let Some(again_ns) = self.end_due(now_ns, core) {
            return Some(again_ns);
        }
        if now_ns < self.free_from_ns {
            return Some(self.free_from_ns);
        }
        self.queue.retain(|_, waiting| !waiting.is_empty());
        // Nothing has changed since the core refused everything, so it would refuse again.
        if self.queue.is_empty() || self.refused_at == Some(core.changes()) {
            return None;
        }
        if self.queue.values().all(|waiting| refused(&waiting[0], core)) {
            self.refused_at = Some(core.changes());
            return None;
        }
        if self.refused_at.take().is_some() {
            // Until now the host would have asked the device again and again.
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
        // A frame begins with its own token.
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

    /// Ends the present transaction when its time has come, or lets the scheduled mishap happen. Returns the instant of
    /// the next call if the bus is not free.
    fn end_due(&mut self, now_ns: u64, core: &mut Core) -> Option<u64> {
        let transaction = self.under_way.take()?;
        if now_ns < transaction.ends_ns {
            let ends_ns = transaction.ends_ns;
            self.under_way = Some(transaction);
            return Some(ends_ns);
        }
        let traffic = self.traffic.transactions;
        // An odd number lets the transaction end first, so that mishaps before and after its effect both occur.
        let Some((number, mishap)) = self.mishap.take_if(|(number, _)| traffic >= *number) else {
            self.end(transaction, core);
            return None;
        };
        if number % 2 == 1 {
            self.end(transaction, core);
        }
        match mishap {
            Mishap::Unplug => self.unplug(now_ns),
            Mishap::Reset => self.reset_bus(now_ns, RESET_NS),
        }
        Some(now_ns)
    }

    /// The pipe whose turn comes next.
    fn next_pipe(&self) -> Option<Pipe> {
        self.queue
            .keys()
            .find(|pipe| Some(**pipe) > self.turn)
            .or_else(|| self.queue.keys().next())
            .copied()
    }
}

/// Returns true if the core would refuse the transfer's next transaction without any other effect.
fn refused(pending: &Pending, core: &Core) -> bool {
    match pending.packets() {
        Packets::Setup(_) => false,
        Packets::Out { endpoint: 0, .. } | Packets::In { endpoint: 0 } if core.in_setup_stage() => false,
        Packets::Out { endpoint, data } => core.answer_out(endpoint, data.len()) == Some(Handshake::Nak),
        Packets::In { endpoint } => core.answer_in(endpoint) == Some(InAnswer::Nak),
    }
}

/// Tolerance of a full-speed device's clock (USB 2.0, section 7.1.11).
const CLOCK_TOLERANCE_PPM: i64 = 2_500;
/// Number of attempts at a transaction that fails.
const TRIES: u32 = 3;

impl Host {
    /// Sets the deviation of the device's clock, parts per million. Beyond the tolerance neither host nor device
    /// understands the other.
    pub fn set_clock_deviation(&mut self, ppm: i64) {
        self.clock_is_off = ppm.abs() > CLOCK_TOLERANCE_PPM;
    }

    /// Begins the next transaction of `pipe`.
    fn begin(&mut self, now_ns: u64, pipe: Pipe, packets: Packets, core: &mut Core) -> Transaction {
        let is_there = self.address == core.address();
        // A SETUP is always DATA0, and a status stage DATA1 (section 8.5.3).
        let pid = match (&packets, self.queue[&pipe][0].stage) {
            (Packets::Setup(_), _) => Pid::Data0,
            (_, Stage::Status) => Pid::Data1,
            _ => self.toggles.get(&pipe).copied().unwrap_or(Pid::Data0),
        };
        let arrives = is_there && !self.clock_is_off && !self.breaks();
        let (sent, took_ns) = match &packets {
            Packets::In { endpoint } => {
                let answer = if arrives { core.token_in(*endpoint) } else { None };
                match answer {
                    None => (Sent::Unheard, nanos(TOKEN_BITS + TIMEOUT_BITS)),
                    Some(answer) => {
                        let answer_ns = match &answer {
                            InAnswer::Data(_, data) => data_nanos(data.len()) + nanos(TURNAROUND_BITS + HANDSHAKE_BITS),
                            _ => nanos(HANDSHAKE_BITS),
                        };
                        let sent = Sent::Answered {
                            answer,
                            arrives: !self.breaks(),
                            is_acknowledged: !self.breaks(),
                        };
                        (sent, nanos(TOKEN_BITS + 2 * TURNAROUND_BITS) + answer_ns)
                    }
                }
            }
            Packets::Setup(_) | Packets::Out { .. } => {
                let bytes = match &packets {
                    Packets::Out { data, .. } => data.len(),
                    _ => 8,
                };
                let spent = nanos(TOKEN_BITS) + data_nanos(bytes);
                if arrives && !self.breaks() {
                    let is_answered = !self.breaks();
                    let answer_ns = nanos(2 * TURNAROUND_BITS + HANDSHAKE_BITS);
                    (Sent::Heard { is_answered }, spent + answer_ns)
                } else {
                    (Sent::Unheard, spent + nanos(TIMEOUT_BITS))
                }
            }
        };
        Transaction {
            pipe,
            id: self.queue[&pipe][0].id,
            packets,
            pid,
            ends_ns: now_ns + took_ns,
            sent,
        }
    }

    /// Ends the transaction, and its transfer if the transaction was the last.
    fn end(&mut self, transaction: Transaction, core: &mut Core) {
        self.traffic.transactions += 1;
        let (pipe, id, pid, at_ns) = (transaction.pipe, transaction.id, transaction.pid, transaction.ends_ns);
        let outcome = Outcome::of(transaction, core);
        self.count(&outcome);
        let Some(pending) = self.queue.get_mut(&pipe).and_then(VecDeque::front_mut) else {
            return;
        };
        if pending.id != id {
            // The transfer was cancelled meanwhile.
            return;
        }
        if let Outcome::SetUp | Outcome::Took(_) | Outcome::Got(_) = outcome {
            self.toggles.insert(pipe, pid.next());
        }
        if let Some(result) = outcome.ends(pending) {
            self.queue.entry(pipe).or_default().pop_front();
            self.completions.push(Completion { id, at_ns, result });
        }
    }

    fn count(&mut self, outcome: &Outcome) {
        match outcome {
            Outcome::Refused => self.traffic.naks += 1,
            Outcome::Broken => self.traffic.broken += 1,
            Outcome::Repeated => self.traffic.repeated += 1,
            _ => {}
        }
    }
}

/// Outcome of a transaction, as the host knows it.
enum Outcome {
    SetUp,
    Took(usize),
    Got(Vec<u8>),
    Repeated,
    Refused,
    Broken,
    Failed(TransferError),
}

impl Outcome {
    /// Makes the core do its part of the transaction, at the transaction's end.
    fn of(transaction: Transaction, core: &mut Core) -> Self {
        let pid = transaction.pid;
        match (&transaction.packets, transaction.sent) {
            (Packets::Setup(data), Sent::Heard { is_answered }) => match core.setup(*data) {
                Some(Handshake::Ack) if is_answered => Self::SetUp,
                _ => Self::Broken,
            },
            (Packets::Out { endpoint, data }, Sent::Heard { is_answered }) => match core.out(*endpoint, pid, data) {
                None => Self::Broken,
                Some(_) if !is_answered => Self::Broken,
                Some(Handshake::Ack) => Self::Took(data.len()),
                Some(Handshake::Nak) => Self::Refused,
                Some(Handshake::Stall) => Self::Failed(TransferError::Stall),
            },
            (
                Packets::In { endpoint },
                Sent::Answered {
                    answer,
                    arrives: true,
                    is_acknowledged,
                },
            ) => match answer {
                InAnswer::Nak => Self::Refused,
                InAnswer::Stall => Self::Failed(TransferError::Stall),
                InAnswer::Data(found, data) => {
                    if is_acknowledged {
                        core.acknowledged(*endpoint);
                    }
                    // The same packet comes again if the device has missed the host's last handshake.
                    if found == pid { Self::Got(data) } else { Self::Repeated }
                }
            },
            _ => Self::Broken,
        }
    }

    /// Applies the outcome to the transfer. Returns the transfer's result if the transfer is over.
    fn ends(self, pending: &mut Pending) -> Option<Result<Vec<u8>, TransferError>> {
        let is_over = match self {
            Self::Broken => {
                pending.failures += 1;
                let is_last = pending.failures == TRIES;
                return is_last.then_some(Err(TransferError::NotAnswered));
            }
            Self::Failed(error) => return Some(Err(error)),
            Self::SetUp => {
                pending.set_up();
                Ok(false)
            }
            Self::Took(bytes) => Ok(pending.took(bytes)),
            Self::Got(data) => pending.got(&data),
            Self::Repeated | Self::Refused => Ok(false),
        };
        pending.failures = 0;
        match is_over {
            Ok(false) => None,
            Ok(true) => Some(Ok(std::mem::take(&mut pending.received))),
            Err(error) => Some(Err(error)),
        }
    }
}
