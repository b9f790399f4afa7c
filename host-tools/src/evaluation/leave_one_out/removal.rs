//! One node that is being removed, and everything that is played in its place.

use crate::dsp::linear_prediction::error_share;
use crate::dsp::model::Model;
use crate::support::error::Result;
use crate::texture::domain::{Domain, Level, Method, Neighbour};

use super::options::{Options, SMOOTHING_WIDTHS_HZ};
use super::play::{self, Judged, Voice};
use super::prepared::{Prepared, PreparedTexture, Target};
use super::results::{Outcome, Row};

/// The part of a row that determines its timbre. The level is a gain behind the filter: methods that differ by it alone
/// are one synthesis, scaled.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Timbre {
    Own,
    Interpolated(Domain),
    Densified,
    Denser,
}

/// A node that is being removed.
pub(super) struct Removal<'p, 's> {
    prepared: &'p Prepared<'s>,
    target: Target,
    options: &'p Options,
    neighbours: Vec<Neighbour<'p>>,
    /// Syntheses so far.
    pub(super) voices: Vec<(Timbre, Option<Voice>)>,
}

impl<'p, 's> Removal<'p, 's> {
    pub(super) fn new(prepared: &'p Prepared<'s>, target: Target, options: &'p Options) -> Self {
        let texture = &prepared.textures[target.texture];
        Self {
            prepared,
            target,
            options,
            neighbours: texture.neighbours(target.place, options.around),
            voices: Vec::new(),
        }
    }

    fn texture(&self) -> &'p PreparedTexture {
        &self.prepared.textures[self.target.texture]
    }

    /// The model that is played for a timbre.
    fn model(&self, timbre: Timbre) -> Option<Model> {
        let (texture, place) = (self.texture(), self.target.place);
        match timbre {
            Timbre::Own => Some(texture.model(place).clone()),
            Timbre::Densified => texture.densified(place, self.options.around),
            Timbre::Denser => texture.in_denser_grid(place, self.options.around),
            Timbre::Interpolated(domain) => {
                let level = Level::Power;
                let speed_mm_s = self.prepared.set.trials[self.target.trial].speed_mm_s;
                Method { domain, level }.predict(&self.neighbours, speed_mm_s)
            }
        }
    }

    /// Index of the voice of `row`, and the power at which it is to be heard; none if the device cannot play it.
    pub(super) fn voice(&mut self, row: Row) -> Result<Option<(usize, f64)>> {
        let timbre = match row {
            Row::Own => Timbre::Own,
            Row::Densified => Timbre::Densified,
            Row::Denser => Timbre::Denser,
            Row::Interpolated(method) => Timbre::Interpolated(method.domain),
        };
        let known = self.voices.iter().position(|(known, _)| *known == timbre);
        let at = known.unwrap_or(self.voices.len());
        if known.is_none() {
            let seed = self.options.seed.wrapping_add(self.target.trial as u64);
            let model = self.model(timbre);
            let voice = model.map(|model| Voice::of(model, self.options, seed));
            self.voices.push((timbre, voice.transpose()?.flatten()));
        }
        Ok(self.voices[at].1.as_ref().map(|voice| {
            let power = match row {
                Row::Interpolated(method) => method
                    .level
                    .power(&self.neighbours, &voice.model.reflection),
                Row::Own | Row::Densified | Row::Denser => voice.model.output_power,
            };
            (at, power)
        }))
    }

    pub(super) fn outcome(&mut self, row: Row) -> Result<Outcome> {
        let voice = self.voice(row)?;
        let widths: &[f64] = if row.is_followed() {
            &SMOOTHING_WIDTHS_HZ
        } else {
            &[]
        };
        let recorded = &self.prepared.signals[self.target.trial];
        let voice = voice.and_then(|(at, power)| Some((self.voices[at].1.as_ref()?, power)));
        let judged = voice.and_then(|(voice, power)| {
            let synthesised = voice.at_power(power)?;
            let range = self.prepared.ranges[self.target.trial].as_ref()?;
            play::judge(recorded, &synthesised, range, self.options, widths)
        });
        let own = self.texture().model(self.target.place);
        let excitation_error = voice.filter(|_| judged.is_some()).map(|(voice, power)| {
            power * error_share(&voice.model.reflection)
                - own.output_power * error_share(&own.reflection)
        });
        Ok(Outcome {
            is_playable: judged.is_some(),
            order: voice.map_or(0, |(voice, _)| voice.model.reflection.len()),
            excitation_error,
            judged: judged.unwrap_or_else(|| Judged::silence(widths.len())),
        })
    }
}
