//! Requests of probes, see [`ProbeStart`], and of the actuator's response, see [`Response`].

use core::sync::atomic::Ordering;

use model_format::PlayRate;
use model_format::link::{
    LinkId, PlayError, ProbeError, ProbeLoad, ProbeStart, ProbeStarted, ProbeThrough, Response, ResponseChange,
    ResponseError, ResponseState, Setting, SettingChange, SettingsError, StoredResponse, waveform_crc32,
};
use stylus_kernel::scene::Wave;

use super::{Control, Device};
use crate::TICKS_PER_MS;
use crate::lease::HeldBy;
use crate::player::{Busy, Piece, Probe};
use crate::safety::Config;

/// Ticks from a request to the probe's first sample: 20 ms. The next poll starts the probe's plan, which then plays
/// silence for up to two blocks. This takes 5 ms.
pub const LEAD_TICKS: u64 = 20 * TICKS_PER_MS as u64;

impl<D: Device> Control<D> {
    /// Serves `ProbeLoadEndpoint`.
    ///
    /// # Errors
    /// A probe is played, the other link plays, or the samples end beyond the memory.
    pub fn load_probe(&mut self, from: LinkId, load: &ProbeLoad) -> Result<(), ProbeError> {
        self.check_lease(from)?;
        if self.player.probing().is_some() {
            return Err(ProbeError::Playing);
        }
        let offset = load.offset;
        let rest = self.device.waveform().get(offset.into()..);
        let places = rest.and_then(|rest| rest.get(..load.samples.len()));
        let places = places.ok_or(ProbeError::Offset { offset })?;
        for (place, &sample) in places.iter().zip(&load.samples) {
            place.store(sample, Ordering::Relaxed);
        }
        Ok(())
    }

    /// Serves `ProbeStartEndpoint`, and gives the lease to `from`. The probe ends after its last sample, or when `from`
    /// lets the lease lapse.
    ///
    /// # Errors
    /// A value is out of its range; the loaded waveform is not the requested one; there is no response to play through;
    /// the other link plays; something is played already, or nothing may be played.
    pub fn start_probe(&mut self, from: LinkId, request: &ProbeStart) -> Result<ProbeStarted, ProbeError> {
        self.check_lease(from)?;
        let (rate, samples) = request.check()?;
        self.check_playable().map_err(ProbeError::Refused)?;
        let period = &self.device.waveform()[..request.length.into()];
        let loaded = waveform_crc32(period.iter().map(|sample| sample.load(Ordering::Relaxed)));
        if loaded != request.crc32 {
            return Err(ProbeError::Waveform { loaded });
        }
        let response = match request.through {
            ProbeThrough::Nothing => None,
            ProbeThrough::Stored => Some(self.response.as_ref()),
            ProbeThrough::Proposed => Some(self.proposed_by(from)),
        };
        let response = response
            .map(|response| response.ok_or(ProbeError::NoResponse))
            .transpose()?;
        let proposed = response.filter(|_| request.through == ProbeThrough::Proposed);
        let in_force = self.settings.get(Setting::OutputGain);
        let output_gain = proposed.map_or(in_force, |response| response.output_gain);
        let sections = response.map(|response| response.sections(rate).biquads());

        let now = self.device.now();
        let first_tick = now + LEAD_TICKS;
        let end_tick = first_tick + u64::from(samples.div_ceil(rate.samples_per_tick()));
        let probe = Probe { end_tick, output_gain };
        let begun = self.player.probe(probe, rate);
        begun.map_err(|Busy| ProbeError::Playing)?;
        self.lease.give(from, now);
        self.proposals.end();
        let wave = Wave {
            samples: period,
            total: samples,
            peak_m_s2: request.peak_m_s2,
            first_tick,
        };
        // Six sections and a waveform are within any budget.
        let plan = (self.device).plan_wave(wave, rate, sections.as_deref().unwrap_or_default());
        self.device.prepare(plan);
        self.tell_mute();
        // Rounded up, because the setting may have a fraction of a millisecond.
        let soft_start_ms = self.settings.get(Setting::SoftStart) as u32 + 1;
        Ok(ProbeStarted {
            first_tick,
            whole_tick: first_tick + u64::from(soft_start_ms * TICKS_PER_MS),
            end_tick,
        })
    }

    /// Ends the probe after its last sample, or when the lease of its host has lapsed.
    pub(super) fn end_probe(&mut self, link_lost: bool) {
        let now = self.device.now();
        let probe = self.player.probing();
        if probe.is_some_and(|probe| link_lost || now >= probe.end_tick) {
            // A probe that is played can be stopped, so this does not fail.
            let _ = self.player.stop();
            self.lease.end();
        }
    }

    /// Configuration of the safety stages for `piece`.
    pub(super) fn config(&self, piece: &Piece, rate: PlayRate) -> Config {
        match piece {
            Piece::Selected(request) => Config::at_rate(&self.settings, request.gain, rate),
            Piece::Probe(probe) => {
                let change = SettingChange {
                    setting: Setting::OutputGain,
                    value: probe.output_gain,
                };
                // A proposed gain has been checked, so it is in its range.
                let settings = self.settings.with(change).unwrap_or(self.settings);
                Config::at_rate(&settings, 1.0, rate)
            }
        }
    }

    fn check_lease(&mut self, from: LinkId) -> Result<(), ProbeError> {
        let held = self.lease.check_play(from, self.device.now());
        held.map_err(|HeldBy(by)| ProbeError::Refused(PlayError::Held { by }))
    }
}

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
