//! Library files, as the library reads them.

pub use host_tools::texture::library_file::{decode_library, read_library};
