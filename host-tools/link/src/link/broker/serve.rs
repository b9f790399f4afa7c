//! The process of a broker: its sockets, its queues, and its end.

use std::collections::BTreeMap;
use std::fs::{self, File, Permissions};
use std::io;
use std::os::unix::fs::PermissionsExt;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

use postcard_rpc::host_client::{WireRx, WireTx};
use tokio::io::AsyncWriteExt;
use tokio::net::{UnixListener, UnixStream};
use tokio::signal::unix::{SignalKind, signal};
use tokio::sync::mpsc::{self, UnboundedReceiver, UnboundedSender};
use tokio::sync::{OwnedSemaphorePermit, Semaphore};
use tokio::time::Instant;

use super::IDLE;
use super::message::{ClientId, FromBroker, Messages, Program, ToBroker};
use super::place::{Place, unusable};
use super::switchboard::{Action, Switchboard};
use crate::link::LinkAddress;
use crate::link::error::{LinkError, Result};
use crate::link::health::Health;
use crate::link::open::{self, Ends};
use crate::link::virtual_usb::encode;

/// Time that clients have to read the last messages of a broker that ends.
const LAST_MESSAGES: Duration = Duration::from_millis(200);

/// Largest number of frames of one client on their way to the device. Further frames wait in the client's socket. A
/// client that sends more than the link can carry therefore delays the stops and motions of others by no more than
/// these frames.
const CLIENT_FRAMES: usize = 2;

/// Number of messages waiting for a client from which on blocks of a recording are left out. They amount to more than a
/// second of blocks.
const MOST_WITH_BLOCKS: usize = 256;

/// Number of messages waiting for a client from which on the client counts as dead.
const MOST_MESSAGES: usize = 4096;

/// Reason for which a broker has ended without a failure.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Served {
    /// No client was left, the link has ended, or the system has asked the process to end.
    Ended,
    /// Another program has the device: a broker, or one that uses it exclusively.
    Taken,
}

/// Opens the link to a device, and shares it until the last client has left. Calls `ready` as soon as clients can
/// connect.
///
/// # Errors
/// A link that cannot be opened, or a socket that cannot be made.
pub fn serve(address: &LinkAddress, ready: impl FnOnce()) -> Result<Served> {
    let runtime = tokio::runtime::Builder::new_current_thread()
        .enable_all()
        .build()
        .map_err(LinkError::Host)?;
    let mut lock = None;
    let served = runtime.block_on(run(address, &mut lock, ready));
    // Threads are not waited for, because a read of a port may still block one.
    runtime.shutdown_background();
    // The lock is freed last, so that its next holder finds the device closed.
    drop(lock);
    served
}

async fn run(
    address: &LinkAddress,
    lock: &mut Option<File>,
    ready: impl FnOnce(),
) -> Result<Served> {
    let place = Place::of(address).await?;
    *lock = place.lock()?;
    if lock.is_none() {
        return Ok(Served::Taken);
    }
    // The names that an earlier holder of the lock left are wrong from now on.
    place.name_clients("");
    let failed = |failure: io::Error| unusable(address, &failure);
    let mut terminated = signal(SignalKind::terminate()).map_err(failed)?;
    // A hangup is ignored, because other clients continue when the terminal of the first client closes.
    let mut hung_up = signal(SignalKind::hangup()).map_err(failed)?;
    let (events, mut arrivals) = mpsc::unbounded_channel();
    let health = Arc::new(Health::default());
    let (to_device, outgoing) = mpsc::unbounded_channel();
    let pumps = Pumps {
        outgoing,
        events: events.clone(),
        health: health.clone(),
    };
    open::open(&place.address, &health, pumps).await?;
    let (_socket, listener) = Socket::bind(&place, address)?;
    ready();
    let mut broker = Broker {
        switchboard: Switchboard::default(),
        clients: BTreeMap::new(),
        last_client: 0,
        place: &place,
        to_device,
        events,
        health,
        broken: 0,
        idle_since: Instant::now(),
    };
    loop {
        let is_idle = broker.clients.is_empty();
        tokio::select! {
            Some(event) = arrivals.recv() => {
                if broker.serve(event) {
                    break;
                }
            }
            Ok((stream, _)) = listener.accept() => broker.accept(stream),
            () = tokio::time::sleep_until(broker.idle_since + IDLE), if is_idle => break,
            _ = terminated.recv() => {
                let reason = "the process that shares it was ended".to_owned();
                broker.tell_all(&FromBroker::Ended(reason));
                break;
            }
            _ = hung_up.recv() => {}
        }
    }
    drop(listener);
    // A program that comes now starts a broker of its own, instead of joining this one at its end.
    let _ = fs::remove_file(&place.socket);
    broker.flush().await;
    Ok(Served::Ended)
}

/// A socket that is removed when its broker ends, also after a failure.
struct Socket<'a>(&'a Place);

impl<'a> Socket<'a> {
    /// Listens at the socket of `place`, for this user only.
    fn bind(place: &'a Place, address: &LinkAddress) -> Result<(Self, UnixListener)> {
        let failed = |failure: io::Error| unusable(address, &failure);
        // The lock was free, so nobody listens at an existing socket: a broker that crashed has left it.
        match fs::remove_file(&place.socket) {
            Err(failure) if failure.kind() != io::ErrorKind::NotFound => {
                let shown = place.socket.display();
                return Err(unusable(
                    address,
                    &format!("{shown} cannot be replaced ({failure}): remove it"),
                ));
            }
            _ => {}
        }
        let listener = UnixListener::bind(&place.socket).map_err(failed)?;
        let socket = Self(place);
        fs::set_permissions(&place.socket, Permissions::from_mode(0o600)).map_err(failed)?;
        Ok((socket, listener))
    }
}

impl Drop for Socket<'_> {
    fn drop(&mut self) {
        let _ = fs::remove_file(&self.0.socket);
    }
}

/// A frame for the device, with the permit that its client used for it. The permit is freed once the frame is sent.
type Outgoing = (Vec<u8>, Option<OwnedSemaphorePermit>);

/// An event that the broker serves.
enum Event {
    /// A client that has sent its command, with the queue of messages to it and their number.
    Joined(
        ClientId,
        Program,
        UnboundedSender<FromBroker>,
        Arc<AtomicUsize>,
    ),
    /// A frame of a client, with the permit that bounds the number of such frames.
    OfClient(ClientId, Vec<u8>, OwnedSemaphorePermit),
    /// The end of a client.
    Left(ClientId),
    /// A frame of the device.
    OfDevice(Vec<u8>),
    /// The end of the link.
    LinkEnded,
}

/// The two tasks that move frames between the link and the broker's queues.
struct Pumps {
    outgoing: UnboundedReceiver<Outgoing>,
    events: UnboundedSender<Event>,
    health: Arc<Health>,
}

impl Ends for Pumps {
    type Made = ();

    fn take(self, mut sender: impl WireTx, mut receiver: impl WireRx) {
        let Self {
            mut outgoing,
            events,
            health,
        } = self;
        let ended = events.clone();
        tokio::spawn(async move {
            // The permit is held until the frame is sent.
            while let Some((frame, _permit)) = outgoing.recv().await {
                if let Err(failure) = sender.send(frame).await {
                    health.end(&format!("{failure:?}"));
                    let _ = ended.send(Event::LinkEnded);
                    return;
                }
            }
        });
        tokio::spawn(async move {
            while let Ok(frame) = receiver.receive().await {
                if events.send(Event::OfDevice(frame)).is_err() {
                    return;
                }
            }
            let _ = events.send(Event::LinkEnded);
        });
    }
}

/// A client's end of its socket.
struct Client {
    messages: UnboundedSender<FromBroker>,
    waiting: Arc<AtomicUsize>,
}

impl Client {
    /// Queues a message for the client. Returns false if the client counts as dead.
    fn tell(&self, message: FromBroker) -> bool {
        self.waiting.fetch_add(1, Ordering::Relaxed) < MOST_MESSAGES
            && self.messages.send(message).is_ok()
    }

    fn is_slow(&self) -> bool {
        self.waiting.load(Ordering::Relaxed) >= MOST_WITH_BLOCKS
    }
}

struct Broker<'a> {
    switchboard: Switchboard,
    clients: BTreeMap<ClientId, Client>,
    last_client: ClientId,
    place: &'a Place,
    to_device: UnboundedSender<Outgoing>,
    events: UnboundedSender<Event>,
    health: Arc<Health>,
    /// Number of broken frames that the clients know of.
    broken: u64,
    idle_since: Instant,
}

impl Broker<'_> {
    /// Serves an event. Returns true if the broker must end.
    fn serve(&mut self, event: Event) -> bool {
        match event {
            Event::Joined(id, program, messages, waiting) => {
                let client = Client { messages, waiting };
                // The first message is the welcome.
                client.tell(FromBroker::Broken(self.broken));
                self.clients.insert(id, client);
                self.switchboard.joined(id, program);
                self.place.name_clients(&self.switchboard.programs());
            }
            Event::OfClient(client, frame, permit) if self.clients.contains_key(&client) => {
                let actions = self.switchboard.frame_of(client, &frame);
                self.act(actions, Some(permit));
            }
            // A client that was removed as dead may still send.
            Event::OfClient(..) => {}
            Event::Left(client) => self.remove(client),
            Event::OfDevice(frame) => {
                let broken = self.health.broken_frames();
                if broken != self.broken {
                    self.broken = broken;
                    self.tell_all(&FromBroker::Broken(broken));
                }
                let actions = self.switchboard.frame_of_device(&frame);
                self.act(actions, None);
            }
            Event::LinkEnded => {
                let reason = self.health.why_ended().to_owned();
                self.tell_all(&FromBroker::Ended(reason));
                return true;
            }
        }
        false
    }

    /// Starts the two tasks of a client.
    fn accept(&mut self, stream: UnixStream) {
        // A client counts only once it has sent its command. Until then the broker must not end as idle.
        self.idle_since = Instant::now();
        let Ok(peer) = stream.peer_cred() else { return };
        // This is a second check: the folder's permissions already keep other users out.
        if !is_own(&peer) {
            return;
        }
        self.last_client += 1;
        let id = self.last_client;
        let (reader, mut writer) = stream.into_split();
        let (messages, outbox) = mpsc::unbounded_channel();
        let waiting = Arc::new(AtomicUsize::new(0));
        // The queue itself has no length, so the messages are counted beside it.
        let told = waiting.clone();
        tokio::spawn(async move { write(outbox, &mut writer, &told).await });
        let events = self.events.clone();
        tokio::spawn(async move {
            let permits = Arc::new(Semaphore::new(CLIENT_FRAMES));
            let mut arrivals = Messages::new(reader);
            let Ok(ToBroker::Command(command)) = arrivals.next().await else {
                return;
            };
            let process = peer.pid();
            let program = Program { command, process };
            let _ = events.send(Event::Joined(id, program, messages, waiting));
            while let Ok(ToBroker::Frame(frame)) = arrivals.next().await {
                let Ok(permit) = permits.clone().acquire_owned().await else {
                    break;
                };
                if events.send(Event::OfClient(id, frame, permit)).is_err() {
                    break;
                }
            }
            let _ = events.send(Event::Left(id));
        });
    }

    fn remove(&mut self, client: ClientId) {
        if self.clients.remove(&client).is_some() {
            self.idle_since = Instant::now();
            let actions = self.switchboard.left(client);
            self.place.name_clients(&self.switchboard.programs());
            self.act(actions, None);
        }
    }

    fn act(&mut self, actions: Vec<Action>, mut permit: Option<OwnedSemaphorePermit>) {
        let mut dead = Vec::new();
        for action in actions {
            match action {
                Action::ToDevice(frame) => {
                    // A failure is ignored, because the end of the link is an event of its own.
                    let _ = self.to_device.send((frame, permit.take()));
                }
                Action::ToClient(to, message) => {
                    let client = self.clients.get(&to);
                    if client.is_some_and(|client| !client.tell(message)) {
                        // It is removed below, because its removal adds actions of its own.
                        dead.push(to);
                    }
                }
                Action::Block(frame) => {
                    // A block may be left out, because its number shows the client what it has missed. An answer may
                    // not.
                    for client in self.clients.values().filter(|client| !client.is_slow()) {
                        client.tell(FromBroker::Frame(frame.clone()));
                    }
                }
            }
        }
        dead.into_iter().for_each(|client| self.remove(client));
    }

    fn tell_all(&self, message: &FromBroker) {
        for client in self.clients.values() {
            client.tell(message.clone());
        }
    }

    /// Gives the clients time to read their last messages.
    async fn flush(&self) {
        let is_waiting = |client: &Client| {
            !client.messages.is_closed() && client.waiting.load(Ordering::Relaxed) > 0
        };
        let end = Instant::now() + LAST_MESSAGES;
        while self.clients.values().any(is_waiting) && Instant::now() < end {
            tokio::time::sleep(Duration::from_millis(2)).await;
        }
    }
}

/// Writes messages until the client or the broker ends.
async fn write(
    mut outbox: UnboundedReceiver<FromBroker>,
    writer: &mut (impl tokio::io::AsyncWrite + Unpin),
    waiting: &AtomicUsize,
) {
    while let Some(message) = outbox.recv().await {
        if writer.write_all(&encode(&message)).await.is_err() {
            return;
        }
        waiting.fetch_sub(1, Ordering::Relaxed);
    }
}

/// True if the program at the other end is this user's.
fn is_own(peer: &tokio::net::unix::UCred) -> bool {
    let own = UnixStream::pair().and_then(|(one, _)| one.peer_cred());
    own.is_ok_and(|own| own.uid() == peer.uid())
}
