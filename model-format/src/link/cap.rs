//! Caps that the image is built with, which no setting exceeds.
//!
//! Settings say what hardware there is, and whoever sets them may be wrong. These constants hold whatever they say. The
//! device knows one thing by itself: the voltage at its own pin. So the power of the coil is capped by that voltage,
//! for the strongest hardware that the image is built for.
//!
//! To build for other hardware, change the three constants and nothing else, and build host and image anew.

use postcard_schema::Schema;
use serde::{Deserialize, Serialize};

/// Largest mean power of the coil, W.
///
/// A stylus of 150 mm by 12 mm has 57 cm² of surface, which gives 10 W/(m² K) to still air: 1 W warms it by 18 K, from
/// 25 to 43 °C, the temperature of a surface that skin bears for hours (ISO 13732-1, burn threshold for contact of
/// eight hours and longer). `power-limit` ends here.
pub const MAX_COIL_POWER_WATT: f32 = 1.0;

/// Gain of the strongest amplifier that the image is built for, V/V.
pub const BUILT_FOR_GAIN: f32 = 10.0;

/// Resistance of the coil that the image is built for, Ω; a coil of less takes more power from the same voltage.
pub const BUILT_FOR_OHM: f32 = 8.0;

/// Largest mean square of the voltage at the pin from mid-scale, V²: the one at which the hardware that the image is
/// built for has [`MAX_COIL_POWER_WATT`].
///
/// This cap holds for any `coil-resistance`, `amplifier-gain` and `power-limit`. A gain that was told too small, or a
/// resistance that was told too large, cannot lead beyond it.
pub const MAX_PIN_MEAN_SQUARE: f32 =
    MAX_COIL_POWER_WATT * BUILT_FOR_OHM / (BUILT_FOR_GAIN * BUILT_FOR_GAIN);

/// Longest `thermal-time-constant`, s. A cold coil takes this long times its power limit, in J, before the thermal
/// limiter acts: 60 J at most, whatever was told.
pub const MAX_THERMAL_TIME_CONSTANT_S: f32 = 60.0;

/// Limits of the output that are in force: by the settings, or by the caps of this module where these are tighter.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize, Schema)]
pub struct OutputLimits {
    /// Largest voltage at the pin to either side of mid-scale, V.
    pub peak_volt: f32,
    /// Mean square of the voltage at the pin that is held for long, V².
    pub mean_square: f32,
    /// Power of the coil at that mean square by the settings' resistance and gain, W.
    pub coil_watt: f32,
    /// True if [`MAX_PIN_MEAN_SQUARE`] limits, and not the settings.
    pub is_capped: bool,
}
