//! Exclusive use of a device by one program. Meanwhile no broker starts, and other programs are refused with an error
//! that names this program.

use std::fs::File;
use std::time::{Duration, Instant};

use super::RETRY;
use super::place::Place;
use crate::link::LinkAddress;
use crate::link::error::{LinkError, Result};

/// Time after which a broker without clients has certainly ended.
const BROKER_END: Duration = super::IDLE.saturating_add(Duration::from_secs(1));

/// The lock of a device that this program uses exclusively. Dropping it frees the device.
#[derive(Debug)]
pub(in crate::link) struct Hold {
    _lock: File,
}

/// Locks the device for this program only, and writes its `command` into the lock. First waits for the end of a broker
/// without clients. Returns `None` if no place for the lock can be determined.
///
/// # Errors
/// Another program has the device exclusively, or a broker has clients: the error names them. A lock file that cannot
/// be made.
pub(in crate::link) async fn hold(address: &LinkAddress, command: &str) -> Result<Option<Hold>> {
    let Ok(place) = Place::of(address).await else {
        // Opening the link will report what is wrong with the address.
        return Ok(None);
    };
    let begin = Instant::now();
    loop {
        if let Some(lock) = place.lock()? {
            place.name_alone(command);
            return Ok(Some(Hold { _lock: lock }));
        }
        // A broker without clients ends within this time and frees the lock; one that has clients does not.
        if !place.is_held_alone(begin)? && begin.elapsed() > BROKER_END {
            return Err(LinkError::Held {
                link: place.address.to_string(),
                what: format!(
                    "in use by {}, and this command needs the device alone: wait for their end, or end them",
                    place.clients()
                ),
            });
        }
        tokio::time::sleep(RETRY).await;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn a_second_program_is_refused_with_the_name_of_the_first_until_that_ends() {
        let address: LinkAddress = "tcp:127.0.0.1:9".parse().unwrap();
        let first = hold(&address, "update").await.unwrap();
        let refused = hold(&address, "play").await.unwrap_err();
        let told = refused.to_string();
        assert!(matches!(refused, LinkError::Held { .. }), "{told}");
        let who = format!(
            "`stylus update` (process {}) has it alone",
            std::process::id()
        );
        assert!(told.contains(&who), "{told}");
        drop(first);
        assert!(hold(&address, "play").await.unwrap().is_some());
    }
}
