//! Results of the removed-node test: a row per way of predicting, an outcome per removed node and row.

use serde::Serialize;

use crate::texture::domain::Method;

use super::options::Around;
use super::play::Judged;

/// A row of the table: how the removed node was predicted.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Row {
    /// Not at all: the node's own model, as the best that its structure and order can do.
    Own,
    /// In one of the domains.
    Interpolated(Method),
    /// As `fit --densify` fills the place: log-spectra over f/v with surface and tool apart, refitted.
    Densified,
    /// As the device interpolates over the place in a grid that `fit --densify` made, where all beside it was filled in
    /// without its recording. It needs [`Prepared::set_denser`](super::Prepared::set_denser).
    Denser,
}

impl Row {
    /// Rows that are compared with the paper's Table I.
    pub const TABLE_I: [Self; 4] = [
        Self::Interpolated(Method::PAPER),
        Self::Interpolated(Method::DEVICE),
        Self::Densified,
        Self::Own,
    ];

    /// Every row, in the table's order.
    pub fn all() -> Vec<Self> {
        let methods = Method::ALL.map(Self::Interpolated);
        [&methods[..], &[Self::Densified, Self::Own]].concat()
    }

    /// A name for tables.
    pub fn name(self) -> String {
        match self {
            Self::Own => "(not removed: its own model; in-sample)".into(),
            Self::Interpolated(method) => method.name(),
            Self::Densified => "densified: f/v, surface and tool apart".into(),
            Self::Denser => "interpolated in the denser grid, filled without it".into(),
        }
    }

    /// Returns true if its C is shown for every width of the smoothing.
    pub(super) fn is_followed(self) -> bool {
        self == Self::Denser || Self::TABLE_I.contains(&self)
    }
}

impl Serialize for Row {
    fn serialize<S: serde::Serializer>(
        &self,
        serializer: S,
    ) -> std::result::Result<S::Ok, S::Error> {
        serializer.collect_str(&self.name())
    }
}

/// One removed node and what became of it in every row.
#[derive(Clone, Debug, Serialize)]
pub struct Removed {
    /// The recording it is compared with.
    pub file: String,
    /// Its texture.
    pub texture: String,
    /// Tangential speed, mm/s.
    pub speed_mm_s: f64,
    /// Normal force, N.
    pub force_n: f64,
    /// The outcome of each row of [`LeaveOneOut::rows`].
    pub outcomes: Vec<Outcome>,
}

/// The comparison of a prediction with the recording.
#[derive(Clone, Debug, Serialize)]
pub struct Outcome {
    /// The synthesis against the recording.
    #[serde(flatten)]
    pub judged: Judged,
    /// True if the device could play the prediction.
    pub is_playable: bool,
    /// Order of the predicted model.
    pub order: usize,
    /// Variance of the predicted excitation less that fitted to the recording, (m/s²)²; none if not playable.
    pub excitation_error: Option<f64>,
}

/// The outcome of the test.
#[derive(Clone, Debug, Serialize)]
pub struct LeaveOneOut {
    /// The kernel that smooths amplitudes for C.
    pub smoothing: String,
    /// Order of the interpolated models.
    pub order: String,
    /// Neighbours that predict.
    pub around: Around,
    /// True if any recording behind it is simulated.
    pub simulated: bool,
    /// Textures that were simulated after the paper's protocol, for which the paper has figures.
    pub papers_textures: Vec<String>,
    /// Ways of predicting a node.
    pub rows: Vec<Row>,
    /// Widths, Hz, over which [`Judged::costs_by_width`] goes.
    pub smoothing_widths_hz: Vec<f64>,
    /// Every removed node, in the order of the set.
    pub removed: Vec<Removed>,
}

impl LeaveOneOut {
    /// Names of the textures with a removed node, in the order of the set.
    pub fn textures(&self) -> Vec<&str> {
        let mut textures: Vec<&str> = Vec::new();
        for node in &self.removed {
            if !textures.contains(&node.texture.as_str()) {
                textures.push(&node.texture);
            }
        }
        textures
    }
}
