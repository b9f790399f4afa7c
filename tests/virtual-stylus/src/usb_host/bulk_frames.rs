//! Frames over a pair of bulk endpoints.

use std::collections::VecDeque;

use super::enumeration::{Arrived, Transferred, UsbHost};
use crate::error::Result;
use crate::model::usb::host::{PACKET_BYTES, Transfer, TransferId};
use crate::stylus::VirtualStylus;

/// Frames over a pair of bulk endpoints, as a program on the host exchanges them. A frame is a transfer, which a packet
/// that is not full ends.
#[derive(Debug)]
pub struct BulkFrames {
    output: u8,
    input: u8,
    bytes: usize,
    waiting: VecDeque<TransferId>,
    sending: VecDeque<TransferId>,
}

impl BulkFrames {
    /// Frames between an OUT and an IN endpoint of these addresses; `waiting` IN transfers of `bytes` wait for the
    /// device.
    ///
    /// # Errors
    /// The run is over.
    pub fn open(
        stylus: &mut VirtualStylus,
        output: u8,
        input: u8,
        bytes: usize,
        waiting: usize,
    ) -> Result<Self> {
        let mut frames = Self {
            output: output & 0x0F,
            input: input & 0x0F,
            bytes: bytes.next_multiple_of(PACKET_BYTES),
            waiting: VecDeque::new(),
            sending: VecDeque::new(),
        };
        for _ in 0..waiting {
            frames.await_one(stylus)?;
        }
        Ok(frames)
    }

    fn await_one(&mut self, stylus: &mut VirtualStylus) -> Result<()> {
        let (endpoint, bytes) = (self.input, self.bytes);
        let id = stylus.usb(move |host, _| host.submit(Transfer::In { endpoint, bytes }))?;
        self.waiting.push_back(id);
        Ok(())
    }

    /// Sends a frame, behind those that wait.
    ///
    /// # Errors
    /// The run is over.
    pub fn send(&mut self, stylus: &mut VirtualStylus, frame: &[u8]) -> Result<()> {
        let (endpoint, data) = (self.output, frame.to_vec());
        let ids = stylus.usb(move |host, _| {
            let is_full = data.len().is_multiple_of(PACKET_BYTES) && !data.is_empty();
            let first = host.submit(Transfer::Out { endpoint, data });
            let end = is_full.then(|| {
                host.submit(Transfer::Out {
                    endpoint,
                    data: Vec::new(),
                })
            });
            [Some(first), end]
        })?;
        self.sending.extend(ids.into_iter().flatten());
        Ok(())
    }

    /// Takes the frames that have come, each with the instant of its last packet.
    ///
    /// # Errors
    /// The run is over; or, inside, a transfer that failed. The link is over then.
    pub fn receive(
        &mut self,
        usb: &mut UsbHost,
        stylus: &mut VirtualStylus,
    ) -> Transferred<Vec<Arrived>> {
        let mut frames = Vec::new();
        usb.collect(stylus)?;
        while let Some(&id) = self.sending.front()
            && let Some(ended) = usb.find_ended(id)
        {
            self.sending.pop_front();
            if let Err(error) = ended.result {
                return Ok(Err(error));
            }
        }
        while let Some(&id) = self.waiting.front()
            && let Some(ended) = usb.find_ended(id)
        {
            self.waiting.pop_front();
            match ended.result {
                Err(error) => return Ok(Err(error)),
                Ok(data) => {
                    self.await_one(stylus)?;
                    if !data.is_empty() {
                        frames.push((ended.at_ns, data));
                    }
                }
            }
        }
        Ok(Ok(frames))
    }

    /// Cancels all transfers that wait.
    ///
    /// # Errors
    /// The run is over.
    pub fn close(self, usb: &mut UsbHost, stylus: &mut VirtualStylus) -> Result<()> {
        let waiting: Vec<TransferId> = self.sending.into_iter().chain(self.waiting).collect();
        usb.call_off(stylus, &waiting)
    }
}
