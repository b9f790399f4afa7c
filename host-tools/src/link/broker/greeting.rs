//! The first message of either side: a line of text whose form never changes, so that any two versions understand each
//! other. A client's is `stylus-b MESSAGES SCHEMA COMMAND`, with the versions of the messages after it and of the
//! device's protocol; a broker's is `stylus-b ANSWER WORDS`.

use std::io;

use model_format::link::SCHEMA_HASH;
use tokio::io::{AsyncRead, AsyncReadExt};

/// First word of every greeting.
const MARK: &str = "stylus-b";

/// Version of the messages after the greeting.
const VERSION: u16 = 1;

/// Longest greeting, bytes.
const MAX_BYTES: usize = 1100;

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
pub(super) enum Answer {
    /// The client is welcome; messages follow.
    Welcome,
    /// The client has other versions; the broker had no clients and leaves.
    Leaves,
    /// The client has other versions, and the broker has clients, which the words name.
    InUse,
}

impl Answer {
    const ALL: [Self; 3] = [Self::Welcome, Self::Leaves, Self::InUse];

    fn name(self) -> &'static str {
        match self {
            Self::Welcome => "welcome",
            Self::Leaves => "leaves",
            Self::InUse => "in-use",
        }
    }
}

/// A client's greeting.
pub(super) fn of_client(versions: Versions, command: &str) -> String {
    let Versions { messages, schema } = versions;
    line(&format!("{messages} {schema:016x} {command}"))
}

/// A broker's greeting.
pub(super) fn of_broker(answer: Answer, words: &str) -> String {
    line(&format!("{} {words}", answer.name()))
}

fn line(text: &str) -> String {
    let end = text.floor_char_boundary(MAX_BYTES - MARK.len() - 2);
    format!("{MARK} {}\n", text[..end].replace('\n', " "))
}

/// Reads a client's greeting: its versions and its command.
///
/// # Errors
/// A connection that ends, or bytes that are no greeting.
pub(super) async fn read_client(
    reader: &mut (impl AsyncRead + Unpin),
) -> io::Result<(Versions, String)> {
    let line = read(reader).await?;
    let mut words = line.splitn(3, ' ');
    let mut word = || words.next().ok_or_else(unusable);
    let (messages, schema) = (word()?, word()?);
    let versions = Versions {
        messages: messages.parse().map_err(|_| unusable())?,
        schema: u64::from_str_radix(schema, 16).map_err(|_| unusable())?,
    };
    Ok((versions, word()?.to_owned()))
}

/// Reads a broker's greeting: its answer, and the words with it.
///
/// # Errors
/// As [`read_client`].
pub(super) async fn read_broker(
    reader: &mut (impl AsyncRead + Unpin),
) -> io::Result<(Answer, String)> {
    let line = read(reader).await?;
    let (name, words) = line.split_once(' ').ok_or_else(unusable)?;
    let answer = Answer::ALL.into_iter().find(|answer| answer.name() == name);
    Ok((answer.ok_or_else(unusable)?, words.to_owned()))
}

/// Reads a line, and nothing after it, and gives what follows its mark.
async fn read(reader: &mut (impl AsyncRead + Unpin)) -> io::Result<String> {
    let mut bytes = Vec::new();
    loop {
        match reader.read_u8().await? {
            b'\n' => break,
            byte if bytes.len() < MAX_BYTES => bytes.push(byte),
            _ => return Err(unusable()),
        }
    }
    let line = String::from_utf8(bytes).map_err(|_| unusable())?;
    let rest = line
        .strip_prefix(MARK)
        .and_then(|rest| rest.strip_prefix(' '));
    rest.map(str::to_owned).ok_or_else(unusable)
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
        let read = read_client(&mut bytes.as_bytes()).await.unwrap();
        assert_eq!(read, (Versions::OWN, "play".to_owned()));
        for answer in Answer::ALL {
            let bytes = of_broker(answer, "näher");
            let read = read_broker(&mut bytes.as_bytes()).await.unwrap();
            assert_eq!(read, (answer, "näher".to_owned()));
        }
        let long = of_broker(Answer::InUse, &"ä".repeat(MAX_BYTES));
        assert!(read_broker(&mut long.as_bytes()).await.is_ok());
        for end in 0..bytes.len() {
            assert!(read_client(&mut &bytes.as_bytes()[..end]).await.is_err());
        }
        for wrong in [
            "stylus-b later \n",
            "stylus 1 2 play\n",
            "stylus-b 1 x play\n",
        ] {
            assert!(read_broker(&mut wrong.as_bytes()).await.is_err());
            assert!(read_client(&mut wrong.as_bytes()).await.is_err());
        }
        assert!(read_client(&mut [0x5a; 2000].as_slice()).await.is_err());
    }
}
