//! Requests about probes, and about the actuator's response that probes measure.

use model_format::link::{
    ProbeLoad, ProbeLoadEndpoint, ProbeStart, ProbeStartEndpoint, ProbeStarted, Response, ResponseChange,
    ResponseGetEndpoint, ResponseProposeEndpoint, ResponseSetEndpoint, ResponseState, waveform_crc32,
};

use super::connection::Device;
use crate::link::error::Result;

impl Device {
    /// Loads one period of a probe's waveform. Returns its checksum, for [`ProbeStart::crc32`].
    pub fn load_probe(&self, period: &[i16]) -> Result<u32> {
        for load in ProbeLoad::parts(period) {
            self.request::<ProbeLoadEndpoint>("probe load", &load)??;
        }
        Ok(waveform_crc32(period.iter().copied()))
    }

    /// Plays the waveform that was loaded. While it plays, the host sends [`Device::keep_alive`] every
    /// [`model_format::link::KEEP_ALIVE_MS`].
    pub fn start_probe(&self, start: &ProbeStart) -> Result<ProbeStarted> {
        Ok(self.request::<ProbeStartEndpoint>("probe", start)??)
    }

    /// Reads which response is stored, and which is proposed.
    pub fn response(&self) -> Result<ResponseState> {
        self.request::<ResponseGetEndpoint>("response", &())
    }

    /// Proposes a response, through which a probe may then be played. Stored data does not change. Returns the
    /// response's hash.
    pub fn propose_response(&self, response: &Response) -> Result<u32> {
        let id = self.request::<ResponseProposeEndpoint>("response proposal", response)??;
        if id == response.id() {
            Ok(id)
        } else {
            Err(self.not_verified("the device took another response than this one: propose it again".to_owned()))
        }
    }

    /// Stores the response that was proposed over this link, or removes the stored one, and checks this by reading the
    /// state back.
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
            Err(self.not_verified("the response was changed, but another one reads back: change it again".to_owned()))
        }
    }
}
