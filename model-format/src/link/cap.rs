//! Caps that are built into the image. No setting can exceed them.
//!
//! Settings describe the hardware, and whoever sets them may be wrong. These constants apply whatever the settings are.
//! The device knows only one quantity by itself: the voltage at its own pin. Therefore the coil's power is capped by a
//! cap on that voltage, for the strongest hardware that the image is built for.
//!
//! To build for other hardware, change only [`MAX_COIL_POWER_WATT`], [`BUILT_FOR_GAIN`] and [`BUILT_FOR_OHM`], and
//! build host and image again.

use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

/// Largest mean power of the coil, W.
///
/// A stylus of 150 mm by 12 mm has a surface of 57 cm², which loses 10 W/(m² K) to still air. So 1 W warms it by 18 K,
/// from 25 to 43 °C. Skin tolerates a surface of this temperature for hours (ISO 13732-1, burn threshold for contact of
/// eight hours and longer). The range of `power-limit` ends at this power.
pub const MAX_COIL_POWER_WATT: f32 = 1.0;

/// Gain of the strongest amplifier that the image is built for, V/V.
pub const BUILT_FOR_GAIN: f32 = 10.0;

/// Resistance of the coil that the image is built for, Ω. A coil of lower resistance takes more power at the same
/// voltage.
pub const BUILT_FOR_OHM: f32 = 8.0;

/// Largest mean square of the voltage at the pin from mid-scale, V². At this value, the hardware that the image is
/// built for has a coil power of [`MAX_COIL_POWER_WATT`].
///
/// This cap holds for any `coil-resistance`, `amplifier-gain` and `power-limit`. A gain that is set too small, or a
/// resistance that is set too large, cannot lead beyond the cap.
pub const MAX_PIN_MEAN_SQUARE: f32 = MAX_COIL_POWER_WATT * BUILT_FOR_OHM / (BUILT_FOR_GAIN * BUILT_FOR_GAIN);

/// Longest `thermal-time-constant`, s. Before the thermal limiter acts, a cold coil takes up an energy of this time
/// constant times its power limit: 60 J at most, for any settings.
pub const MAX_THERMAL_TIME_CONSTANT_S: f32 = 60.0;

/// Limits of the output that are in force: those of the settings, or the caps of this module where the caps are
/// tighter.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, Schema)]
pub struct OutputLimits {
    /// Largest voltage at the pin to either side of mid-scale, V.
    pub peak_volt: f32,
    /// Mean square of the voltage at the pin that the thermal limiter allows continuously, V².
    pub mean_square: f32,
    /// Power of the coil at that mean square, computed with the settings' resistance and gain, W.
    pub coil_watt: f32,
    /// True if [`MAX_PIN_MEAN_SQUARE`] determines the mean square, and not the settings.
    pub is_capped: bool,
}
