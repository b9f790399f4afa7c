//! The job of the image, which the emulator writes into the memory of the image before the start. Without a job the
//! image plays the test vectors.

use serde::{Deserialize, Serialize};

/// Address of the job on the emulated boards. The image's `memory.x` keeps that memory free.
pub const ADDRESS: u32 = 0x2020_0000;

/// Largest size of the job, bytes.
pub const CAPACITY: usize = 2 << 20;

/// First word of a job.
const MAGIC: u32 = 0x0b5e_55ed;

/// Bytes before the job: [`MAGIC`], and the number of bytes that follow.
const HEADER_BYTES: usize = 8;

/// A job.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Job<'a> {
    /// Plays every texture of a library along [`counted_motion`](crate::counted_motion), and counts the instructions of
    /// samples and updates.
    Count {
        /// A library.
        library: &'a [u8],
    },
    /// Plays hard cases, and counts the instructions of each sample.
    Hard {
        /// [`HardCase`](crate::HardCase)s, one after the other.
        cases: &'a [u8],
    },
    /// Decodes libraries and plans their playback, and counts the instructions.
    Bounds {
        /// [`Libraries`], one after the other.
        libraries: &'a [u8],
    },
    /// Plays a library's first texture along the fixed stroke of [`stylus_kernel::digest`].
    Digest {
        /// A library.
        library: &'a [u8],
    },
}

/// Libraries. The length of each, as a `u32`, precedes it.
#[derive(Clone, Debug)]
pub struct Libraries<'a>(pub &'a [u8]);

impl<'a> Iterator for Libraries<'a> {
    type Item = &'a [u8];

    fn next(&mut self) -> Option<&'a [u8]> {
        let (length, rest) = self.0.split_first_chunk()?;
        let (library, rest) = rest.split_at_checked(u32::from_le_bytes(*length) as usize)?;
        self.0 = rest;
        Some(library)
    }
}

#[cfg(feature = "library")]
impl Libraries<'_> {
    /// Appends `library` to `bytes`.
    ///
    /// # Panics
    /// The library is longer than 4 GB.
    pub fn append(library: &[u8], bytes: &mut alloc::vec::Vec<u8>) {
        let length = u32::try_from(library.len()).expect("no library is so long");
        bytes.extend(length.to_le_bytes());
        bytes.extend(library);
    }
}

/// Returns the job in `memory`, if there is one.
pub fn read(memory: &[u8]) -> Option<Job<'_>> {
    let (magic, rest) = memory.split_first_chunk()?;
    let (len, rest) = rest.split_first_chunk()?;
    if u32::from_le_bytes(*magic) != MAGIC {
        return None;
    }
    let bytes = rest.get(..u32::from_le_bytes(*len) as usize)?;
    postcard::from_bytes(bytes).ok()
}

/// Returns the bytes of `job`, to be put at [`ADDRESS`]; `None` if they do not fit there.
#[cfg(feature = "library")]
pub fn write(job: &Job<'_>) -> Option<alloc::vec::Vec<u8>> {
    let body = postcard::to_allocvec(job).ok()?;
    let len = u32::try_from(body.len()).ok()?;
    let bytes = [&MAGIC.to_le_bytes()[..], &len.to_le_bytes(), &body].concat();
    (bytes.len() <= CAPACITY).then_some(bytes)
}

/// Largest number of bytes of a job in addition to its library ([`Job::Count`], [`Job::Digest`]), its cases
/// ([`Job::Hard`]) or its libraries ([`Job::Bounds`]).
pub const OVERHEAD_BYTES: usize = HEADER_BYTES + 16;

#[cfg(all(test, feature = "library"))]
mod tests {
    use super::*;

    #[test]
    fn a_job_is_read_as_it_was_written_and_nothing_else_is_one() {
        let job = Job::Count { library: b"a library" };
        let mut bytes = write(&job).expect("it is small");
        assert!(bytes.len() <= b"a library".len() + OVERHEAD_BYTES);
        bytes.resize(CAPACITY, 0);
        assert_eq!(read(&bytes), Some(job));
        assert_eq!(read(&bytes[..HEADER_BYTES + 4]), None);
        bytes[0] ^= 1;
        assert_eq!(read(&bytes), None);
        assert_eq!(read(&[0; 64]), None);
    }

    #[test]
    fn what_has_no_room_is_no_job() {
        let cases = alloc::vec![0; CAPACITY - OVERHEAD_BYTES + 1];
        assert!(write(&Job::Hard { cases: &cases[1..] }).is_some());
        assert!(
            write(&Job::Hard {
                cases: &alloc::vec![0; CAPACITY]
            })
            .is_none()
        );
    }
}
