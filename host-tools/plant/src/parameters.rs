//! Parameters of a plant.

use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

use serde::{Deserialize, Serialize};
use toml::Value;

use crate::chance::Chance;
use crate::fault::{Axis, Fault};

/// Largest size of a file of parameters, bytes: a hundred times that of a preset.
const MAX_BYTES: u64 = 64 * 1024;

/// Names of the presets. Each is an actuator that is held lightly.
pub const PRESETS: [&str; 2] = ["haptuator", "mark-ii-d"];

/// Parameters that cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[expect(missing_docs, reason = "each message says it")]
pub enum Error {
    #[error("not the parameters of an actuator model: {0}")]
    Form(String),
    /// A file that cannot be used.
    #[error("{path}: {reason}")]
    File { path: String, reason: String },
    #[error("{name} of {value}: it must be {least} to {most}")]
    OutOfRange {
        /// Table and key of the value.
        name: String,
        value: String,
        least: String,
        most: String,
    },
    #[error(
        "there is no actuator model '{0}': name one of {names}, with /light, /firm or /free for the hand",
        names = PRESETS.join(", ")
    )]
    NoPreset(String),
}

/// A result with an [`Error`] of parameters.
pub type Result<T> = std::result::Result<T, Error>;

/// A voice coil with a moving mass on a spring.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Coil {
    /// Resistance, Ω.
    pub resistance_ohm: f64,
    /// Inductance, H.
    pub inductance_h: f64,
    /// Force per current, N/A; the same number is the back-EMF per velocity, V per m/s.
    pub force_n_per_a: f64,
    /// Moving mass, kg.
    pub moving_mass_kg: f64,
    /// Stiffness of the spring between moving mass and body, N/m.
    pub stiffness_n_per_m: f64,
    /// Damping between moving mass and body, N per m/s.
    pub damping_n_s_per_m: f64,
    /// Power that the coil bears continuously, W. No equation uses it; it is the value that an owner would set.
    pub rated_watts: f64,
}

/// The amplifier between pin and coil.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Amplifier {
    /// Voltage at the coil per voltage at the pin.
    pub gain: f64,
    /// Voltage at the coil without a signal, V.
    pub offset_volts: f64,
    /// Corner of the high-pass at its input, Hz; 0 for none.
    pub low_hz: f64,
    /// Corner of the low-pass at its output, Hz.
    pub high_hz: f64,
    /// Largest voltage to either side, V.
    pub clip_volts: f64,
    /// Time from a rise of the enable until the amplifier outputs a signal, s. A fall of the enable mutes it at once.
    pub wake_s: f64,
}

/// The stylus without its moving mass: tip, actuator's case, electronics. It is rigid.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Body {
    /// Mass, kg.
    pub mass_kg: f64,
}

/// A grip: a spring and a damper from the body to a hand that does not move.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Hand {
    /// Stiffness, N/m.
    pub stiffness_n_per_m: f64,
    /// Damping, N per m/s.
    pub damping_n_s_per_m: f64,
}

impl Hand {
    /// A light grip; the source of the figures is at the head of the preset `haptuator`.
    pub const LIGHT: Self = Self {
        stiffness_n_per_m: 228.0,
        damping_n_s_per_m: 0.5,
    };
    /// A firm grip, from the same source.
    pub const FIRM: Self = Self {
        stiffness_n_per_m: 1043.0,
        damping_n_s_per_m: 2.4,
    };
    /// No hand: the stylus hangs on a thread.
    pub const FREE: Self = Self {
        stiffness_n_per_m: 0.0,
        damping_n_s_per_m: 0.0,
    };
}

/// An analogue accelerometer of three axes on the body.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Accelerometer {
    /// The axis nearest to the actuator's.
    pub main_axis: Axis,
    /// Angle between the main axis and the actuator's, degrees.
    pub tilt_deg: f64,
    /// Direction of that angle around the main axis, degrees. It counts from the next axis (Y after X) towards the axis
    /// after that.
    pub azimuth_deg: f64,
    /// Sensitivity, V per m/s².
    pub volts_per_m_s2: f64,
    /// Voltages at rest relative to mid-scale, caused by bias and gravity, V.
    pub rest_volts: [f64; 3],
    /// Density of each axis's noise, m/s² per √Hz.
    pub noise_m_s2_per_root_hz: [f64; 3],
    /// Corner of each axis's low-pass, Hz.
    pub bandwidth_hz: [f64; 3],
    /// Largest acceleration to either side that an axis shows, m/s².
    pub saturation_m_s2: f64,
}

/// All parameters of a plant.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Parameters {
    /// The voice coil.
    pub coil: Coil,
    /// The amplifier.
    pub amplifier: Amplifier,
    /// The body.
    pub body: Body,
    /// The hand that holds it.
    pub hand: Hand,
    /// The accelerometer.
    pub accelerometer: Accelerometer,
    /// Faults of the plant.
    #[serde(default)]
    pub faults: Vec<Fault>,
}

impl Parameters {
    /// The parameters in a TOML text: the tables `coil`, `amplifier`, `body`, `hand` and `accelerometer`, and any
    /// number of `[[faults]]`.
    pub fn from_toml(text: &str) -> Result<Self> {
        let parameters: Self = toml::from_str(text).map_err(|error| Error::Form(error.to_string()))?;
        parameters.check()?;
        Ok(parameters)
    }

    /// A preset by its name, one of [`PRESETS`], with `/light`, `/firm` or `/free` after it for another hand.
    pub fn preset(name: &str) -> Result<Self> {
        let unknown = || Error::NoPreset(name.to_owned());
        // The figures of every preset are those of a light grip.
        let (actuator, hand) = name.split_once('/').unwrap_or((name, "light"));
        let text = match actuator {
            "haptuator" => include_str!("../presets/haptuator.toml"),
            "mark-ii-d" => include_str!("../presets/mark-ii-d.toml"),
            _ => return Err(unknown()),
        };
        let hand = match hand {
            "light" => Hand::LIGHT,
            "firm" => Hand::FIRM,
            "free" => Hand::FREE,
            _ => return Err(unknown()),
        };
        let parameters = Self::from_toml(text)?;
        Ok(Self { hand, ..parameters })
    }

    /// The parameters in the TOML file `source`, or those of the preset of that name if no such file can be read.
    ///
    /// # Errors
    /// A file that cannot be read or used or is longer than 64 KiB, or a name that is neither a file nor a preset.
    pub fn read(source: &Path) -> Result<Self> {
        let name = source.display().to_string();
        let file = |reason: String| Error::File {
            path: name.clone(),
            reason,
        };
        let text = || -> io::Result<String> {
            let mut text = String::new();
            File::open(source)?.take(MAX_BYTES + 1).read_to_string(&mut text)?;
            Ok(text)
        };
        match text() {
            Ok(text) if text.len() as u64 > MAX_BYTES => Err(file(format!(
                "has more than {MAX_BYTES} bytes, the most of a plant's parameters"
            ))),
            Ok(text) => Self::from_toml(&text).map_err(|error| file(error.to_string())),
            Err(error) => Self::preset(&name).map_err(|unknown| file(format!("{error}; {unknown}"))),
        }
    }

    /// Returns another specimen of the same design, in another grip if a hand holds it, and with the accelerometer at
    /// another angle. `seed` determines it. The faults stay the same. No value leaves the range that [`Self::check`]
    /// allows.
    #[must_use]
    pub fn varied(&self, seed: u64) -> Self {
        let mut chance = Chance(seed);
        let mut varied = self.clone();
        let mut vary = |value: &mut f64, share: f64| *value = chance.about(*value, share);
        vary(&mut varied.coil.resistance_ohm, 0.05);
        vary(&mut varied.coil.inductance_h, 0.15);
        vary(&mut varied.coil.force_n_per_a, 0.1);
        vary(&mut varied.coil.moving_mass_kg, 0.05);
        vary(&mut varied.coil.stiffness_n_per_m, 0.2);
        vary(&mut varied.coil.damping_n_s_per_m, 0.3);
        vary(&mut varied.amplifier.gain, 0.05);
        vary(&mut varied.amplifier.high_hz, 0.1);
        vary(&mut varied.body.mass_kg, 0.1);
        vary(&mut varied.hand.stiffness_n_per_m, 1.0);
        vary(&mut varied.hand.damping_n_s_per_m, 1.0);
        vary(&mut varied.accelerometer.volts_per_m_s2, 0.02);
        varied.amplifier.offset_volts += chance.within(0.01);
        let accelerometer = &mut varied.accelerometer;
        accelerometer.tilt_deg += chance.within(15.0);
        accelerometer.azimuth_deg += chance.within(180.0);
        for volts in &mut accelerometer.rest_volts {
            *volts += chance.within(0.05);
        }
        let mut value = Value::try_from(varied).expect("parameters have the form of a table");
        hold_in_range("", &mut value);
        value.try_into().expect("the form is the same")
    }

    /// Checks that every value is one that a plant may have, so that its steps stay finite.
    pub fn check(&self) -> Result<()> {
        // In the form of a table, one list of ranges by key checks all tables, those of faults too.
        let table = toml::Table::try_from(self).map_err(|error| Error::Form(error.to_string()))?;
        check_in("", &table)
    }
}

/// Keys of all numbers, the least and the largest value of each.
const RANGES: [(&str, f64, f64); 27] = [
    ("resistance_ohm", 0.1, 1e3),
    ("inductance_h", 1e-6, 1.0),
    ("force_n_per_a", 0.0, 100.0),
    ("moving_mass_kg", 1e-5, 1.0),
    ("stiffness_n_per_m", 0.0, 1e6),
    ("damping_n_s_per_m", 0.0, 1e3),
    ("rated_watts", 1e-3, 100.0),
    ("gain", 0.01, 100.0),
    ("offset_volts", -1.0, 1.0),
    ("low_hz", 0.0, 1e3),
    ("high_hz", 100.0, 1e6),
    ("clip_volts", 0.01, 100.0),
    ("wake_s", 0.0, 10.0),
    ("mass_kg", 1e-3, 10.0),
    ("tilt_deg", -180.0, 180.0),
    ("azimuth_deg", -360.0, 360.0),
    ("volts_per_m_s2", 1e-5, 10.0),
    ("rest_volts", -1.65, 1.65),
    ("noise_m_s2_per_root_hz", 0.0, 10.0),
    ("bandwidth_hz", 1.0, 1e5),
    ("saturation_m_s2", 0.1, 1e5),
    ("volts", 1e-3, 100.0),
    ("gap_m", 0.0, 0.1),
    ("doubles_at_m", 1e-5, 1.0),
    ("hz", 1.0, 1e4),
    ("coil_volts", 0.0, 100.0),
    ("accelerometer_volts", 0.0, 3.3),
];

fn check_in(path: &str, table: &toml::Table) -> Result<()> {
    table
        .iter()
        .try_for_each(|(key, value)| check_value(&format!("{path}{key}"), key, value))
}

fn check_value(path: &str, key: &str, value: &Value) -> Result<()> {
    match value {
        Value::Table(table) => check_in(&format!("{path}."), table),
        Value::Array(values) => values.iter().try_for_each(|value| check_value(path, key, value)),
        Value::Float(number) => {
            let (least, most) = range(key);
            // A comparison with NaN is false.
            if (least..=most).contains(number) {
                return Ok(());
            }
            Err(Error::OutOfRange {
                name: path.to_owned(),
                value: number.to_string(),
                least: least.to_string(),
                most: most.to_string(),
            })
        }
        // Names of axes and kinds of faults are texts, and checked by their types.
        _ => Ok(()),
    }
}

/// Moves every number of `value`, which is at `key`, to the nearest one in its range.
fn hold_in_range(key: &str, value: &mut Value) {
    match value {
        Value::Table(table) => table.iter_mut().for_each(|(key, value)| hold_in_range(key, value)),
        Value::Array(values) => values.iter_mut().for_each(|value| hold_in_range(key, value)),
        Value::Float(number) => {
            let (least, most) = range(key);
            *number = number.clamp(least, most);
        }
        _ => {}
    }
}

/// Returns the least and the largest value of the number at `key`.
fn range(key: &str) -> (f64, f64) {
    let range = RANGES.iter().find(|(of, ..)| *of == key);
    let &(_, least, most) = range.expect("every number has a range");
    (least, most)
}
