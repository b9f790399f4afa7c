//! Requests of the actuator's response: see [`Response`].

use model_format::link::{
    LinkId, Response, ResponseChange, ResponseError, ResponseState, SettingsError, StoredResponse,
};

use super::{Control, Device};

impl<D: Device> Control<D> {
    /// Serves `ResponseGetEndpoint`.
    pub fn response(&self) -> ResponseState {
        let stored = self.response.map(|response| StoredResponse {
            id: response.id(),
            stale: response.stale(&self.settings),
            response,
        });
        ResponseState {
            stored,
            proposed: self.proposed.as_ref().map(|(_, response)| response.id()),
        }
    }

    /// Serves `ResponseProposeEndpoint`: keeps `response` until the settings change or the device restarts, in place of
    /// any response proposed before. Returns the hash of `response`.
    ///
    /// # Errors
    /// Something is played, activated or stored, or the response cannot be stored with the settings in force.
    pub fn propose_response(&mut self, from: LinkId, response: Response) -> Result<u32, ResponseError> {
        if !self.player.is_idle() {
            return Err(SettingsError::Playing.into());
        }
        response.check(&self.settings)?;
        self.proposed = Some((from, response));
        Ok(response.id())
    }

    /// The response that `from` has proposed.
    pub(super) fn proposed_by(&self, from: LinkId) -> Option<&Response> {
        let of_link = self.proposed.as_ref().filter(|(link, _)| *link == from);
        of_link.map(|(_, response)| response)
    }

    /// Blocks playing until [`Control::end_configuration`]. Returns the response to store, or `None` to remove the
    /// stored one.
    ///
    /// # Errors
    /// There is no such response, another link has proposed it, or something is played, activated or stored.
    pub fn begin_response(&mut self, from: LinkId, change: ResponseChange) -> Result<Option<Response>, ResponseError> {
        let (id, found) = match change {
            ResponseChange::Store { id } => (id, self.proposed.as_ref().map(|(_, one)| one)),
            ResponseChange::Clear { id } => (id, self.response.as_ref()),
        };
        let found = found.copied().filter(|response| response.id() == id);
        let response = found.ok_or(ResponseError::NoSuchResponse { id })?;
        let stores = matches!(change, ResponseChange::Store { .. });
        if let Some((by, _)) = self.proposed
            && stores
            && by != from
        {
            return Err(ResponseError::OtherLink { from: by });
        }
        self.begin_configuration()?;
        Ok(stores.then_some(response))
    }
}
