//! Requests of probes, and of the actuator's response that they measure.

use model_format::link::{
    LIBRARY_CRC, PROBE_CHUNK_SAMPLES, ProbeLoad, ProbeLoadEndpoint, ProbeStart, ProbeStartEndpoint,
    ProbeStarted, Response, ResponseChange, ResponseGetEndpoint, ResponseProposeEndpoint,
    ResponseSetEndpoint, ResponseState,
};

use super::connection::Device;
use crate::link::error::Result;

impl Device {
    /// Loads one period of a probe's waveform. Returns its checksum, for [`ProbeStart::crc32`].
    ///
    /// # Errors
    /// A refusal, a lost link or a missing answer.
    pub fn load_probe(&self, period: &[i16]) -> Result<u32> {
        let mut digest = LIBRARY_CRC.digest();
        for (number, samples) in period.chunks(PROBE_CHUNK_SAMPLES).enumerate() {
            let load = ProbeLoad {
                // A waveform that is too long is refused.
                offset: u16::try_from(number * PROBE_CHUNK_SAMPLES).unwrap_or(u16::MAX),
                samples: samples.iter().copied().collect(),
            };
            self.request::<ProbeLoadEndpoint>("probe load", &load)??;
            let bytes: Vec<u8> = samples.iter().flat_map(|s| s.to_le_bytes()).collect();
            digest.update(&bytes);
        }
        Ok(digest.finalize())
    }

    /// Plays the waveform that was loaded. While it plays, the host sends [`Device::keep_alive`] every
    /// [`model_format::link::KEEP_ALIVE_MS`].
    ///
    /// # Errors
    /// A refusal, a lost link or a missing answer.
    pub fn start_probe(&self, start: &ProbeStart) -> Result<ProbeStarted> {
        Ok(self.request::<ProbeStartEndpoint>("probe", start)??)
    }

    /// Reads which response is stored, and which is proposed.
    ///
    /// # Errors
    /// A lost link or a missing answer.
    pub fn response(&self) -> Result<ResponseState> {
        self.request::<ResponseGetEndpoint>("response", &())
    }

    /// Proposes a response, which a probe may then play through. Nothing that is stored changes. Returns its hash.
    ///
    /// # Errors
    /// A refusal, a lost link or a missing answer; an answer about another response.
    pub fn propose_response(&self, response: &Response) -> Result<u32> {
        let id = self.request::<ResponseProposeEndpoint>("response proposal", response)??;
        if id == response.id() {
            Ok(id)
        } else {
            Err(self.not_verified(
                "the device took another response than this one: propose it again".to_owned(),
            ))
        }
    }

    /// Stores the response that was proposed over this link, or removes the stored one, and reads it back.
    ///
    /// # Errors
    /// A refusal, a lost link or a missing answer, or another response read back.
    pub fn set_response(&self, change: ResponseChange) -> Result<ResponseState> {
        self.request_flash::<ResponseSetEndpoint>("response change", &change)??;
        let state = self.response()?;
        let wanted = match change {
            ResponseChange::Store { id } => Some(id),
            ResponseChange::Clear { .. } => None,
        };
        if state.stored.as_ref().map(|stored| stored.id) == wanted {
            Ok(state)
        } else {
            Err(self.not_verified(
                "the response was changed, but another one reads back: change it again".to_owned(),
            ))
        }
    }
}
