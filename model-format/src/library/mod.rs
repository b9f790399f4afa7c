//! Reading of a library: decoding and validation of any bytes, and views into bytes that were found valid.
//!
//! | file | content |
//! |---|---|
//! | `view` | [`Library`] and its textures and scenes |
//! | `texture`, `node` | the parts of a texture |
//! | `part` | the optional parts of a texture, one file per kind |
//! | `decode` | from bytes to [`Library`]: prefix, textures, scenes, in steps |
//! | `check` | all rules that a texture must keep |
//! | `names` | names that were found so far |
//!
//! Views allocate nothing. They parse bytes that validation has already parsed, so that this parsing cannot fail.

mod check;
mod decode;
mod names;
mod node;
pub(crate) mod part;
mod texture;
mod view;

pub use decode::{Decoder, Workspace};
#[cfg(feature = "alloc")]
pub(crate) use node::theta;
pub use node::{Coefficients, Node, NodeFlags, Tail};
#[cfg(feature = "alloc")]
pub use part::PartsSpec;
pub use part::excitation::{Codebook, Excitation};
#[cfg(feature = "alloc")]
pub use part::excitation::{CodebookSpec, ExcitationSpec};
pub use part::levels::{FadeLaw, Laws, LevelLaw};
pub use part::lines::{Line, Lines};
#[cfg(feature = "alloc")]
pub use part::lines::{LineSpec, LinesSpec};
#[cfg(feature = "alloc")]
pub use part::tails::TailSpec;
pub use part::wander::Wander;
pub use part::{BLOCK_BYTES, BLOCK_MAGNITUDES, BLOCK_SAMPLES, PartKind, SHARE_FRACTION_BITS, block_scale, block_share};
pub use texture::{Axis, Texture};
pub use view::{Library, Outline};
