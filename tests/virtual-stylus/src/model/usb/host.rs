//! The host at the other end of the cable: its root port and its controller, in virtual time.
//!
//! | What | USB 2.0 |
//! |---|---|
//! | 12 Mbit/s, frames of 1 ms begun by a start of frame; no transaction runs over a frame's end | 7.1.11, 8.4.3, 11.3 |
//! | A transaction takes its packets' bits (data with the worst bit stuffing, 7/6) and the longest turnaround between them | 5.11.3, 7.1.9, 7.1.18 |
//! | Control, bulk IN and bulk OUT, one transfer of a pipe at a time, pipes in turn | 5.5, 5.8, 8.5 |
//! | Data toggles at both ends; a packet that comes twice is acknowledged and dropped | 8.6 |
//! | NAK: tried again for ever; STALL: the transfer ends | 8.4.5 |
//! | No answer or a broken one: three tries, then the transfer ends | 10.2.6 |
//! | Reset, suspend by silence, resume; a cable that is pulled | 7.1.7 |
//!
//! Packets are broken by chance, at a rate and from a seed: a token or data that breaks on its way to the device is not
//! answered, and a broken handshake leaves each side with its own idea of what happened.
//!
//! While all that is due would be refused again, no token is sent and none is counted: the firmware cannot tell, and the
//! next one comes at the instant at which it would have come. Left out: low and high speed, hubs, isochronous and interrupt
//! transfers, and a host's own software, which is `usb_host.rs`.

use std::collections::{BTreeMap, VecDeque};

use super::core::{Core, Handshake, InAnswer, Pid};

/// A bit's time in thousandths of a nanosecond.
const PICOS_PER_BIT: u64 = 83_333;
const FRAME_NS: u64 = 1_000_000;
/// Bits of a token, of a handshake, and of a data packet beside its data: sync, identifiers, CRC and end of packet.
const TOKEN_BITS: u64 = 35;
const HANDSHAKE_BITS: u64 = 19;
const DATA_BITS: u64 = 35;
/// Longest time to an answer, and the wait for one that does not come (section 7.1.19).
const TURNAROUND_BITS: u64 = 8;
const TIMEOUT_BITS: u64 = 18;
/// What is left free at the end of a frame.
const GUARD_NS: u64 = 3_500;
/// Tries of a transaction that fails.
const TRIES: u32 = 3;
/// Silence after which a device is suspended (section 7.1.7.6).
const SUSPEND_NS: u64 = 3_000_000;
/// Longest packet of a bulk or control endpoint at full speed (sections 5.5.3 and 5.8.3).
pub const PACKET_BYTES: usize = 64;

fn nanos(bits: u64) -> u64 {
    bits * PICOS_PER_BIT / 1000
}

fn data_nanos(bytes: usize) -> u64 {
    nanos(DATA_BITS + (bytes as u64 * 8 * 7).div_ceil(6))
}

/// Number of a transfer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct TransferId(u64);

/// What a transfer is asked to do.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Transfer {
    /// A control transfer to endpoint 0.
    Control {
        /// The eight bytes of the SETUP packet.
        setup: [u8; 8],
        /// The data stage's data, when it goes to the device.
        data: Vec<u8>,
    },
    /// Data to a bulk endpoint, in packets of [`PACKET_BYTES`]; no data is an empty packet.
    Out {
        /// The endpoint's number.
        endpoint: u8,
        /// All of it.
        data: Vec<u8>,
    },
    /// Data from a bulk endpoint, until a packet is not full or all of `bytes` is there.
    In {
        /// The endpoint's number.
        endpoint: u8,
        /// How much.
        bytes: usize,
    },
}

/// Why a transfer failed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum TransferError {
    /// The device answered STALL.
    #[error("the device stalled it")]
    Stall,
    /// Three tries of a transaction were not answered, or broken.
    #[error("it was not answered, three times")]
    NotAnswered,
    /// The device sent more than was asked for.
    #[error("the device sent more than was asked for")]
    Babble,
    /// It was called off.
    #[error("it was called off")]
    Cancelled,
    /// There is no device.
    #[error("there is no device")]
    Gone,
}

/// How a transfer ended.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Completion {
    /// Which.
    pub id: TransferId,
    /// When, in nanoseconds of virtual time.
    pub at_ns: u64,
    /// What came from the device, if the transfer went well.
    pub result: Result<Vec<u8>, TransferError>,
}

/// What the bus carried.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Traffic {
    /// Transactions that were carried out.
    pub transactions: u64,
    /// Those that the device refused for now.
    pub naks: u64,
    /// Those that were broken or not answered.
    pub broken: u64,
    /// Packets that came twice and were dropped by the host.
    pub repeated: u64,
}

/// What may happen in the middle of anything.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mishap {
    /// The cable is pulled.
    Unplug,
    /// The host resets the bus for 10 ms.
    Reset,
}

/// A reset of the bus by a root port (section 7.1.7.5).
pub const RESET_NS: u64 = 10_000_000;

/// What is driven on the bus.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Bus {
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

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Pipe {
    Control,
    In(u8),
    Out(u8),
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Stage {
    Setup,
    Data,
    Status,
}

#[derive(Clone, Debug)]
struct Pending {
    id: TransferId,
    transfer: Transfer,
    stage: Stage,
    /// Bytes of the data that the device has acknowledged.
    sent: usize,
    received: Vec<u8>,
    failures: u32,
}

/// The next transaction of a transfer.
#[derive(Clone, Debug)]
enum Packets {
    Setup([u8; 8]),
    Out { endpoint: usize, data: Vec<u8> },
    In { endpoint: usize },
}

impl Pending {
    fn packets(&self) -> Packets {
        let rest = |data: &[u8]| {
            let to = data.len().min(self.sent + PACKET_BYTES);
            data[self.sent.min(to)..to].to_vec()
        };
        match (&self.transfer, self.stage) {
            (Transfer::Control { setup, .. }, Stage::Setup) => Packets::Setup(*setup),
            (Transfer::Control { data, .. }, Stage::Data) if !self.is_read() => Packets::Out {
                endpoint: 0,
                data: rest(data),
            },
            // The status goes the other way than the data (section 8.5.3).
            (Transfer::Control { .. }, Stage::Status) if self.is_read() && self.asked() > 0 => {
                Packets::Out {
                    endpoint: 0,
                    data: Vec::new(),
                }
            }
            (Transfer::Control { .. }, _) => Packets::In { endpoint: 0 },
            (Transfer::Out { endpoint, data }, _) => Packets::Out {
                endpoint: usize::from(*endpoint),
                data: rest(data),
            },
            (Transfer::In { endpoint, .. }, _) => Packets::In {
                endpoint: usize::from(*endpoint),
            },
        }
    }

    fn is_read(&self) -> bool {
        matches!(&self.transfer, Transfer::Control { setup, .. } if setup[0] & 0x80 != 0)
    }

    /// Bytes that are wanted from the device.
    fn asked(&self) -> usize {
        match &self.transfer {
            Transfer::Control { setup, .. } => {
                usize::from(u16::from_le_bytes([setup[6], setup[7]]))
            }
            Transfer::In { bytes, .. } => *bytes,
            Transfer::Out { .. } => 0,
        }
    }

    /// After `bytes` of data were acknowledged by the device; whether the transfer is over.
    fn took(&mut self, bytes: usize) -> bool {
        self.sent += bytes;
        match (&self.transfer, self.stage) {
            (Transfer::Control { data, .. }, Stage::Data) => {
                if self.sent >= data.len() {
                    self.stage = Stage::Status;
                }
                false
            }
            (Transfer::Control { .. }, _) => true,
            (Transfer::Out { data, .. }, _) => self.sent >= data.len(),
            (Transfer::In { .. }, _) => false,
        }
    }

    /// After `data` came from the device; whether the transfer is over.
    fn got(&mut self, data: &[u8]) -> Result<bool, TransferError> {
        let is_control = matches!(self.transfer, Transfer::Control { .. });
        if is_control && self.stage == Stage::Status {
            return if data.is_empty() {
                Ok(true)
            } else {
                Err(TransferError::Babble)
            };
        }
        self.received.extend(data);
        if self.received.len() > self.asked() {
            return Err(TransferError::Babble);
        }
        let is_last = data.len() < PACKET_BYTES || self.received.len() == self.asked();
        if is_control && is_last {
            self.stage = Stage::Status;
        }
        Ok(is_last && !is_control)
    }

    /// After the device took the SETUP packet.
    fn set_up(&mut self) {
        let data = match &self.transfer {
            Transfer::Control { data, .. } => data.len(),
            _ => 0,
        };
        let has_data = if self.is_read() {
            self.asked() > 0
        } else {
            data > 0
        };
        self.stage = if has_data { Stage::Data } else { Stage::Status };
    }
}

/// A transaction under way.
#[derive(Clone, Debug)]
struct Transaction {
    pipe: Pipe,
    id: TransferId,
    packets: Packets,
    pid: Pid,
    ends_ns: u64,
    sent: Sent,
}

/// What becomes of its packets on the wire.
#[derive(Clone, Debug)]
enum Sent {
    /// The device does not hear it, or not whole.
    Unheard,
    /// The device hears all, and `is_answered` tells whether its handshake arrives.
    Heard { is_answered: bool },
    /// What the device answered an IN token with, whether it arrives, and whether the host's handshake does.
    Answered {
        answer: InAnswer,
        arrives: bool,
        is_acknowledged: bool,
    },
}

/// Chance from a seed (splitmix64).
#[derive(Clone, Copy, Debug)]
struct Chance {
    state: u64,
    per_million: u64,
}

impl Chance {
    fn breaks(&mut self) -> bool {
        if self.per_million == 0 {
            return false;
        }
        self.state = self.state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut mixed = self.state;
        mixed = (mixed ^ mixed >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        mixed = (mixed ^ mixed >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
        (mixed ^ mixed >> 31) % 1_000_000 < self.per_million
    }
}

/// The host.
#[derive(Debug)]
pub struct Host {
    bus: Bus,
    /// Since when nothing is sent, and whether the device has been suspended by it.
    quiet_from_ns: u64,
    quiet_told: bool,
    is_pulled_up: bool,
    sees_device: bool,
    frames_from_ns: u64,
    free_from_ns: u64,
    address: u8,
    queue: BTreeMap<Pipe, VecDeque<Pending>>,
    turn: Option<Pipe>,
    toggles: BTreeMap<Pipe, Pid>,
    under_way: Option<Transaction>,
    /// Everything due was refused, and nothing of the core has changed since this many changes.
    refused_at: Option<u64>,
    chance: Chance,
    mishap: Option<(u64, Mishap)>,
    next_id: u64,
    completions: Vec<Completion>,
    traffic: Traffic,
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
        }
    }
}

// What the host's software does.
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

    /// Whether the host sees a device's pull-up.
    pub fn sees_device(&self) -> bool {
        self.sees_device
    }

    /// Whether frames are sent.
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

    /// Sends nothing more; the device is suspended 3 ms later. What waits goes on after a resume.
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

    /// The address that tokens are sent to from now on.
    pub fn set_address(&mut self, address: u8) {
        self.address = address;
    }

    /// From now on each packet breaks with a chance of so many in a million.
    pub fn break_packets(&mut self, per_million: u64, seed: u64) {
        self.chance = Chance {
            state: seed,
            per_million,
        };
    }

    /// Has something happen once so many more transactions were begun; the last one is lost with an even number, and is
    /// carried out with an odd one.
    pub fn have(&mut self, mishap: Mishap, transactions: u64) {
        self.mishap = Some((self.traffic.transactions + transactions, mishap));
    }

    /// Whether what was to happen has happened.
    pub fn has_happened(&self) -> bool {
        self.mishap.is_none()
    }

    /// Puts `transfer` behind what waits for the same pipe.
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

    /// Calls a transfer off; a transaction under way still ends on the wire, and nobody hears of it.
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

    /// Begins the toggles of a bulk endpoint anew, one way, as after its halt was cleared.
    pub fn reset_toggle(&mut self, address: u8) {
        let number = address & 0x0F;
        let pipe = if address & 0x80 == 0 {
            Pipe::Out(number)
        } else {
            Pipe::In(number)
        };
        self.toggles.remove(&pipe);
    }

    /// The transfers that ended since this was asked last, in the order of their ends.
    pub fn take_completions(&mut self) -> Vec<Completion> {
        std::mem::take(&mut self.completions)
    }

    /// What the bus carried since the power came on.
    pub fn traffic(&self) -> Traffic {
        self.traffic
    }

    fn go_quiet(&mut self, bus: Bus, now_ns: u64) {
        self.bus = bus;
        self.quiet_from_ns = now_ns;
        self.quiet_told = false;
    }

    fn fail_all(&mut self, now_ns: u64, error: TransferError) {
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

// What happens on the bus.
impl Host {
    /// Does what is due at `now_ns`, the core's changes since the last call considered; when it wants to be called again at
    /// the latest.
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

    /// Without a pull-up nobody hears the silence; with one the core does, even when the cable is out.
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
            // All this while it was asked again and again.
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

    fn begin(&mut self, now_ns: u64, pipe: Pipe, packets: Packets, core: &mut Core) -> Transaction {
        let is_there = self.address == core.address();
        let pid = match (&packets, self.queue[&pipe][0].stage) {
            (Packets::Setup(_), _) => Pid::Data0,
            (_, Stage::Status) => Pid::Data1,
            _ => self.toggles.get(&pipe).copied().unwrap_or(Pid::Data0),
        };
        let arrives = is_there && !self.chance.breaks();
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

    fn end(&mut self, transaction: Transaction, core: &mut Core) {
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
            // It was called off meanwhile.
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

/// What a transaction came to, as the host knows it.
enum Outcome {
    SetUp,
    Took(usize),
    Got(Vec<u8>),
    Repeated,
    Refused,
    Broken,
    Failed(TransferError),
}

/// Whether the core would refuse the transfer's next transaction, and nothing else would happen.
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

/// How long a transaction takes that the device refuses.
fn refusal_nanos(packets: &Packets) -> u64 {
    let data_ns = match packets {
        Packets::Setup(_) => data_nanos(8),
        Packets::Out { data, .. } => data_nanos(data.len()),
        Packets::In { .. } => 0,
    };
    data_ns + nanos(TOKEN_BITS + 2 * TURNAROUND_BITS + HANDSHAKE_BITS)
}

/// How long a transaction takes at the longest.
fn longest_nanos(packets: &Packets) -> u64 {
    refusal_nanos(packets)
        + match packets {
            Packets::In { .. } => data_nanos(PACKET_BYTES) + nanos(TURNAROUND_BITS),
            _ => 0,
        }
}
