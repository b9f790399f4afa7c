//! Quantities with their units, as they stand along axes and in files.

/// A quantity with its unit, as it stands along an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Quantity<'a> {
    name: &'a str,
    unit: &'a str,
}

/// Tangential speed.
pub const SPEED: Quantity<'static> = Quantity::new("tangential speed", "mm/s");
/// Normal force.
pub const FORCE: Quantity<'static> = Quantity::new("normal force", "N");
/// Acceleration.
pub const ACCELERATION: Quantity<'static> = Quantity::new("acceleration", "m/s²");
/// Frequency.
pub const FREQUENCY: Quantity<'static> = Quantity::new("frequency", "Hz");
/// Time in seconds.
pub const TIME_S: Quantity<'static> = Quantity::new("time", "s");
/// Time in milliseconds.
pub const TIME_MS: Quantity<'static> = Quantity::new("time", "ms");
/// The paper's cost.
pub const COST: Quantity<'static> = Quantity::new("cost C", "%");
/// The order of a model, which is a count.
pub const ORDER: Quantity<'static> = Quantity::new("order of the model", "");
/// The density of a signal's power over frequency.
pub const POWER_DENSITY: Quantity<'static> =
    Quantity::new("power spectral density", "dB re 1 (m/s²)²/Hz");

impl<'a> Quantity<'a> {
    /// A quantity; the unit of a count or a ratio is empty.
    pub const fn new(name: &'a str, unit: &'a str) -> Self {
        Self { name, unit }
    }

    /// The name.
    pub fn name(&self) -> &str {
        self.name
    }

    /// The unit; empty for a count or a ratio.
    pub fn unit(&self) -> &str {
        self.unit
    }

    /// Name and unit in one line.
    pub fn label(&self) -> String {
        if self.unit.is_empty() {
            self.name.to_owned()
        } else {
            format!("{}, {}", self.name, self.unit)
        }
    }
}
