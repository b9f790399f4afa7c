//! The checks that a texture of a library must pass, in bounded steps.
//!
//! | file | content |
//! |---|---|
//! | `texture` | the header, in one step |
//! | `lines` | the amplitudes of lines, some per step |
//! | `node` | the nodes, some per step |
//! | `certificate` | the certificate, whose checksum takes steps |

mod certificate;
mod lines;
mod node;
mod texture;

pub(super) use certificate::{CertificateCheck, Demand};
pub(super) use lines::LinesCheck;
pub(super) use node::NodesCheck;
pub(super) use texture::check_header;
