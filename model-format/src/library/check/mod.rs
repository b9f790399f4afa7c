//! The checks that a texture of a library must pass, in bounded steps.
//!
//! | file | content |
//! |---|---|
//! | `texture` | the header, in one step |
//! | `lines` | the amplitudes of lines, some per step |
//! | `node` | the nodes, some per step |
//! | `fed` | codebooks and level track, in steps |

mod fed;
mod lines;
mod node;
mod texture;

pub(super) use fed::FedCheck;
pub(super) use lines::LinesCheck;
pub(super) use node::NodesCheck;
pub(super) use texture::check_header;
