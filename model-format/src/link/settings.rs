//! Settings: the properties that differ from one stylus to the next, each a number with a unit and a range.

use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

use super::{FLASH_SUPPLY_MV, FlashOperation, LinkId, MAX_COIL_POWER_WATT, MAX_THERMAL_TIME_CONSTANT_S};
use crate::{AdcCode, Volt};

/// A setting. Flash keeps values in the order of these variants.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize, Schema)]
#[repr(u8)]
pub enum Setting {
    /// ADC code of the force sensor without force.
    ForceZero,
    /// Force per volt above the voltage at [`Self::ForceZero`], N/V.
    ForcePerVolt,
    /// Path per count of the encoder, mm.
    PathPerCount,
    /// ADC code of the accelerometer's X axis without acceleration.
    AccelerationZeroX,
    /// ADC code of the accelerometer's Y axis without acceleration.
    AccelerationZeroY,
    /// ADC code of the accelerometer's Z axis without acceleration.
    AccelerationZeroZ,
    /// Acceleration of axis X per volt above the voltage at [`Self::AccelerationZeroX`], m/s² per V.
    AccelerationPerVoltX,
    /// Acceleration of axis Y per volt above the voltage at [`Self::AccelerationZeroY`], m/s² per V.
    AccelerationPerVoltY,
    /// Acceleration of axis Z per volt above the voltage at [`Self::AccelerationZeroZ`], m/s² per V.
    AccelerationPerVoltZ,
    /// Voltage at the DAC per acceleration, V per m/s².
    OutputGain,
    /// Voltage at the coil per voltage at the DAC, V/V.
    AmplifierGain,
    /// Largest voltage at the DAC to either side of mid-scale, V.
    HardLimit,
    /// Fastest change of the voltage at the DAC, V/ms.
    SlewLimit,
    /// Resistance of the coil, Ω.
    CoilResistance,
    /// Time constant of the coil's warming, s.
    ThermalTimeConstant,
    /// Power that the coil bears continuously, W.
    PowerLimit,
    /// Time of the output's ramp to full level when a mute ends, ms.
    SoftStart,
    /// Time of the output's ramp from full level to mid-scale when the output is muted, ms.
    MuteRamp,
    /// Force above which contact begins, N; 0 derives it from the converter's noise.
    ContactThreshold,
    /// 1 if the amplifier's enable input is wired to PE9, so that the amplifier is off while PE9 is low; 0 if it is
    /// not, or if nobody knows. The self test moves the output only if the value is 1, or if the user states that no
    /// amplifier is connected.
    EnableWired,
}

/// Time for which a proposed change of settings can be applied, ms.
pub const PROPOSAL_VALID_MS: u32 = 60_000;

/// Number of settings.
pub const SETTING_COUNT: usize = 20;

/// Which of two values of a protective setting is tighter, and so protects better.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tighter {
    /// The lower value.
    Lower,
    /// The higher value.
    Higher,
}

impl Tighter {
    /// Returns the tighter one of two values.
    pub fn of(self, one: f32, other: f32) -> f32 {
        match self {
            Self::Lower => one.min(other),
            Self::Higher => one.max(other),
        }
    }
}

/// Name, unit, range and default of a setting.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SettingSpec {
    /// Name of the setting on a command line.
    pub name: &'static str,
    /// Unit of the setting's value.
    pub unit: &'static str,
    /// The lowest value.
    pub lowest: f32,
    /// The highest value.
    pub highest: f32,
    /// The least magnitude; 0 if the value may be 0. A scale must not be 0, because the sensor would then always read
    /// 0.
    pub least_magnitude: f32,
    /// Value of the setting in a device where it was never set. For a setting of [`super::SettingSet::REQUIRED`], the
    /// default is only a placeholder, and nothing is played with it.
    pub default: f32,
    /// True if the value must be a whole number.
    pub whole: bool,
}

impl Setting {
    /// All settings, in the order of their numbers.
    pub const ALL: [Self; SETTING_COUNT] = [
        Self::ForceZero,
        Self::ForcePerVolt,
        Self::PathPerCount,
        Self::AccelerationZeroX,
        Self::AccelerationZeroY,
        Self::AccelerationZeroZ,
        Self::AccelerationPerVoltX,
        Self::AccelerationPerVoltY,
        Self::AccelerationPerVoltZ,
        Self::OutputGain,
        Self::AmplifierGain,
        Self::HardLimit,
        Self::SlewLimit,
        Self::CoilResistance,
        Self::ThermalTimeConstant,
        Self::PowerLimit,
        Self::SoftStart,
        Self::MuteRamp,
        Self::ContactThreshold,
        Self::EnableWired,
    ];

    /// Name, unit, range and default of this setting.
    pub const fn spec(self) -> SettingSpec {
        match self {
            // A sixteenth of the range, because the sensor should have a live zero: an open wire then differs from no
            // force.
            Self::ForceZero => code("force-zero", 4096.0),
            Self::ForcePerVolt => scale("force-per-volt", "N/V", 0.001, 100.0, 2.0),
            Self::PathPerCount => scale("path-per-count", "mm", 1e-6, 10.0, 0.01),
            Self::AccelerationZeroX => code("acceleration-zero-x", 32_768.0),
            Self::AccelerationZeroY => code("acceleration-zero-y", 32_768.0),
            Self::AccelerationZeroZ => code("acceleration-zero-z", 32_768.0),
            Self::AccelerationPerVoltX => acceleration("acceleration-per-volt-x"),
            Self::AccelerationPerVoltY => acceleration("acceleration-per-volt-y"),
            Self::AccelerationPerVoltZ => acceleration("acceleration-per-volt-z"),
            // A gain of 0 is refused, because the device would be silent and report that it plays.
            Self::OutputGain => number("output-gain", "V/(m/s²)", [1e-6, 1.0], 0.01),
            Self::AmplifierGain => number("amplifier-gain", "V/V", [0.01, 100.0], 1.0),
            // The buffered output reaches to within 0.2 V of either rail (DS12110, DAC characteristics), and mid-scale
            // is 1.65 V. The lowest limit is more than a code of the DAC, 0.8 mV, because a lower limit would silence
            // everything.
            Self::HardLimit => number("hard-limit", "V", [0.001, 1.45], 0.5),
            Self::SlewLimit => number("slew-limit", "V/ms", [0.1, 16.0], 4.0),
            Self::CoilResistance => number("coil-resistance", "Ω", [0.1, 1000.0], 8.0),
            Self::ThermalTimeConstant => number("thermal-time-constant", "s", [1.0, MAX_THERMAL_TIME_CONSTANT_S], 10.0),
            Self::PowerLimit => number("power-limit", "W", [0.001, MAX_COIL_POWER_WATT], 0.1),
            Self::SoftStart => number("soft-start", "ms", [1.0, 5000.0], 200.0),
            // With the longest ramp, the output is silent within 100 ms after a link was lost: LINK_LOST_AFTER_MS, a
            // few ms until the mute begins, the ramp and at most 16 ms of slew.
            Self::MuteRamp => number("mute-ramp", "ms", [1.0, 30.0], 20.0),
            Self::ContactThreshold => number("contact-threshold", "N", [0.0, 10.0], 0.0),
            Self::EnableWired => SettingSpec {
                whole: true,
                ..number("enable-wired", "0 or 1", [0.0, 1.0], 0.0)
            },
        }
    }

    /// What this setting is, in a few words for a list.
    pub const fn meaning(self) -> &'static str {
        match self {
            Self::ForceZero => "force sensor's code without force",
            Self::ForcePerVolt => "force per volt above its zero",
            Self::PathPerCount => "way of the tip per encoder count",
            Self::AccelerationZeroX => "accelerometer's code at rest, X",
            Self::AccelerationZeroY => "accelerometer's code at rest, Y",
            Self::AccelerationZeroZ => "accelerometer's code at rest, Z",
            Self::AccelerationPerVoltX => "acceleration per volt, X",
            Self::AccelerationPerVoltY => "acceleration per volt, Y",
            Self::AccelerationPerVoltZ => "acceleration per volt, Z",
            Self::OutputGain => "volts at the pin per m/s² asked for",
            Self::AmplifierGain => "its gain, for the coil's heat",
            Self::HardLimit => "most volts at the pin, either side",
            Self::SlewLimit => "fastest change at the pin",
            Self::CoilResistance => "coil's resistance, for its heat",
            Self::ThermalTimeConstant => "time in which the coil warms",
            Self::PowerLimit => "power that the coil always bears",
            Self::SoftStart => "rise of the output after a mute",
            Self::MuteRamp => "fall of the output in a mute",
            Self::ContactThreshold => "force of contact; 0: by the noise",
            Self::EnableWired => "1: the amplifier's enable is at PE9",
        }
    }

    /// Direction in which a value of this setting protects coil and user better; none if the setting has no such
    /// direction.
    ///
    /// The model of the coil's temperature computes the power as (voltage at the DAC x `amplifier-gain`)² /
    /// `coil-resistance`. So the model limits earlier with a larger gain and with a smaller resistance. A shorter
    /// `thermal-time-constant` is tighter, because a first-order mean over a longer time never exceeds the maximum of
    /// the mean over a shorter time.
    pub const fn tighter(self) -> Option<Tighter> {
        match self {
            Self::OutputGain
            | Self::HardLimit
            | Self::SlewLimit
            | Self::CoilResistance
            | Self::ThermalTimeConstant
            | Self::PowerLimit
            | Self::MuteRamp
            | Self::EnableWired => Some(Tighter::Lower),
            Self::AmplifierGain | Self::SoftStart => Some(Tighter::Higher),
            Self::ForceZero
            | Self::ForcePerVolt
            | Self::PathPerCount
            | Self::AccelerationZeroX
            | Self::AccelerationZeroY
            | Self::AccelerationZeroZ
            | Self::AccelerationPerVoltX
            | Self::AccelerationPerVoltY
            | Self::AccelerationPerVoltZ
            | Self::ContactThreshold => None,
        }
    }

    /// The setting of this name, if there is one.
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|setting| setting.spec().name == name)
    }

    /// Returns `value` if this setting may have it.
    ///
    /// # Errors
    /// A value that is not finite, out of range, below the least magnitude, or not whole where it must be.
    pub fn check(self, value: f32) -> Result<f32, SettingsError> {
        let SettingSpec {
            lowest,
            highest,
            least_magnitude,
            whole,
            ..
        } = self.spec();
        // A comparison with NaN is false. A whole number of this size is exact as i32.
        if (lowest..=highest).contains(&value)
            && value.abs() >= least_magnitude
            && (!whole || value as i32 as f32 == value)
        {
            Ok(value)
        } else {
            Err(SettingsError::OutOfRange {
                setting: self,
                value,
                lowest,
                highest,
            })
        }
    }
}

const fn number(name: &'static str, unit: &'static str, range: [f32; 2], default: f32) -> SettingSpec {
    let [lowest, highest] = range;
    SettingSpec {
        name,
        unit,
        lowest,
        highest,
        least_magnitude: 0.0,
        default,
        whole: false,
    }
}

/// A factor of either sign: its magnitude is from `least` to `most`.
const fn scale(name: &'static str, unit: &'static str, least: f32, most: f32, default: f32) -> SettingSpec {
    SettingSpec {
        least_magnitude: least,
        ..number(name, unit, [-most, most], default)
    }
}

const fn code(name: &'static str, default: f32) -> SettingSpec {
    SettingSpec {
        name,
        unit: "ADC code",
        lowest: 0.0,
        highest: 65_535.0,
        least_magnitude: 0.0,
        default,
        whole: true,
    }
}

const fn acceleration(name: &'static str) -> SettingSpec {
    // The default is 330 mV per standard gravity, as of many analogue accelerometers with a supply of 3.3 V.
    scale(name, "m/s²/V", 0.001, 10_000.0, 29.72)
}

/// Shows as text what a setting requires of a value in addition to its range. A comma precedes each requirement.
struct Besides(SettingSpec);

impl core::fmt::Display for Besides {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        if self.0.whole {
            f.write_str(", a whole number")?;
        }
        if self.0.least_magnitude > 0.0 {
            let least = self.0.least_magnitude;
            write!(f, ", and not between -{least} and {least}")?;
        }
        Ok(())
    }
}

impl core::fmt::Display for Setting {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(self.spec().name)
    }
}

/// A value for each setting, all of them in range.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, Schema)]
#[serde(try_from = "[f32; SETTING_COUNT]")]
pub struct Settings([f32; SETTING_COUNT]);

impl TryFrom<[f32; SETTING_COUNT]> for Settings {
    type Error = SettingsError;

    fn try_from(values: [f32; SETTING_COUNT]) -> Result<Self, SettingsError> {
        for (setting, value) in Setting::ALL.into_iter().zip(values) {
            setting.check(value)?;
        }
        Ok(Self(values))
    }
}

impl Default for Settings {
    fn default() -> Self {
        Self::DEFAULT
    }
}

impl Settings {
    /// Every setting at its default.
    pub const DEFAULT: Self = {
        let mut values = [0.0; SETTING_COUNT];
        let mut index = 0;
        while index < SETTING_COUNT {
            values[index] = Setting::ALL[index].spec().default;
            index += 1;
        }
        Self(values)
    };

    /// The value of `setting`, in its unit.
    pub const fn get(&self, setting: Setting) -> f32 {
        self.0[setting as usize]
    }

    /// Returns these settings with one changed.
    pub fn with(mut self, change: SettingChange) -> Result<Self, SettingsError> {
        self.0[change.setting as usize] = change.setting.check(change.value)?;
        Ok(self)
    }

    /// All settings with their values.
    pub fn iter(&self) -> impl Iterator<Item = SettingChange> {
        let of = |(setting, value)| SettingChange { setting, value };
        Setting::ALL.into_iter().zip(self.0).map(of)
    }

    /// ADC code of the force sensor without force.
    pub const fn force_zero(&self) -> AdcCode {
        AdcCode(self.get(Setting::ForceZero) as u16)
    }

    /// ADC codes of the accelerometer's axes at rest.
    pub const fn acceleration_zero(&self) -> [AdcCode; 3] {
        [
            AdcCode(self.get(Setting::AccelerationZeroX) as u16),
            AdcCode(self.get(Setting::AccelerationZeroY) as u16),
            AdcCode(self.get(Setting::AccelerationZeroZ) as u16),
        ]
    }

    /// Acceleration per voltage of each axis, m/s² per V.
    pub const fn acceleration_per_volt(&self) -> [f32; 3] {
        [
            self.get(Setting::AccelerationPerVoltX),
            self.get(Setting::AccelerationPerVoltY),
            self.get(Setting::AccelerationPerVoltZ),
        ]
    }

    /// Largest voltage at the DAC from mid-scale.
    pub const fn hard_limit(&self) -> Volt {
        Volt(self.get(Setting::HardLimit))
    }
}

/// A setting and a value for it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, Schema)]
pub struct SettingChange {
    /// The setting.
    pub setting: Setting,
    /// The value, in the setting's unit.
    pub value: f32,
}

/// Reason for which settings were not changed. The previous settings stay in force, unless stated otherwise.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, Schema, thiserror::Error)]
#[expect(missing_docs, reason = "each message says it")]
pub enum SettingsError {
    #[error(
        "{setting} of {value}; it must be {lowest} to {highest} {}{}",
        setting.spec().unit, Besides(setting.spec())
    )]
    OutOfRange {
        setting: Setting,
        value: f32,
        /// The lowest value of the setting.
        lowest: f32,
        /// The highest value of the setting.
        highest: f32,
    },
    #[error("settings do not change while a texture is played: stop it first")]
    Playing,
    #[error("a fault while {operation} the settings: try again; if it stays, reset them")]
    Flash {
        /// The operation that failed.
        operation: FlashOperation,
    },
    #[error("{setting} is given twice: give each setting one value")]
    Repeated { setting: Setting },
    #[error("nothing is to be changed: give a setting and its value")]
    Nothing,
    #[error(
        "no change with this token waits: it was applied, another one was proposed, something was played, or {} s have \
         passed; propose it again",
        PROPOSAL_VALID_MS / 1_000
    )]
    NoProposal,
    #[error("{from} has proposed this change, and it alone applies it: propose it on this link")]
    OtherLink {
        /// The link that proposed the change.
        from: LinkId,
    },
    #[error("the supply is below {FLASH_SUPPLY_MV} mV, too low to write flash: see to the supply, then try again")]
    SupplyLow,
}
