//! The place at which a proof ended, and the reason.

/// A cell that could not be proved stable.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Refusal {
    /// Index of the texture in its library.
    pub texture: usize,
    /// Speed index of the cell.
    pub speed: usize,
    /// Force index of the cell.
    pub force: usize,
    /// Frequency at which the proof ended, in steps of 2⁻³² of the sample rate.
    pub frequency: u32,
    /// Reason.
    pub cause: Cause,
}

/// Reason of a refusal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cause {
    /// Some mean of the cell's nodes has a zero on the unit circle, or one too near to tell: it is unstable, or some
    /// other mean is.
    OnCircle,
    /// |A| falls below the margin that the certificate claims.
    Margin,
    /// The nodes have zeros outside the unit circle: they are unstable.
    Outside,
    /// The proof takes more effort than is allowed for a cell.
    Effort,
}

impl core::fmt::Display for Cause {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::OnCircle => "unstable, or too near to it to tell",
            Self::Margin => "nearer to unstable than its certificate claims",
            Self::Outside => "unstable",
            Self::Effort => "not proved stable with the effort allowed",
        })
    }
}

impl Refusal {
    /// Frequency at which the proof ended, Hz, at this sample rate.
    pub fn frequency_hz(&self, sample_rate_hz: u32) -> u32 {
        ((u64::from(self.frequency) * u64::from(sample_rate_hz)) >> 32) as u32
    }
}
