//! One recording of the device for several clients: it begins with the first and ends with the last.
//!
//! Each client gets the blocks as if the recording were its own: numbered from 0, with the losses since it joined.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use model_format::link::{RecordBlock, RecordStopped};

use super::message::ClientId;

/// Time after which the answer to a start counts as lost.
const START_IS_LOST: Duration = Duration::from_secs(1);

/// The recording of the device, as far as its clients have part in it.
#[derive(Debug, Default)]
pub(super) struct Recording {
    state: State,
    parts: BTreeMap<ClientId, Part>,
    /// Clients whose recording was stopped, to which blocks may still be on the way.
    ended: BTreeMap<ClientId, Part>,
}

#[derive(Debug, Default)]
enum State {
    /// No client records.
    #[default]
    Idle,
    /// A start was sent and is not answered.
    Starting(Instant),
    /// The device records; the body of its answer to the start.
    On(Vec<u8>),
}

/// The part of one client.
#[derive(Clone, Copy, Debug, Default)]
struct Part {
    /// Number and losses of the recording before this client's first block; none until it comes.
    begin: Option<(u32, u32)>,
    /// Number and losses after the last block.
    end: (u32, u32),
}

impl Part {
    /// The part of the client that has started the recording.
    const WHOLE: Self = Self {
        begin: Some((0, 0)),
        end: (0, 0),
    };

    fn block(&mut self, block: &RecordBlock) -> RecordBlock {
        let (first, lost) = *self
            .begin
            .get_or_insert((block.sequence, block.lost_blocks));
        self.end = (block.sequence.wrapping_add(1), block.lost_blocks);
        RecordBlock {
            sequence: block.sequence.wrapping_sub(first),
            lost_blocks: block.lost_blocks.wrapping_sub(lost),
            ..block.clone()
        }
    }

    /// This part of a recording that ends so.
    fn of(&self, whole: RecordStopped) -> RecordStopped {
        let (first, lost) = self.begin.unwrap_or((whole.blocks, whole.lost_blocks));
        RecordStopped {
            blocks: whole.blocks.saturating_sub(first),
            lost_blocks: whole.lost_blocks.saturating_sub(lost),
        }
    }
}

/// Answer to a client that wants to record.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Start {
    /// The request goes to the device.
    Ask,
    /// The request waits for the answer to another client's.
    Wait,
    /// The device records already; this is the answer's body.
    Joined(Vec<u8>),
    /// This client records already.
    Refused,
}

/// Answer to a client that wants to end a recording.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Stop {
    /// The request goes to the device, and ends the recordings of these other clients.
    Ask(Vec<ClientId>),
    /// The device goes on for others.
    Left(RecordStopped),
}

impl Recording {
    /// A client wants to record.
    pub(super) fn start(&mut self, client: ClientId) -> Start {
        if self.parts.contains_key(&client) {
            return Start::Refused;
        }
        match &self.state {
            State::On(answer) => {
                let answer = answer.clone();
                self.ended.remove(&client);
                self.parts.insert(client, Part::default());
                Start::Joined(answer)
            }
            State::Starting(since) if since.elapsed() < START_IS_LOST => Start::Wait,
            _ => {
                self.state = State::Starting(Instant::now());
                Start::Ask
            }
        }
    }

    /// The device has answered a start of `client`, with the body in `answer`, or has refused. `client` is none if it
    /// has left meanwhile; the others have waited. Returns true if nobody wants what has begun.
    pub(super) fn started(
        &mut self,
        client: Option<ClientId>,
        waiting: &[ClientId],
        answer: Option<&[u8]>,
    ) -> bool {
        let Some(answer) = answer else {
            self.state = State::Idle;
            return false;
        };
        // Blocks of the recording before do not come any more.
        self.ended.clear();
        for client in client.into_iter().chain(waiting.iter().copied()) {
            self.parts.insert(client, Part::WHOLE);
        }
        if self.parts.is_empty() {
            self.state = State::Idle;
            return true;
        }
        self.state = State::On(answer.to_vec());
        false
    }

    /// A client wants to end its recording, or any if it has none.
    pub(super) fn stop(&mut self, client: ClientId) -> Stop {
        if let Some(part) = self.parts.remove(&client) {
            if !self.parts.is_empty() {
                let (blocks, lost_blocks) = part.end;
                return Stop::Left(part.of(RecordStopped {
                    blocks,
                    lost_blocks,
                }));
            }
            self.ended.insert(client, part);
        }
        if matches!(self.state, State::On(_)) {
            self.state = State::Idle;
        }
        let parts = std::mem::take(&mut self.parts);
        let others = parts.keys().copied().collect();
        self.ended.extend(parts);
        Stop::Ask(others)
    }

    /// The part that a client had of a recording that has ended.
    pub(super) fn stopped(&self, client: ClientId, whole: RecordStopped) -> RecordStopped {
        self.ended.get(&client).map_or(whole, |part| part.of(whole))
    }

    /// The clients that a block goes to, each with the block as it sees it.
    pub(super) fn block(&mut self, block: &RecordBlock) -> Vec<(ClientId, RecordBlock)> {
        self.parts
            .iter_mut()
            .chain(&mut self.ended)
            .map(|(&client, part)| (client, part.block(block)))
            .collect()
    }

    /// A client has left. Returns true if nobody wants the recording any more.
    pub(super) fn left(&mut self, client: ClientId) -> bool {
        self.ended.remove(&client);
        let is_last = self.parts.remove(&client).is_some() && self.parts.is_empty();
        if is_last && matches!(self.state, State::On(_)) {
            self.state = State::Idle;
            return true;
        }
        false
    }
}
