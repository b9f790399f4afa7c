//! Library files, as the library reads them.

pub use host_tools::texture::library::{decode_library, read_library};
