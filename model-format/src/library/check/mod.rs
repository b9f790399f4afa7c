//! The checks that a texture of a library must pass, in bounded steps.
//!
//! | file | content |
//! |---|---|
//! | `texture` | the header, in one step |
//! | `node` | the nodes, some per step |
//! | `certificate` | the certificate, whose checksum takes steps |
//! | `fed` | codebooks and level track, in steps |

mod certificate;
mod fed;
mod node;
mod texture;

pub(super) use certificate::{CertificateCheck, Demand};
pub(super) use fed::FedCheck;
pub(super) use node::NodesCheck;
pub(super) use texture::check_header;
