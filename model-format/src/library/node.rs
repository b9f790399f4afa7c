//! The model at a node of a grid.

/// The model at one node of a grid.
#[derive(Clone, Copy, Debug)]
pub struct Node<'a> {
    /// Variance of the model's output, (m/s²)².
    pub output_power: f32,
    /// Variance of the prediction error of the model that was fitted, (m/s²)². It is only for reports.
    pub prediction_error_power: f32,
    /// Flags of the node: its origin, and whether it is silent or doubtful.
    pub flags: NodeFlags,
    /// The model's coefficients; their number is the model's order.
    pub coefficients: Coefficients<'a>,
}

/// A node's coefficients as stored: little-endian and not aligned. Their number is the model's order.
///
/// θ of stage 1 comes first; θ = (code · 256 + fraction) · [`crate::FINE_THETA_STEP_RAD`]. See
/// [`Coefficients::thetas`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Coefficients<'a> {
    /// The codes, `i16` in steps of [`crate::THETA_STEP_RAD`].
    pub codes: &'a [[u8; 2]],
    /// Fractions of θ of the first stages, `i8`; at most as many as codes. Further stages have a fraction of 0.
    pub fractions: &'a [u8],
    /// The stages after those of `codes`.
    pub tail: Tail<'a>,
}

/// The last stages of a lattice, whose θ is stored in one byte.
///
/// The tail is empty, or it begins after the first [`crate::limits::MAX_FINE_STAGES`] stages.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct Tail<'a> {
    /// The codes, `i8`, at least -127: θ = code · step.
    pub codes: &'a [u8],
    /// Step of a code, in units of [`crate::FINE_THETA_STEP_RAD`]. Even 127 of the largest steps are below π/2.
    pub step: u16,
}

impl Tail<'_> {
    /// θ of the stages, in steps of [`crate::FINE_THETA_STEP_RAD`].
    pub fn thetas(self) -> impl Iterator<Item = i32> {
        let step = i32::from(self.step);
        let codes = self.codes.iter();
        codes.map(move |code| i32::from(code.cast_signed()) * step)
    }
}

/// Set of flags of a node: its origin, and whether it is silent or doubtful.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub struct NodeFlags(pub(super) u8);

impl NodeFlags {
    /// No flag: the model was fitted to a recording.
    pub const NONE: Self = Self(0);
    /// A silent node, whose output power is zero.
    pub const SILENT: Self = Self(1);
    /// No recording: the node was filled from measured nodes on both sides.
    pub const INTERPOLATED: Self = Self(2);
    /// No recording: the node lies beyond the last measured ones and was taken over from the nearest of them.
    pub const EXTRAPOLATED: Self = Self(4);
    /// Triage found a fault in a recording behind this node.
    pub const DOUBTFUL: Self = Self(8);

    const KNOWN: u8 = 0b1111;

    /// Union of both sets.
    #[must_use]
    pub const fn with(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// Returns whether all flags of `other` are set.
    pub const fn contains(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }

    /// The stored byte.
    pub const fn bits(self) -> u8 {
        self.0
    }

    pub(super) const fn from_bits(bits: u16) -> Option<Self> {
        if bits & !(Self::KNOWN as u16) == 0 {
            Some(Self(bits as u8))
        } else {
            None
        }
    }
}

impl<'a> Coefficients<'a> {
    /// Order of the model.
    pub fn order(&self) -> usize {
        self.codes.len() + self.tail.codes.len()
    }

    /// θ of all stages, stage 1 first, in steps of [`crate::FINE_THETA_STEP_RAD`]; below 2²³ in magnitude.
    pub fn thetas(self) -> impl Iterator<Item = i32> + use<'a> {
        let fractions = self.fractions.iter().copied().chain(core::iter::repeat(0));
        let codes = self.codes.iter().zip(fractions);
        codes
            .map(|(&code, fraction)| theta(i16::from_le_bytes(code), fraction.cast_signed()))
            .chain(self.tail.thetas())
    }
}

/// θ of a code and its fraction, in steps of [`crate::FINE_THETA_STEP_RAD`].
pub(crate) fn theta(code: i16, fraction: i8) -> i32 {
    (i32::from(code) << crate::THETA_FRACTION_BITS) + i32::from(fraction)
}
