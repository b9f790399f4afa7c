//! The first message of either side. Its form never changes, so that any two versions understand each other.
//!
//! All of it: eight bytes of a mark, the version of the messages after it and the schema of the device's protocol, both
//! in little-endian order; then a client's command, or a broker's answer as a code and its words. A text has two bytes
//! of length.

use std::io;

use model_format::link::SCHEMA_HASH;
use tokio::io::{AsyncRead, AsyncReadExt};

/// Mark of a broker's socket.
const MARK: [u8; 8] = *b"stylus-b";

/// Version of the messages after the greeting.
const VERSION: u16 = 1;

/// Longest text of a greeting, bytes.
const MAX_TEXT_BYTES: usize = 1000;

/// Versions of a side.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Versions {
    messages: u16,
    schema: u64,
}

impl Versions {
    /// The versions of this program.
    pub(super) const OWN: Self = Self {
        messages: VERSION,
        schema: SCHEMA_HASH,
    };

    /// Versions of no program: a client that gives them wants a broker without clients to leave.
    pub(super) const NONE: Self = Self {
        messages: 0,
        schema: 0,
    };
}

/// Answer of a broker.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub(super) enum Answer {
    /// The client is welcome; messages follow.
    Welcome,
    /// The client has other versions; the broker had no clients and leaves.
    Leaves,
    /// The client has other versions, and the broker has clients, which the words name.
    InUse,
}

impl Answer {
    fn from_code(code: u8) -> Option<Self> {
        [Self::Welcome, Self::Leaves, Self::InUse]
            .into_iter()
            .find(|answer| *answer as u8 == code)
    }
}

/// Bytes of a client's greeting.
pub(super) fn of_client(versions: Versions, command: &str) -> Vec<u8> {
    let mut bytes = head(versions);
    put_text(&mut bytes, command);
    bytes
}

/// Bytes of a broker's greeting.
pub(super) fn of_broker(answer: Answer, words: &str) -> Vec<u8> {
    let mut bytes = head(Versions::OWN);
    bytes.push(answer as u8);
    put_text(&mut bytes, words);
    bytes
}

/// Reads a client's greeting: its versions and its command.
///
/// # Errors
/// A connection that ends, or bytes that are no greeting.
pub(super) async fn read_client(
    reader: &mut (impl AsyncRead + Unpin),
) -> io::Result<(Versions, String)> {
    let versions = read_head(reader).await?;
    Ok((versions, read_text(reader).await?))
}

/// Reads a broker's greeting: its answer, and the words with it.
///
/// # Errors
/// As [`read_client`].
pub(super) async fn read_broker(
    reader: &mut (impl AsyncRead + Unpin),
) -> io::Result<(Answer, String)> {
    read_head(reader).await?;
    let answer = Answer::from_code(reader.read_u8().await?).ok_or_else(unusable)?;
    Ok((answer, read_text(reader).await?))
}

fn head(versions: Versions) -> Vec<u8> {
    let mut bytes = MARK.to_vec();
    bytes.extend(versions.messages.to_le_bytes());
    bytes.extend(versions.schema.to_le_bytes());
    bytes
}

async fn read_head(reader: &mut (impl AsyncRead + Unpin)) -> io::Result<Versions> {
    let mut mark = [0; MARK.len()];
    reader.read_exact(&mut mark).await?;
    if mark != MARK {
        return Err(unusable());
    }
    Ok(Versions {
        messages: reader.read_u16_le().await?,
        schema: reader.read_u64_le().await?,
    })
}

fn put_text(bytes: &mut Vec<u8>, text: &str) {
    let end = text.floor_char_boundary(MAX_TEXT_BYTES);
    bytes.extend((end as u16).to_le_bytes());
    bytes.extend(&text.as_bytes()[..end]);
}

async fn read_text(reader: &mut (impl AsyncRead + Unpin)) -> io::Result<String> {
    let length = usize::from(reader.read_u16_le().await?);
    if length > MAX_TEXT_BYTES {
        return Err(unusable());
    }
    let mut text = vec![0; length];
    reader.read_exact(&mut text).await?;
    String::from_utf8(text).map_err(|_| unusable())
}

fn unusable() -> io::Error {
    io::Error::new(io::ErrorKind::InvalidData, "not a greeting of a broker")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn greetings_are_read_as_they_were_written_and_nothing_else_is_one() {
        let bytes = of_client(Versions::OWN, "play");
        let read = read_client(&mut bytes.as_slice()).await.unwrap();
        assert_eq!(read, (Versions::OWN, "play".to_owned()));
        for answer in [Answer::Welcome, Answer::Leaves, Answer::InUse] {
            let bytes = of_broker(answer, "näher");
            let read = read_broker(&mut bytes.as_slice()).await.unwrap();
            assert_eq!(read, (answer, "näher".to_owned()));
        }
        let long = of_client(Versions::OWN, &"ä".repeat(MAX_TEXT_BYTES));
        let (_, text) = read_client(&mut long.as_slice()).await.unwrap();
        assert_eq!(text, "ä".repeat(MAX_TEXT_BYTES / 2));
        for end in 0..bytes.len() {
            assert!(read_client(&mut &bytes[..end]).await.is_err());
        }
        assert!(read_client(&mut [0x5a; 64].as_slice()).await.is_err());
        let mut unknown = of_broker(Answer::InUse, "");
        unknown[MARK.len() + 10] = 3;
        assert!(read_broker(&mut unknown.as_slice()).await.is_err());
    }
}
