//! Values of a coil and its amplifier, as a person has measured them, and what follows from them.

use model_format::link::{Setting, SettingChange};

/// Values of a coil and its amplifier, as a person has measured them.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct Coil {
    /// Resistance of the coil, Ω.
    pub resistance: f32,
    /// Voltage at the coil per voltage at the DAC, V/V.
    pub amplifier_gain: f32,
    /// Power that the coil bears continuously, W.
    pub power_limit: f32,
    /// Largest voltage at the DAC to either side of mid-scale, V.
    pub hard_limit: f32,
}

impl Coil {
    /// The settings of the coil.
    pub fn changes(&self) -> [SettingChange; 4] {
        [
            (Setting::CoilResistance, self.resistance),
            (Setting::AmplifierGain, self.amplifier_gain),
            (Setting::PowerLimit, self.power_limit),
            (Setting::HardLimit, self.hard_limit),
        ]
        .map(|(setting, value)| SettingChange { setting, value })
    }

    /// Voltage at the coil at the hard limit, V.
    pub fn peak_volts(&self) -> f64 {
        f64::from(self.hard_limit) * f64::from(self.amplifier_gain)
    }

    /// Current in the coil at the hard limit, A.
    pub fn peak_amperes(&self) -> f64 {
        self.peak_volts() / f64::from(self.resistance)
    }

    /// Power in the coil at the hard limit, W.
    pub fn peak_watts(&self) -> f64 {
        self.peak_volts() * self.peak_amperes()
    }

    /// Hard limit at which a constant output just reaches the power limit, V.
    pub fn hard_limit_of_power(&self) -> f64 {
        (f64::from(self.power_limit) * f64::from(self.resistance)).sqrt() / f64::from(self.amplifier_gain)
    }

    /// Consequences of the values, one line each.
    pub fn summary(&self) -> Vec<String> {
        let mut lines = vec![format!(
            "at the hard limit: {:.2} V, {:.0} mA, {:.3} W in {} Ω",
            self.peak_volts(),
            1e3 * self.peak_amperes(),
            self.peak_watts(),
            self.resistance
        )];
        lines.push(if self.peak_watts() > f64::from(self.power_limit) {
            format!(
                "that is {:.1} x the power limit of {} W, so the thermal limiter has to reduce it; a hard limit of \
                 {:.3} V would keep within it",
                self.peak_watts() / f64::from(self.power_limit),
                self.power_limit,
                self.hard_limit_of_power()
            )
        } else {
            format!("the power limit of {} W is never reached", self.power_limit)
        });
        lines
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use test_helpers::near;

    #[test]
    fn the_figures_of_a_coil_are_those_of_ohms_law() {
        let coil = Coil {
            resistance: 8.0,
            amplifier_gain: 10.0,
            power_limit: 0.5,
            hard_limit: 0.5,
        };
        near(coil.peak_amperes(), 0.625, 1e-6);
        near(coil.peak_watts(), 3.125, 1e-6);
        near(coil.hard_limit_of_power(), 0.2, 1e-6);
        assert!(coil.summary()[1].contains("6.2 x") || coil.summary()[1].contains("6.3 x"));
    }
}
