//! Enumeration and control requests.

use super::descriptor::{self, microsoft_set, total_length};
use super::request::Request;
use crate::error::Result;
use crate::model::usb::host::{Completion, Host, Transfer, TransferError, TransferId};
use crate::stylus::VirtualStylus;

const MS: u64 = 1_000_000;
/// Virtual time between two looks at the transfers that have ended.
const STEP_NS: u64 = 50_000;
/// Timeout of a control transfer (section 9.2.6.1).
const CONTROL_PATIENCE_NS: u64 = 5_000 * MS;

/// The result of a transfer, within that of the run.
pub type Transferred<T> = Result<std::result::Result<T, TransferError>>;

/// The instant of a transfer's end, in nanoseconds of virtual time, and the data from the device.
pub type Arrived = (u64, Vec<u8>);

/// The descriptors that an enumeration read, each as it came over the wire.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Descriptors {
    /// The device descriptor.
    pub device: Vec<u8>,
    /// The configuration descriptor, with the descriptors that belong to it.
    pub configuration: Vec<u8>,
    /// The descriptor of further capabilities (BOS), if there is one.
    pub bos: Vec<u8>,
    /// The Microsoft OS 2.0 descriptor set, if the BOS names one.
    pub microsoft: Vec<u8>,
    /// The languages of its strings.
    pub languages: Vec<u8>,
    /// Manufacturer, product and serial number.
    pub strings: [Vec<u8>; 3],
}

/// Times of an enumeration.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Timing {
    /// From the pull-up to the first reset, nanoseconds.
    pub settle_ns: u64,
    /// A reset, nanoseconds.
    pub reset_ns: u64,
    /// From a reset to the first packet, nanoseconds.
    pub recovery_ns: u64,
}

impl Default for Timing {
    fn default() -> Self {
        Self {
            settle_ns: 100 * MS,
            reset_ns: 10 * MS,
            recovery_ns: 10 * MS,
        }
    }
}

/// The host's software.
#[derive(Debug, Default)]
pub struct UsbHost {
    /// Times of its enumerations.
    pub timing: Timing,
    ended: Vec<Completion>,
    next_address: u8,
}

impl UsbHost {
    /// Waits for the device, resets the bus, gives the device an address, reads all of its descriptors, and configures
    /// it.
    ///
    /// # Errors
    /// The run is over; or, inside, a transfer that failed.
    pub fn enumerate(&mut self, stylus: &mut VirtualStylus) -> Transferred<Descriptors> {
        stylus.usb(Host::plug)?;
        let begin_ns = stylus.now_ns();
        let sees = stylus.run_until_true(begin_ns + 2_000 * MS, MS, |stylus| {
            stylus.usb(|host, _| host.sees_device())
        })?;
        if !sees {
            return Ok(Err(TransferError::Gone));
        }
        stylus.run_for(self.timing.settle_ns)?;
        self.reset(stylus)?;
        self.describe(stylus)
    }

    fn describe(&mut self, stylus: &mut VirtualStylus) -> Transferred<Descriptors> {
        macro_rules! ask {
            ($request:expr) => {
                match self.control(stylus, $request, &[])? {
                    Ok(data) => data,
                    Err(error) => return Ok(Err(error)),
                }
            };
        }
        // The first packet tells the packet size of endpoint 0.
        ask!(Request::descriptor(descriptor::DEVICE, 0, 0, 64));
        self.reset(stylus)?;
        self.next_address = self.next_address % 127 + 1;
        let address = self.next_address;
        ask!(Request::set_address(address));
        stylus.usb(move |host, _| host.set_address(address))?;
        stylus.run_for(2 * MS)?;
        let mut read = Descriptors {
            device: ask!(Request::descriptor(descriptor::DEVICE, 0, 0, 18)),
            ..Descriptors::default()
        };
        let head = ask!(Request::descriptor(descriptor::CONFIGURATION, 0, 0, 9));
        let total = total_length(&head);
        read.configuration = ask!(Request::descriptor(descriptor::CONFIGURATION, 0, 0, total));
        if read.device.get(2..4) > Some(&[0x00, 0x02]) {
            let head = ask!(Request::descriptor(descriptor::BOS, 0, 0, 5));
            read.bos = ask!(Request::descriptor(
                descriptor::BOS,
                0,
                0,
                total_length(&head)
            ));
        }
        if let Some((code, length)) = microsoft_set(&read.bos) {
            read.microsoft = ask!(Request {
                kind: 0xC0,
                request: code,
                value: 0,
                index: 7,
                length,
            });
        }
        read.languages = ask!(Request::descriptor(descriptor::STRING, 0, 0, 255));
        let language = match read.languages[..] {
            [_, _, low, high, ..] => u16::from_le_bytes([low, high]),
            _ => 0,
        };
        for (place, string) in [14, 15, 16].into_iter().zip(&mut read.strings) {
            if let Some(&number) = read.device.get(place).filter(|number| **number != 0) {
                *string = ask!(Request::descriptor(
                    descriptor::STRING,
                    number,
                    language,
                    255
                ));
            }
        }
        let value = read.configuration.get(5).copied().unwrap_or_default();
        ask!(Request::set_configuration(value));
        Ok(Ok(read))
    }

    /// Resets the bus, and waits until the device has recovered.
    ///
    /// # Errors
    /// The run is over.
    pub fn reset(&mut self, stylus: &mut VirtualStylus) -> Result<()> {
        let Timing {
            reset_ns,
            recovery_ns,
            ..
        } = self.timing;
        stylus.usb(move |host, now_ns| host.reset_bus(now_ns, reset_ns))?;
        stylus.run_for(reset_ns + recovery_ns)
    }

    /// One control request, with `data` for the device.
    ///
    /// # Errors
    /// The run is over; or, inside, a transfer that failed or took longer than 5 s.
    pub fn control(
        &mut self,
        stylus: &mut VirtualStylus,
        request: Request,
        data: &[u8],
    ) -> Transferred<Vec<u8>> {
        let transfer = Transfer::Control {
            setup: request.bytes(),
            data: data.to_vec(),
        };
        let id = stylus.usb(move |host, _| host.submit(transfer))?;
        Ok(self
            .wait(stylus, id, CONTROL_PATIENCE_NS)?
            .map(|(_, data)| data))
    }

    /// Ends an endpoint's halt, at both ends.
    ///
    /// # Errors
    /// As [`UsbHost::control`].
    pub fn clear_halt(&mut self, stylus: &mut VirtualStylus, endpoint: u8) -> Transferred<()> {
        let cleared = self.control(stylus, Request::clear_halt(endpoint), &[])?;
        if cleared.is_ok() {
            stylus.usb(move |host, _| host.reset_toggle(endpoint))?;
        }
        Ok(cleared.map(|_| ()))
    }

    /// Waits for a transfer's end; returns its instant, and the data from the device.
    ///
    /// # Errors
    /// The run is over; or, inside, a transfer that failed, or that was cancelled because `patience_ns` had passed.
    pub fn wait(
        &mut self,
        stylus: &mut VirtualStylus,
        id: TransferId,
        patience_ns: u64,
    ) -> Transferred<Arrived> {
        let until_ns = stylus.now_ns() + patience_ns;
        loop {
            self.collect(stylus)?;
            if let Some(Completion { at_ns, result, .. }) = self.find_ended(id) {
                return Ok(result.map(|data| (at_ns, data)));
            }
            if stylus.now_ns() >= until_ns {
                stylus.usb(move |host, now_ns| host.cancel(id, now_ns))?;
            } else {
                stylus.run_for(STEP_NS)?;
            }
        }
    }

    /// Takes the completion of a transfer, if it has ended.
    ///
    /// # Errors
    /// The run is over.
    pub fn take_ended(
        &mut self,
        stylus: &mut VirtualStylus,
        id: TransferId,
    ) -> Result<Option<Completion>> {
        self.collect(stylus)?;
        Ok(self.find_ended(id))
    }

    /// Cancels transfers, as when the program that asked for them ends.
    ///
    /// # Errors
    /// The run is over.
    pub fn call_off(&mut self, stylus: &mut VirtualStylus, ids: &[TransferId]) -> Result<()> {
        let cancelled = ids.to_owned();
        stylus.usb(move |host, now_ns| {
            for id in cancelled {
                host.cancel(id, now_ns);
            }
        })?;
        self.collect(stylus)?;
        self.ended.retain(|ended| !ids.contains(&ended.id));
        Ok(())
    }

    /// Takes over the completions from the controller.
    pub(super) fn collect(&mut self, stylus: &mut VirtualStylus) -> Result<()> {
        let ended = stylus.usb(|host, _| host.take_completions())?;
        self.ended.extend(ended);
        Ok(())
    }

    /// Takes the completion of a transfer from those that were taken over.
    pub(super) fn find_ended(&mut self, id: TransferId) -> Option<Completion> {
        let position = self.ended.iter().position(|ended| ended.id == id)?;
        Some(self.ended.remove(position))
    }
}
