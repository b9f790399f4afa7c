//! The client of a broker: finds the broker or starts one, and makes a link from its socket.

use std::io::{self, BufRead, BufReader};
use std::os::unix::process::CommandExt;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::time::{Duration, Instant};

use postcard_rpc::host_client::{WireRx, WireTx};
use tokio::io::AsyncWriteExt;
use tokio::net::UnixStream;
use tokio::net::unix::{OwnedReadHalf, OwnedWriteHalf};

use super::RETRY;
use super::message::{FromBroker, Messages, ToBroker};
use super::place::{Place, unusable};
use super::sharing::{BROKER_READY, BROKER_TAKEN, Sharing};
use crate::link::LinkAddress;
use crate::link::error::{LinkError, Result};
use crate::link::health::Health;
use crate::link::open::Ends;
use crate::link::virtual_usb::encode;

/// Longest time to find or start a broker. A TCP connection by itself may take three seconds.
const TIMEOUT: Duration = Duration::from_secs(8);

/// Longest time until a broker welcomes a client.
const WELCOME_TIMEOUT: Duration = Duration::from_secs(2);

/// Opens a shared link and passes its two ends to `ends`. Starts a broker if none is running.
///
/// # Errors
/// The device cannot be opened, another program has it exclusively, or a program of another version shares it.
pub(in crate::link) async fn open<E: Ends>(
    address: &LinkAddress,
    sharing: &Sharing,
    health: &Arc<Health>,
    ends: E,
) -> Result<E::Made> {
    let place = Place::of(address).await?;
    let begin = Instant::now();
    loop {
        if let Some(socket) = connect(&place, &sharing.command, health).await? {
            return Ok(give(socket, health, ends));
        }
        if place.is_held_alone(begin)? {
            tokio::time::sleep(RETRY).await;
            continue;
        }
        continue_within(&place, begin)?;
        start(&place, sharing).await?;
    }
}

/// Opens a link that another program shares, and passes its two ends to `ends`. Returns `None` if no program shares it.
///
/// # Errors
/// A program of another version shares the link, or a program has the device exclusively. A lock file that cannot be
/// made.
pub(in crate::link) async fn join<E: Ends>(
    address: &LinkAddress,
    command: &str,
    health: &Arc<Health>,
    ends: E,
) -> Result<Option<E::Made>> {
    let Ok(place) = Place::of(address).await else {
        // Opening the link will report what is wrong with the address. Without a runtime folder there is no broker.
        return Ok(None);
    };
    let begin = Instant::now();
    loop {
        if let Some(socket) = connect(&place, command, health).await? {
            return Ok(Some(give(socket, health, ends)));
        }
        // The lock is only tried and freed at once: like a direct link, this one keeps nobody else out.
        if place.lock()?.is_some() {
            return Ok(None);
        }
        if !place.is_held_alone(begin)? {
            continue_within(&place, begin)?;
        }
        tokio::time::sleep(RETRY).await;
    }
}

fn continue_within(place: &Place, begin: Instant) -> Result<()> {
    if begin.elapsed() < TIMEOUT {
        return Ok(());
    }
    // A broker of this version would have answered by now. Others listen at sockets of other names, but hold the same
    // lock.
    Err(unusable(
        &place.address,
        &format!(
            "another version of stylus shares it with {}: end that program, or use the same version",
            place.clients()
        ),
    ))
}

/// The two ends of a broker's socket.
type Socket = (Messages<OwnedReadHalf>, OwnedWriteHalf);

/// Connects to the socket as a client with this `command`. Returns `None` if no broker answers there.
async fn connect(place: &Place, command: &str, health: &Health) -> Result<Option<Socket>> {
    let stream = match UnixStream::connect(&place.socket).await {
        Ok(stream) => stream,
        Err(failure)
            if matches!(
                failure.kind(),
                // A broker that crashed leaves a socket at which nobody listens.
                io::ErrorKind::NotFound | io::ErrorKind::ConnectionRefused
            ) =>
        {
            return Ok(None);
        }
        Err(failure) => return Err(unusable(&place.address, &failure)),
    };
    let (reader, mut writer) = stream.into_split();
    let mut messages = Messages::new(reader);
    let welcome = async {
        let command = ToBroker::Command(command.to_owned());
        writer.write_all(&encode(&command)).await?;
        messages.next().await
    };
    match tokio::time::timeout(WELCOME_TIMEOUT, welcome).await {
        Ok(Ok(FromBroker::Broken(frames))) => {
            health.set_broken(frames);
            Ok(Some((messages, writer)))
        }
        // The broker is just ending.
        Ok(_) => Ok(None),
        Err(_) => Err(unusable(
            &place.address,
            &"the process that shares it does not answer: end it",
        )),
    }
}

/// Starts a broker, and waits until it is ready or reports that another program already has the device.
async fn start(place: &Place, sharing: &Sharing) -> Result<()> {
    let failed = |failure: io::Error| unusable(&place.address, &failure);
    let mut broker = Command::new(&sharing.program)
        .args(sharing.arguments(&place.address))
        .current_dir("/")
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        // The broker gets a process group of its own, so that Ctrl-C ends only the command.
        .process_group(0)
        .spawn()
        .map_err(failed)?;
    let output = broker.stdout.take().expect("it is piped");
    let line = tokio::task::spawn_blocking(move || {
        let mut line = String::new();
        BufReader::new(output).read_line(&mut line).map(|_| line)
    });
    let line = match tokio::time::timeout(TIMEOUT, line).await {
        Ok(Ok(line)) => line.map_err(failed)?,
        Ok(Err(failure)) => return Err(unusable(&place.address, &failure)),
        Err(_) => {
            return Err(unusable(&place.address, &"the sharing process won't start"));
        }
    };
    // If the broker outlives this process, the system waits for it instead.
    drop(tokio::task::spawn_blocking(move || broker.wait()));
    match line.trim_end() {
        BROKER_READY => Ok(()),
        // The other program holds the lock, but its socket may not be there yet.
        BROKER_TAKEN => {
            tokio::time::sleep(RETRY).await;
            Ok(())
        }
        "" => Err(unusable(&place.address, &"the sharing process has ended")),
        problem => Err(LinkError::Broker(problem.to_owned())),
    }
}

/// Makes a link from a socket.
fn give<E: Ends>((messages, writer): Socket, health: &Arc<Health>, ends: E) -> E::Made {
    let health = health.clone();
    ends.take(SocketTx(writer), SocketRx { messages, health })
}

/// Reason for the end of a link whose broker has given none.
const GONE: &str = "the process that shared it has ended";

/// The sending end.
struct SocketTx(OwnedWriteHalf);

impl WireTx for SocketTx {
    type Error = io::Error;

    async fn send(&mut self, frame: Vec<u8>) -> io::Result<()> {
        let sent = self.0.write_all(&encode(&ToBroker::Frame(frame))).await;
        match sent {
            Ok(()) => Ok(()),
            // The receiving end reports why the link ended, because the broker's last message may not have been read
            // yet.
            Err(_) => std::future::pending().await,
        }
    }
}

/// The receiving end.
struct SocketRx {
    messages: Messages<OwnedReadHalf>,
    health: Arc<Health>,
}

impl WireRx for SocketRx {
    type Error = io::Error;

    async fn receive(&mut self) -> io::Result<Vec<u8>> {
        loop {
            let message = self.messages.next().await;
            match message.inspect_err(|_| self.health.end(&GONE))? {
                FromBroker::Frame(frame) => return Ok(frame),
                FromBroker::Refused { key, words } => self.health.refuse(key, words),
                FromBroker::Stopped { by } => self.health.stop(by),
                FromBroker::Joins {
                    blocks,
                    lost_blocks,
                } => self.health.join_recording(blocks, lost_blocks),
                FromBroker::Broken(frames) => self.health.set_broken(frames),
                FromBroker::Ended(reason) => {
                    self.health.end(&reason);
                    return Err(io::ErrorKind::UnexpectedEof.into());
                }
            }
        }
    }
}
