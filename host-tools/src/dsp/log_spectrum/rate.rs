//! Spectra of models at twice and at half of their sample rate.

use std::f64::consts::LN_2;

use super::values::LogSpectrum;

/// Fall of the density above the half of the old rate, of which nothing is known: 24 dB per octave of frequency, as
/// the exponent of a power density.
const FALL: f64 = 8.0;

/// Share of the frequencies below the half of the old rate whose mean density the fall begins at.
const LAST_SHARE: f64 = 0.05;

impl LogSpectrum {
    /// The spectrum of the same signal at twice the sample rate, with twice the frequencies at the same step.
    ///
    /// Up to the half of the old rate the density stays. Above it, it falls by 24 dB per octave from the mean of the
    /// last twentieth, so that a model does not end in a wall, which no all-pole model follows.
    #[must_use]
    pub fn at_twice_the_rate(&self) -> Self {
        let last = self.values().len() - 1;
        let end = &self.values()[last - (last as f64 * LAST_SHARE) as usize..];
        let mean = (end.iter().map(|value| value.exp()).sum::<f64>() / end.len() as f64).ln();
        let above = |bin: usize| mean - FALL * (bin as f64 / last as f64).ln();
        // A value is the density times the sample rate.
        let kept = self.values().iter().map(|value| value + LN_2);
        let continued = (last + 1..=2 * last).map(|bin| above(bin) + LN_2);
        Self::from_values(kept.chain(continued).collect())
    }

    /// The spectrum of the same signal at half of the sample rate, without what is above half of that. The number of
    /// frequencies must be odd.
    #[must_use]
    pub fn at_half_the_rate(&self) -> Self {
        let last = (self.values().len() - 1) / 2;
        let kept = self.values()[..=last].iter();
        Self::from_values(kept.map(|value| value - LN_2).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn half_of_twice_the_rate_is_the_spectrum_itself(
            values in prop::collection::vec(-20.0f64..20.0, 41),
        ) {
            let spectrum = LogSpectrum::from_values(values);
            let there = spectrum.at_twice_the_rate();
            prop_assert_eq!(there.values().len(), 81);
            let back = there.at_half_the_rate();
            for (a, b) in spectrum.values().iter().zip(back.values()) {
                prop_assert!((a - b).abs() < 1e-12);
            }
        }
    }

    /// White noise of unit power gets what is above: the integral of x^-8 from 1 to 2, a seventh of its power.
    #[test]
    fn what_is_added_above_white_noise_is_a_seventh_of_its_power() {
        let white = LogSpectrum::from_values(vec![0.0; 10_001]);
        let power = white.at_twice_the_rate().power();
        let above = (1.0 - 0.5f64.powi(7)) / 7.0;
        assert!((power - 1.0 - above).abs() < 1e-3, "{power}");
    }
}
