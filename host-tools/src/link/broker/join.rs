//! A client's side of a broker: finds it, starts it where there is none, and makes a link of its socket.

use std::io::{self, BufRead, BufReader};
use std::os::unix::process::CommandExt;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::time::{Duration, Instant};

use postcard_rpc::host_client::{WireRx, WireTx};
use tokio::io::AsyncWriteExt;
use tokio::net::UnixStream;
use tokio::net::unix::{OwnedReadHalf, OwnedWriteHalf};

use super::greeting::{self, Answer, Versions};
use super::message::{FromBroker, Messages, ToBroker};
use super::place::{Place, unusable};
use crate::link::LinkAddress;
use crate::link::error::{LinkError, Result};
use crate::link::health::Health;
use crate::link::open::Ends;
use crate::link::route::{BROKER_READY, BROKER_TAKEN, Sharing};
use crate::link::virtual_usb::encode;

/// Time in which a broker has to be found or started. A TCP connection alone may take three seconds.
const TIMEOUT: Duration = Duration::from_secs(8);

/// Time in which a broker has to answer a greeting.
const GREETING_TIMEOUT: Duration = Duration::from_secs(2);

/// Interval between attempts while another program starts or ends a broker.
const RETRY: Duration = Duration::from_millis(10);

/// Opens a shared link, and gives its ends to `ends`. Starts a broker where there is none.
///
/// # Errors
/// A device that cannot be opened, or a broker that is of another version, in use, or dead.
pub(in crate::link) async fn open<E: Ends>(
    address: &LinkAddress,
    sharing: &Sharing,
    health: &Arc<Health>,
    ends: E,
) -> Result<E::Made> {
    let place = Place::of(address).await?;
    let begin = Instant::now();
    loop {
        continue_within(&place, begin)?;
        match attempt(&place, &sharing.command).await? {
            Attempt::Welcome(stream) => return Ok(give(stream, health, ends)),
            Attempt::Nobody => start(&place, sharing).await?,
            Attempt::Leaves => tokio::time::sleep(RETRY).await,
        }
    }
}

/// Opens a link that another program shares, and gives its ends to `ends`; none if nobody shares it.
///
/// # Errors
/// A broker that is of another version, or dead.
pub(in crate::link) async fn join<E: Ends>(
    address: &LinkAddress,
    command: &str,
    health: &Arc<Health>,
    ends: E,
) -> Result<Option<E::Made>> {
    let Ok(place) = Place::of(address).await else {
        // The opening tells what is wrong with the address; without a folder there is no broker.
        return Ok(None);
    };
    let begin = Instant::now();
    loop {
        match attempt(&place, command).await? {
            Attempt::Welcome(stream) => return Ok(Some(give(stream, health, ends))),
            // The lock is held by one that begins or ends.
            Attempt::Nobody if place.lock()?.is_some() => return Ok(None),
            Attempt::Nobody | Attempt::Leaves => {}
        }
        continue_within(&place, begin)?;
        tokio::time::sleep(RETRY).await;
    }
}

/// Answer to an attempt to be a broker's client.
enum Attempt {
    /// It is one's own now.
    Welcome(UnixStream),
    /// There is none.
    Nobody,
    /// It leaves, or has left.
    Leaves,
}

/// Attempts once to be a broker's client.
///
/// # Errors
/// A broker that is of another version, or dead.
async fn attempt(place: &Place, command: &str) -> Result<Attempt> {
    let Some(mut stream) = connect(place).await? else {
        return Ok(Attempt::Nobody);
    };
    match greet(place, &mut stream, Versions::OWN, command).await? {
        Some((Answer::Welcome, _)) => Ok(Attempt::Welcome(stream)),
        Some((Answer::InUse, programs)) => Err(unusable(
            &place.address,
            &format!(
                "another version of stylus shares it with {programs}: end that, or use the same version"
            ),
        )),
        Some((Answer::Leaves, _)) | None => Ok(Attempt::Leaves),
    }
}

/// Asks a broker without clients to leave, so that its device can be opened by this program alone.
///
/// # Errors
/// A broker that has clients; the error names them.
pub(in crate::link) async fn leave(address: &LinkAddress, sharing: &Sharing) -> Result<()> {
    let Ok(place) = Place::of(address).await else {
        // The opening tells what is wrong with the address; without a folder there is no broker.
        return Ok(());
    };
    let begin = Instant::now();
    loop {
        if let Some(mut stream) = connect(&place).await?
            && let Some((Answer::InUse, programs)) =
                greet(&place, &mut stream, Versions::NONE, &sharing.command).await?
        {
            return Err(LinkError::Open {
                link: place.address.to_string(),
                reason: format!("it is in use by {programs}: end that, or leave --no-broker out"),
            });
        }
        // The lock is free once the broker has closed the device.
        if place.lock()?.is_some() {
            return Ok(());
        }
        continue_within(&place, begin)?;
        tokio::time::sleep(RETRY).await;
    }
}

fn continue_within(place: &Place, begin: Instant) -> Result<()> {
    if begin.elapsed() < TIMEOUT {
        return Ok(());
    }
    Err(unusable(
        &place.address,
        &format!("no broker was there within {} s", TIMEOUT.as_secs()),
    ))
}

/// Connects to the socket; none if nobody listens there.
async fn connect(place: &Place) -> Result<Option<UnixStream>> {
    match UnixStream::connect(&place.socket).await {
        Ok(stream) => Ok(Some(stream)),
        Err(failure)
            if matches!(
                failure.kind(),
                io::ErrorKind::NotFound | io::ErrorKind::ConnectionRefused
            ) =>
        {
            Ok(None)
        }
        Err(failure) => Err(unusable(&place.address, &failure)),
    }
}

/// Greets a broker; none if it ends in the middle.
async fn greet(
    place: &Place,
    stream: &mut UnixStream,
    versions: Versions,
    command: &str,
) -> Result<Option<(Answer, String)>> {
    let process = stream.peer_cred().ok().and_then(|peer| peer.pid());
    let answer = async {
        stream
            .write_all(greeting::of_client(versions, command).as_bytes())
            .await?;
        greeting::read_broker(stream).await
    };
    match tokio::time::timeout(GREETING_TIMEOUT, answer).await {
        Ok(Ok(answer)) => Ok(Some(answer)),
        Ok(Err(failure)) if failure.kind() == io::ErrorKind::InvalidData => Err(unusable(
            &place.address,
            &format!("{}: {failure}", place.socket.display()),
        )),
        Ok(Err(_)) => Ok(None),
        Err(_) => {
            let process = process.map_or_else(String::new, |process| format!(" {process}"));
            Err(unusable(
                &place.address,
                &format!("the process{process} that shares it does not answer: end it"),
            ))
        }
    }
}

/// Starts a broker, and waits until it is ready or knows that another one is there.
async fn start(place: &Place, sharing: &Sharing) -> Result<()> {
    let failed = |failure: io::Error| unusable(&place.address, &failure);
    let mut broker = Command::new(&sharing.program)
        .args(sharing.arguments(&place.address))
        .current_dir("/")
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        // A group of its own, so that Ctrl-C ends the command and not the broker.
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
            return Err(unusable(&place.address, &"its broker does not start"));
        }
    };
    // A broker that lives longer than this process is the system's to wait for.
    drop(tokio::task::spawn_blocking(move || broker.wait()));
    match line.trim_end() {
        BROKER_READY => Ok(()),
        BROKER_TAKEN => {
            tokio::time::sleep(RETRY).await;
            Ok(())
        }
        "" => Err(unusable(&place.address, &"its broker has ended at once")),
        problem => Err(LinkError::Broker(problem.to_owned())),
    }
}

/// Makes a link of a socket whose broker has said welcome.
fn give<E: Ends>(stream: UnixStream, health: &Arc<Health>, ends: E) -> E::Made {
    let (reader, writer) = stream.into_split();
    let sender = SocketTx(writer);
    let receiver = SocketRx {
        messages: Messages::new(reader),
        health: health.clone(),
    };
    ends.take(sender, receiver)
}

/// Reason for the end of a socket without another one.
const GONE: &str = "the process that shared it has ended";

/// The sending end.
struct SocketTx(OwnedWriteHalf);

impl WireTx for SocketTx {
    type Error = io::Error;

    async fn send(&mut self, frame: Vec<u8>) -> io::Result<()> {
        let sent = self.0.write_all(&encode(&ToBroker::Frame(frame))).await;
        match sent {
            Ok(()) => Ok(()),
            // The broker's last message may still wait to be read, and says why.
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
                FromBroker::OthersRecord(others) => self.health.set_others_record(others),
                FromBroker::Broken(frames) => self.health.set_broken(frames),
                FromBroker::Ended(reason) => {
                    self.health.end(&reason);
                    return Err(io::ErrorKind::UnexpectedEof.into());
                }
            }
        }
    }
}
