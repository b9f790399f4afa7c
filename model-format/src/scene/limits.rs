//! Bounds that every scene keeps.

/// Largest number of scenes in a library.
pub const MAX_SCENES: usize = 32;

/// Largest number of surfaces in a scene.
pub const MAX_SURFACES: usize = 16;

/// Largest number of regions in a scene.
pub const MAX_REGIONS: usize = 32;

/// Largest number of sections of an equaliser.
pub const MAX_SECTIONS: usize = 8;

/// Largest number of sections of the response's equaliser in the device. They follow the sections of a scene.
pub const MAX_RESPONSE_SECTIONS: usize = 6;

/// Largest distance of a position from the path's origin, in either direction, mm. At 100 m, a step of `f32` is still 8
/// µm.
pub const MAX_POSITION_MM: f32 = 100_000.0;

/// Widest transition, mm.
pub const MAX_TRANSITION_MM: f32 = 100.0;

/// Largest gain of a texture. A gain above 1 must leave the texture's loudest node at most half the highest RMS that a
/// library's node may have.
pub const MAX_GAIN: f32 = 64.0;

/// Highest constant speed, mm/s.
pub const MAX_SPEED_MM_S: f32 = 10_000.0;

/// Highest constant force, N.
pub const MAX_FORCE_N: f32 = 1000.0;

/// Lowest frequency of a tap transient, Hz.
pub const MIN_TAP_HZ: f32 = 10.0;

/// Highest frequency of a tap transient, as a fraction of the sample rate.
pub const MAX_TAP_SHARE_OF_RATE: f32 = 0.45;

/// Shortest and longest time constant of a tap transient, s.
pub const TAP_DECAY_S: [f32; 2] = [0.000_5, 1.0];

/// Largest gain of a tap transient, m/s² per N/s.
pub const MAX_TAP_GAIN: f32 = 100.0;

/// Largest amplitude of a tap transient, m/s²: an eighth of the output's full scale.
pub const MAX_TAP_M_S2: f32 = 256.0;

/// Shortest and longest period of stick-slip, mm.
pub const STICK_SLIP_PERIOD_MM: [f32; 2] = [0.01, 1000.0];

/// Smallest and largest fraction of a period that a slip takes.
pub const STICK_SLIP_DUTY: [f32; 2] = [0.05, 1.0];

/// Lowest threshold of stick-slip, of speed in mm/s and of force in N.
pub const MIN_STICK_SLIP_THRESHOLD: f32 = 0.001;

/// Largest radius of a pole of an equaliser's section, in 1024ths: 1023/1024 corresponds to a time constant of 1023
/// samples, 0.2 s at 5 kHz.
pub const MAX_POLE_RADIUS_1024THS: i64 = 1023;

/// Largest gain at any frequency, 24 dB: of each section of an equaliser, and of the sections from the first up to
/// each.
pub const MAX_EQUALISER_GAIN: f64 = 16.0;
