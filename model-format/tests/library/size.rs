//! Sizes of libraries, which must suit the flash and the download.

use model_format::limits::MAX_ORDER;
use model_format::{CodeSpec, Library, NodeSpec, TextureSpec, encode};

/// A dense grid of 15 speeds and 8 forces, in which every node has the highest order.
fn dense(name: &str) -> TextureSpec {
    let codes = (0..MAX_ORDER).map(|stage| stage as i16 * 81 - 16_000);
    let node = NodeSpec::new(1.0, CodeSpec::lattice(codes.collect()));
    let speeds: Vec<f32> = (1..=15).map(|step| 20.0 * step as f32).collect();
    let forces: Vec<f32> = (1..=8).map(|step| 0.25 * step as f32).collect();
    TextureSpec::new(name, &speeds, &forces, vec![node; 15 * 8])
}

/// Nodes with 24 fractions of θ and with tails.
#[test]
fn a_dense_texture_with_tails_takes_at_most_56_kibibytes() {
    let mut texture = dense("dense");
    for node in &mut texture.nodes {
        let thetas: Vec<i32> = node.codes.thetas().map(|theta| theta / 3).collect();
        node.codes = CodeSpec::compact_lattice(&thetas, 24);
    }
    let bytes = encode(&[texture]).expect("a valid library");
    assert!(bytes.len() <= 56 * 1024, "{} bytes", bytes.len());
    let library = Library::decode(&bytes).expect("what was encoded");
    let texture = library.textures().next().expect("one was encoded");
    assert_eq!(texture.max_order(), MAX_ORDER);
    assert_eq!(texture.fine_stages(), 24);
}
