//! Lines of the mains, and their distinction from lines of a texture.

use crate::dsp::autocorrelation::Autocorrelation;
use model_format::SAMPLE_RATE_HZ;

/// Least level of a mains line above its surroundings, dB.
pub const HUM_RATIO_DB: f64 = 20.0;

/// Mains frequencies, and the second and third harmonics: rectifiers and magnets hum at twice the frequency; Hz.
const MAINS_HZ: [f64; 6] = [50.0, 60.0, 100.0, 120.0, 150.0, 180.0];

/// Returns the frequency of a mains line in the spectrum of a reduced trial, in Hz.
///
/// A line of the texture can coincide with a mains frequency at one speed; [`confirmed_hum`] distinguishes the two.
pub fn mains_line(autocorrelation: &Autocorrelation) -> Option<f64> {
    let bin_hz = f64::from(SAMPLE_RATE_HZ) / autocorrelation.transform_length as f64;
    let power = &autocorrelation.power;
    let bins = |from_hz: f64, to_hz: f64| {
        let from = (from_hz / bin_hz).round() as usize;
        let to = ((to_hz / bin_hz).round() as usize).min(power.len());
        from.min(to)..to
    };
    MAINS_HZ.into_iter().find_map(|mains| {
        let line = bins(mains - 1.0, mains + 1.0);
        let peak = line.max_by(|&a, &b| power[a].total_cmp(&power[b]))?;
        let mut around: Vec<f64> = bins(mains - 10.0, mains - 3.0)
            .chain(bins(mains + 3.0, mains + 10.0))
            .map(|bin| power[bin])
            .collect();
        around.sort_by(f64::total_cmp);
        let median = *around.get(around.len() / 2)?;
        let ratio = 10f64.powf(HUM_RATIO_DB / 10.0);
        (power[peak] > ratio * median && power[peak] > 0.0).then_some(peak as f64 * bin_hz)
    })
}

/// Returns the confirmed mains line, in Hz, of each of a texture's trials, given as speed, mm/s, and mains line, Hz.
///
/// A line that stays at its frequency at half of the speeds or more is of the mains; another one is of the texture.
/// With one or two speeds the two cannot be distinguished, and every line counts as hum.
pub fn confirmed_hum(trials: &[(f64, Option<f64>)]) -> Vec<Option<f64>> {
    let speeds = |lines_only: bool| {
        let mut speeds: Vec<f64> = trials
            .iter()
            .filter(|(_, line)| !lines_only || line.is_some())
            .map(|&(speed, _)| speed)
            .collect();
        speeds.sort_by(f64::total_cmp);
        speeds.dedup();
        speeds.len()
    };
    let (all, with_line) = (speeds(false), speeds(true));
    let mains = all <= 2 || 2 * with_line >= all;
    trials
        .iter()
        .map(|&(_, line)| line.filter(|_| mains))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::super::test_signals::{noise, plus, tone};
    use super::*;

    fn line_of(signal: &[f64]) -> Option<f64> {
        mains_line(&Autocorrelation::of(signal, 400))
    }

    #[test]
    fn mains_lines_are_found_with_their_frequency_and_others_are_not() {
        for frequency_hz in [50.0, 59.9, 100.0, 119.8, 150.2, 180.0] {
            let found = line_of(&plus(&noise(7), tone(frequency_hz, 0.3))).unwrap();
            assert!((found - frequency_hz).abs() < 0.5, "{found}");
        }
        assert_eq!(line_of(&plus(&noise(8), tone(70.0, 0.5))), None);
        assert_eq!(line_of(&vec![0.0; 10_000]), None);
    }

    #[test]
    fn a_textures_own_line_is_not_hum_and_one_at_all_speeds_is() {
        let speeds = [40.0, 50.0, 60.0, 80.0];
        let own: Vec<_> = speeds.map(|v| (v, (v == 50.0).then_some(50.0))).to_vec();
        assert!(confirmed_hum(&own).iter().all(Option::is_none));
        let mains: Vec<_> = speeds.map(|v| (v, Some(50.1))).to_vec();
        assert!(confirmed_hum(&mains).iter().all(Option::is_some));
        assert_eq!(confirmed_hum(&[(100.0, Some(60.0))]), [Some(60.0)]);
    }
}
