//! A memory for models that use none.

use rigless::emulator::{Error, Memory};
use rigless::soc::Width;

/// Memory in which every access fails.
pub struct NoMemory;

impl Memory for NoMemory {
    fn read(&mut self, address: u64, width: Width) -> Result<u64, Error> {
        Err(Error::Memory { address, width })
    }

    fn write(&mut self, address: u64, width: Width, _value: u64) -> Result<(), Error> {
        Err(Error::Memory { address, width })
    }
}
