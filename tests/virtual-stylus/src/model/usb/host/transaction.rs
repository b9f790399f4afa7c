//! One transaction: its packets on the wire, and its outcome.

use std::collections::VecDeque;

use super::pending::{Packets, Pipe, Stage};
use super::state::{Host, Sent, Transaction};
use super::timing::{HANDSHAKE_BITS, TIMEOUT_BITS, TOKEN_BITS, TURNAROUND_BITS, data_nanos, nanos};
use super::transfer::{Completion, TransferError};
use crate::model::usb::core::Core;
use crate::model::usb::packets::{Handshake, InAnswer, Pid};

/// Tolerance of a full-speed device's clock (USB 2.0, section 7.1.11).
const CLOCK_TOLERANCE_PPM: i64 = 2_500;
/// Tries of a transaction that fails.
const TRIES: u32 = 3;

impl Host {
    /// Sets the deviation of the device's clock, parts per million. Beyond the tolerance neither side understands the
    /// other.
    pub fn set_clock_deviation(&mut self, ppm: i64) {
        self.clock_is_off = ppm.abs() > CLOCK_TOLERANCE_PPM;
    }

    /// Begins the next transaction of `pipe`.
    pub(super) fn begin(
        &mut self,
        now_ns: u64,
        pipe: Pipe,
        packets: Packets,
        core: &mut Core,
    ) -> Transaction {
        let is_there = self.address == core.address();
        let pid = match (&packets, self.queue[&pipe][0].stage) {
            (Packets::Setup(_), _) => Pid::Data0,
            (_, Stage::Status) => Pid::Data1,
            _ => self.toggles.get(&pipe).copied().unwrap_or(Pid::Data0),
        };
        let arrives = is_there && !self.clock_is_off && !self.chance.breaks();
        let (sent, took_ns) = match &packets {
            Packets::In { endpoint } => {
                let answer = if arrives {
                    core.token_in(*endpoint)
                } else {
                    None
                };
                match answer {
                    None => (Sent::Unheard, nanos(TOKEN_BITS + TIMEOUT_BITS)),
                    Some(answer) => {
                        let answer_ns = match &answer {
                            InAnswer::Data(_, data) => {
                                data_nanos(data.len()) + nanos(TURNAROUND_BITS + HANDSHAKE_BITS)
                            }
                            _ => nanos(HANDSHAKE_BITS),
                        };
                        let sent = Sent::Answered {
                            answer,
                            arrives: !self.chance.breaks(),
                            is_acknowledged: !self.chance.breaks(),
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
                if arrives && !self.chance.breaks() {
                    let is_answered = !self.chance.breaks();
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
    pub(super) fn end(&mut self, transaction: Transaction, core: &mut Core) {
        self.traffic.transactions += 1;
        let Transaction {
            pipe,
            id,
            packets,
            pid,
            ends_ns,
            sent,
        } = transaction;
        let outcome = match (&packets, sent) {
            (Packets::Setup(data), Sent::Heard { is_answered }) => match core.setup(*data) {
                Some(Handshake::Ack) if is_answered => Outcome::SetUp,
                _ => Outcome::Broken,
            },
            (Packets::Out { endpoint, data }, Sent::Heard { is_answered }) => {
                match core.out(*endpoint, pid, data) {
                    None => Outcome::Broken,
                    Some(_) if !is_answered => Outcome::Broken,
                    Some(Handshake::Ack) => Outcome::Took(data.len()),
                    Some(Handshake::Nak) => Outcome::Refused,
                    Some(Handshake::Stall) => Outcome::Failed(TransferError::Stall),
                }
            }
            (
                Packets::In { endpoint },
                Sent::Answered {
                    answer,
                    arrives: true,
                    is_acknowledged,
                },
            ) => match answer {
                InAnswer::Nak => Outcome::Refused,
                InAnswer::Stall => Outcome::Failed(TransferError::Stall),
                InAnswer::Data(found, data) => {
                    if is_acknowledged {
                        core.acknowledged(*endpoint);
                    }
                    if found == pid {
                        Outcome::Got(data)
                    } else {
                        Outcome::Repeated
                    }
                }
            },
            _ => Outcome::Broken,
        };
        self.count(&outcome);
        let Some(pending) = self.queue.get_mut(&pipe).and_then(VecDeque::front_mut) else {
            return;
        };
        if pending.id != id {
            // The transfer was cancelled meanwhile.
            return;
        }
        let is_over = match outcome {
            Outcome::Broken => {
                pending.failures += 1;
                (pending.failures == TRIES).then_some(Err(TransferError::NotAnswered))
            }
            Outcome::Failed(error) => Some(Err(error)),
            outcome => {
                pending.failures = 0;
                let step = match outcome {
                    Outcome::SetUp => {
                        pending.set_up();
                        self.toggles.insert(pipe, Pid::Data1);
                        Ok(false)
                    }
                    Outcome::Took(bytes) => {
                        self.toggles.insert(pipe, pid.next());
                        Ok(pending.took(bytes))
                    }
                    Outcome::Got(data) => {
                        self.toggles.insert(pipe, pid.next());
                        pending.got(&data)
                    }
                    _ => Ok(false),
                };
                match step {
                    Ok(false) => None,
                    Ok(true) => Some(Ok(std::mem::take(&mut pending.received))),
                    Err(error) => Some(Err(error)),
                }
            }
        };
        if let Some(result) = is_over {
            self.queue.entry(pipe).or_default().pop_front();
            self.completions.push(Completion {
                id,
                at_ns: ends_ns,
                result,
            });
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
