//! A library that several players and threads share.

use std::sync::Arc;

use model_format::{DecodeError, Library, Outline};

/// A validated library with its bytes, which live as long as anything plays from them.
#[derive(Clone, Debug)]
pub struct SharedLibrary(Arc<Bytes>);

#[derive(Debug)]
struct Bytes {
    bytes: Vec<u8>,
    outline: Outline,
}

impl SharedLibrary {
    /// Decodes `bytes`.
    pub fn decode(bytes: Vec<u8>) -> Result<Self, DecodeError> {
        let outline = Library::decode(&bytes)?.outline(&bytes);
        Ok(Self(Arc::new(Bytes { bytes, outline })))
    }

    /// The library.
    pub fn library(&self) -> Library<'_> {
        let found = self.0.outline.library(&self.0.bytes);
        found.expect("the outline is that of these bytes")
    }
}
