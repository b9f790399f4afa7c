//! Small libraries, and functions that upload them inside the device.

use model_format::limits::{MAX_LIBRARY_BYTES, SLOT_BYTES};
use model_format::link::{
    CHUNK_ALIGN, LIBRARY_CRC, MAX_CHUNK_BYTES, SlotId, UploadBegin, UploadChunk, UploadCommitted, UploadError,
};
use model_format::{CodeSpec, NodeSpec, TextureSpec, encode};
use stylus_app::flash::WORD_BYTES;
use stylus_app::slots::{HEADER_VERSION, MappedFlash, SlotStore};
use stylus_app::upload::Uploader;

use crate::flash::Memory;

/// Returns a library of `textures` textures of [`texture`], named "texture 0", "texture 1", ..., for 5000 Hz.
pub fn library(textures: usize, order: usize, seed: i16) -> Vec<u8> {
    let textures: Vec<_> = (0..textures)
        .map(|index| texture(&format!("texture {index}"), order, seed, 5_000))
        .collect();
    encode(&textures).expect("the library is valid")
}

/// A texture of 15 x 8 lattice nodes of `order`, whose coefficients depend on `seed`.
pub fn texture(name: &str, order: usize, seed: i16, sample_rate_hz: u32) -> TextureSpec {
    let code = |stage: usize| ((stage as i16).wrapping_mul(31).wrapping_add(seed) % 8_000).max(-8_000);
    let node = NodeSpec::new(2.0, CodeSpec::lattice((0..order).map(code).collect()));
    TextureSpec {
        sample_rate_hz,
        ..TextureSpec::new(
            name,
            &(1..=15).map(|speed| 20.0 * speed as f32).collect::<Vec<_>>(),
            &(1..=8).map(|force| 0.25 * force as f32).collect::<Vec<_>>(),
            vec![node; 15 * 8],
        )
    }
}

/// Returns the length and checksum of `bytes`, with which an upload begins.
pub fn announcement(bytes: &[u8]) -> UploadBegin {
    UploadBegin {
        length: bytes.len() as u32,
        crc32: LIBRARY_CRC.checksum(bytes),
        replaces_last: false,
    }
}

/// Returns the chunks of an upload of `bytes` from byte `from` on. Each has `size` bytes; the last may have fewer.
pub fn chunks(bytes: &[u8], from: usize, size: usize) -> impl Iterator<Item = UploadChunk<'_>> {
    let offsets = (from as u32..).step_by(size);
    bytes[from..]
        .chunks(size)
        .zip(offsets)
        .map(|(data, offset)| UploadChunk { offset, data })
}

/// A library of one texture with one node, a few flash words long.
pub fn small(name: &str) -> Vec<u8> {
    small_of(&[name], 1)
}

/// A library of textures with one node each, whose coefficient depends on `seed`.
pub fn small_of(names: &[&str], seed: i16) -> Vec<u8> {
    let textures: Vec<_> = names.iter().map(|name| small_texture(name, seed, 5_000)).collect();
    encode(&textures).expect("the library is valid")
}

/// A texture with one node, whose coefficient depends on `seed`.
pub fn small_texture(name: &str, seed: i16, sample_rate_hz: u32) -> TextureSpec {
    let whole = texture(name, 1, seed, sample_rate_hz);
    TextureSpec {
        speed_axis_mm_s: vec![100.0],
        force_axis_n: vec![1.0],
        nodes: whole.nodes[..1].to_vec(),
        ..whole
    }
}

/// Writes `bytes` into the erased `slot`, as an upload with the number `sequence` leaves them.
pub fn put(memory: &mut Memory, slot: SlotId, bytes: &[u8], sequence: u32) {
    let mut header = b"HTXS".to_vec();
    header.extend(HEADER_VERSION.to_le_bytes());
    header.extend([0; 2]);
    for field in [sequence, bytes.len() as u32, LIBRARY_CRC.checksum(bytes)] {
        header.extend(field.to_le_bytes());
    }
    header.extend(LIBRARY_CRC.checksum(&header).to_le_bytes());
    header.resize(WORD_BYTES, 0);
    // A commit, too, writes the header last, behind the longest library, and then its copy.
    let start = slot.index() * SLOT_BYTES;
    memory.program(start, bytes);
    memory.program(start + MAX_LIBRARY_BYTES, &header.repeat(2));
}

/// Uploads `bytes` directly into `store`, in chunks of `chunk` bytes.
pub async fn upload<F: MappedFlash>(
    uploader: &mut Uploader,
    store: &mut SlotStore<F>,
    bytes: &[u8],
    chunk: usize,
) -> Result<UploadCommitted, UploadError> {
    assert!(chunk.is_multiple_of(CHUNK_ALIGN) && chunk <= MAX_CHUNK_BYTES);
    let begun = uploader.begin(store, announcement(bytes)).await?;
    for chunk in chunks(bytes, begun.next_offset as usize, chunk) {
        uploader.chunk(store, chunk).await?;
    }
    uploader.commit(store).await
}
